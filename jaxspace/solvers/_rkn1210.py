"""The Runge-Kutta-Nystrom method of order 12 with an embedded error of order 10, for r'' = a(t, r)
and tight tolerances.

Dense output: two shorter steps from the start of a step reach a third and two thirds of it, and

    r(x) = r0 + h (x v0 + q(x))          q = sum_i H_i0 q_i + H_i1 q_i' + H_i2 q_i''
    v(x) = v0 + q'(x)

with Hermite's polynomials of degree 11 that fit position, velocity and acceleration at the four
places.

    symbol  meaning                                                       unit
    h       length of the step                                            s
    x, x_i  fraction of the step; 0, 1/3, 2/3, 1                          1
    q_i     (r_i - r0)/h - x_i v0; q_i' = v_i - v0, q_i'' = h a_i         m/s
    H_ik    polynomial whose k-th derivative at x_i is 1, all others 0    1

Source: Dormand, El-Mikkawy, Prince (1987), High-order embedded Runge-Kutta-Nystrom formulae, IMA
Journal of Numerical Analysis 7, 423. The dense output is not from that paper.
"""

import functools
from typing import ClassVar, NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import State
from ..core.barrier import barrier
from . import tableaus as tableau
from ._nystrom import RKN12, nystrom_step
from .dense_output import AbstractDenseOutput
from .protocol import AbstractFieldSolver, Advance, SolverTraits
from .second_order import Parts, SecondOrder, Vectors, second_order
from .stages import Weights, weighted
from .tolerances import Tolerance
from .vector_field import StepField

NODES = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
OTHERS = np.array([[other for other in NODES if other != node] for node in NODES])
GAPS = np.array(NODES)[:, None] - OTHERS
COEFFICIENTS = 3 * len(NODES) - 2
"""Position, velocity and acceleration at each node, without q and q' of the first, which are
zero."""


def _difference(first: Weights, second: Weights) -> Weights:
    a = dict(first)
    b = dict(second)
    return tuple((i, a.get(i, 0.0) - b.get(i, 0.0)) for i in sorted(a.keys() | b.keys()))


POSITION_ERROR = _difference(tableau.RKN1210_POSITION, tableau.RKN1210_POSITION_10)
VELOCITY_ERROR = _difference(tableau.RKN1210_VELOCITY, tableau.RKN1210_VELOCITY_10)


def _factors() -> Float[np.ndarray, "powers nodes 3"]:
    """For each node the factors 1 + a d + b d^2, d + a d^2 and d^2/2 of its three polynomials, by
    their coefficients of the powers of d = x - x_i.

    The product with lagrange^3, which is 1 at its node and has no derivative up to the second at
    the others, has the value, the slope or the curvature alone: a and b cancel what it has itself
    of these at its node."""
    s1, s2 = np.sum(1.0 / GAPS, axis=1), np.sum(1.0 / GAPS**2, axis=1)
    a, b = -3.0 * s1, 4.5 * s1 * s1 + 1.5 * s2
    zero, one = np.zeros(len(NODES)), np.ones(len(NODES))
    rows = [[one, zero, zero], [a, one, zero], [b, a, 0.5 * one]]
    return np.array(rows).transpose(0, 2, 1)


FACTORS = _factors()


def _hermite(
    x: Float[Array, "*#runs"],
) -> tuple[Float[Array, "nodes 3 *#runs"], Float[Array, "nodes 3 *#runs"]]:
    """H_ik at x, and its derivative.

    Of a sum of two products a processor may round either one by itself: in a kernel for other
    numbers of runs the other one. Here one of both is behind a barrier, so that a run is
    bit-identical with any neighbours."""

    def column(values: np.ndarray) -> np.ndarray:
        return values.reshape(*values.shape, *(1,) * x.ndim).astype(x.dtype)

    one, two, three = (x - column(others) for others in OTHERS.T)
    scale, pair = column(1.0 / np.prod(GAPS, axis=1)), barrier(two * three)
    # Behind a barrier as well, because each polynomial would compute them again.
    lagrange, slope = barrier((scale * one * pair, scale * (one * (two + three) + pair)))
    lagrange, slope = lagrange[:, None], slope[:, None]
    d = (x - column(np.array(NODES)))[:, None]
    constant, linear, square = (column(powers) for powers in FACTORS)
    factor = constant + d * (linear + d * square)
    falling = barrier(3.0 * slope * factor)
    steep = falling + lagrange * (linear + d * (2.0 * square))
    return lagrange * lagrange * lagrange * factor, lagrange * lagrange * steep


class _HermiteOutput(AbstractDenseOutput):
    """States within a step: `q` contains q_i, q_i' and q_i'' in the order of `_hermite`; `travel`
    is the change of the position in the step for a velocity of ones."""

    t0: Float[Array, ""]
    t1: Float[Array, ""]
    y0: State
    q: Float[Array, "coefficients ..."]
    travel: Vectors

    def state(self, t: Float[Array, "*#runs"]) -> State:
        x = self.fraction(t).astype(self.q.dtype)
        # Behind a barrier, because each component would compute the weights of its run again.
        weights, slopes = barrier(_hermite(x))
        q, dq_dx = (self._sum(rows.reshape(-1, *x.shape)) for rows in (weights, slopes))
        parts = Parts.of(self.y0)
        assert parts is not None
        r0, v0 = parts.split(self.y0)
        return parts.state(r0 + self.travel * (x * v0 + q), v0 + dq_dx)

    def _sum(self, weights: Float[Array, "12 *#runs"]) -> Vectors:
        """The sum of the coefficients with these weights; q_0 and q_0' are zero."""
        first, *terms = (w * q for w, q in zip(weights[2:], self.q, strict=True))
        # Rounded by itself, as of any two products one has to be.
        return functools.reduce(jnp.add, terms, barrier(first))


