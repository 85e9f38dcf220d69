"""Any function as an effect."""

import dataclasses
import inspect
from collections.abc import Callable, Iterable
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import InputError, Scalar, quantity
from ..core.jit import quick_jit
from ..core.shapes import check_components
from ..core.user_functions import user_function
from ..core.vectors import dot, norm

# Quantities that an effect may conserve.
KEPT = ("energy", "angular_momentum", "axial_angular_momentum", "rotational_momentum")
VECTORS = ("acceleration_N", "force_N", "torque_B", "momentum_B")


def _as_conserved(x: object) -> frozenset[str]:
    """The names of the quantities that an effect conserves. Raises `InputError` for anything else
    than names."""
    names = x if isinstance(x, Iterable) and not isinstance(x, str) else None
    if names is None or not all(isinstance(name, str) for name in names):
        raise InputError(f"Custom.keeps is {x!r}: it must be a set of names, such as {{'energy'}}.")
    return frozenset(names)


def _check_arguments(function: object) -> None:
    """Raise `InputError` for a function that cannot be called with (t, y, body)."""
    # Of other callables nothing is asked but to be called.
    if not inspect.isfunction(function):
        return
    signature = inspect.signature(function)
    try:
        signature.bind(None, None, None)
    except TypeError:
        raise InputError(
            f"Custom.function has the arguments {signature}: it must accept (t, y, body), the time "
            "in s, the BodyState and the body, and return a Load, such as "
            "lambda t, y, body: Load(force_N=-k * y.position)."
        ) from None


def _kind(x: object) -> str:
    if isinstance(x, jax.Array | np.ndarray):
        return f"an array of the shape {x.shape}"
    return "nothing" if x is None else f"an object of type {type(x).__name__}"


def _check_vector(name: str, value: object) -> None:
    """Raise `InputError` unless the value is a vector, or absent. A number would push along all
    three axes."""
    if value is None:
        return
    if not isinstance(value, jax.Array | np.ndarray):
        kind = type(value).__name__
        raise InputError(f"{name} is of type {kind}: it must be an array (3, *runs), or None.")
    if value.ndim == 0:
        raise InputError(f"{name} has no axis: it must be an array (3, *runs), or None.")
    check_components(name, value, 3)


@final
class Custom(AbstractEffect):
    """An effect from a function `load(t, y, body) -> Load`: components first, runs last.

    - `function`: best an `equinox.Module` with a `__call__`, whose parameters are then part of the
      scene. In a batch the last axis of its arrays is the batch axis, of length one when all runs
      share them.
    - `keeps`: as in `AbstractEffect`.
    - `energy`: a function (t, y, body) -> potential energy per unit mass, J/kg, if the effect
      conserves the energy. Before a run it is compared with the work of the load at the start.
    - `break_times`: at which the load or a derivative of it jumps, s; steps end there.

    Raises `InputError` for an unknown conserved quantity, or an effect that conserves the energy
    without a potential; a scene raises it for a function that does not return a load."""

    function: Callable[[Scalar, BodyState, AbstractBody], Load]
    # Of the instance and not of the class, because each function has a different one.
    keeps: frozenset[str] = eqx.field(  # pyright: ignore
        static=True, converter=_as_conserved, default=frozenset()
    )
    energy: Callable[..., Scalar] | None = None
    break_times: Float[Array, "times *#runs"] | None = quantity(
        "s", optional=True, doc="times at which the load or its derivative jumps"
    )

    def __check_init__(self):
        _check_arguments(self.function)
        unknown = sorted(self.keeps - set(KEPT))
        # Checked, because a misspelt word would otherwise be ignored.
        if unknown:
            raise InputError(f"Custom.keeps names {unknown}: it may name {', '.join(KEPT)}.")
        if "energy" in self.keeps and self.energy is None:
            raise InputError(
                "Custom.keeps names the energy, and Custom.energy is None: "
                "give the potential energy per unit mass."
            )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        with user_function("Custom.function"):
            load = self.function(t, y, body)
        if not isinstance(load, Load):
            raise InputError(
                f"Custom.function returns {_kind(load)}: it must return a Load, such as "
                "Load(force_N=...), Load(acceleration_N=...) or Load(torque_B=...)."
            )
        for field in VECTORS:
            _check_vector(f"Custom.function: Load.{field}", getattr(load, field))
        return load

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar | None:
        with user_function("Custom.energy"):
            return None if self.energy is None else self.energy(t, y, body)

    def check_values(self, t: Scalar, y: BodyState, body: AbstractBody) -> None:
        """Raise `InputError` where the load does not do the work that the energy gives.

        The power at the state `y`, and at the same place with other rates, is -d(energy)/dt: to a
        thousandth in single precision, and to 1e-6 in double."""
        if "energy" not in self.keeps:
            return
        power, change, size = (np.asarray(x) for x in _power(self, jnp.asarray(t), y, body))
        known = np.isfinite(power + change)
        # Of each number below: a root of the rounding would be 1e-8, as for tables.
        allowed = 1e-6 if power.dtype == np.float64 else 1e-3
        wrong = known & (np.abs(power + change) > allowed * size)
        if np.any(wrong):
            at = np.unravel_index(np.argmax(wrong), wrong.shape)
            raise InputError(
                f"Custom.energy does not belong to Custom.function: at the start the load does the "
                f"work {power[at]:.6g} W/kg, and the energy falls by {-change[at]:.6g} W/kg. It "
                f"must be the potential energy per unit mass, or keeps must not name the energy."
            )

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.break_times


