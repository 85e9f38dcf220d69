"""Invariants of a body under several effects: those that every effect conserves.

    energy per unit mass     v^2/2 + sum of potentials
                             + omega . J omega / 2m, where torques couple both motions;
                             of the orbit alone, where the other effects only turn the body
    angular momentum         r x v, or its z component alone
    rotation without torque  J omega in inertial axes, omega . J omega / 2
    internal torques alone   J omega + h in inertial axes, with the inertia and the momentum h of
                             moving parts

Source: Thomson 4.2, 5.3.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array

from ..bodies import AbstractBody, AbstractEffect, BodyState
from ..bodies.inertia import kinetic_energy
from ..core import Scalar
from ..core.vectors import cross, dot, matvec
from ._interface import AbstractScene

ALL_KEPT = frozenset({"energy", "angular_momentum", "axial_angular_momentum"})
# Contributions that turn the body, or move in it, without an effect on the orbit.
TURNING = frozenset({"torque", "inertia", "momentum", "parts"})


def conserved(scene: AbstractScene, t: Scalar, y: BodyState) -> dict[str, Array]:
    """The conserved quantities of a body under effects.

    **Arguments**

    - `scene`: the body and its effects.
    - `t`, s, and `y`: time and state.

    **Returns** the quantities by name, with the runs of the state.
    """
    effects = scene.effects
    body = scene.body
    mass = scene.mass(y)
    pairs = [(e, reading.adds) for e, reading in zip(effects, scene.readings, strict=True)]
    kept = frozenset.intersection(*(e.keeps for e in effects)) if effects else ALL_KEPT
    adds = frozenset().union(*(added for _, added in pairs))
    # Effects that add a torque alone do not change the energy of the orbit.
    pushing = [(e, added) for e, added in pairs if not added or not added <= TURNING]
    unit = {} if y.attitude is None else {"quaternion_norm": y.attitude.norm_squared}
    result: dict[str, Array] = {}
    # Mass that leaves takes energy and momentum along.
    if "mass_rate" in adds:
        return unit
    if y.position is not None and y.velocity is not None:
        moment = cross(y.position, y.velocity)
        if "angular_momentum" in kept:
            result["angular_momentum"] = moment
        elif "axial_angular_momentum" in kept:
            result["axial_angular_momentum"] = moment[2]
    if "energy" in kept:
        # Without a torque the energy of the rotation is constant by itself, and listed so.
        result["energy"] = _energy(effects, body, mass if "torque" in adds else None, t, y)
    elif pushing and all("energy" in e.keeps and "torque" not in x for e, x in pushing):
        result["orbital_energy"] = _energy([e for e, _ in pushing], body, None, t, y)
    if y.omega is not None and y.attitude is not None:
        inertia = body.inertia(mass)
        turning = [e for e, added in pairs if added & (TURNING - {"parts"})]
        if all("rotational_momentum" in e.keeps for e in turning):
            h = inertia.times(y.omega)
            for load in (e.load(t, y, body) for e in turning):
                if load.inertia_B is not None:
                    h = h + matvec(load.inertia_B, y.omega)
                if load.momentum_B is not None:
                    h = h + load.momentum_B
            result["rotational_momentum"] = y.attitude.rotate(h)
        if not turning:
            result["rotational_energy"] = kinetic_energy(inertia, y.omega)
    return result | unit


def _energy(
    effects: Sequence[AbstractEffect],
    body: AbstractBody,
    mass: Scalar | None,
    t: Scalar,
    y: BodyState,
) -> Array:
    """Energy per unit mass, J/kg, with that of the rotation where a `mass`, kg, is given."""
    energy = 0.0 if y.velocity is None else 0.5 * dot(y.velocity, y.velocity)
    for effect in effects:
        potential = effect.potential(t, y, body)
        assert potential is not None, (
            f"{type(effect).__name__} conserves the energy but has no potential"
        )
        energy = energy + potential
    if mass is not None and y.omega is not None:
        energy = energy + kinetic_energy(body.inertia(mass), y.omega) / mass
    return jnp.asarray(energy)
