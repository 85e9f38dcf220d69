"""The warning of an interpolation in time whose nodes are not breaks."""

import warnings

import jax.numpy as jnp
import pytest

from jaxspace.core import AbstractSystem, Table
from jaxspace.simulation import simulate

NODES, VALUES = jnp.array([0.0, 1.0, 2.0]), jnp.array([0.0, 1.0, 0.0])
SPAN = jnp.array([0.0, 2.0])


class Driven(AbstractSystem):
    """A system that keeps nothing."""

    def invariants(self, t, y):
        return {}


class Interpolated(Driven):
    """x' = u(t), by an interpolation that declares nothing."""

    def vector_field(self, t, y):
        return jnp.interp(t, NODES, VALUES) + 0.0 * y


class Tabulated(Driven):
    """The same by a table, whose nodes are breaks."""

    control: Table

    def vector_field(self, t, y):
        return self.control(t) + 0.0 * y


class OfState(Driven):
    """x' = u(x): kinks along the state, not in time."""

    def vector_field(self, t, y):
        return jnp.interp(y, NODES, VALUES)


def test_an_interpolation_in_time_without_breaks_is_warned_of():
    with pytest.warns(UserWarning, match="Interpolated.vector_field interpolates in time"):
        simulate(Interpolated(), jnp.array(0.5), SPAN, accuracy=1e-6)


@pytest.mark.parametrize("system", [Tabulated(Table(NODES, VALUES)), OfState()])
def test_breaks_and_states_are_not(system):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(system, jnp.array(0.5), SPAN, accuracy=1e-6)
