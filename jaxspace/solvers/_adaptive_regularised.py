"""Adaptive steps in a fictitious time in which the motion is smooth: for eccentric orbits and close
passes, perturbed or not.

    dz/d(sigma) = f(t, z)                     z: regularised variables; the last one is the time
    q'' = f(q, c), t = T(q, q') + int g(q)     where the perturbation has a potential

Every run has individual steps, in its own fictitious time. With a potential the method is RKN
12(10), otherwise, as under drag, DOP853 with a larger estimate of the error (`cautious`). A step
that would pass the next save time is replaced by one whose length follows from the unperturbed
motion. This is repeated until two terms of a series cover the remaining time
(`regularised_step.py`).

    symbol  meaning
    sigma   fictitious time

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, for such variables; Dormand,
El-Mikkawy, Prince (1987), for the method of order 12.
"""

from typing import ClassVar, final

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import State
from .protocol import AbstractFieldSolver, Advance, SolverTraits
from .regularised_step import Regular, landed, regularised_start, trial_step
from .vector_field import ScaledField, StepField

# Number of steps that land on a time within a step: the error of each is the effect of the
# perturbation in it.
LANDINGS = 4


@final
class AdaptiveRegularised(AbstractFieldSolver):
    """Adaptive steps in regularised variables, of order 12 where the perturbation has a potential
    and of order 8 elsewhere; each run of a batch has individual steps.

    For systems that offer such variables, as a scene of `PointGravity` and any accelerations does.
    A step ends at every save time, which costs one or two more steps for each. The absolute
    tolerance is not used: errors are relative to the size of the orbit."""

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(
            lands_on_save_times=True, needs="regularised", evaluations=17, individual_steps=True
        )

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return 8

    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: None
    ) -> Advance:
        """One step, with the steps to land: for times within a step of the same run."""
        del carried
        field: ScaledField = f.args
        form, z = regularised_start(field, y0)
        t = field.time(t0)
        duration = field.duration(t0, t1 - t0).astype(z.dtype)

        def closer(_: Array, z: Regular) -> Regular:
            h = jax.lax.stop_gradient(form.fictitious_time(duration - z[-1], z))
            return trial_step(form, t, duration, z, h).z

        z = jax.lax.fori_loop(0, LANDINGS, closer, z)
        y1 = form.from_regularised(landed(form, t, duration, z))
        return Advance(y1, jax.tree.map(jnp.zeros_like, y1), dict(y0=y0, y1=y1))
