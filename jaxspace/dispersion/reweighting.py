"""What-if questions without new runs: the stored runs, weighted by how likely their inputs are
under other distributions.

    w_i = q(x_i) / p(x_i) / sum,   n_e = min(1 / sum w^2, n / E_q[q/p])

    symbol  meaning                                                      unit
    p, q    densities of the changed inputs in the campaign, and now     1 / of the inputs
    w_i     weight of run i                                              1
    n_e     effective number of runs                                     1

The first number of runs is that of the weights at hand, which reveal nothing about places that no
run has reached; the second one is expected from the two densities. For a normal input, a shift by d
standard deviations leaves n exp(-d^2) runs, and a standard deviation that is greater by a factor of
the square root of two or more none, because the largest weights are then unbounded in mean square.
Source: Owen, Monte Carlo theory, methods and examples (2013), 9.1 to 9.3.
"""

__all__ = ["reweight"]

import math
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from ..core import InputError
from ..sampling.densities import is_listed, log_density
from ..sampling.designs import Sobol, map_normals, normal_columns
from ..sampling.distributions import AbstractDistribution
from ..sampling.joint import Component
from ..statistics import Dispersion
from ..statistics.weighted import WeightedDispersion, check_effective
from ._campaign import Campaign

# Share of the new draws that no stored run can have; it biases a mean by this part at most.
OUTSIDE = 1e-4
GRID, POINTS = 2001, 2**13

Inputs = Mapping[str, AbstractDistribution]


def reweight(
    result: Dispersion, campaign: Campaign, inputs: Mapping[str, AbstractDistribution]
) -> WeightedDispersion:
    """The statistics that a campaign would have with other distributions of some inputs.

    **Arguments**

    - `result`: the runs of the `campaign`, as of `disperse` or `open_store`.
    - `campaign`: whose inputs have the distributions from which the runs were drawn.
    - `inputs`: the changed distributions, by the name of the input. Inputs that are drawn together
      are changed together, as `joint.inputs` makes them.

    **Returns** a `WeightedDispersion`.

    **Raises** `InputError` for runs of another campaign and of several rows of a sweep, for unknown
    names, for distributions without a density and for values that no stored run can have, and if
    the effective number of runs is below 100."""
    _check(result, campaign, inputs)
    before = {name: campaign.inputs[name] for name in inputs}
    log = _log_density(inputs, result.inputs) - _log_density(before, result.inputs)
    log = np.where(np.isnan(log), -np.inf, log)
    if not np.isfinite(log).any():
        raise InputError(f"{_named(inputs)}: none of the stored runs has possible values.")
    # Of the largest, because all of them may underflow.
    weights = np.exp(log - log.max())
    weights = weights / weights.sum()
    losses = _losses(before, inputs)
    most = max(losses, key=lambda name: losses[name])
    effective = min(1.0 / float(weights @ weights), result.runs / math.prod(losses.values()))
    check_effective(
        effective,
        result.runs,
        f"the new distribution of {most} is too far from the stored one. Change it less, store "
        "more runs, or compute a new campaign",
    )
    changes = tuple(f"{name}: {before[name].text()} → {inputs[name].text()}" for name in inputs)
    return WeightedDispersion(result, weights, effective, changes)


def _check(result: Dispersion, campaign: Campaign, inputs: Inputs) -> None:
    """Raise `InputError` for inputs that cannot be changed."""
    if not inputs:
        raise InputError("inputs is empty: it must name at least one changed input.")
    if result.attributes.get("inputs", campaign.text()) != campaign.text():
        raise InputError("campaign has other inputs than the campaign of these runs.")
    if np.unique(result.run_numbers % result.rows).size > 1:
        raise InputError("These are runs of several rows of a sweep: use result.row(number).")
    for name, d in inputs.items():
        if name not in campaign.inputs:
            raise InputError(
                f"inputs has {name!r}: it must be one of {', '.join(campaign.inputs)}."
                f"{InputError.hint(name, campaign.inputs)}"
            )
        if not isinstance(d, AbstractDistribution):
            raise InputError(f"inputs[{name!r}] is {d!r}: it must be a distribution.")
        if is_listed(d) != is_listed(campaign.inputs[name]):
            raise InputError(
                f"{name} has values of a list either before or now: the weights need both "
                "distributions to be continuous, or both to be lists."
            )
    for every, given in ((campaign.inputs, inputs), (inputs, campaign.inputs)):
        for name, d in every.items():
            others = [n for n, e in every.items() if d.source and e.source == d.source]
            missing = [n for n in others if n not in given]
            if missing and name in inputs:
                raise InputError(
                    f"{name} is drawn together with {', '.join(missing)}: change all of them, as "
                    "joint.inputs makes them."
                )
    for name, d in inputs.items():
        if isinstance(d, Component) and len(_members(d, inputs)) != d.joint.size:
            raise InputError(f"{name} is one number of a joint distribution: give all of them.")


def _members(d: Component, inputs: Inputs) -> list[str]:
    """The names of the numbers of a joint distribution, in its order."""
    names = [n for n, e in inputs.items() if isinstance(e, Component) and e.source == d.source]
    return sorted(names, key=lambda n: inputs[n].index)  # type: ignore[attr-defined]


def _log_density(inputs: Inputs, x: Mapping[str, np.ndarray]) -> np.ndarray:
    """The logarithm of the density of inputs at the values x, (runs,)."""
    total = np.zeros(len(next(iter(x.values()))))
    for name in normal_columns(dict(inputs)):
        d = inputs[name]
        if isinstance(d, Component):
            values = np.stack([np.asarray(x[n], float) for n in _members(d, inputs)])
            total = total + log_density(d.joint, values)
        else:
            total = total + log_density(d, np.asarray(x[name], float))
    return total


def _losses(before: Inputs, after: Inputs) -> dict[str, float]:
    """The expected factors by which the number of runs falls, by the name of the input, or by those
    of all where some are drawn together. Raises `InputError` for new draws that no run can have."""
    if any(d.source for d in (*before.values(), *after.values())):
        n = sum(map(len, normal_columns(dict(after)).values()))
        z = np.asarray(Sobol().normals(jax.random.key(0), jnp.arange(POINTS), n))
        name = _named(after)
        return {name: _loss(name, before, after, z, np.full(POINTS, 1.0 / POINTS))}
    # The trapezoidal rule far into the tails, where the ratio of the densities is largest.
    z = np.linspace(-8.5, 8.5, GRID)
    weights = np.exp(-0.5 * z * z)
    weights = weights / weights.sum()
    return {
        name: _loss(name, {name: before[name]}, {name: after[name]}, z[:, None], weights)
        for name in after
    }


def _loss(name: str, before: Inputs, after: Inputs, z: np.ndarray, weights: np.ndarray) -> float:
    """The mean of q/p over draws from q at the normal numbers z, (points, n)."""
    drawn = {n: np.asarray(x) for n, x in map_normals(after, jnp.asarray(z)).items()}
    below = _log_density(before, drawn)
    outside = float(weights @ ~np.isfinite(below))
    if outside > OUTSIDE:
        raise InputError(
            f"{100.0 * outside:.2g} % of the draws from the new distribution of {name} are values "
            "that the stored runs cannot have: it must stay within the range of the stored one."
        )
    some = np.isfinite(below) & (weights > 0.0)
    log = _log_density(after, {n: x[some] for n, x in drawn.items()}) - below[some]
    with np.errstate(over="ignore"):
        return max(float(weights[some] @ np.exp(log)), 1.0)


def _named(inputs: Inputs) -> str:
    return ", ".join(inputs)
