"""A million states of all conics to classical, modified equinoctial and equinoctial elements, and
back: compiled, in one array and in blocks on every core, beside the formulas of the textbooks for
the classical ones in NumPy, whole arrays at a time. The error is that of the position after both
ways, relative."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.orbits import (
    ClassicalElements,
    EquinoctialElements,
    ModifiedEquinoctialElements,
    elements_from_state,
    state_from_elements,
)

from ._measure import in_blocks, in_turn, on_one_device, worst

STATES = 2**20


def elements() -> ClassicalElements:
    """Ellipses up to e = 0.95 and hyperbolas up to 3, anywhere; gravitational parameter 1."""
    g = np.random.default_rng(3)
    hyperbola = g.uniform(size=STATES) < 0.3
    e = np.where(hyperbola, g.uniform(1.05, 3.0, STATES), g.uniform(0.0, 0.95, STATES))
    furthest = np.where(hyperbola, 0.8 * np.arccos(-1.0 / np.maximum(e, 1.0)), np.pi)
    p = g.uniform(0.5, 2.0, STATES) * (1.0 + e)
    i = np.arccos(g.uniform(-1.0, 1.0, STATES))
    node, turn = g.uniform(0.0, 2.0 * np.pi, (2, STATES))
    anomaly = g.uniform(-1.0, 1.0, STATES) * furthest
    return ClassicalElements(*map(jnp.asarray, (p, e, i, node, turn, anomaly)))


def numpy_elements(r: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
    """p, e and four angles by h, e and the node as vectors."""
    h = np.cross(r, v, axis=0)
    size = np.linalg.norm(r, axis=0)
    eccentric = np.cross(v, h, axis=0) - r / size
    hh, e = np.linalg.norm(h, axis=0), np.linalg.norm(eccentric, axis=0)
    node = np.stack([-h[1], h[0]])
    across = np.stack([-h[2] * node[1], h[2] * node[0], h[0] * node[1] - h[1] * node[0]]) / hh
    turn = np.arctan2(np.sum(eccentric * across, axis=0), np.sum(eccentric[:2] * node, axis=0))
    outwards = np.sum(r * np.cross(h, eccentric, axis=0), axis=0) / hh
    anomaly = np.arctan2(outwards, np.sum(r * eccentric, axis=0))
    tilt = np.arctan2(np.hypot(h[0], h[1]), h[2])
    return hh * hh, e, tilt, np.arctan2(node[1], node[0]), turn, anomaly


def numpy_state(p, e, i, node, turn, anomaly) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity by the matrix of the three angles."""
    cn, sn, ci, si = np.cos(node), np.sin(node), np.cos(i), np.sin(i)
    cw, sw = np.cos(turn), np.sin(turn)
    x = np.stack([cn * cw - sn * sw * ci, sn * cw + cn * sw * ci, sw * si])
    y = np.stack([-cn * sw - sn * cw * ci, -sn * sw + cn * cw * ci, cw * si])
    c, s = np.cos(anomaly), np.sin(anomaly)
    size = p / (1.0 + e * c)
    speed = 1.0 / np.sqrt(p)
    return size * (c * x + s * y), speed * (-s * x + (e + c) * y)


def to_and_back(kind: str):
    """The states by way of one kind of elements."""

    def classical(r, v):
        return state_from_elements(elements_from_state(r, v, 1.0), 1.0)

    def modified(r, v):
        return ModifiedEquinoctialElements.of_state(r, v, 1.0).state(1.0)

    def equinoctial(r, v):
        return EquinoctialElements.of_state(r, v, 1.0).state(1.0)

    return {"classical": classical, "modified equinoctial": modified, "equinoctial": equinoctial}[
        kind
    ]


def measure() -> dict:
    """States a second by each way, and errors."""
    r, v = on_one_device(jax.jit(lambda x: state_from_elements(x, 1.0))(elements()))
    array = np.asarray(r), np.asarray(v)
    calls = {"NumPy, classical": lambda: numpy_state(*numpy_elements(*array))}
    for kind in ("classical", "modified equinoctial", "equinoctial"):
        work = to_and_back(kind)
        whole = jax.jit(work)
        _, shared = in_blocks(work, (r, v))
        calls[f"ours, {kind}, one array"] = lambda whole=whole: whole(r, v)
        calls[f"ours, {kind}, in blocks on every core"] = shared
    rows = in_turn(calls, STATES)
    base = rows["NumPy, classical"]["runs_per_cpu_second"]
    for name, call in calls.items():
        rows[name]["times_numpy_per_cpu_second"] = rows[name]["runs_per_cpu_second"] / base
        found = np.asarray(call()[0])
        if found.ndim == 2:
            rows[name]["worst_position_error"] = worst(found, array[0])
    return rows
