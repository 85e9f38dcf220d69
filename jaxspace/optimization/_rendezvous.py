"""The rendezvous of least total velocity, over the times of departure and arrival, by gradients.

    minimise |dv1(t1, t2)| + |dv2(t1, t2)|,   t1 >= earliest,  t2 <= latest

    symbol     meaning                                        unit
    t1, t2     times of the departure and of the arrival      s
    dv1, dv2   impulses of `orbits.interception` there        m/s

Source: Thomson 4.16; the derivatives are those of Lambert's problem, and the search is `minimise`.

A sum of sizes has a corner where one impulse vanishes, and each revolution of the bodies brings
other minima: start from the best place of a `porkchop`.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import Scalar, Vector
from ..core.formula import POSITIVE, formula
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.vectors import norm
from ..minimisation import Criterion, minimise
from ..orbits import Interception
from ..orbits.burnout import circular_speed
from ..orbits.interception import OrbitState, interception, position_and_velocity


@printed(departure="s", arrival="s", total="m/s")
class Rendezvous(NamedTuple):
    """The result of `least_rendezvous`: times of the `departure` and of the `arrival`, s, the
    `transfer`, the sum of its impulses `total`, m/s, and whether the search `converged`."""

    departure: Scalar
    arrival: Scalar
    transfer: Interception
    total: Scalar
    converged: Bool[Array, ""]


@formula(mu=POSITIVE)
def least_rendezvous(
    chaser: OrbitState,
    target: OrbitState,
    start: tuple[Scalar, Scalar],
    mu: Scalar,
    *,
    earliest: Scalar | None = None,
    latest: Scalar | None = None,
    intercept_only: bool = False,
    revolutions: int = 0,
    low: bool = True,
    tolerance: Scalar = 1e-7,
) -> Rendezvous:
    """A local minimum of the sum of both impulses over departure and arrival.

    **Arguments**

    - `chaser`, `target`, `mu`, `revolutions`, `low`: as in `orbits.interception`, of one run.
    - `start`: departure and arrival, s, at which the search begins.
    - `earliest`, `latest`: bounds of the departure and of the arrival, s.
    - `intercept_only`: whether to count only the impulse at the departure.
    - `tolerance`: of the gradient, with the speed and the period of the chaser as units.

    **Returns** a `Rendezvous`.

    **Raises** `InputError` for a `chaser` or `target` of another kind.
    """
    pairs = position_and_velocity("chaser", chaser), position_and_velocity("target", target)
    limits = earliest, latest
    return _least(*pairs, start, mu, limits, intercept_only, revolutions, low, tolerance)


@quick_jit
def _least(
    chaser: tuple[Vector, Vector],
    target: tuple[Vector, Vector],
    start: tuple[Scalar, Scalar],
    mu: Scalar,
    limits: tuple[Scalar | None, Scalar | None],
    intercept_only: bool,
    revolutions: int,
    low: bool,
    tolerance: Scalar,
) -> Rendezvous:
    earliest, latest = limits
    radius = norm(chaser[0])
    speed = circular_speed(radius, mu)
    unit_of_time = radius / speed

    def problem(x: Float[Array, "2"]) -> Criterion:
        departure, arrival = x * unit_of_time
        transfer = interception(
            chaser, target, departure, arrival, mu, revolutions=revolutions, low=low
        )
        total = norm(transfer.departure) if intercept_only else transfer.total
        # Without a transfer the line search backtracks.
        total = jnp.where(jnp.isfinite(total), total / speed, jnp.inf)
        bounds = []
        if earliest is not None:
            bounds.append((departure - earliest) / unit_of_time)
        if latest is not None:
            bounds.append((latest - arrival) / unit_of_time)
        return Criterion(total, non_negative=jnp.stack(bounds) if bounds else None, report=transfer)

    x = jnp.stack([jnp.asarray(t, radius.dtype) for t in start]) / unit_of_time
    # The gradient needs no check: the motion is in closed form, without steps that could pass over
    # a kink.
    minimum = minimise(problem, x, tolerance=tolerance, check_gradient=False)
    departure, arrival = minimum.x * unit_of_time
    total = minimum.criterion.objective * speed
    return Rendezvous(departure, arrival, minimum.criterion.report, total, minimum.converged)
