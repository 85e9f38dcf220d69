"""The rule of shapes: components lead, then times, then runs; everything else is one sentence."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import core
from jaxspace.bodies import BodyState
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.rotations.euler_angles import omega_from_euler_rates

TIMES, RUNS = 5, 4

# Every case is a call that a wrong first axis must stop, with what the sentence names. They run in
# an interpreter without the instrumentation of these tests, which would stop them before.
CASES = {
    "vectors.dot(rows, rows)": "dot: a has the shape (201, 3): its first axis must have the 3 "
    "components (components first, then times, batch axis last).",
    "vectors.dot(v, rows)": "dot: b has the shape (201, 3)",
    "vectors.cross(rows, v)": "cross: a has the shape (201, 3)",
    "vectors.norm(rows)": "norm: a has the shape (201, 3)",
    "vectors.unit(rows)": "unit: a has the shape (201, 3)",
    "vectors.inverse_norm(rows)": "inverse_norm: a has the shape (201, 3)",
    "vectors.scale(1.0, rows)": "scale: a has the shape (201, 3)",
    "vectors.matvec(m, rows)": "matvec: a has the shape (201, 3)",
    "vectors.matvec(rows, v)": "matvec: m has the shape (201, 3): its first two axes",
    "vectors.solve3(m, rows)": "solve3: b has the shape (201, 3)",
    "jax.jit(vectors.norm)(rows)": "norm: a has the shape (201, 3)",
    "jax.grad(lambda x: vectors.dot(x, x)[0])(rows)": "dot: a has the shape (201, 3)",
    "vectors.norm(jnp.ones(()))": "norm: a has the shape ()",
    "Quaternion(jnp.ones((201, 4)))": "Quaternion.wxyz has the shape (201, 4): its first axis must "
    "have the 4 components",
    "Quaternion.from_xyzw(jnp.ones((201, 4)))": "Quaternion.from_xyzw: xyzw",
    "Quaternion.from_matrix(jnp.ones((201, 3, 3)))": "Quaternion.from_matrix: m",
    "Quaternion.from_rotation_vector(rows)": "Quaternion.from_rotation_vector: angle_axis",
    "q.rotate(rows)": "Quaternion.rotate: v_B has the shape (201, 3)",
    "q.rotate_back(rows)": "Quaternion.rotate_back: v_N",
    "q.rate(rows)": "Quaternion.rate: omega_B",
    "q.moved(rows)": "Quaternion.moved: local",
    "q.coordinate_rate(rows, q)": "Quaternion.coordinate_rate: local",
    "wrong.matrix()": "Quaternion.wxyz has the shape (201, 4)",
    "wrong.xyzw()": "Quaternion.wxyz",
    "wrong.norm_squared": "Quaternion.wxyz",
    "wrong.normalised()": "Quaternion.wxyz",
    "wrong.inverse()": "Quaternion.wxyz",
    "wrong.then(q)": "Quaternion.wxyz",
    "q.then(wrong)": "Quaternion.wxyz",
    "wrong.rotate(v)": "Quaternion.wxyz",
    "wrong.rotate_back(v)": "Quaternion.wxyz",
    "wrong.rate(v)": "Quaternion.wxyz",
    "wrong.coordinates()": "Quaternion.wxyz",
    "wrong.coordinate_rate(v, q)": "Quaternion.wxyz",
    "wrong.rotation_vector()": "Quaternion.wxyz",
    "from_euler_angles(rows)": "angles has the shape (201, 3)",
    "omega_from_euler_rates(v, rows)": "rates has the shape (201, 3)",
    "euler_rates_from_omega(v, rows)": "omega has the shape (201, 3)",
    "BodyState(position=rows)": "BodyState.position has the shape (201, 3)",
    "BodyState(velocity=rows)": "BodyState.velocity",
    "BodyState(omega=np.ones((201, 3)))": "BodyState.omega",
    "BodyState(attitude=wrong)": "BodyState.attitude has the shape (201, 4)",
}
CHECK = """
import jax, jax.numpy as jnp, numpy as np
from jaxspace import core
from jaxspace.bodies import BodyState
from jaxspace.core import vectors
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.rotations.euler_angles import euler_rates_from_omega, omega_from_euler_rates
rows, v, m, q = jnp.ones((201, 3)), jnp.ones(3), jnp.eye(3), Quaternion.identity()
wrong = jax.tree.map(lambda x: jnp.ones((201, 4)), q)
for case, sentence in %r.items():
    try:
        eval(case)
    except core.InputError as error:
        if sentence not in str(error):
            print(case, "said", error)
    else:
        print(case, "passed")
for parts in (None, object(), 0, jax.ShapeDtypeStruct((201, 3), float)):
    BodyState(position=parts, velocity=parts, attitude=parts, omega=parts)
