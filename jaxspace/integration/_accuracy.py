"""How accurate a run shall be, and by which method it gets there."""

import dataclasses
from typing import Any, Literal, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import (
    AbstractSystem,
    InputError,
    Scalar,
    State,
    as_float,
    as_optional_float,
    check_non_negative,
    check_positive,
    is_concrete,
)
from ..solvers import AbstractFixedStep, Regularised, Splitting
from ._selection import by_rules
from ._stiffness import Starts

FINEST = (
    8  # how many times as many equal steps are taken for a run that missed the tolerance, at most
)


@final
class Accuracy(eqx.Module):
    """What error each step may make, and how.

    - `rtol`: of the length of every block of the state (position, quaternion, ...); `atol`: in the
      block's own unit, by default a thousandth of `rtol` (it matters only for a block that is
      zero).
    - `method`: `"auto"` takes the closed form where the system has one, else ExponentialRosenbrock
      for slow motion beside a fast linear one (told from the numbers of the run, so not under `jit`
      or in a mission), Tsit5 above a tolerance of 1e-5, RKN1210 where the acceleration is free of
      the velocity and nothing else moves, and DOP853 for the rest; or any diffrax solver with an
      error estimate. A method of equal steps takes the steps that it was told, and the tolerance
      judges them: where they prove too few, the run is repeated with up to eight times as many (not
      under `jit` or in a derivative).
    - `adjoint`: diffrax's way of differentiation: reverse mode by default, `diffrax.ForwardMode()`
      for `jvp` and `jacfwd`.
    - `max_steps`: how many steps a run may take. Reverse mode keeps room for the ends of all of
      them: many short runs are differentiated faster with fewer.
    - `max_step`, s: how long a step may be; by default as long as the tolerance allows. The vector
      field is seen at the stages of the steps alone: a pulse that lasts for a small part of a step
      may fall between them, and no estimate tells. Half the length of the shortest pulse is right.
      Not for methods of equal steps; of no use to a closed form, nor for a system that tells the
      times of its jumps (`breaks`).

    The tolerances and `max_step` are traced: changing them compiles nothing anew. Raises
    `InputError` for one of them that is not positive, and for a `max_step` with equal steps."""

    rtol: Float[Array, ""] = eqx.field(converter=as_float, default=1e-9)
    atol: Float[Array, ""] | None = eqx.field(converter=as_optional_float, default=None)
    method: diffrax.AbstractSolver | Literal["auto"] = "auto"
    adjoint: diffrax.AbstractAdjoint = diffrax.RecursiveCheckpointAdjoint()
    max_steps: int = eqx.field(static=True, default=16384)
    max_step: Float[Array, ""] | None = eqx.field(converter=as_optional_float, default=None)

    def __check_init__(self):
        check_positive("Accuracy.rtol", self.rtol)
        if self.atol is not None:
            check_non_negative("Accuracy.atol", self.atol)
        check_positive("Accuracy.max_steps", self.max_steps)
        if self.max_step is not None:
            check_positive("Accuracy.max_step", self.max_step)
            if isinstance(self.method, AbstractFixedStep):
                name = type(self.method).__name__
                raise InputError(
                    f"Accuracy.max_step is given with {name}: number its equal steps by {name}(steps=...)."
                )

    def tightened(self, factor: float, dtype: Any) -> "Accuracy":
        """The same accuracy with tolerances `factor` times smaller, as far as the precision `dtype`
        allows; half the `max_step`, and twice the steps where these are equal ones."""
        rtol = jnp.maximum(self.rtol * factor, 2.0 * least_tolerance(dtype))
        atol = None if self.atol is None else self.atol * factor
        method = (
            self.method.refined(2) if isinstance(self.method, AbstractFixedStep) else self.method
        )
        max_step = None if self.max_step is None else 0.5 * self.max_step
        return Accuracy(rtol, atol, method, self.adjoint, self.max_steps, max_step)

    def with_more_steps(self, error: float) -> "Accuracy":
        """The same accuracy with as many more equal steps as a largest local `error`, in units of
        the tolerance, asks for: from twice to eight times as many."""
        method: Any = self.method
        factor = np.ceil(1.1 * error ** (1.0 / method.order(None)))
        return dataclasses.replace(self, method=method.refined(int(np.clip(factor, 2, FINEST))))


def least_tolerance(dtype: Any) -> float:
    """The smallest tolerance that the precision can resolve: sixteen units in the last place."""
    return 16.0 * float(jnp.finfo(dtype).eps)


def as_accuracy(accuracy: Accuracy | Scalar) -> Accuracy:
    """An `Accuracy` from itself or from a relative tolerance."""
    return accuracy if isinstance(accuracy, Accuracy) else Accuracy(rtol=accuracy)


def state_dtype(y: State) -> Any:
    """The precision of a state. Raises `InputError` if it is no state, or if its blocks differ."""
    dtypes = {leaf.dtype for leaf in jax.tree.leaves(y) if isinstance(leaf, Array | np.ndarray)}
    if len(dtypes) != 1 or not jnp.issubdtype(next(iter(dtypes)), jnp.floating):
        raise InputError(
            f"y0 holds arrays of the types {sorted(map(str, dtypes))}: it must hold one floating-point type."
        )
    return next(iter(dtypes))


def settled(
    accuracy: Accuracy, system: AbstractSystem, y0: State, starts: Starts | None = None
) -> Accuracy:
    """The accuracy with its method chosen for this system, by `with_method`.

    Raises `InputError` for a tolerance that the precision of the state cannot reach, before
    anything is compiled."""
    dtype = state_dtype(y0)
    if is_concrete(accuracy.rtol) and float(np.min(np.asarray(accuracy.rtol))) < least_tolerance(
        dtype
    ):
        raise InputError(
            f"Accuracy.rtol is {float(np.min(np.asarray(accuracy.rtol))):.3g}: for {dtype} states it must be at least "
            f"{least_tolerance(dtype):.2g}; loosen it, or use float64."
        )
    if isinstance(accuracy.method, Splitting) and system.split() is None:
        raise InputError(
            f"{type(system).__name__} offers no drift and kick: take another method than Splitting."
        )
    if isinstance(accuracy.method, Regularised) and system.regularised() is None:
        raise InputError(
            f"{type(system).__name__} offers no regular variables: take another method than Regularised."
        )
    return with_method(accuracy, system, y0, starts)


def with_method(
    accuracy: Accuracy, system: AbstractSystem, y: Any, starts: Starts | None = None
) -> Accuracy:
    """The accuracy with its method chosen for this system and state, or for their shapes, and by
    the numbers of the runs `starts`; `"auto"` stays only where the closed form is meant."""
    if accuracy.method != "auto":
        return accuracy
    rtol = float(np.max(np.asarray(accuracy.rtol))) if is_concrete(accuracy.rtol) else 0.0
    return eqx.tree_at(lambda a: a.method, accuracy, by_rules(system, y, rtol, starts))
