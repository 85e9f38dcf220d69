"""Capabilities of a scene, composed from those of its effects.

Closed form: the orbit under the one effect that has a closed form (a straight line without one),
and the free rotation of the body. Decoupled: the free rotation, where only forces act, which do not
depend on it. Split: this motion as the drift, all other effects as the kick. Regularised: the
variables of the one effect that has them, perturbed by all others.

Each function returns the capability and an empty text, or `None` and the reason for it, so that an
error message can give the reason.
"""

import dataclasses
from collections.abc import Sequence
from typing import final

import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractEffect, BodyState, FreeRotation
from ..bodies.newton_euler import linear_acceleration
from ..bodies.state import PARTS
from ..core import (
    AbstractClosedForm,
    AbstractDecoupled,
    AbstractRegularised,
    AbstractSplit,
    Flag,
    Scalar,
)
from ..core.vectors import norm
from ._interface import AbstractScene
from .reading import ROTATION, TRANSLATION


@final
class BodyMotion(AbstractClosedForm):
    """The exact motion of a body: its `orbit`, or a straight line where that is `None`, and its
    free rotation as the `body`. A mass in the state stays as it is."""

    orbit: AbstractClosedForm | None
    body: AbstractBody

    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        # Orbit and rotation are independent: no effect in a closed form couples them.
        position = y.position
        velocity = y.velocity
        if position is not None and self.orbit is None:
            position = position + duration * velocity
        elif self.orbit is not None:
            moved = self.orbit.flow(duration, BodyState(position, velocity))
            position = moved.position
            velocity = moved.velocity
        attitude = y.attitude
        omega = y.omega
        if attitude is not None:
            turned = _turned(duration, y, self.body)
            attitude = turned.attitude
            omega = turned.omega
        return BodyState(position, velocity, attitude, omega, y.mass)

    @property
    def range_of_validity(self) -> str:
        return "" if self.orbit is None else self.orbit.range_of_validity

    def outside(self, duration: Scalar, y: BodyState) -> Flag | None:
        if self.orbit is None:
            return None
        return self.orbit.outside(duration, BodyState(y.position, y.velocity))


def _turned(duration: Scalar, y: BodyState, body: AbstractBody) -> BodyState:
    """Attitude and angular velocity of a body without torque a `duration`, s, after `y`."""
    mass = body.constant_mass() if y.mass is None else y.mass
    start = BodyState(attitude=y.attitude, omega=y.omega)
    return FreeRotation(body.inertia(mass)).flow(duration, start)


@final
class FreeTurn(AbstractDecoupled):
    """The free rotation of the `body` as the exact part, and the `scene` without it."""

    scene: AbstractScene

    @property
    def rest(self) -> AbstractScene:
        return self.scene

    def rest_of(self, y: BodyState) -> BodyState:
        return dataclasses.replace(y, attitude=None, omega=None)

    def joined(self, duration: Scalar, y: BodyState, rest: BodyState) -> BodyState:
        turned = _turned(duration, y, self.scene.body)
        return dataclasses.replace(rest, attitude=turned.attitude, omega=turned.omega)

    def turns(self, duration: Scalar, y: BodyState) -> Scalar:
        # A state before the body turns knows no rate.
        if y.omega is None:
            return jnp.zeros_like(duration)
        return norm(y.omega) * jnp.abs(duration)


@final
class SceneSplit(AbstractSplit):
    """The exact motion of the body as the drift, the loads of the `kicking` scene as the kick."""

    motion: BodyMotion
    kicking: AbstractScene

    def drift(self, duration: Scalar, y: BodyState) -> BodyState:
        return self.motion.flow(duration, y)

    def kick(self, t: Scalar, duration: Scalar, y: BodyState) -> BodyState:
        # Exact, because the loads depend on what a kick does not change: position and attitude.
        load = self.kicking.loads(t, y)
        velocity = y.velocity
        omega = y.omega
        if load.acceleration_N is not None or load.force_N is not None:
            mass = self.kicking.mass(y)
            velocity = velocity + duration * linear_acceleration(
                load.acceleration_N, load.force_N, mass
            )
        if load.torque_B is not None:
            inertia = self.kicking.body.inertia(self.kicking.mass(y))
            omega = omega + duration * inertia.solve(load.torque_B)
        return BodyState(y.position, velocity, y.attitude, omega)