@final
class RKN1210(AbstractFieldSolver, diffrax.AbstractAdaptiveSolver):
    """The Runge-Kutta-Nystrom method of Dormand, El-Mikkawy and Prince, of order 12 with an
    embedded error of order 10.

    For states of a position and a velocity whose acceleration does not depend on the velocity; a
    run in which it does ends at once with the status of a run that is not finite. A step requires
    seventeen evaluations; in a run with save times eighteen, and 36 more if interior states are
    saved. These states are as accurate as the steps.

    **Arguments**

    - `save_ts`: the times at which states are saved, if they are known beforehand. `simulate` sets
      them; without them every step computes the dense output.
    - `rolled`: whether the stages are a loop of the program, which compiles sooner and runs
      slower. Set for derivatives of single runs.
    - `run_axes`: number of trailing axes of the state carry runs; by default all but the first.
      `simulate` sets it.

    **Raises** `InputError` in its first step for a state with further parts.
    """

    save_ts: Float[Array, "times *#runs"] | None = None
    rolled: bool = eqx.field(static=True, default=False)
    run_axes: int | None = eqx.field(static=True, default=None)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _HermiteOutput

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(evaluations=17)

    def bind(
        self,
        *,
        tolerance: Tolerance,
        save_ts: Float[Array, "times *#runs"] | None,
        run_axes: int,
        searched: bool = False,
    ) -> "RKN1210":
        del tolerance
        if searched:
            return RKN1210(None, self.rolled, run_axes)
        return RKN1210(jnp.zeros((0,)) if save_ts is None else save_ts, self.rolled, run_axes)

    def rolled_stages(self) -> "RKN1210":
        return RKN1210(self.save_ts, rolled=True, run_axes=self.run_axes)

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return 12

    def start(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State
    ) -> Bool[Array, "*runs"]:
        system = second_order(f.terms, t0, t1, y0, f.args, "RKN1210")
        return system.velocity_matters(self.run_axes)

    def advance(
        self,
        f: StepField,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        carried: Bool[Array, "*runs"],
    ) -> Advance:
        system = second_order(f.terms, t0, t1, y0, f.args, "RKN1210")
        if self.save_ts is not None and self.save_ts.shape[0] == 0:
            end = self._part(system, t0, t1 - t0, jnp.ones((), system.r.dtype))
            q = jnp.zeros((COEFFICIENTS, *end.r.shape), end.r.dtype)
        else:
            end, q = self._with_dense(system, t0, t1)
        # Where the acceleration depends on the velocity, the method would converge to the motion of
        # another system.
        y1 = system.state(end.r, jnp.where(carried, jnp.nan, end.v))
        h = (t1 - t0).astype(end.r.dtype)
        error = system.state(
            h * system.position_rate(h * end.position_error), h * end.velocity_error
        )
        return Advance(y1, error, dict(y0=y0, q=q, travel=h * system.dt_ds), carried)

    def _part(
        self, system: SecondOrder, t0: Float[Array, ""], h: Float[Array, ""], x: Float[Array, ""]
    ) -> "_Part":
        """The step of this fraction of the length `h`."""
        length = x.astype(h.dtype) * h
        step = nystrom_step(system, RKN12, t0, length, system.r, system.v, self.rolled)
        errors = (weighted(row, step.ks) for row in (POSITION_ERROR, VELOCITY_ERROR))
        return _Part(step.r, step.v, step.mean_velocity, step.ks[0], *errors)

    def _with_dense(
        self, system: SecondOrder, t0: Float[Array, ""], t1: Float[Array, ""]
    ) -> tuple["_Part", Float[Array, "coefficients ..."]]:
        """The step, and the coefficients q_i, q_i' and q_i'' of its dense output in the order of
        `_hermite`; zeros in a step within which no state is saved."""
        h = t1 - t0
        r0, v0 = system.r, system.v
        dt = h.astype(r0.dtype)

        def evaluated(x: Array) -> tuple[_Part, Array]:
            part = self._part(system, t0, h, x)
            a = system.acceleration(t0 + x.astype(h.dtype) * h, part.r)
            return part, jnp.stack([x * (part.mean_velocity - v0), part.v - v0, dt * a])

        def skipped(x: Array) -> tuple[_Part, Array]:
            shapes = jax.eval_shape(evaluated, x)
            return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)

        def place(_: None, node: tuple[Array, Array]) -> tuple[None, tuple[_Part, Array]]:
            x, asked = node
            if self.save_ts is None:
                return None, evaluated(x)
            # A conditional, because the compiler cannot see that nothing reads the dense output.
            return None, jax.lax.cond(asked, evaluated, skipped, x)

        saving = jnp.array(True)
        if self.save_ts is not None:
            saving = jnp.any((self.save_ts >= t0) & (self.save_ts <= t1))
        asked = jnp.stack([saving, saving, jnp.array(True)])
        # A loop, so that the program contains the stages once for all positions, including the end.
        nodes = jnp.asarray(NODES[1:], r0.dtype), asked
        _, (parts, places) = jax.lax.scan(place, None, nodes)
        end = jax.tree.map(lambda x: x[-1], parts)
        q = jnp.concatenate([dt * end.first_rate[None], *places])
        return end, q


class _Part(NamedTuple):
    """A step from the start of another to a place within it, or to its end: position, velocity, the
    mean velocity along it, the acceleration at its start, and the errors for a length of one."""

    r: Vectors
    v: Vectors
    mean_velocity: Vectors
    first_rate: Vectors
    position_error: Vectors
    velocity_error: Vectors
