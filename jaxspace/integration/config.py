"""Configuration of one integration, resolved once: method, tolerances, limits.

`resolve` is the only place that decides. It rejects invalid settings before anything is compiled;
later code relies on the validated configuration.
"""

import dataclasses
from collections.abc import Callable
from typing import final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, DTypeLike, Float, PyTree

from ..core import AbstractDecoupled, AbstractSystem, InputError, Scalar, check
from ..core.checks import is_concrete
from ..solvers.protocol import carries_steps, refine, rolled_stages, solver_traits
from ._selection import has_closed_form, select_method
from .accuracy import DEFAULT_RTOL, Accuracy, as_method, least_tolerance
from .initial_state import state_dtype
from .stiffness import InitialConditions

# A fixed-step run that missed the tolerance is repeated with at most this many times the steps.
MAX_REFINEMENT = 8


@final
class IntegrationConfig(eqx.Module):
    """A resolved `Accuracy`: every default is filled in, and the method is the one that runs.

    - `rtol`, `atol`: tolerances in the precision of the state; in a batch each run may have
      individual ones.
    - `method`: a solver, or "closed_form".
    - `max_steps`, `max_step`, `derivative_control`: as in `Accuracy`.
    - `decoupled`: whether the exact part of the motion (`AbstractSystem.decoupled`) is computed
      separately, and the `method` integrates the rest."""

    rtol: Float[Array | np.ndarray, "*runs"]
    atol: Float[Array | np.ndarray, "*runs"]
    method: diffrax.AbstractSolver | str = eqx.field(converter=as_method)
    max_steps: int = eqx.field(static=True)
    max_step: Float[Array | np.ndarray, ""] | None
    decoupled: bool = eqx.field(static=True, default=False)
    derivative_control: bool = eqx.field(static=True, default=True)

    def __repr__(self) -> str:
        # With their numbers: Equinox shows arrays by their shapes.
        return eqx.tree_pformat(self, short_arrays=False)

    @property
    def solver(self) -> diffrax.AbstractSolver:
        """The method of a run that is integrated."""
        assert not isinstance(self.method, str), "a closed form needs no steps"
        return self.method

    @property
    def fixed_step(self) -> bool:
        """Whether the method uses a given number of steps, independent of the tolerance."""
        return not isinstance(self.method, str) and solver_traits(self.method).fixed_step

    def split(self) -> tuple["IntegrationConfig", "IntegrationConfig"]:
        """The tolerances that differ between runs, and the rest: `eqx.combine` joins them."""
        none = jax.tree.map(lambda _: False, self)
        own = [np.ndim(x) > 0 for x in (self.rtol, self.atol)]
        return eqx.partition(self, eqx.tree_at(lambda c: (c.rtol, c.atol), none, own))

    def of_runs(self, rows: np.ndarray) -> "IntegrationConfig":
        """The configuration of these runs of a batch."""
        own, rest = self.split()
        return eqx.combine(jax.tree.map(lambda x: x[..., rows], own), rest)

    def rolled_stages(self) -> "IntegrationConfig":
        """The same with a program that compiles faster and runs slower, if the method has one."""
        method = self.method if isinstance(self.method, str) else rolled_stages(self.method)
        return dataclasses.replace(self, method=method)

    def tightened(self, factor: float) -> "IntegrationConfig":
        """The same with tolerances `factor` times as large, as far as the precision allows.

        Half the `max_step`, and twice the steps of a fixed-step method."""
        dtype = self.rtol.dtype
        # Twice the least: at the limit itself, rounding would reject steps.
        rtol = jnp.maximum(self.rtol * factor, 2.0 * least_tolerance(dtype))
        atol = _in_precision(self.atol * factor, dtype)
        max_step = None if self.max_step is None else _in_precision(0.5 * self.max_step, dtype)
        method = self.method if isinstance(self.method, str) else refine(self.method, 2)
        return dataclasses.replace(self, rtol=rtol, atol=atol, method=method, max_step=max_step)

    def with_more_steps(self, error: float) -> "IntegrationConfig":
        """The same with more fixed steps: as many as the largest local `error` requires.

        `error` is in units of the tolerance. From twice to `MAX_REFINEMENT` times the steps."""
        assert not isinstance(self.method, str)
        order = self.method.order(None)  # pyright: ignore[reportArgumentType]
        assert order is not None
        # A tenth more, because the error follows the order of the method only roughly.
        factor = int(np.clip(np.ceil(1.1 * error ** (1.0 / order)), 2, MAX_REFINEMENT))
        return eqx.tree_at(lambda c: c.method, self, refine(self.method, factor))


