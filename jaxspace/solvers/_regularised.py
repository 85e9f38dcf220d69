"""Equal steps in a fictitious time in which the motion is smooth, landing on given times: for
eccentric orbits and close passes.

    dz/d(sigma) = f(t, z)             z: regular variables of the state, with the time as the last one
    h = span(t1 - t, z) / steps left  step; predicted anew now and then, more often towards the end

The steps are those of DOP853 (order 8). What the system calls `span` is exact for the unperturbed
motion: a perturbation leaves little over when the steps are done. Three further blocks of a few
short steps land, each on what the last one has left over. Derivatives take the steps as they are,
and the landing to be exact: sigma' = (t1' - t') / (dt/d(sigma)).

    symbol  meaning
    sigma   fictitious time
    t1      time to land on

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, for such variables; Hairer,
Norsett, Wanner, Solving Ordinary Differential Equations I, II.5, for the method.
"""

import math
from collections.abc import Callable
from typing import Any, ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractRegularised, InputError, State, barrier
from . import _tableaus as tableau
from ._protocol import AbstractFixedStep, SolverTraits
from ._runge_kutta import combine
from ._second_order import estimate_by_coarsening

LANDINGS = 3
ERROR_REDUCTION = (
    2.0**4
    # at least this much smaller are errors of half the step, also where a perturbation is not yet
    # resolved
)


@eqx.filter_jit
def _derivative(form: AbstractRegularised, t: Array, duration: Array, z: Array) -> Array:
    """dz/d(sigma) in a segment that starts at the time `t` and takes a `duration`."""
    z = barrier(z)
    # The steps overshoot the end of the segment before they land on it. Beyond the end the
    # perturbation is that of the end, just inside: the vector field may jump there.
    inside = duration * (1.0 - 4.0 * jnp.finfo(z.dtype).eps)
    since = jnp.clip(z[-1], jnp.minimum(inside, 0.0), jnp.maximum(inside, 0.0))
    return barrier(form.derivative(z, barrier(form.perturbation(t + since, z))))


@final
class Regularised(AbstractFixedStep):
    """Order 8 in regular variables with `steps` equal steps of fictitious time from one time to
    land on to the next.

    For systems that offer such variables (`AbstractRegularisedSystem`), as a scene of
    `PointGravity` and any accelerations. Some 30 steps a revolution serve every eccentricity where
    the perturbations are smooth along the orbit; one that is felt only close to the centre wants
    more. Every state asked for is landed on. The error is estimated for the stretch as a whole,
    with care, from the same with half as many steps, which costs half as much again;
    `estimate=False` leaves it out, and then no status tells of too few steps.

    The number of steps is rounded up to whole blocks of some steps. Raises `InputError` if it is
    less than 4."""

    steps: int = eqx.field(static=True)
    estimate: bool = eqx.field(static=True)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    def __init__(self, *, steps: int, estimate: bool = True):
        if steps < 4:
            raise InputError(f"Regularised.steps is {steps}: it must be at least 4.")
        self.steps, self.estimate = math.prod(_blocks(steps)), estimate

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(
            replayable=True,
            lands_on_save_times=True,
            fixed_step=True,
            needs="regularised",
            evaluations=self._evaluations,
            steps=self.steps,
        )

    @property
    def _evaluations(self) -> int:
        counts = [
            _blocks(steps)
            for steps in ((self.steps, self.steps // 2) if self.estimate else (self.steps,))
        ]
        return 12 * sum((blocks + LANDINGS) * length for blocks, length in counts)

    def refined(self, factor: int) -> "Regularised":
        return Regularised(steps=factor * self.steps, estimate=self.estimate)

    def order(self, terms: Any) -> int:
        return 8

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any) -> None:
        return None

    def func(self, terms: Any, t0: Any, y0: Any, args: Any) -> Any:
        return terms.vf(t0, y0, args)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: None, made_jump: Any
    ):
        del terms, solver_state, made_jump
        form = args.regularised()
        z0 = form.to_regularised(y0)
        t, duration = args.time(t0), args.duration(t0, t1 - t0)

        def integrate(steps: int) -> State:
            return form.from_regularised(_integrate(form, t, duration, z0, steps))

        y1, error = estimate_by_coarsening(
            integrate, self.steps, self.steps // 2, ERROR_REDUCTION, self.estimate
        )
        return y1, error, dict(y0=y0, y1=y1), None, diffrax.RESULTS.successful


def _blocks(steps: int) -> tuple[int, int]:
    """How many blocks there are, and how many steps each has: a power of two, about a quarter of
    the root of all steps."""
    length = 2 ** max(1, (steps.bit_length() - 1) // 2 - 2)
    return -(-steps // length), length


def _integrate(
    form: AbstractRegularised, t: Array, duration: Array, z0: Array, steps: int
) -> Array:
    """The regularised variables a `duration` after the time `t`.

    In blocks of steps, so that reverse mode keeps the variables at the start of each and takes its
    steps once more. The steps' length is predicted anew before a block with which 1, 4, 16, ... are
    left to do, and before each of those that land."""

    def derivative(z: Array) -> Array:
        return _derivative(form, t, duration, z)

    blocks, length = _blocks(steps)
    numbers = np.arange(blocks, -LANDINGS, -1)
    due = np.isin(numbers, [blocks, *4 ** np.arange(16)]) | (numbers <= 0)

    def predicted(z: Array, number: Array) -> Array:
        left = duration - z[-1]
        newton = jnp.where(number <= 0, left / derivative(z)[-1], 0.0)
        aim = jax.lax.stop_gradient(form.fictitious_time(left, z) - newton) + newton
        return aim / (length * jnp.maximum(number, 1)).astype(z.dtype)

    def block(
        carry: tuple[Array, Array], now: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array], None]:
        z, h = carry
        h = jax.lax.cond(now[1], lambda: predicted(z, now[0]), lambda: h)
        z = jax.lax.scan(
            jax.checkpoint(lambda z, _: (_step(derivative, z, h), None)), z, length=length
        )[0]
        return (z, h), None

    start = (z0, jnp.zeros(z0.shape[1:], z0.dtype))
    return jax.lax.scan(jax.checkpoint(block), start, (jnp.asarray(numbers), jnp.asarray(due)))[0][
        0
    ]


def _step(f: Callable[[Array], Array], z: Array, h: Array) -> Array:
    """One step of DOP853 along an autonomous slope."""
    ks = []
    for row in tableau.DOP853_A:
        ks.append(f(combine(z, h, row, ks) if row else z))
    return combine(z, h, tableau.DOP853_B, ks)