"""


def test_a_wrong_first_axis_is_one_sentence():
    code = CHECK % CASES
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr == "" and done.stdout == ""


def test_formulas_hold_along_a_trajectory_of_many_runs(key):
    """Every time and run gives what it gives alone; values differ by a few roundings at most."""
    a, b = jax.random.normal(key, (2, 3, TIMES, RUNS))
    q = Quaternion(jax.random.normal(key, (4, TIMES, RUNS)))
    angles = 0.1 + 0.5 * jnp.abs(a)

    def formulas(a, b, q, angles):
        return {
            "dot": core.vectors.dot(a, b),
            "cross": core.vectors.cross(a, b),
            "norm": core.vectors.norm(a),
            "unit": core.vectors.unit(a),
            "inverse norm": core.vectors.inverse_norm(a, 3),
            "rotate": q.rotate(a),
            "rotate back": q.rotate_back(a),
            "matrix": q.matrix(),
            "rate": q.rate(a).wxyz,
            "then": q.then(q.inverse()).wxyz,
            "rotation vector": q.rotation_vector(),
            "euler": from_euler_angles(angles, "321").wxyz,
            "euler rates": omega_from_euler_rates(angles, b),
        }

    at_once = formulas(a, b, q, angles)
    for place in ((0, 0), (3, 2), (TIMES - 1, RUNS - 1)):
        alone = formulas(*jax.tree.map(lambda x, p=place: x[:, *p], (a, b, q, angles)))
        jax.tree.map(
            lambda x, y, p=place: np.testing.assert_allclose(x[..., *p], y, rtol=1e-13, atol=1e-13),
            at_once,
            alone,
        )


# With three times or runs a vector could meet the wrong axis without an error.
@pytest.mark.parametrize("shape", [(3,), (3, 3), (3, 2, 3)])
def test_one_vector_meets_many_times_and_runs(shape, key):
    """A vector without axes, or with an axis of runs, gives what it gives repeated along them."""
    q = Quaternion(jax.random.normal(key, (4, *shape)))
    m = jax.random.normal(key, (3, 3, *shape))
    for v in (jnp.array([1.0, -2.0, 0.5]), jax.random.normal(key, (3, shape[-1]))):
        many = jnp.broadcast_to(core.shapes.with_rank(v, len(shape)), (3, *shape))
        s = q.wxyz[0]
        for found, expected in (
            (q.rotate(v), q.rotate(many)),
            (q.rotate_back(v), q.rotate_back(many)),
            (q.rate(v).wxyz, q.rate(many).wxyz),
            (core.vectors.dot(many, v), core.vectors.dot(many, many)),
            (core.vectors.cross(q.wxyz[1:], v), core.vectors.cross(q.wxyz[1:], many)),
            (core.vectors.matvec(m, v), core.vectors.matvec(m, many)),
            (core.vectors.scale(s, v), s * many),
        ):
            np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-14)
    fixed = Quaternion.about(1, jnp.array(0.3))
    np.testing.assert_allclose(
        q.then(fixed).matrix()[:, :, *(0,) * len(shape)],
        q.matrix()[:, :, *(0,) * len(shape)] @ fixed.matrix(),
        atol=1e-14,
    )
    # A matrix without axes meets many vectors.
    np.testing.assert_allclose(
        core.vectors.matvec(fixed.matrix(), q.wxyz[1:]), fixed.rotate(q.wxyz[1:]), atol=1e-14
    )


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives_of_products_of_unequal_rank(mode, key):
    """d(a . b) = da . b + a . db, where b has runs only: as many times as runs hide no mistake."""
    a = jax.random.normal(key, (3, 3, 3))
    b = jax.random.normal(key, (3, 3))
    weight = jax.random.normal(key, (3, 3))
    by_b = mode(lambda b: jnp.sum(weight * core.vectors.dot(a, b)))(b)
    np.testing.assert_allclose(by_b, jnp.sum(weight * a, axis=1), atol=1e-14)
    by_a = mode(lambda a: jnp.sum(weight * core.vectors.dot(a, b)))(a)
    np.testing.assert_allclose(by_a, weight * b[:, None], atol=1e-14)
    by_v = mode(lambda v: jnp.sum(weight * core.vectors.scale(a[0], v)[1]))(b[:, 0])
    np.testing.assert_allclose(by_v, [0.0, jnp.sum(weight * a[0]), 0.0], atol=1e-14)


def test_runs_last_and_runs_first(key):
    tree = {
        "state": BodyState(mass=jax.random.normal(key, (RUNS,))),
        "features": jax.random.normal(key, (RUNS, 7)),
        "layers": jax.random.normal(key, (RUNS, 2, 6)),
        "shared": jnp.array(2.0),
        "none": None,
    }
    last = core.shapes.runs_last(tree)
    assert last["features"].shape == (7, RUNS) and last["layers"].shape == (2, 6, RUNS)
    assert last["state"].mass.shape == (RUNS,) and last["shared"].shape == ()
    np.testing.assert_array_equal(last["features"], tree["features"].T)
    for f in (core.shapes.runs_first, jax.jit(core.shapes.runs_first)):
        jax.tree.map(np.testing.assert_array_equal, f(last), tree)
    # A state made by a network of many runs obeys the rule after the move.
    state = BodyState(position=core.shapes.runs_last(jnp.ones((RUNS, 3))))
    assert state.position.shape == (3, RUNS)


def test_runs_last_under_transformations(key):
    x = jax.random.normal(key, (2, RUNS, 3))
    np.testing.assert_array_equal(jax.vmap(core.shapes.runs_last)(x), jnp.swapaxes(x, 1, 2))
    weight = jax.random.normal(key, (3, RUNS))
    gradient = jax.grad(lambda x: jnp.sum(weight * core.shapes.runs_last(x)))(x[0])
    np.testing.assert_array_equal(gradient, weight.T)
    np.testing.assert_array_equal(
        jax.jvp(core.shapes.runs_first, (weight,), (2.0 * weight,))[1], 2.0 * weight.T
    )