def resolve(
    system: AbstractSystem,
    y0: PyTree,
    accuracy: Accuracy,
    starts: Callable[[], InitialConditions | None] | None = None,
) -> IntegrationConfig:
    """The configuration of an integration.

    **Arguments**

    - `system`, `y0`: the system and its initial state (or its shapes), of one run or of many.
    - `accuracy`: that of the user.
    - `starts`: returns the runs whose numbers show whether the system is stiff; called only if
      the rules get that far. `None` in missions, where only the structure is decisive.

    **Raises** `InputError` for a tolerance that the precision of the state cannot reach, and for a
    method that requires a capability that the system does not offer."""
    dtype = state_dtype(y0)
    rtol = DEFAULT_RTOL.get(dtype.name, 1e-2) if accuracy.rtol is None else accuracy.rtol
    # Zero represents a traced tolerance, for which the structural rules decide.
    known_rtol = 0.0
    if is_concrete(rtol):
        known = np.asarray(rtol)
        known_rtol = float(known.max())
        if accuracy.chosen_at is not None:
            known_rtol = min(known_rtol, accuracy.chosen_at)
        check_tolerance(float(known.min()), dtype)
    check_countable(accuracy.max_steps)
    method = accuracy.method
    exactly = method == "closed_form" or (method == "auto" and has_closed_form(system))
    decoupled = system.decoupled() if accuracy.decoupled and not exactly else None
    if decoupled is not None:
        starts = _starts_of_rest(decoupled, starts)
        system = decoupled.rest
        y0 = decoupled.rest_of(y0)
    if method == "auto":
        # The rules have checked the needs of the method already.
        method = select_method(system, y0, known_rtol, starts=starts)
    else:
        _check_needs(system, method)
        _check_one_step(system, y0, method)
    atol = 1e-3 * rtol if accuracy.atol is None else accuracy.atol
    return IntegrationConfig(
        _in_precision(rtol, dtype),
        _in_precision(atol, dtype),
        method,
        accuracy.max_steps,
        None if accuracy.max_step is None else _in_precision(accuracy.max_step, dtype),
        decoupled=decoupled is not None,
        derivative_control=accuracy.derivative_control,
    )


def _starts_of_rest(
    decoupled: AbstractDecoupled, starts: Callable[[], InitialConditions | None] | None
) -> Callable[[], InitialConditions | None] | None:
    """The runs whose numbers are known, without the exact part of their motion."""
    if starts is None:
        return None
    rest = decoupled.rest

    def of_rest() -> InitialConditions | None:
        whole = starts()
        if whole is None:
            return None
        system, y, ts = whole.runs
        axes, y_axes, ts_axes = whole.run_axes
        pairs = zip(jax.tree.leaves(system), jax.tree.leaves(axes), strict=True)
        known = {id(x): n for x, n in pairs}
        if not all(id(x) in known for x in jax.tree.leaves(rest)):
            # An array of the rest that the whole system does not have: it may or may not carry
            # runs.
            return None
        axes = jax.tree.map(lambda x: known[id(x)], rest)
        runs = (rest, decoupled.rest_of(y), ts)
        return whole._replace(runs=runs, run_axes=(axes, decoupled.rest_of(y_axes), ts_axes))

    return of_rest


def _check_one_step(
    system: AbstractSystem, y0: PyTree, method: diffrax.AbstractSolver | str
) -> None:
    """Raise `InputError` for a method whose steps depend on those before: derivatives repeat each
    step from the state before it, which must be all that it starts from."""
    if not isinstance(method, str) and carries_steps(method, system.vector_field, y0):
        raise InputError(
            f"Accuracy.method is {type(method).__name__}, whose steps depend on the steps before "
            "them: it must be a method of jaxspace, a Runge-Kutta method of diffrax or a solver "
            "whose `init` returns None. diffrax.diffeqsolve integrates system.vector_field by any "
            "other."
        )


def _in_precision(x: Scalar | np.ndarray, dtype: DTypeLike) -> Float[Array | np.ndarray, "*runs"]:
    """The number in this precision."""
    # A conversion by JAX takes a tenth of the time of a short run, one by NumPy almost none.
    return np.asarray(x, dtype) if is_concrete(x) else jnp.asarray(x, dtype)


def check_tolerance(rtol: float, dtype: DTypeLike) -> None:
    """Raise `InputError` for a relative tolerance that the precision `dtype` cannot reach."""
    least = least_tolerance(dtype)
    if rtol < least:
        raise InputError(
            f"Accuracy.rtol is {rtol:.3g}: for {jnp.dtype(dtype).name} states it must be at least "
            f"{least:.2g}; loosen it, or compute in float64 (jaxspace.enable_x64)."
        )


def check_countable(max_steps: int) -> None:
    """Raise `InputError` for more steps than JAX's whole numbers count."""
    # So many count whatever the setting.
    if max_steps <= 2**31 - 1:
        return
    most = jnp.iinfo(jnp.result_type(int)).max
    allowed = f"at most {most}, the limit of JAX"
    if not jax.config.read("jax_enable_x64"):
        allowed += " without jaxspace.enable_x64()"
    check(max_steps <= most, "Accuracy.max_steps", max_steps, allowed)


CAPABILITIES = {
    "closed_form": "closed form",
    "split": "split into drift and kick",
    "regularised": "regularised variables",
}


def _check_needs(system: AbstractSystem, method: diffrax.AbstractSolver | str) -> None:
    """Raise `InputError`, with the reason, if the system does not offer the capability that the
    method requires."""
    needs = method if isinstance(method, str) else solver_traits(method).needs
    # The capability has the name of the system's method that provides it.
    if not needs or getattr(system, needs)() is not None:
        return
    name = method if isinstance(method, str) else type(method).__name__
    reason = system.missing(needs)
    raise InputError(
        f"{type(system).__name__} offers no {CAPABILITIES[needs]}{': ' if reason else ''}{reason}. "
        f"Use a method other than {name}."
    )
