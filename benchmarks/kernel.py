"""Stormer's steps of the low orbits in one kernel, written by hand in Pallas: each run stays in the
registers of the device from its start to its end, where XLA takes every step through the memory.
"""

from typing import Any

import jax
import jax.numpy as jnp

from jaxspace import BodyState
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import RKN1210
from jaxspace.solvers._polynomials import stormer_weights

from .low_orbits import DAY, J2, SCENE

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


def _march(*refs):
    rows = [ref[:] for ref in refs[:-3]]
    vectors = [tuple(rows[k : k + 3]) for k in range(0, len(rows), 3)]
    state = vectors[0], vectors[1], tuple(vectors[2:])
    rounds, rest = divmod(STEPS - (ORDER - 1), ORDER)

    def several(state, count):
        # Written out, so that no acceleration moves to another register.
        for _ in range(count):
            state = _advance(*state)
        return state

    state = jax.lax.fori_loop(0, rounds, lambda _, state: several(state, ORDER), state)
    for ref, x in zip(refs[-3:], several(state, rest)[0], strict=True):
        ref[:] = x


def days(y0: BodyState) -> jax.Array:
    """Positions of low orbits a day later, (3, runs). The first eleven steps are RKN 12(10)'s."""
    from jax.experimental import pallas as pl

    first = jnp.arange(ORDER, dtype=y0.position.dtype) * H
    single = y0.position.dtype == jnp.float32
    accuracy = Accuracy(2e-6 if single else 1e-13, method=RKN1210())
    states = simulate_batch(SCENE, y0, first, accuracy=accuracy).states
    known = jnp.stack(acceleration(*states.position))
    g = stormer_weights(ORDER).velocity
    w = states.velocity[:, -1] - H * sum(g[j] * known[:, -1 - j] for j in range(ORDER))
    vectors = [states.position[:, -1], w, *(known[:, k] for k in reversed(range(ORDER - 1)))]
    runs = y0.position.shape[-1]
    filled = jnp.arange(-(-runs // BLOCK) * BLOCK) % runs
    rows = [v[axis][filled] for v in vectors for axis in range(3)]
    one = pl.BlockSpec((BLOCK,), lambda block: (block,))
    like = jax.ShapeDtypeStruct(filled.shape, w.dtype)

    def on(**how: Any):
        call = pl.pallas_call(
            _march,
            out_shape=[like] * 3,
            grid=(filled.size // BLOCK,),
            in_specs=[one] * len(rows),
            out_specs=[one] * 3,
            **how,
        )
        return lambda *rows: call(*rows)

    def on_gpu(*rows):
        from jax.experimental.pallas import triton

        params = triton.CompilerParams(num_warps=WARPS, num_stages=1)
        return on(compiler_params=params)(*rows)

    ends = jax.lax.platform_dependent(*rows, cuda=on_gpu, default=on(interpret=True))
    return jnp.stack(ends)[:, :runs]
