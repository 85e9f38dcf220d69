"""Conversion of a million states on all conics to classical, modified equinoctial and equinoctial
elements and back. The compiled conversions, on one array and distributed over all cores, are
compared with the same formulas in NumPy on whole arrays, with Newton iterations for Kepler's
equation. "In one loop" applies both conversions to one block of states at a time (`core.in_blocks`
around both) with the widest vectors, so that the elements remain in the cache. "In place"
overwrites the states, which are donated, with the results. The error is the relative error of the
position after both conversions; in place, after as many conversions as were timed. The last rows
are lower bounds of the time: a million sines and a million arctangents, in XLA, in NumPy and in the
vector functions of jaxspace, and the negation of all values, which has the memory traffic of
reading and writing the states. With new memory the negation takes five times as long as in place,
because the operating system maps each page on first access."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.core.blocks import in_blocks
from jaxspace.core.trigonometry import atan2, sincos
from jaxspace.orbits import ClassicalElements, EquinoctialElements, ModifiedEquinoctialElements
from jaxspace.orbits.elements import elements_from_state, state_from_elements

from ._measure import BLOCK, WIDE, in_turn, on_one_device, worst

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


def numpy_modified(r: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
    """p, f, g, h, k and the true longitude."""
    w, size = np.cross(r, v, axis=0), np.linalg.norm(r, axis=0)
    eccentric, hh = np.cross(v, w, axis=0) - r / size, np.sum(w * w, axis=0)
    per = 1.0 / (np.sqrt(hh) + w[2])
    h, k = -w[1] * per, w[0] * per
    F, G = numpy_axes(h, k)
    L = np.arctan2(np.sum(r * G, axis=0), np.sum(r * F, axis=0))
    return hh, np.sum(eccentric * F, axis=0), np.sum(eccentric * G, axis=0), h, k, L


def numpy_axes(h: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The unit vectors F and G."""
    hh, kk, hk = h * h, k * k, 2.0 * h * k
    per = 1.0 / (1.0 + hh + kk)
    return per * np.stack([1.0 + hh - kk, hk, -2.0 * k]), per * np.stack(
        [hk, 1.0 - hh + kk, 2.0 * h]
    )


def numpy_of_modified(p, f, g, h, k, L) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity."""
    F, G = numpy_axes(h, k)
    c, s = np.cos(L), np.sin(L)
    size, speed = p / (1.0 + f * c + g * s), 1.0 / np.sqrt(p)
    return size * (c * F + s * G), speed * ((f + c) * G - (g + s) * F)


def numpy_equinoctial(r: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
    """a, f, g, h, k and the mean longitude, from the eccentric anomaly."""
    p, f, g, h, k, L = numpy_modified(r, v)
    e, turn = np.hypot(f, g), np.arctan2(g, f)
    a = p / (1.0 - e * e)
    x = np.sqrt(np.abs((1.0 - e) / (1.0 + e))) * np.tan(0.5 * (L - turn))
    with np.errstate(invalid="ignore"):
        E, H = 2.0 * np.arctan(x), 2.0 * np.arctanh(x)
        mean = np.where(e < 1.0, E - e * np.sin(E), e * np.sinh(H) - H)
    return a, f, g, h, k, turn + mean


def numpy_of_equinoctial(a, f, g, h, k, mean) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity: Kepler's equation by Newton's method, ellipses and hyperbolas each at
    once, until all have converged."""
    e, turn = np.hypot(f, g), np.arctan2(g, f)
    closed = e < 1.0
    anomaly = np.empty_like(e)
    for some, open_ in ((closed, False), (~closed, True)):
        ee, m = e[some], (mean - turn)[some]
        m = m if open_ else np.remainder(m + np.pi, 2.0 * np.pi) - np.pi
        x = np.arcsinh(m / ee) if open_ else m + np.sign(m) * 0.85 * ee
        for _ in range(50):
            if open_:
                step = (ee * np.sinh(x) - x - m) / (ee * np.cosh(x) - 1.0)
            else:
                step = (x - ee * np.sin(x) - m) / (1.0 - ee * np.cos(x))
            x = x - step
            if np.max(np.abs(step)) < 1e-14 * max(1.0, np.max(np.abs(x))):
                break
        half = np.tanh(0.5 * x) if open_ else np.tan(0.5 * x)
        anomaly[some] = 2.0 * np.arctan(np.sqrt(np.abs((1.0 + ee) / (1.0 - ee))) * half)
    return numpy_of_modified(a * (1.0 - e * e), f, g, h, k, turn + anomaly)


def _classical(r, v):
    return state_from_elements(elements_from_state(r, v, 1.0), 1.0)


