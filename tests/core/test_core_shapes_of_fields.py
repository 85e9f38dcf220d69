"""Declared shapes are checked in every constructor: an axis of runs is never taken for one of
components."""

import dataclasses
import inspect
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from more_systems import MORE
from systems import SAMPLES

from jaxspace.attitude import Top, ViscousTorque
from jaxspace.core import InputError
from jaxspace.core.quantities import AbstractParameters, quantities
from jaxspace.rockets import Thrust


def parameters(tree):
    """Every module with declared numbers within a tree."""
    found = {}

    def look(node):
        if isinstance(node, AbstractParameters):
            found.setdefault(type(node), node)
        if isinstance(node, eqx.Module):
            node = [getattr(node, field.name, None) for field in dataclasses.fields(node)]
        if isinstance(node, dict):
            node = list(node.values())
        if isinstance(node, list | tuple):
            for part in node:
                look(part)

    look(tree)
    return found


# Classes that compute their fields from other arguments check them with these.
MODULES = {
    cls: module
    for cls, module in parameters([sample.system for sample in [*SAMPLES, *MORE]]).items()
    if {field.name for field in dataclasses.fields(cls)} <= set(inspect.signature(cls).parameters)
}
FIELDS = [
    (cls, name)
    for cls, module in MODULES.items()
    for name, declared in quantities(cls).items()
    if declared.shape and isinstance(getattr(module, name), jax.Array)
]


def test_a_declared_shape_is_checked_in_every_class():
    """A plain number in place of several, and an axis of components of another length; the same
    numbers with an axis of runs behind them are taken."""
    assert len(MODULES) > 60 and len(FIELDS) > 25
    for cls, name in FIELDS:
        module, declared = MODULES[cls], quantities(cls)[name]
        value = np.asarray(getattr(module, name))
        wrong = [value.ravel()[0]]
        if declared.shape[0] is not None:
            wrong.append(np.concatenate([value, value]))
        sentence = re.escape(f"{cls.__name__}.{name} is ") + ".*: it must have the shape "
        for x in wrong:
            with pytest.raises(InputError, match=sentence + re.escape(declared.form())):
                dataclasses.replace(module, **{name: x})


def test_runs_stand_behind_the_declared_axes():
    assert ViscousTorque(np.ones((3, 2))).damping.shape == (3, 2)
    with pytest.raises(InputError, match=r"damping is 0.2: it must have the shape \(3, \*runs\)"):
        ViscousTorque(0.2)
    with pytest.raises(InputError, match=r"damping is \[0.1 0.2\]: it must have the shape \(3, "):
        ViscousTorque([0.1, 0.2])
    # A traced number has a shape, too.
    with pytest.raises(InputError, match=r"damping has the shape \(2,\): it must have the shape"):
        jax.jit(lambda x: ViscousTorque(x).damping)(jnp.ones(2))


def test_named_constructors_check_their_arguments():
    top = Top(0.002, 0.0008, 0.3)
    with pytest.raises(InputError, match=r"Top.angles has the shape \(2,\): it must have the sha"):
        top.state([0.1, 0.2], jnp.ones(3))
    with pytest.raises(InputError, match=r"Thrust.offset has the shape \(3,\): .* \(2, \*runs\)"):
        Thrust.of_motor(300.0, 2.5, 0.5, station=-1.0, offset=(0.1, 0.2, 0.3))
    assert top.state(jnp.ones((3, 4)), jnp.ones((3, 1))).omega.shape == (3, 4)