@quick_jit
def _power(
    effect: Custom, t: Scalar, y: BodyState, body: AbstractBody
) -> tuple[Array, Array, Array]:
    """Power of the load, rate of the energy and the size of their terms, W/kg, at the rates of `y`
    and at others, on a leading axis."""
    # One rate at a time, because the power of an orbit would hide that of a rotation.
    states = [
        dataclasses.replace(each, **{other: None if x is None else jnp.zeros_like(x)})
        for each in (y, _with_other_rates(y))
        for other, x in (("omega", each.omega), ("velocity", each.velocity))
    ]
    rows = [_power_at(effect, t, each, body) for each in states]
    power, rate, size = (jnp.stack(jnp.broadcast_arrays(*x)) for x in zip(*rows, strict=True))
    return power, rate, size


def _with_other_rates(y: BodyState) -> BodyState:
    """The same position, with rates in a generic direction, of the same size or of unit size."""

    def other(v: Array | None) -> Array | None:
        if v is None:
            return None
        size = norm(v)
        size = jnp.where(size > 0.0, size, 1.0)
        direction = jnp.array([0.48, -0.6, 0.64], v.dtype).reshape(3, *(1,) * (v.ndim - 1))
        return size * direction

    return dataclasses.replace(y, velocity=other(y.velocity), omega=other(y.omega))


def _power_at(
    effect: Custom, t: Scalar, y: BodyState, body: AbstractBody
) -> tuple[Scalar, Scalar, Scalar]:
    load = effect.load(t, y, body)
    mass = body.constant_mass() if y.mass is None else y.mass
    pairs = [(load.acceleration_N, y.velocity, None), (load.force_N, y.velocity, mass)]
    pairs += [(load.torque_B, y.omega, mass)]
    power = size = jnp.zeros(())
    for push, rate, per in pairs:
        if push is not None and rate is not None and (per is not None or push is pairs[0][0]):
            per = 1.0 if per is None else per
            power = power + dot(push, rate) / per
            size = size + norm(push) * norm(rate) / per
    turning = None
    if y.attitude is not None and y.omega is not None:
        turning = y.attitude.rate(y.omega)

    def energy(t: Scalar, r: Array | None, q: PyTree) -> Scalar:
        moved = dataclasses.replace(y, position=r, attitude=q)
        return jnp.asarray(effect.potential(t, moved, body))

    still = jax.tree.map(jnp.zeros_like, (y.position, y.attitude))
    rates = (still[0] if y.velocity is None else y.velocity, turning or still[1])
    at = jnp.asarray(t, power.dtype)
    _, change = jax.jvp(energy, (at, y.position, y.attitude), (jnp.ones_like(at), *rates))
    return power, change, size + jnp.abs(change)