def _modified(r, v):
    return ModifiedEquinoctialElements.of_state(r, v, 1.0).state(1.0)


def _equinoctial(r, v):
    return EquinoctialElements.of_state(r, v, 1.0).state(1.0)


KINDS = {
    "classical": (_classical, numpy_elements, numpy_state),
    "modified equinoctial": (_modified, numpy_modified, numpy_of_modified),
    "equinoctial": (_equinoctial, numpy_equinoctial, numpy_of_equinoctial),
}


def one_loop(work):
    """`work` for a block of states after the other."""
    return lambda r, v: in_blocks(work, (1, 1), r, v)


def in_place(work):
    """`work` for a block after the other, each written where it was read."""

    def step(k, states):
        block = [jax.lax.dynamic_slice_in_dim(x, k * BLOCK, BLOCK, -1) for x in states]
        return tuple(
            jax.lax.dynamic_update_slice_in_dim(x, new, k * BLOCK, -1)
            for x, new in zip(states, work(*block), strict=True)
        )

    return lambda r, v: jax.lax.fori_loop(0, r.shape[-1] // BLOCK, step, (r, v))


def shared_out(work, r, v, *, donate=False, **how):
    """A call of `work` on the states shared out among all devices; on those that the last call left
    where they are donated."""
    mesh = jax.make_mesh((len(jax.devices()),), ("runs",))
    spread = jax.sharding.PartitionSpec(None, "runs")
    # Copies, because what is donated is gone afterwards.
    given = jax.device_put((jnp.array(r), jnp.array(v)), jax.sharding.NamedSharding(mesh, spread))
    call = jax.jit(
        jax.shard_map(
            work, mesh=mesh, in_specs=(spread, spread), out_specs=spread, check_vma=False
        ),
        donate_argnums=(0, 1) if donate else (),
        **how,
    )
    if not donate:
        return lambda: call(*given)
    held = [given]

    def again():
        held[0] = call(*held[0])
        return held[0]

    return again


def functions(x) -> dict:
    """Calls of single functions of a million numbers, or of pairs of them."""
    x, y = on_one_device((jnp.asarray(x[0]), jnp.asarray(x[1])))
    array = np.asarray(x), np.asarray(y)
    compiled = {
        "sine and cosine, XLA": jax.jit(lambda x, y: (jnp.sin(x), jnp.cos(x))),
        "sine and cosine, ours": jax.jit(lambda x, y: sincos(x)),
        "arctangent of a point, XLA": jax.jit(lambda x, y: jnp.arctan2(y, x)),
        "arctangent of a point, ours": jax.jit(lambda x, y: atan2(y, x)),
    }
    calls = {name: lambda f=f: f(x, y) for name, f in compiled.items()}
    calls["sine and cosine, NumPy"] = lambda: (np.sin(array[0]), np.cos(array[0]))
    calls["arctangent of a point, NumPy"] = lambda: np.arctan2(array[1], array[0])
    return calls


def traffic(r, v) -> dict:
    """Calls that read and write all states, and do nothing else worth a time."""

    def scaled(r, v):
        return -r, -v

    return {
        "traffic alone, every core": shared_out(scaled, r, v),
        "traffic alone, in place, every core": shared_out(scaled, r, v, donate=True),
    }


def measure() -> dict:
    """States a second by each way, and errors."""
    r, v = on_one_device(jax.jit(lambda x: state_from_elements(x, 1.0))(elements()))
    array = np.asarray(r), np.asarray(v)
    calls, peers = {}, {}
    for kind, (work, there, back) in KINDS.items():
        whole = jax.jit(work)
        calls |= {
            f"NumPy, {kind}": lambda there=there, back=back: back(*there(*array)),
            f"ours, {kind}, one array": lambda whole=whole: whole(r, v),
            f"ours, {kind}, every core": shared_out(work, r, v),
            f"ours, {kind}, one loop, every core": shared_out(
                one_loop(work), r, v, compiler_options=WIDE
            ),
            f"ours, {kind}, in place, every core": shared_out(
                in_place(work), r, v, donate=True, compiler_options=WIDE
            ),
        }
        peers |= dict.fromkeys(list(calls)[-5:], f"NumPy, {kind}")
    rows = in_turn(calls | functions(array[0]) | traffic(r, v), STATES)
    for name, peer in peers.items():
        for speed in ("runs_per_second", "runs_per_cpu_second"):
            rows[name][f"{speed}_over_numpy"] = rows[name][speed] / rows[peer][speed]
        rows[name]["worst_position_error"] = worst(calls[name]()[0], array[0])
    return rows
