"""Equal steps in a fictitious time in which the motion is smooth, with landings on given times: for
eccentric orbits and close passes.

    dz/d(sigma) = f(t, z)             z: regularised variables; the last one is the time
    h = sigma(t1 - t, z) / n          step, with n steps left; predicted again now and then

The steps are those of DOP853 (order 8). The predicted fictitious time of a duration, sigma(t1 - t,
z), is exact for the unperturbed motion; with a perturbation a short time remains after the steps.
Three further blocks of a few short steps land, each over the remaining time. Derivatives treat the
steps as constant and the landing as exact: sigma' = (t1' - t') / (dt/d(sigma)).

    symbol  meaning
    sigma   fictitious time
    t1      time to land on

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, for such variables; Hairer,
Norsett, Wanner, Solving Ordinary Differential Equations I, II.5, for the method.
"""

import math
from collections.abc import Callable
from typing import ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import Scalar, State
from . import tableaus as tableau
from .protocol import AbstractFieldSolver, AbstractFixedStep, Advance, SolverTraits, check_steps
from .regularised_step import Regular, derivative_in
from .second_order import estimate_by_coarsening
from .stages import combine
from .vector_field import ScaledField, StepField

STAGES = len(tableau.DOP853_A)
# Blocks of steps that land. The remaining time after each is the effect of the perturbation within
# its few short steps: after three blocks it is rounding.
LANDINGS = 3
# Half the step of order 8 would reduce the error by 2^8. Even where the steps do not yet resolve a
# perturbation, the error is smaller than the difference by this factor.
ERROR_REDUCTION = 2.0**4


@final
class Regularised(AbstractFieldSolver, AbstractFixedStep):
    """Order 8 in regularised variables, with `steps` equal steps of fictitious time in each
    segment.

    For systems that offer such variables, as a scene of `PointGravity` and any accelerations does.
    About 30 steps a revolution are enough for every eccentricity if the perturbations are smooth
    along the orbit; one that acts only close to the centre requires more. Steps land on every save
    time, so that a segment lasts from one to the next.

    **Arguments**

    - `steps`: in each segment, rounded up to whole blocks of steps; at least 4.
    - `estimate`: whether an upper bound of the error of each segment is estimated, by a second
      solution with half as many steps. Without it no status reports too few steps.

    **Raises** `InputError` for fewer than 4 steps.
    """

    steps: int = eqx.field(static=True)
    estimate: bool = eqx.field(static=True)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    def __init__(self, *, steps: int, estimate: bool = True):
        check_steps("Regularised.steps", steps, 4, "at least 4")
        self.steps = math.prod(_blocks(steps))
        self.estimate = estimate

    @property
    def traits(self) -> SolverTraits:
        evaluations = _evaluations(self.steps)
        if self.estimate:
            evaluations += _evaluations(self.steps // 2)
        return SolverTraits(
            lands_on_save_times=True,
            fixed_step=True,
            needs="regularised",
            evaluations=evaluations,
            steps=self.steps,
        )

    def refined(self, factor: int) -> "Regularised":
        return Regularised(steps=factor * self.steps, estimate=self.estimate)

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return 8

    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: None
    ) -> Advance:
        del carried
        field: ScaledField = f.args
        form = field.regularised()
        z0 = form.to_regularised(y0)
        t = field.time(t0)
        duration = field.duration(t0, t1 - t0).astype(z0.dtype)

        def integrate(steps: int) -> State:
            return form.from_regularised(_integrate(form, t, duration, z0, steps))

        y1, error = estimate_by_coarsening(
            integrate, self.steps, self.steps // 2, ERROR_REDUCTION, self.estimate
        )
        return Advance(y1, error, dict(y0=y0, y1=y1))


def _blocks(steps: int) -> tuple[int, int]:
    """Number of blocks, and number of steps in each.

    The latter is a power of two, about a quarter of the square root of all steps: so large that
    reverse mode stores few states, and so small that a landing costs little."""
    length = 2 ** max(1, (steps.bit_length() - 1) // 2 - 2)
    return -(-steps // length), length


def _schedule(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """For each block the number of remaining blocks, including itself, and whether the step is
    predicted.

    The blocks that land have the numbers 0, -1, -2."""
    blocks, _ = _blocks(steps)
    blocks_left = np.arange(blocks, -LANDINGS, -1)
    return blocks_left, np.isin(blocks_left, np.append(4 ** np.arange(16), blocks)) | (
        blocks_left <= 0
    )


def _evaluations(steps: int) -> int:
    _, length = _blocks(steps)
    blocks_left, due = _schedule(steps)
    # Twelve in each step, and one in each prediction.
    return STAGES * length * blocks_left.size + int(np.sum(due))


def _integrate(form: PyTree, t: Scalar, duration: Scalar, z0: Regular, steps: int) -> Regular:
    """The regularised variables a `duration` after the time `t`.

    In blocks of steps: reverse mode stores the variables at the start of each block and repeats its
    steps. The step is predicted before the blocks with 1, 4, 16, ... remaining ones, and before
    each of those that land."""

    def derivative(z: Regular) -> Regular:
        return derivative_in(form, t, duration, z)

    def predicted_step(z: Regular, blocks_left: Int[Array, ""]) -> Float[Array, "*runs"]:
        left = duration - z[-1]
        # The prediction has only the derivatives of a Newton step in time, by which the landing is
        # exact in the derivatives. Only the blocks that land have them; in others they would
        # cancel.
        newton = jnp.where(blocks_left <= 0, left / derivative(z)[-1], 0.0)
        sigma = jax.lax.stop_gradient(form.fictitious_time(left, z) - newton) + newton
        return sigma / (length * jnp.maximum(blocks_left, 1)).astype(z.dtype)

    def block(
        carry: tuple[Regular, Array], now: tuple[Int[Array, ""], Bool[Array, ""]]
    ) -> tuple[tuple[Regular, Array], None]:
        z, h = carry
        blocks_left, due = now
        h = jax.lax.cond(due, lambda: predicted_step(z, blocks_left), lambda: h)

        def step(z: Regular, _: None) -> tuple[Regular, None]:
            return _step(derivative, z, h), None

        z, _ = jax.lax.scan(jax.checkpoint(step), z, length=length)
        return (z, h), None

    _, length = _blocks(steps)
    blocks_left, due = _schedule(steps)
    start = (z0, jnp.zeros(z0.shape[1:], z0.dtype))
    given = (jnp.asarray(blocks_left), jnp.asarray(due))
    (z, _), _ = jax.lax.scan(jax.checkpoint(block), start, given)
    return z


def _step(f: Callable[[Regular], Regular], z: Regular, h: Float[Array, "*runs"]) -> Regular:
    """One step of DOP853 of dz/d(sigma) = f(z)."""
    ks = []
    for row in tableau.DOP853_A:
        ks.append(f(combine(z, h, row, ks) if row else z))
    return combine(z, h, tableau.DOP853_B, ks)
