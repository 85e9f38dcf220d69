"""What a row of the tables is, and the few words that the rows share."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

DEG = np.pi / 180.0
MILE = 5280.0  # ft

# Why a row is compared to its tolerance.
CLOSED = "closed form: the digits of the case"
STEPS = "integration: the tolerance of the run over its number of steps"
LINEAR = "derivative of the motion: the digits of the case"


class Case(NamedTuple):
    """One row: what is computed from what is given, by which functions, and what comes out.

    - `compute`: takes `given` by name, and returns the numbers of `expected` in their order.
    - `expected`: by name and unit, in the units of the book.
    - `rtol`, `atol`: relative, and absolute for components that are zero.
    - `why`: the reason of the tolerance."""

    id: str
    title: str
    uses: tuple[Any, ...]
    given: Mapping[str, Any]
    compute: Callable[..., tuple[Any, ...]]
    expected: Mapping[str, Any]
    rtol: float = 1e-9
    atol: float = 0.0
    why: str = CLOSED


def vec(*components) -> jax.Array:
    """A vector of floating-point components."""
    return jnp.array(components, float)


def rates(path: Callable, t: float = 0.0):
    """The first and the second derivative of a `path` of time, at the time `t`."""
    one = jnp.ones(())

    def first(t):
        return jax.jvp(path, (t,), (one,))[1]

    return jax.jvp(first, (jnp.asarray(t, float),), (one,))
