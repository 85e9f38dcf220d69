"""A design of many unknowns: the table of a throttle, whose optimum is known by linear algebra."""

from typing import final

import jax.numpy as jnp
import numpy as np

from jaxspace.core import AbstractSystem, Scalar, Table
from jaxspace.dispersion import Campaign, Normal
from jaxspace.dispersion.evaluate import inputs_at
from jaxspace.robust import optimise_design
from jaxspace.robust.statistics import Mean
from jaxspace.simulation import Accuracy, Mission, Phase
from jaxspace.solvers import Tsit5

NODES, DURATION, PRICE = 20, 10.0, 0.1
TIMES = np.linspace(0.0, DURATION, NODES)
LIMIT = -0.2


@final
class Thrown(AbstractSystem):
    """z' = v, v' = factor u(t); e' = u^2 is what the throttle costs."""

    factor: Scalar
    throttle: Table

    def vector_field(self, t, y):
        u = self.throttle(t) + 0.0 * y["v"]
        return {"z": y["v"], "v": self.factor * u, "e": u * u}

    def invariants(self, t, y):
        return {}


def brought_to_rest(x):
    def build(samples):
        system = Thrown(samples["factor"], Table(TIMES, x))
        none = jnp.zeros_like(samples["z"])
        return Mission([Phase(system, DURATION)]), {"z": samples["z"], "v": none - 2.0, "e": none}

    def outputs(result, samples):
        z, v, e = (result.final[name] for name in ("z", "v", "e"))
        return {"cost": z * z + 4.0 * v * v + PRICE * e, "climb": v}

    return Campaign(
        build,
        {"factor": Normal(1.0, 0.1), "z": Normal(15.0, 1.0)},
        outputs,
        accuracy=Accuracy(1e-6, method=Tsit5(), max_steps=64),
    )


def best_throttle(factor, z):
    """The minimum over these runs under the limit, which holds with equality: with the hats of the
    nodes, z and v at the end are linear in the throttle, and the cost is quadratic."""
    h = TIMES[1]
    ends = np.r_[0.5, np.ones(NODES - 2), 0.5]
    speed = h * ends
    # Of the hat at either end, the centre of mass is a third of an interval inside.
    centres = np.r_[h / 3.0, TIMES[1:-1], DURATION - h / 3.0]
    place = speed * (DURATION - centres)
    squares = h / 6.0 * (np.diag(4.0 * ends) + np.eye(NODES, k=1) + np.eye(NODES, k=-1))
    start_z, start_v = z - 2.0 * DURATION, -2.0
    second = np.mean(factor**2)
    hessian = 2.0 * second * (np.outer(place, place) + 4.0 * np.outer(speed, speed))
    hessian += 2.0 * PRICE * squares
    slope = 2.0 * (place * np.mean(factor * start_z) + 4.0 * speed * start_v * np.mean(factor))
    row = np.mean(factor) * speed
    matrix = np.block([[hessian, row[:, None]], [row[None], np.zeros((1, 1))]])
    found = np.linalg.solve(matrix, np.r_[-slope, LIMIT - start_v])
    # The weight of an active upper limit is positive.
    assert found[-1] > 0.0
    return found[:-1]


def test_a_throttle_table_of_twenty_numbers_is_found():
    """By reverse mode through the nodes of the table, with a limit that is active."""
    found = optimise_design(
        brought_to_rest,
        jnp.zeros(NODES),
        minimise=Mean("cost"),
        subject_to=[Mean("climb").at_most(LIMIT)],
        scale=jnp.ones(NODES),
        runs=64,
        tolerance=1e-7,
    )
    assert found.converged, found.sentence()
    normals = found.problem.normals
    assert normals is not None
    samples = inputs_at(brought_to_rest(found.x), normals)
    expected = best_throttle(np.asarray(samples["factor"]), np.asarray(samples["z"]))
    # The runs are polynomials, which the method integrates to rounding: what is left is the
    # tolerance over the least curvature, which is that of the price, 2 PRICE/3 of an interval.
    np.testing.assert_allclose(found.x, expected, atol=1e-4)
