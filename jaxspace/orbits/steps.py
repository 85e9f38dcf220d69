"""Number of equal steps required for an orbit.

    mu = -(a . r) |r|       1/A = 2/|r| - v^2/mu       n = sqrt(mu/A^3)
    steps = n duration / (2 pi) x steps per revolution

    symbol   meaning                                        unit
    r, v, a  position, velocity and acceleration            m, m/s, m/s^2
    mu       gravitational parameter of the attraction      m^3/s^2
    A, n     semi-major axis and mean motion of the orbit   m, rad/s

The orbit is the osculating one: that of two bodies through the state, with the attraction there.
"""

__all__ = ["steps_for"]

import math

import jax.numpy as jnp
import numpy as np

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.formula import formula
from ..core.jit import quick_jit
from ..core.squares import quotient
from ..core.tracing import is_traced
from ..core.vectors import dot, norm


@quick_jit
def _mean_motion(system: AbstractSystem, y: State, t: Scalar) -> Scalar:
    """Mean motion, rad/s, (*runs,): zero on an open orbit, NaN without an attracting force."""
    a = system.vector_field(t, y).velocity
    r = norm(y.position)
    mu = -dot(a, y.position) * r
    # 1/A, and zero for an orbit that does not come back.
    curvature = jnp.maximum(2.0 / r - quotient(dot(y.velocity, y.velocity), mu), 0.0)
    return jnp.sqrt(mu * curvature) * curvature


@formula
def steps_for(
    system: AbstractSystem,
    y0: State,
    duration: Scalar,
    per_revolution: int,
    t0: Scalar = 0.0,
) -> int:
    """Number of equal steps such that each revolution has at least `per_revolution` steps.

    `Stormer(steps=steps_for(scene, y0, ts[-1], 90))` takes at least 90 steps per revolution.

    **Arguments**

    - `system`: any system whose state has a position and a velocity.
    - `y0`: the initial state; of many runs, on the last axis, the fastest counts.
    - `duration`: s, of either sign. For `Stormer` that of the run; for `Splitting` and
      `Regularised` the time between two saved states.
    - `per_revolution`: steps in a revolution of the osculating orbit. An open orbit counts as one
      revolution.
    - `t0`: the time of `y0`, s.

    **Returns** the number, rounded up to the next even number of 2, 2 sqrt(2), 4, ..., so that
    similar orbits share a compiled program.

    **Raises** `InputError` for a state without position or velocity, for a traced state, and
    without an attracting force.
    """
    parts = (getattr(y0, "position", None), getattr(y0, "velocity", None))
    if is_traced((system, y0, duration)) or any(part is None for part in parts):
        raise InputError(
            "steps_for requires a position and a velocity with concrete values, outside of jit: "
            "give the number of steps instead."
        )
    n = np.asarray(_mean_motion(system, y0, jnp.asarray(t0, y0.position.dtype)))
    if np.all(np.isnan(n)):
        raise InputError(
            "steps_for finds no attraction at the initial position: "
            "give the number of steps instead."
        )
    # A run that nothing attracts, or whose state is NaN, does not decide for the others.
    revolutions = float(np.nanmax(n)) * abs(float(duration)) / (2.0 * np.pi)
    least = per_revolution * max(1.0, revolutions)
    # Half-integer powers of two; the margin preserves exact powers in spite of rounding.
    power = 0.5 * math.ceil(2.0 * math.log2(least) - 1e-9)
    return 2 * math.ceil(0.5 * 2.0**power)
