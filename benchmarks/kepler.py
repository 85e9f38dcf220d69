"""Propagation of a million states on ellipses and hyperbolas in closed form. The errors are those
of a sample compared with forty digits, and of a sample of strong hyperbolas. pykep runs on one
core, with lists prepared in advance and without storing its results.

In blocks: a thousand states at a time, arrays (blocks, 3, 1024). Ours give the whole state, as
pykep does; pykep moves the first 2^16 states only, and has its own process."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.orbits import ClassicalElements
from jaxspace.orbits.elements import state_from_elements
from jaxspace.orbits.kepler import kepler_flow

from ._measure import exact_position, in_blocks, in_turn, pykep

STATES, PEERS, CHECKED = 2**20, 2**16, 200


def states():
    """Three fifths ellipses up to e = 0.95, two fifths hyperbolas from 1.05 to 4, anywhere on the
    orbit; gravitational parameter 1."""
    g = np.random.default_rng(1)
    e = np.where(
        g.uniform(size=STATES) < 0.4, g.uniform(1.05, 4.0, STATES), g.uniform(0.0, 0.95, STATES)
    )
    p = g.uniform(0.5, 2.0, STATES) * (1.0 + e)
    furthest = np.where(e > 1.0, 0.8 * np.arccos(-1.0 / np.maximum(e, 1.0)), np.pi)
    anomaly = g.uniform(-1.0, 1.0, STATES) * furthest
    i, (node, periapsis) = (
        np.arccos(g.uniform(-1.0, 1.0, STATES)),
        g.uniform(0.0, 2.0 * np.pi, (2, STATES)),
    )
    r, v = state_from_elements(
        ClassicalElements(*map(jnp.asarray, (p, e, i, node, periapsis, anomaly))), 1.0
    )
    return r, v, jnp.asarray(g.uniform(-10.0, 10.0, STATES))


def strong_hyperbolas():
    """Eccentricities from 1.001 to 1000, from and to anywhere on the way."""
    g = np.random.default_rng(2)
    e, f = 1.0 + 10.0 ** g.uniform(-3.0, 3.0, CHECKED), g.uniform(-0.98, 0.98, CHECKED)
    p, f = 1.0 + e, f * np.arccos(-1.0 / e)
    level, size = np.zeros(CHECKED), p / (1.0 + e * np.cos(f))
    r, v = state_from_elements(
        ClassicalElements(*map(jnp.asarray, (p, e, level, level, level, f))), 1.0
    )
    return (
        r,
        v,
        jnp.asarray(
            size
            * np.sqrt(size)
            * 10.0 ** g.uniform(-3.0, 2.0, CHECKED)
            * g.choice([-1.0, 1.0], CHECKED)
        ),
    )


def error(found, expected) -> float:
    """The worst relative error of positions (3, CHECKED)."""
    found = np.asarray(found)[:, :CHECKED]
    return float(
        np.max(np.linalg.norm(found - expected, axis=0) / np.linalg.norm(expected, axis=0))
    )


def measure() -> dict:
    """States per second of the flow, of its reverse mode and of the peer, and the worst relative
    error of the samples."""
    r, v, t = states()
    flow = jax.jit(lambda r, v, t: kepler_flow(r, v, t, 1.0))
    gradient = jax.jit(jax.grad(lambda r, v, t: jnp.sum(kepler_flow(r, v, t, 1.0)[0][0])))
    alone, together = in_blocks(lambda *block: kepler_flow(*block, 1.0), (r, v, t))
    calls = {
        "ours, one array": lambda: flow(r, v, t),
        "ours, one array, with reverse mode": lambda: gradient(r, v, t),
        "ours, in blocks": alone,
        "ours, in blocks on every core": together,
    }
    seen, strong = in_turn(calls, STATES), strong_hyperbolas()
    found = {
        "ours, one array": (flow(r, v, t)[0], flow(*strong)[0]),
        "ours, in blocks on every core": (np.asarray(together()[0])[0],),
    }
    some = (
        jnp.concatenate([x[..., :PEERS], y], axis=-1)
        for x, y in zip((r, v, t), strong, strict=True)
    )
    if peer := pykep("propagate_lagrangian", *some):
        seen["pykep"], positions = peer
        found["pykep"] = (positions, positions[:, PEERS:])
    for which, (column, start) in enumerate(
        (("worst_position_error", (r, v, t)), ("of_strong_hyperbolas", strong))
    ):
        first = [np.asarray(x[..., :CHECKED]) for x in start]
        expected = np.stack(
            [exact_position(*(x[..., k] for x in first)) for k in range(CHECKED)], axis=1
        )
        for name, positions in found.items():
            if which < len(positions):
                seen[name][column] = error(positions[which], expected)
    seen["ours, one array, with reverse mode"]["times_the_run"] = (
        seen["ours, one array"]["runs_per_cpu_second"]
        / seen["ours, one array, with reverse mode"]["runs_per_cpu_second"]
    )
    return seen
