"""A million states on ellipses and hyperbolas moved along by the closed form, with the error of a sample against forty digits."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np

from jaxspace.orbits import ClassicalElements, kepler_flow, state_from_elements

from ._measure import in_turn

STATES, CHECKED = 2**20, 200


def states():
    """Three fifths ellipses up to e = 0.95, two fifths hyperbolas from 1.05 to 4, anywhere on the orbit; centre of strength 1."""
    g = np.random.default_rng(1)
    e = np.where(g.uniform(size=STATES) < 0.4, g.uniform(1.05, 4.0, STATES), g.uniform(0.0, 0.95, STATES))
    p = g.uniform(0.5, 2.0, STATES) * (1.0 + e)
    furthest = np.where(e > 1.0, 0.8 * np.arccos(-1.0 / np.maximum(e, 1.0)), np.pi)
    anomaly = g.uniform(-1.0, 1.0, STATES) * furthest
    i, (node, periapsis) = np.arccos(g.uniform(-1.0, 1.0, STATES)), g.uniform(0.0, 2.0 * np.pi, (2, STATES))
    r, v = state_from_elements(ClassicalElements(*map(jnp.asarray, (p, e, i, node, periapsis, anomaly))), 1.0)
    return r, v, jnp.asarray(g.uniform(-10.0, 10.0, STATES))


def exact(r, v, t):
    """The position after the time `t` in forty digits, by Kepler's equation in the universal anomaly."""
    with mpmath.workdps(40):
        r, v, t = [mpmath.mpf(float(x)) for x in r], [mpmath.mpf(float(x)) for x in v], mpmath.mpf(float(t))
        size, sigma = mpmath.sqrt(mpmath.fdot(r, r)), mpmath.fdot(r, v)
        beta = 2 / size - mpmath.fdot(v, v)
        root = mpmath.sqrt(beta)  # imaginary on a hyperbola: the functions below are real all the same

        def g(x):
            c, s = mpmath.re(mpmath.cos(root * x)), mpmath.re(mpmath.sin(root * x) / root)
            return s, (1 - c) / mpmath.re(root**2), (x - s) / mpmath.re(root**2)

        def late(x):
            g1, g2, g3 = g(x)
            return size * g1 + sigma * g2 + g3 - t

        low, high = mpmath.mpf(-1), mpmath.mpf(1)
        while late(low) > 0:
            low *= 2
        while late(high) < 0:
            high *= 2
        x = mpmath.findroot(late, (low, high), solver="anderson", tol=1e-60, maxsteps=500, verify=False)
        _, g2, g3 = g(x)
        return np.array([float((1 - g2 / size) * a + (t - g3) * b) for a, b in zip(r, v, strict=True)])


def measure() -> dict:
    """States per second of the flow and of its reverse mode, and the worst relative error of a sample."""
    r, v, t = states()
    flow = jax.jit(lambda r, v, t: kepler_flow(r, v, t, 1.0)[0])
    slope = jax.jit(jax.grad(lambda r: jnp.sum(kepler_flow(r, v, t, 1.0)[0][0])))
    calls = {"ours": lambda: flow(r, v, t), "ours, with reverse mode": lambda: slope(r)}
    seen = in_turn(calls, STATES)
    found = np.asarray(flow(r, v, t))[:, :CHECKED]
    expected = np.stack([exact(r[:, k], v[:, k], t[k]) for k in range(CHECKED)], axis=1)
    errors = np.linalg.norm(found - expected, axis=0) / np.linalg.norm(expected, axis=0)
    seen["ours"]["worst_relative_error"] = float(errors.max())
    seen["ours, with reverse mode"]["times_the_run"] = (
        seen["ours"]["runs_per_cpu_second"] / seen["ours, with reverse mode"]["runs_per_cpu_second"]
    )
    return seen
