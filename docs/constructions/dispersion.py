"""One construction of each class of `jaxspace.dispersion`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.dispersion import Campaign, Normal, StopRule
from jaxspace.dispersion.evaluate import Evaluator
from jaxspace.dispersion.purpose import ByPurpose
from jaxspace.mechanics import SimplePendulum
from jaxspace.simulation import Accuracy, Mission, Phase


def build(samples):
    """A swing of ten seconds; every sample has the shape (runs,)."""
    pendulum = SimplePendulum(length=samples["length"], gravity=9.81)
    start = pendulum.state(theta=jnp.full_like(samples["length"], 0.1))
    return Mission([Phase(pendulum, until=10.0)]), start


def outputs(result, samples):
    """The angle at the end."""
    return {"angle": result.final.coordinates[0]}


campaign = Campaign(
    build,
    inputs={"length": Normal(mean=1.0, deviation=0.01)},
    outputs=outputs,
    units={"length": "m", "angle": "rad"},
)
StopRule(output="angle", precision=0.01)
ByPurpose(Accuracy(max_steps=5000))
Evaluator(campaign, Accuracy(rtol=1e-9))
