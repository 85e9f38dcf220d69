"""An integration that owes nothing to the library's runner, and derivatives by differences: for
tests only."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from both_modes import both_modes
from jax.flatten_util import ravel_pytree
from scipy.integrate import solve_ivp


@jax.jit
def _rate(system, like, t, flat):
    _, unravel = ravel_pytree(like)
    return ravel_pytree(system.vector_field(t, unravel(flat)))[0]


def run(system, y0, ts, rtol=1e-12, atol=1e-15):
    """States at the times `ts` (the first is the start), by DOP853 of scipy: as `y0`, with the
    times on a new last axis."""
    flat, unravel = ravel_pytree(y0)
    answer = solve_ivp(
        lambda t, y: np.asarray(_rate(system, y0, t, y)),
        (ts[0], ts[-1]),
        np.asarray(flat),
        method="DOP853",
        t_eval=ts,
        rtol=rtol,
        atol=atol,
    )
    assert answer.success
    return jax.vmap(unravel, in_axes=1, out_axes=-1)(answer.y)


@partial(jax.jit, static_argnames="steps")
def long_run(system, y0, duration, steps):
    """States after every one of `steps` equal steps, the start first, with the times on a new last
    axis: Gragg's midpoint rule, extrapolated to order 10. Compiled as a whole, for runs of hundreds
    of turns."""
    flat, unravel = ravel_pytree(y0)
    H, orders = duration / steps, (2, 4, 6, 8, 10)

    def f(t, y):
        return ravel_pytree(system.vector_field(t, unravel(y)))[0]

    def midpoint(t, y, n):
        h = H / n
        last, now = jax.lax.fori_loop(
            1, n, lambda i, p: (p[1], p[0] + 2.0 * h * f(t + i * h, p[1])), (y, y + h * f(t, y))
        )
        return 0.5 * (now + last + h * f(t + H, now))

    def step(y, i):
        row = []
        for k, n in enumerate(orders):
            new = [midpoint(i * H, y, n)]
            for j in range(k):
                new.append(new[j] + (new[j] - row[j]) / ((n / orders[k - j - 1]) ** 2 - 1.0))
            row = new
        return row[-1], row[-1]

    _, ys = jax.lax.scan(step, flat, jnp.arange(steps, dtype=flat.dtype))
    return jax.vmap(unravel, out_axes=-1)(jnp.concatenate([flat[None], ys]))


def drifts(system, states, ts):
    """The greatest change of every invariant along the run, relative to its size (or to 1 where it
    is smaller than that)."""
    kept = jax.vmap(system.invariants, in_axes=(0, -1), out_axes=-1)(jnp.asarray(ts), states)
    return {
        name: float(np.max(np.abs(v - v[..., :1])) / max(1.0, np.max(np.abs(v))))
        for name, v in kept.items()
    }


# Kept, so that the cases of a parametrised test share their programs; few, because a test may give
# a function of its own, which is never asked for again.
_kept_modes = lru_cache(maxsize=4)(both_modes)


def check_derivatives(f, x, step=1e-6, rtol=2e-7, atol=1e-7):
    """Forward and reverse derivatives of `f` at the vector `x` are finite, equal, and right.

    Central differences with the step 1e-6 carry a rounding error of about 1e-16/1e-6 and a
    truncation of 1e-12 times the third derivative: hence the tolerances, for functions and
    derivatives of order one."""
    x = np.asarray(x, dtype=float)
    g = _kept_modes(f)
    _, forward, reverse = map(np.asarray, g(x))
    assert np.all(np.isfinite(forward)) and np.all(np.isfinite(reverse))
    np.testing.assert_allclose(forward, reverse, rtol=1e-10, atol=1e-10)
    columns = [
        (np.asarray(g(x + step * e)[0]) - np.asarray(g(x - step * e)[0])) / (2.0 * step)
        for e in np.eye(x.size)
    ]
    np.testing.assert_allclose(forward, np.stack(columns, axis=-1), rtol=rtol, atol=atol)
