"""A batch as a program of its own (`jax.export`), for any number of runs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export
from systems import MU, Integrated, orbit
from unchecked import unchecked

from jaxspace import Accuracy, simulate_batch
from jaxspace.bodies import BodyState
from jaxspace.orbits import TwoBody
from jaxspace.solvers import Tsit5

TS = np.array([0.0, 300.0, 600.0])


def orbits(count: int) -> list[jax.Array]:
    """Position and velocity of so many orbits that differ."""
    y = orbit()
    factor = 1.0 + 0.01 * jnp.arange(count, dtype=float)
    return [y.position[:, None] * factor, y.velocity[:, None] / jnp.sqrt(factor)]


def run(position, velocity):
    """The positions of a batch at the save times."""
    return simulate_batch(
        Integrated(TwoBody(jnp.asarray(MU))),
        BodyState(position=position, velocity=velocity),
        TS,
        accuracy=Accuracy(1e-6, method=Tsit5()),
    ).states.position


@pytest.fixture(scope="module")
def program() -> export.Exported:
    """The batch, for a number of runs that is left open."""
    (n,) = export.symbolic_shape("n")
    shapes = [jax.ShapeDtypeStruct((3, n), float)] * 2
    # The checks of shapes, which the tests alone turn on, broadcast numbers and no symbols.
    with unchecked():
        return export.export(jax.jit(run))(*shapes)


# Less than a block, and more than one, the last of which is filled up.
@pytest.mark.parametrize("count", [3, 70])
def test_one_exported_program_runs_any_number_of_runs(program, count):
    found = program.call(*orbits(count))
    assert found.shape == (3, TS.size, count)
    # A block of three runs shares its steps with its copies alone, as the filled block does, so
    # that nothing but the order of operations can differ.
    np.testing.assert_allclose(found, run(*orbits(count)), rtol=1e-9)
