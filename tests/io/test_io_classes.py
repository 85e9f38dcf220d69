"""Every effect and system of the library stands in scene files, or the reason stands here."""

import importlib
import inspect

import jax.numpy as jnp
import numpy as np
import pytest
from systems import MU, RADIUS

import jaxspace
from jaxspace.attitude import DipoleField, MagneticDipole
from jaxspace.bodies import AbstractEffect, BodyState, RigidBody
from jaxspace.core import AbstractSystem
from jaxspace.core.modules import public_names
from jaxspace.io import SceneError, catalog

FUNCTION = "is made of any function of Python, and a file executes nothing"
WRAPS = "is made of another object of its kind, by studies and drivers"
TASK = "is a step of an optimisation, which a file gives as [optimize]"
OWN = "is what a file of effects is itself"

NOT_IN_FILES = {
    "attitude.MovingMasses": FUNCTION,
    "orbits.CentralPotential": FUNCTION,
    "scene.Custom": FUNCTION,
    "mechanics.Lagrangian": FUNCTION,
    "mechanics.Hamiltonian": FUNCTION,
    "scene.Scaled": WRAPS,
    "control.ZeroOrderHold": WRAPS,
    "integration.PackedSystem": WRAPS,
    "studies.Uncertain": WRAPS,
    "studies.UncertainRoot": WRAPS,
    "optimization.SteeredBurn": TASK,
    "optimization.SteeredFlight": TASK,
    "optimization.Burn": TASK,
    "scene.Scene": OWN,
}


def final_classes(base):
    """The final subclasses of a class in the packages that are imported."""
    for cls in base.__subclasses__():
        yield from final_classes(cls)
        if getattr(cls, "__final__", False) and cls.__module__.startswith("jaxspace."):
            yield cls


def test_every_effect_and_system_stands_in_files_or_has_a_reason():
    # Subclasses are known when they are imported.
    for thing in (getattr(jaxspace, name) for name in jaxspace.__all__):
        if inspect.ismodule(thing) and hasattr(thing, "__path__"):
            public_names(thing)
    known = catalog()
    named = {*known.effects.values(), *known.systems.values()}
    missing = {
        f"{cls.__module__.split('.')[1]}.{cls.__name__}"
        for base in (AbstractEffect, AbstractSystem)
        for cls in final_classes(base)
        if cls not in named
    }
    assert missing == set(NOT_IN_FILES)
    assert len(known.effects) >= 36


def test_what_is_public_and_not_for_files_is_refused_with_the_reason(tmp_path):
    refused = catalog().refused
    for name, reason in NOT_IN_FILES.items():
        package, _, cls = name.partition(".")
        public = cls in public_names(importlib.import_module(f"jaxspace.{package}"))
        if reason is FUNCTION and public:
            assert any(f"{cls}." in sentence for sentence in refused.values()), name
    path = tmp_path / "scene.toml"
    path.write_text("[effects.moving_masses]\nmass = [2.0]\n[times]\nend = 1.0\n")
    with pytest.raises(
        SceneError, match=r"effects.moving_masses cannot be used in a scene file: Moving.*path"
    ):
        jaxspace.load(path)
    path.write_text('[system]\nname = "lagrangian"\n')
    with pytest.raises(
        SceneError, match=r'system.name = "lagrangian" cannot be used in a scene file'
    ):
        jaxspace.load(path)


DIPOLE = f"""
[planet]
mu = {MU}

[body]
mass = 900.0
inertia = [520.0, 560.0, 340.0]

[effects.point_gravity]

[effects.magnetic_dipole]
moment = [2e3, 1e3, -1e3]
field = [0.0, 0.0, "-7.8e15 T m^3"]

[initial]
position = [{RADIUS}, 0.0, 5e5]
velocity = [0.0, 7e3, 0.0]
omega = [0.0, 0.1, 0.0]

[initial.attitude]
angles = [0.0, 0.0, 0.0]

[times]
end = 20.0
"""


def test_a_dipole_in_the_field_of_a_planet_from_a_file(tmp_path):
    """m x B with B = (3 (k . r^) r^ - k)/r^3, at the identity."""
    path = tmp_path / "scene.toml"
    path.write_text(DIPOLE)
    effect = next(e for e in jaxspace.load(path).system.effects if isinstance(e, MagneticDipole))
    assert isinstance(effect.field, DipoleField)
    r = np.array([RADIUS, 0.0, 5e5])
    k = np.array([0.0, 0.0, -7.8e15])
    size = np.linalg.norm(r)
    field = (3.0 * (k @ r) * r / size**2 - k) / size**3
    y = BodyState(
        jnp.asarray(r), attitude=jaxspace.rotations.Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0]))
    )
    torque = effect.load(0.0, y, RigidBody()).torque_B
    # A dozen roundings of numbers of one size.
    np.testing.assert_allclose(torque, np.cross([2e3, 1e3, -1e3], field), rtol=1e-13, atol=1e-18)
