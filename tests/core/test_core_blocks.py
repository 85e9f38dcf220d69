"""Vectors of sines, cosines and angles beside forty digits, and long arrays in blocks."""

from unittest.mock import Mock

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jaxspace import core
from jaxspace.core.blocks import BLOCK
from jaxspace.orbits.elements import elements_from_state, state_from_elements
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.simulation import blocks


def _units(found, exact):
    """The worst error in units of the last place of the result."""
    with mpmath.workdps(40):
        return max(
            float(abs(mpmath.mpf(float(a)) - b)) / np.spacing(abs(float(b)))
            for a, b in zip(found, exact, strict=True)
        )


def test_sines_and_cosines_of_angles():
    g = np.random.default_rng(0)
    x = np.concatenate(
        [
            g.uniform(-10.0, 10.0, 1000),
            g.uniform(-1e6, 1e6, 1000),
            10.0 ** g.uniform(-300.0, 0.0, 200),
            np.arange(1, 41) * np.pi / 4,
        ]
    )
    with mpmath.workdps(40):
        truth = [[f(mpmath.mpf(float(v))) for v in x] for f in (mpmath.sin, mpmath.cos)]
    for found, exact in zip(jax.jit(core.trigonometry.sincos)(x), truth, strict=True):
        assert _units(np.asarray(found), exact) < 2.0
    s, c = core.trigonometry.sincos(jnp.array([0.0, -0.0, 1e9, jnp.inf]))
    assert list(s[:2]) == [0.0, 0.0] and list(c[:2]) == [1.0, 1.0]
    # Beyond 1e6 the rounding of the argument bounds what it can be.
    assert abs(s[2] - np.sin(1e9)) < np.spacing(1e9) and np.isnan(s[3])


def test_angles_of_points():
    g = np.random.default_rng(1)
    y, x = g.normal(size=(2, 2000)) * 10.0 ** g.uniform(-30.0, 30.0, (2, 2000))
    y[:1000], x[:1000] = g.normal(size=(2, 1000))
    with mpmath.workdps(40):
        exact = [mpmath.atan2(float(a), float(b)) for a, b in zip(y, x, strict=True)]
    assert _units(np.asarray(jax.jit(core.trigonometry.atan2)(y, x)), exact) < 2.0
    sides = np.array([(a, b) for a in (0.0, -0.0, 1.0, -1.0) for b in (1.0, -1.0, 0.0)])
    np.testing.assert_array_equal(
        core.trigonometry.atan2(*jnp.asarray(sides.T)), np.arctan2(*sides.T)
    )


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_their_derivatives(dtype):
    x = jnp.asarray(np.random.default_rng(2).normal(size=50), dtype)
    y = jnp.flip(x) + 0.1
    close = {"rtol": 20 * float(jnp.finfo(dtype).eps), "atol": 20 * float(jnp.finfo(dtype).eps)}

    def ours(x):
        return jnp.sum(
            core.trigonometry.sincos(x)[0] * core.trigonometry.sincos(y)[1]
            + core.trigonometry.atan2(y, x)
        )

    def theirs(x):
        return jnp.sum(jnp.sin(x) * jnp.cos(y) + jnp.arctan2(y, x))

    assert ours(x).dtype == dtype
    for derivative in (jax.grad, jax.jacfwd, lambda f: jax.jacfwd(jax.grad(f))):
        both = jax.jit(lambda x, f=derivative: (f(ours)(x), f(theirs)(x)))(x)
        np.testing.assert_allclose(*both, **close)


RUNS = 5 * BLOCK + 7


@pytest.fixture(scope="module")
def states():
    g = np.random.default_rng(3)
    r, v = g.normal(size=(2, 3, RUNS))
    return jnp.asarray(r), jnp.asarray(v)


def test_blocks_give_what_the_function_gives(states):
    r, v = states

    def work(r, v, mu):
        return {"momentum": core.vectors.cross(r, v), "size": core.vectors.norm(r) * mu}

    # Some arguments serve all runs, and the last block is no whole one.
    for args in ((r, v, jnp.asarray(2.0)), (r, v[:, :1], jnp.arange(1.0, RUNS + 1.0))):
        blocks = jax.jit(lambda *args: core.blocks.in_blocks(work, (1, 1, 0), *args))
        found, expected = blocks(*args), work(*args)
        # Two programs round differently: a component of a product by its terms.
        terms = core.vectors.norm(args[0]) * core.vectors.norm(args[1])
        assert np.all(np.abs(found["momentum"] - expected["momentum"]) <= 1e-15 * terms)
        np.testing.assert_allclose(found["size"], expected["size"], rtol=1e-15)
        assert "while" in blocks.lower(*args).compile().as_text()
    # Few runs stay in one piece.
    few = jax.jit(lambda *args: core.blocks.in_blocks(work, (1, 1, 0), *args))
    assert "while" not in few.lower(r[:, :99], v[:, :99], 2.0).compile().as_text()


def test_blocks_have_the_derivatives_of_the_function(states):
    r, v = states

    def size(r, v):
        return core.blocks.in_blocks(lambda r, v: core.vectors.dot(r, v) ** 2, (1, 1), r, v)

    along, across = jax.jit(lambda r, v: jax.jvp(size, (r, v), (v, r)))(r, v)
    reverse = jax.jit(jax.grad(lambda r: jnp.sum(size(r, v))))(r)
    # A product of vectors has the rounding of its terms, which may be far larger than their sum.
    product, terms = core.vectors.dot(r, v), core.vectors.dot(jnp.abs(r), jnp.abs(v))
    both = core.vectors.dot(r, r) + core.vectors.dot(v, v)
    assert np.all(np.abs(along - product**2) <= 1e-14 * terms**2)
    assert np.all(np.abs(across - 2.0 * product * both) <= 1e-14 * terms * both)
    assert np.all(np.abs(reverse - 2.0 * product * v) <= 1e-14 * terms * np.abs(v))


def test_long_arrays_of_orbits(states):
    """A state to its elements, back and along the orbit, beside the same a few at a time."""
    r, v = states

    def there_and_back(r, v):
        x = elements_from_state(r, v, 1.0)
        return x, state_from_elements(x, 1.0), kepler_flow(r, v, 0.5, 1.0)

    work = jax.jit(there_and_back)
    whole, (x, back, later) = work(r, v), work(r[:, -40:], v[:, -40:])
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a[..., -40:], b, rtol=1e-13, atol=1e-13),
        whole,
        (x, back, later),
    )
    # A near miss of the centre in a hundred thousand loses its digits to the nodes' tilt.
    gap = np.linalg.norm(whole[1][0] - r, axis=0) / np.linalg.norm(r, axis=0)
    assert np.median(gap) < 1e-15 and np.max(gap) < 1e-10


@pytest.mark.parametrize("runs", [1, 10_000, 262_145, 1_000_000, 10_000_000])
@pytest.mark.parametrize("devices", [1, 3])
def test_blocks_of_an_accelerator_are_alike(runs, devices, monkeypatch):
    """None wider than what keeps it busy, and no more of them than that requires."""
    monkeypatch.setattr(blocks, "_mesh_of", lambda devices: None)
    size = blocks.Blocks.on([Mock(jax.Device, platform="gpu")] * devices, runs).size
    share = -(-runs // devices)
    count = -(-share // size)
    assert size <= blocks.ACCELERATOR_BLOCK and size % blocks.BLOCK == 0
    assert count == -(-share // blocks.ACCELERATOR_BLOCK)
    assert count * size - share < count * blocks.BLOCK
