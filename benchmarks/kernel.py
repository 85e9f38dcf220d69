"""Stormer's steps of the low orbits in one kernel, written by hand in Pallas: each run stays in the
registers of the device from its start to its end, where XLA takes every step through the memory.
"""

from typing import Any

import jax
import jax.numpy as jnp

from jaxspace import BodyState
from jaxspace.solvers._polynomials import stormer_weights

from .low_orbits import DAY, J2

ORDER, STEPS = 12, 1310
H = DAY / STEPS
# Of the sizes that were tried (32, 64, 128), the one that is fastest in double precision.
BLOCK, WARPS = 32, 1


def acceleration(x, y, z):
    """The three components under oblateness; earth radius and gravitational parameter 1."""
    per_r2 = 1.0 / (x * x + y * y + z * z)
    pull = per_r2 * jnp.sqrt(per_r2)
    c = 1.5 * J2 * per_r2
    s = 5.0 * z * z * per_r2
    across = -pull * (1.0 + c * (1.0 - s))
    return x * across, y * across, -z * pull * (1.0 + c * (3.0 - s))


def _advance(r, w, earlier):
    """One step: position, velocity between the steps, and the accelerations, the newest first."""
    a = (acceleration(*r), *earlier)
    weights = stormer_weights(ORDER).step

    def change(axis):
        total = weights[0] * a[0][axis]
        for weight, each in zip(weights[1:], a[1:], strict=True):
            total = total + weight * each[axis]
        return H * total

    w = tuple(w[axis] + change(axis) for axis in range(3))
    return tuple(r[axis] + H * w[axis] for axis in range(3)), w, a[:-1]


def _start(r, v):
    """The state of the method after its first steps: eight of order 4 (Runge, Kutta) in each."""
    h = H / 8.0

    def moved(x, dx, length):
        return tuple(a + length * b for a, b in zip(x, dx, strict=True))

    def step(_, state):
        r, v = state
        k1 = acceleration(*r)
        v2 = moved(v, k1, 0.5 * h)
        k2 = acceleration(*moved(r, v, 0.5 * h))
        v3 = moved(v, k2, 0.5 * h)
        k3 = acceleration(*moved(r, v2, 0.5 * h))
        v4 = moved(v, k3, h)
        k4 = acceleration(*moved(r, v3, h))
        for rate, weight in ((v, 1.0), (v2, 2.0), (v3, 2.0), (v4, 1.0)):
            r = moved(r, rate, weight * h / 6.0)
        for rate, weight in ((k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)):
            v = moved(v, rate, weight * h / 6.0)
        return r, v

    accelerations = ()
    for _ in range(ORDER - 1):
        accelerations = (acceleration(*r), *accelerations)
        r, v = jax.lax.fori_loop(0, 8, step, (r, v))
    w = v
    for weight, a in zip(
        stormer_weights(ORDER).velocity, (acceleration(*r), *accelerations), strict=True
    ):
        w = moved(w, a, -H * weight)
    return r, w, accelerations


def _march(*refs):
    given = [ref[:] for ref in refs[:6]]
    state = _start(tuple(given[:3]), tuple(given[3:]))
    rounds, rest = divmod(STEPS - (ORDER - 1), ORDER)

    def several(state, count):
        # Written out, so that no acceleration moves to another register.
        for _ in range(count):
            state = _advance(*state)
        return state

    state = jax.lax.fori_loop(0, rounds, lambda _, state: several(state, ORDER), state)
    for ref, x in zip(refs[6:], several(state, rest)[0], strict=True):
        ref[:] = x


def days(y0: BodyState) -> jax.Array:
    """Positions of low orbits a day later, (3, runs)."""
    from jax.experimental import pallas as pl

    runs = y0.position.shape[-1]
    filled = jnp.arange(-(-runs // BLOCK) * BLOCK) % runs
    rows = [x[filled] for x in (*y0.position, *y0.velocity)]
    one = pl.BlockSpec((BLOCK,), lambda block: (block,))

    def on(**how: Any):
        return pl.pallas_call(
            _march,
            out_shape=[jax.ShapeDtypeStruct(filled.shape, y0.position.dtype)] * 3,
            grid=(filled.size // BLOCK,),
            in_specs=[one] * 6,
            out_specs=[one] * 3,
            **how,
        )

    def on_gpu(*rows):
        from jax.experimental.pallas import triton

        params = triton.CompilerParams(num_warps=WARPS, num_stages=1)
        return on(compiler_params=params)(*rows)

    ends = jax.lax.platform_dependent(
        *rows, cuda=on_gpu, default=lambda *rows: on(interpret=True)(*rows)
    )
    return jnp.stack(ends)[:, :runs]
