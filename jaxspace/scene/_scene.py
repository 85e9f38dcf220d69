"""A scene: a body and the effects that act on it, as one system.

    v' = sum a + sum F / m,    J omega' = sum M - omega x (J omega + h),    m' = sum m'_effects

J and h include the contribution of moving parts to the inertia, and their angular momentum.

The state contains the parts that the effects read or change (`Scene.parts`), and those named in
`carry`. Every other part is `None` and therefore not a leaf of the state, of a batch or of a
gradient.

Source: Thomson 5.6, 7.1, 7.7 for the sums; `jaxspace.bodies` for the equations of one body.
"""

import functools
import operator
from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load, RigidBody
from ..bodies.effects import with_parts
from ..bodies.newton_euler import angular_acceleration, linear_acceleration
from ..bodies.state import PARTS
from ..core import (
    AbstractClosedForm,
    AbstractDecoupled,
    AbstractRegularised,
    AbstractSplit,
    Flag,
    InputError,
    RunWarning,
    Scalar,
    State,
    Vector,
)
from ..core.limits import Limit, any_passed
from ..core.listed import Listed
from ..core.structure import reads_a_leaf
from ._capabilities import body_motion, scene_decoupled, scene_regularised, scene_split
from ._conserved import conserved
from ._explain import explain
from ._interface import AbstractScene
from .ground_check import ground_warning, lowest_below_ground
from .reading import ROTATION, TRANSLATION, Reading, read_effects


def _as_effects(x: PyTree) -> tuple[AbstractEffect, ...]:
    if isinstance(x, AbstractEffect):
        raise InputError(f"Scene.effects is a {type(x).__name__}: it must be a list of effects.")
    effects = tuple(x)
    for effect in effects:
        if not isinstance(effect, AbstractEffect):
            kind = type(effect).__name__
            raise InputError(
                f"Scene.effects contains an object of type {kind}: it must contain effects."
            )
    return effects


