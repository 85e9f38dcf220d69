"""The work of a force along a path.

    W = integral of F(r) . dr = integral of F(r(s)) . r'(s) ds

    symbol   meaning                                        unit
    F        force as a function of the place               N
    r(s)     path as a function of any parameter s          m

A conservative force does the work U(start) - U(end) on every path; a force is conservative if its
curl is zero. Friction and follower forces depend on the path.

Source: Thomson 4.3, 4.4 problem 3. The quadrature has 24 nodes of Gauss: exact to rounding for
paths without corners along which the force varies smoothly. The work along a path with corners is
the sum over its smooth parts.
"""

__all__ = ["work_along"]

from collections.abc import Callable

import jax
import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.checks import check_finite
from ..core.types import as_float
from ..core.vectors import dot
from .beams import beam_integral


def work_along(
    force: Callable[[Vector], Vector],
    path: Callable[[Scalar], Vector],
    start: Scalar = 0.0,
    end: Scalar = 1.0,
) -> Scalar:
    """The work, J, of a force along a path, (*runs,) (Thomson 4.3, 4.4 problem 3).

    **Arguments**

    - `force`: F of the place, N, a function from (3, places, *runs) to the same shape.
    - `path`: r of the parameter, m, a function from (places, *runs) to (3, places, *runs).
    - `start`, `end`: the parameter at both ends, (*runs,).

    **Raises** `InputError` for an end that is not finite, and for a path or a force without three
    components.
    """
    check_finite("start", start)
    check_finite("end", end)

    def power(s: Scalar) -> Scalar:
        r, tangent = jax.jvp(path, (s,), (jnp.ones_like(s),))
        return dot(force(r), tangent)

    # Broadcast to the runs of both ends, of which one may be shared.
    first, last = jnp.broadcast_arrays(as_float(start), as_float(end))
    return beam_integral(power, first, last)
