"""Lambert's problem for a hundred thousand pairs of positions at a few radii from the centre, with
arrival within one revolution; the result is the initial velocity. pykep runs on one core, with
lists prepared in advance and without storing its results. The error is the miss distance of a
sample, computed with forty digits, relative to the distance of the second position; hard transfers
have transfer angles within 1e-4 rad of zero, half a turn and a full turn, and durations of 1e-2 to
1e2 time units.

In blocks: a thousand pairs at a time, arrays (blocks, 3, 1024). Ours give both velocities, as pykep
does."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.orbits.lambert import lambert

from ._measure import exact_position, in_blocks, in_turn, pykep

PAIRS, CHECKED = 100 * 1024, 200


def pairs():
    """Directions anywhere, distances from 0.5 to 2, times from 0.5 to 5; gravitational parameter
    1."""
    g = np.random.default_rng(5)
    places = g.standard_normal((2, 3, PAIRS))
    places *= g.uniform(0.5, 2.0, (2, PAIRS))[:, None] / np.linalg.norm(places, axis=1)[:, None]
    return (*map(jnp.asarray, places), jnp.asarray(g.uniform(0.5, 5.0, PAIRS)))


def hard_pairs():
    """In the plane of the third axis, which half a turn leaves in doubt."""
    g = np.random.default_rng(6)
    aside = 10.0 ** g.uniform(-4.0, 0.0, CHECKED)
    angle = np.choose(
        g.integers(0, 4, CHECKED), [aside, np.pi - aside, np.pi + aside, 2.0 * np.pi - aside]
    )
    first, far = g.uniform(0.0, 2.0 * np.pi, CHECKED), g.uniform(0.5, 2.0, (2, CHECKED))
    places = [
        d * np.stack([np.cos(f), np.sin(f), 0.0 * f])
        for d, f in zip(far, (first, first + angle), strict=True)
    ]
    return (*map(jnp.asarray, places), jnp.asarray(10.0 ** g.uniform(-2.0, 2.0, CHECKED)))


def miss(start, end, duration, velocity) -> float:
    """The worst distance from the `end`, as a part of its own from the centre, of the CHECKED first
    arrivals."""
    start, end, duration, velocity = (
        np.asarray(x)[..., :CHECKED] for x in (start, end, duration, velocity)
    )
    found = np.stack(
        [exact_position(start[:, k], velocity[:, k], duration[k]) for k in range(CHECKED)], axis=1
    )
    return float(np.max(np.linalg.norm(found - end, axis=0) / np.linalg.norm(end, axis=0)))


def measure() -> dict:
    """Pairs per second of the solution, of its reverse mode and of the peer, and the worst errors
    of the samples."""
    given, hard = pairs(), hard_pairs()

    def gradient(*block):
        return jax.grad(lambda *block: jnp.sum(lambert(*block, 1.0)[0]), argnums=(0, 1, 2))(*block)

    def solve(*block):
        return lambert(*block, 1.0)

    (alone, together), (gradient_alone, _) = in_blocks(solve, given), in_blocks(gradient, given)
    calls = {
        "ours, in blocks": alone,
        "ours, in blocks, with reverse mode": gradient_alone,
        "ours, in blocks on every core": together,
    }
    seen = in_turn(calls, PAIRS)
    found = {
        "ours, in blocks on every core": (np.asarray(together()[0])[0], jax.jit(solve)(*hard)[0])
    }
    if peer := pykep(
        "lambert_problem",
        *(jnp.concatenate(both, axis=-1) for both in zip(given, hard, strict=True)),
    ):
        seen["pykep"], velocities = peer
        found["pykep"] = (velocities, velocities[:, PAIRS:])
    for name, (usual, rare) in found.items():
        seen[name]["worst_miss"] = miss(*given, usual)
        seen[name]["of_hard_transfers"] = miss(*hard, rare)
    seen["ours, in blocks, with reverse mode"]["times_the_run"] = (
        seen["ours, in blocks"]["runs_per_cpu_second"]
        / seen["ours, in blocks, with reverse mode"]["runs_per_cpu_second"]
    )
    return seen