@final
class Scene(AbstractScene):
    """A body under effects, as a system.

    `Scene([PointGravity(mu), Oblateness(mu, j2, radius)])` is the motion of a point: position and
    velocity.

    - `effects`: in any order.
    - `body`: mass properties; may be absent where no effect needs a mass or an inertia.
    - `carry`: parts of the state to integrate although no effect requires them: with
      `("attitude",)` a body rotates freely.

    Raises `InputError` when an effect requires a property that the body does not have; the message
    names both."""

    effects: tuple[AbstractEffect, ...] = eqx.field(converter=_as_effects)
    body: AbstractBody = RigidBody()
    carry: tuple[str, ...] = eqx.field(static=True, converter=tuple, default=())

    def __check_init__(self):
        unknown = set(self.carry) - set(PARTS)
        if unknown:
            raise InputError(
                f"Scene.carry names {sorted(unknown)}: it may name {', '.join(PARTS)}."
            )
        readings, parts = read_effects(self.effects, self.body, self.carry)
        losing = any("mass_rate" in reading.adds for reading in readings)
        # A mass that is a part of the state, because effects or the body change or carry it.
        varying = losing or "mass" in self.carry or self.body.loaded_mass() is not None
        varying = varying or self.body.least_mass() is not None
        for effect, reading in zip(self.effects, readings, strict=True):
            name = type(effect).__name__
            if "mass" in reading.needs and not varying:
                raise InputError(
                    f"{name} requires the mass of the body, which has none: "
                    "give body=RigidBody(mass=...) or carry=('mass',)."
                )
            if (
                "force" in reading.adds
                and self.body.constant_mass() is None
                and "mass" not in parts
            ):
                raise InputError(
                    f"{name} adds a force, and the body has no mass: "
                    "give body=RigidBody(mass=...) or carry=('mass',)."
                )
            if ROTATION & reading.needs or TURNING & reading.adds:
                self._check_inertia(f"{name} requires")
        if ROTATION & set(parts):
            self._check_inertia("Scene.carry requires")

    def _check_inertia(self, who: str) -> None:
        if not self.body.has_inertia():
            raise InputError(
                f"{who} a rotating body, and the body has no inertia: "
                "give body=RigidBody(inertia=...)."
            )

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts of a state of this scene, in the order of `BodyState`."""
        # A scene without effects is a point in uniform motion.
        empty = not self.effects and not self.carry
        carry = TRANSLATION if empty else self.carry
        return Listed(read_effects(self.effects, self.body, carry).parts)

    @property
    def readings(self) -> tuple[Reading, ...]:
        """The parts that each effect reads and adds."""
        return Listed(read_effects(self.effects, self.body, self.carry).effects)

    def check_state(self, y: BodyState) -> None:
        """Raise `InputError` unless the state has exactly the parts of this scene; the
        message names the effect that needs a missing one."""
        parts = self.parts
        for part in parts:
            if getattr(y, part) is None:
                who = [
                    type(effect).__name__
                    for effect, reading in zip(self.effects, self.readings, strict=True)
                    if part in reading.needs
                ] or ["Scene"]
                raise InputError(
                    f"{who[0]} requires {part}, which the state does not have: give "
                    f"BodyState({part}=...)."
                )
        # A part without a role would be integrated in vain, or dropped without an error.
        idle = [part for part in y.present if part not in parts]
        if idle:
            raise InputError(
                f"The state has {idle[0]!r}, which no effect of the scene reads or changes: remove "
                f"it, or integrate it with Scene(carry=({idle[0]!r},))."
            )

    def check_values(self, t: Scalar, y: BodyState) -> None:
        """Raise `InputError` for a mass below that of the body without propellant, and for a
        `Custom` effect whose energy is inconsistent with its load."""
        # In a batch such a run is marked, and the others go on.
        if y.mass is not None and y.mass.ndim == 0:
            self._check_mass(float(y.mass))
        for effect in self.effects:
            # By its class: the method of an instance is a separate module, slow to create.
            type(effect).check_values(effect, t, y, self.body)

    def start(self, y: BodyState) -> BodyState:
        """The state `y` with the initial values of the extra parts that the effects integrate.

        Existing parts of `y` are left unchanged. Raises `InputError` where two effects
        integrate a part of the same name."""
        return with_parts(y, self.effects, self.body)

    def loads(self, t: Scalar, y: BodyState) -> Load:
        """The sum of the loads of all effects at the time `t`, s, in the state `y`."""
        loads = [effect.load(t, y, self.body) for effect in self.effects]
        parts = [load.parts_rate for load in loads if load.parts_rate is not None]
        rates = {name: rate for part in parts for name, rate in part.items()} or None
        summed = {k: _sum([getattr(load, k) for load in loads]) for k in SUMMED}
        return Load(**summed, parts_rate=rates)

    def proper_acceleration(self, t: Scalar, y: BodyState) -> Vector:
        falling = [e.load(t, y, self.body).acceleration_N for e in self.effects if e.uniform]
        free = _sum(falling)
        acceleration = self.vector_field(t, y).velocity
        return acceleration if free is None else acceleration - free

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        # Static, and before the loads, whose error about a missing part would name no effect.
        self.check_state(y)
        load = self.loads(t, y)
        # Parts that are `None` are absent in the derivative, as in the state.
        velocity = attitude = omega = mass = None
        if y.velocity is not None:
            if load.acceleration_N is None and load.force_N is None:
                velocity = jnp.zeros_like(y.velocity)
            else:
                velocity = linear_acceleration(load.acceleration_N, load.force_N, self.mass(y))
        if y.omega is not None and y.attitude is not None:
            attitude = y.attitude.rate(y.omega)
            omega = angular_acceleration(
                self.body.inertia(self.mass(y)),
                y.omega,
                load.torque_B,
                load.inertia_B,
                load.momentum_B,
            )
        if y.mass is not None:
            mass = jnp.zeros_like(y.mass) if load.mass_rate is None else load.mass_rate
        parts = None if y.parts is None else _rates_of(y.parts, load.parts_rate or {})
        rate = BodyState(y.velocity, velocity, attitude, omega, mass, parts)
        for effect in self.effects:
            # Last, because a guide reacts to the sum of all loads.
            rate = effect.constrained(t, y, rate)
        return rate

    def mass(self, y: BodyState) -> Scalar | None:
        """The mass of the body, kg: from the state where it changes, else that of the body; `None`
        if it has none."""
        return self.body.constant_mass() if y.mass is None else y.mass

    def outside(self, t: Scalar, y: BodyState) -> Flag | None:
        """Whether more propellant was burnt than available, the mass is exhausted, or the state is
        outside the range of an effect; `None` where none of this is possible."""
        flags = [any_passed(self._mass_limits(y))]
        flags += [effect.outside(t, y, self.body) for effect in self.effects]
        flags = [flag for flag in flags if flag is not None]
        return functools.reduce(operator.or_, flags) if flags else None

    def limits(self, t: Scalar, y: BodyState) -> Sequence[Limit]:
        """The least mass of the body, and the limits of the effects."""
        effects = (limit for e in self.effects for limit in e.limits(t, y, self.body))
        return *self._mass_limits(y), *effects

    def _mass_limits(self, y: BodyState) -> Sequence[Limit]:
        """The least mass that may be left; none where the state has no mass."""
        if y.mass is None:
            return ()
        least = self.body.least_mass()
        if least is None:
            # A mass of zero is none.
            return (
                Limit("the mass of the body", "kg", y.mass, float(jnp.finfo(y.mass.dtype).tiny)),
            )
        # A burn that ends at the dry mass does so within the tolerance of the run.
        slack = max(1e-6, 1e3 * float(jnp.finfo(y.mass.dtype).eps))
        return (Limit("the mass of the body", "kg", y.mass, least, margin=slack * least),)

    def _check_mass(self, mass: float) -> None:
        """Raise `InputError` for a first mass, kg, below that without propellant."""
        burnouts = {type(e).__name__: getattr(e, "burnout_mass", None) for e in self.effects}
        named = {f" (limit: {name}.burnout_mass)": least for name, least in burnouts.items()}
        for name, least in {"": self.body.least_mass(), **named}.items():
            if least is None or np.ndim(least) > 0:
                continue
            low = float(least)
            limit = Limit(f"the mass of the body{name}", "kg", mass, low, margin=1e-6 * low)
            if limit.passed():
                raise InputError(
                    f"y0.mass is below the mass without propellant: {limit.sentence()}. Start with "
                    "the dry mass and the propellant."
                )

    def warning(self, ts: Array, states: BodyState, undisturbed: bool) -> RunWarning | None:
        """The runs that pass below the surface defined by an effect (`AbstractEffect.ground`);
        `None` without one."""
        # By their classes: each method of an instance is a separate module, slow to create.
        grounds = [(e, r) for e in self.effects if (r := type(e).ground(e)) is not None]
        if not grounds:
            return None
        # The lowest: an effect valid inside of the planet returns zero.
        effect, radius = min(grounds, key=lambda ground: np.asarray(ground[1]).min())
        mu = _sole_attraction(self) if undisturbed else None
        lowest = lowest_below_ground(ts, states, radius, mu)
        words = ground_warning(lowest, radius, f"{type(effect).__name__}.radius")
        return RunWarning(words, np.isfinite(lowest)) if words else None

    def with_effects(self, effects: Sequence[AbstractEffect], carry: Sequence[str] = ()) -> "Scene":
        """The scene of the same body under other `effects`, with other parts to `carry`."""
        return Scene(tuple(effects), self.body, tuple(carry))

    def closed_form(self) -> AbstractClosedForm | None:
        """Exact motion of a scene with a single point attraction and free rotation only."""
        return body_motion(self, self.effects)[0]

    def decoupled(self) -> AbstractDecoupled | None:
        """The free rotation, where no effect exerts a torque or depends on the attitude."""
        return scene_decoupled(self)

    def split(self) -> AbstractSplit | None:
        """The motion in closed form as the drift, loads that depend on position and attitude as the
        kick."""
        return scene_split(self)[0]

    def regularised(self) -> AbstractRegularised | None:
        """The regularised variables of the one attracting point, perturbed by other effects."""
        return scene_regularised(self)[0]

    def missing(self, capability: str) -> str:
        reasons = {
            "closed_form": lambda: body_motion(self, self.effects)[1],
            "split": lambda: scene_split(self)[1],
            "regularised": lambda: scene_regularised(self)[1],
        }
        return reasons[capability]() if capability in reasons else ""

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        """The quantities that all effects conserve, such as the energy if every one of them
        conserves it."""
        return conserved(self, t, y)

    def explain(self, names: Sequence[str] = ()) -> str:
        """A table of the effects: their inputs, their contributions and their share of the
        arithmetic of one evaluation.

        **Arguments**

        - `names`: of the effects, in their order; by default those of their classes."""
        return explain(self, names)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        """The break times of all effects, s, (times, *runs)."""
        # Times shared by all runs broadcast with those of single runs.
        times = [e.breaks() for e in self.effects]
        times = [x for x in times if x is not None]
        if not times:
            return None
        runs = jnp.broadcast_shapes(*(x.shape[1:] for x in times))
        return jnp.concatenate([jnp.broadcast_to(x, (x.shape[0], *runs)) for x in times])

    def started_at(self, t0: Scalar) -> "Scene":
        # By their classes, because a bound method of a module is a module, built at each access.
        effects = tuple(type(effect).started_at(effect, t0) for effect in self.effects)
        if all(new is old for new, old in zip(effects, self.effects, strict=True)):
            return self
        # Without the check of a construction: what the effects read and add stays.
        return eqx.tree_at(lambda scene: scene.effects, self, effects)

    def switches(self) -> dict[str, str]:
        """The switches of all effects (`AbstractEffect.switches`)."""
        return {name: part for e in self.effects for name, part in e.switches().items()}


@reads_a_leaf
def _sole_attraction(scene: Scene) -> Scalar | None:
    """The gravitational parameter of the one attracting point, m^3/s^2; `None` for none or
    several."""
    central = [x for e in scene.effects if (x := e.regularised(None)) is not None]
    return central[0].attraction if len(central) == 1 else None


# Contributions that turn the body.
TURNING = frozenset({"torque", "inertia", "momentum"})
SUMMED = ("acceleration_N", "force_N", "torque_B", "mass_rate", "inertia_B", "momentum_B")


def _rates_of(parts: dict[str, State], rates: dict[str, State]) -> dict[str, State]:
    """The rates of the extra parts of a state: zero for those that no effect changes, such as those
    of an effect that acts in another phase."""
    return {
        name: rates[name] if name in rates else jax.tree.map(jnp.zeros_like, part)
        for name, part in parts.items()
    }


def _sum(terms: list[Array | None]) -> Array | None:
    """The sum of the terms that are there; `None` if none is."""
    there = [term for term in terms if term is not None]
    # Without a zero to start from, which would be one more operation.
    return sum(there[1:], there[0]) if there else None