def _separate(
    effects: Sequence[AbstractEffect],
) -> tuple[list[AbstractEffect], list[AbstractEffect]]:
    """The effects with a closed form, and the others."""
    exact = [e for e in effects if e.closed_form() is not None]
    return exact, [e for e in effects if e.closed_form() is None]


def body_motion(
    scene: AbstractScene, effects: Sequence[AbstractEffect]
) -> tuple[BodyMotion | None, str]:
    """The exact motion of the body of a scene under the given `effects` only."""
    exact, others = _separate(effects)
    if others:
        return None, f"{type(others[0]).__name__} has no closed form"
    if len(exact) > 1:
        return None, f"{type(exact[1]).__name__} is a second effect with a closed form"
    # With a constant mass alone: an effect that changes it has no closed form, and cannot be a
    # kick.
    if not set(scene.parts) <= TRANSLATION | ROTATION | {"mass"}:
        return None, "it integrates further parts"
    orbit = exact[0].closed_form() if exact else None
    return BodyMotion(orbit, scene.body), ""


def scene_decoupled(scene: AbstractScene) -> FreeTurn | None:
    """The free rotation of the body, decoupled from the rest of its motion; `None` where an effect
    exerts a torque or changes the mass, where one reads the attitude, and for a pure rotation."""
    rest = set(scene.parts) - ROTATION
    if not rest or not ROTATION <= set(scene.parts):
        return None
    turning = {"torque", "inertia", "momentum", "mass_rate"}
    if any(turning & reading.adds or ROTATION & reading.needs for reading in scene.readings):
        return None
    alone = scene.with_effects(scene.effects, [part for part in scene.carry if part in rest])
    # An effect may do something else where the state has no attitude.
    same = set(alone.parts) == rest and alone.readings == scene.readings
    return FreeTurn(alone) if same else None


def scene_split(scene: AbstractScene) -> tuple[SceneSplit | None, str]:
    """Drift and kick of a scene; the loads of the kick may depend on position and attitude only."""
    exact, others = _separate(scene.effects)
    # Parts that a kick changes, or that change during it.
    moving = {"velocity", "omega", "mass", "parts", "mass_rate", "inertia", "momentum"}
    for effect, reading in zip(scene.effects, scene.readings, strict=True):
        if effect.closed_form() is None and moving & (reading.needs | reading.adds):
            return (
                None,
                f"{type(effect).__name__} reads or adds more than loads by position and attitude",
            )
    motion, reason = body_motion(scene, exact)
    if motion is None:
        return None, reason
    if "mass" in scene.parts:
        return None, "its mass is part of the state, which a kick cannot depend on"
    return SceneSplit(motion, scene.with_effects(others, scene.carry)), ""


def scene_regularised(scene: AbstractScene) -> tuple[AbstractRegularised | None, str]:
    """Regularised variables of the one effect that has them, perturbed by the others."""
    central = [e for e in scene.effects if e.regularised(None) is not None]
    others = tuple(e for e in scene.effects if e.regularised(None) is None)
    # The variables are those of a position and a velocity, which accelerations alone perturb.
    readings = list(zip(scene.effects, scene.readings, strict=True))
    for effect, reading in readings:
        alien = [part for part in PARTS if part in reading.needs - TRANSLATION]
        if alien and effect.regularised(None) is None:
            return None, f"{type(effect).__name__} reads the {alien[0]}"
    for effect, reading in readings:
        alien = sorted(reading.adds & {"torque", "mass_rate", "parts"})
        if alien:
            return None, f"{type(effect).__name__} adds a {alien[0]}"
    if len(central) != 1:
        return None, f"it requires exactly one effect such as PointGravity, and has {len(central)}"
    if set(scene.parts) != TRANSLATION:
        held = ", ".join(scene.parts)
        return None, f"its state has {held}: it must have a position and a velocity only"
    # `None` and not an empty scene, so that an orbit without perturbation costs no product with
    # zero.
    rest = scene.with_effects(others) if others else None
    return central[0].regularised(rest), ""
