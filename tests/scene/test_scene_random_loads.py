"""Random accelerations, torques and factors: exact covariance, closed forms, linear covariance,
and runs that are independent of their neighbours."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Scene, Status, load, simulate, simulate_batch
from jaxspace.bodies import BodyState, ExponentialAtmosphere, RigidBody
from jaxspace.bodies.random_signals import Fluctuation, RandomSignal
from jaxspace.core import InputError
from jaxspace.dispersion import disperse, open_store
from jaxspace.orbits import Drag, PointGravity
from jaxspace.rotations import Quaternion
from jaxspace.scene.random_loads import RandomAcceleration, RandomTorque
from jaxspace.studies import propagate_covariance

RUNS = 1000
# Standard errors of a variance of 1000 runs are 4.5 percent of it.
FOUR_ERRORS = 4.0 * np.sqrt(2.0 / RUNS)
BODY = RigidBody(1.0)


def still(*runs):
    return BodyState(jnp.zeros((3, *runs)), jnp.zeros((3, *runs)))


def test_a_coloured_signal_has_its_covariance_at_the_values():
    """The correlation of x_j and x_k over many seeds is exp(-|t_j - t_k| / tau)."""
    signal = RandomSignal(jnp.arange(20_000.0), 4.0, 0.5, 1.3, 2)
    x = np.asarray(signal.data[:, :2])
    at = 0.5 * np.arange(9)
    expected = np.exp(-np.abs(at[:, None] - at) / 1.3)
    for component in (0, 1):
        np.testing.assert_allclose(np.cov(x[:, component]), expected, atol=0.05)
    assert np.abs(np.corrcoef(x[:, 0].ravel(), x[:, 1].ravel())[0, 1]) < 0.02


def test_a_signal_depends_on_its_seed_alone():
    many = RandomSignal(jnp.array([3.0, 1e6 / 7.0, 5.0]), 30.0, 1.0, 4.0, 3)
    for k, seed in enumerate([3.0, 1e6 / 7.0, 5.0]):
        one = RandomSignal(seed, 30.0, 1.0, 4.0, 3)
        np.testing.assert_array_equal(one.data, many.data[..., k])
        np.testing.assert_array_equal(one.at(7.3), many.at(7.3)[:, k])
    # Seeds that differ beyond single precision differ.
    other = RandomSignal(1e6 / 7.0 + 1e-8, 30.0, 1.0, 4.0, 3)
    assert np.abs(other.data - many.data[..., 1]).max() > 0.1
    # At the values, and with a continuous slope there.
    one = RandomSignal(3.0, 30.0, 1.0, 4.0)
    np.testing.assert_allclose(one.at(9.0), one.data[9, :1], rtol=1e-12)
    slope = jax.jacfwd(one.at)
    np.testing.assert_allclose(slope(9.0 - 1e-9), slope(9.0 + 1e-9), atol=1e-6)
    assert RandomSignal(jnp.float32(3.0), 30.0, 1.0).at(jnp.float32(2.5)).dtype == jnp.float32


def white(seeds, density, duration=40.0, step=0.5):
    return RandomAcceleration.white(density * jnp.ones(3), seeds, duration, step)


def test_white_noise_and_linear_covariance_agree_with_the_closed_form():
    """The velocity has the variance S t, the position S t^3/3, both the covariance S t^2/2."""
    density, t = 0.02, 40.0
    scene = Scene([white(jnp.arange(float(RUNS)), density)], BODY)
    run = simulate_batch(scene, still(RUNS), jnp.array([0.0, t]), accuracy=1e-6)
    assert np.all(run.status == Status.COMPLETED)
    x, v = np.asarray(run.final.position), np.asarray(run.final.velocity)
    # Components are independent: three times as many samples.
    exact = {"v": density * t, "x": density * t**3 / 3.0, "xv": density * t**2 / 2.0}
    np.testing.assert_allclose(np.mean(v**2), exact["v"], rtol=FOUR_ERRORS / 3.0**0.5)
    np.testing.assert_allclose(np.mean(x**2), exact["x"], rtol=FOUR_ERRORS / 3.0**0.5)
    np.testing.assert_allclose(np.mean(x * v), exact["xv"], rtol=FOUR_ERRORS / 3.0**0.5)
    assert np.abs(np.corrcoef(v)[0, 1]) < 0.13
    # Linear covariance has the same process noise, continuous.
    q = jnp.diag(jnp.array([0.0, 0.0, 0.0, density, density, density]))
    free = Scene([PointGravity(1e-30)], BODY)
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.zeros(3))
    _, covariance = propagate_covariance(free, y0, jnp.array([0.0, t]), noise=q)
    linear = np.asarray(covariance)[..., -1]
    np.testing.assert_allclose(np.diag(linear), [exact["x"]] * 3 + [exact["v"]] * 3, rtol=1e-6)


def test_coloured_noise_is_that_of_langevin():
    """2 sigma^2 tau (t - tau (1 - exp(-t/tau))) of the velocity."""
    sigma, tau, t = 0.1, 4.0, 40.0
    seeds = jnp.arange(float(RUNS))
    effect = RandomAcceleration.coloured(sigma * jnp.ones(3), tau, seeds, t, 0.5)
    run = simulate_batch(Scene([effect], BODY), still(RUNS), jnp.array([0.0, t]), accuracy=1e-6)
    exact = 2.0 * sigma**2 * tau * (t - tau * (1.0 - np.exp(-t / tau)))
    found = np.mean(np.asarray(run.final.velocity) ** 2)
    np.testing.assert_allclose(found, exact, rtol=FOUR_ERRORS / 3.0**0.5)


def test_a_run_is_the_same_in_any_batch_and_at_any_tolerance():
    seeds = jnp.array([11.0, 12.0, 13.0])
    ts = jnp.array([0.0, 10.0, 20.0])
    every = simulate_batch(Scene([white(seeds, 0.02)], BODY), still(3), ts, accuracy=1e-8)
    part = simulate_batch(Scene([white(seeds[1:2], 0.02)], BODY), still(1), ts, accuracy=1e-8)
    one = simulate(Scene([white(seeds[1], 0.02)], BODY), still(), ts, accuracy=1e-5)
    # The steps of a batch are those of all its runs: equal to the tolerance.
    np.testing.assert_allclose(part.final.position[:, 0], every.final.position[:, 1], rtol=1e-5)
    np.testing.assert_allclose(one.final.position, every.final.position[:, 1], rtol=1e-3)


def test_a_torque_in_body_axes():
    """A torque about z of a body with the inertia 2: the rate has the variance S t / 4."""
    seeds = jnp.arange(float(RUNS))
    torque = RandomTorque.white(jnp.array([0.0, 0.0, 0.08]), seeds, 20.0, 0.5)
    body = RigidBody(1.0, jnp.array([1.0, 1.0, 2.0]))
    attitude = Quaternion(jnp.zeros((4, RUNS)).at[0].set(1.0))
    y0 = BodyState(attitude=attitude, omega=jnp.zeros((3, RUNS)))
    run = simulate_batch(Scene([torque], body), y0, jnp.array([0.0, 20.0]), accuracy=1e-5)
    found = np.var(np.asarray(run.final.omega[2]))
    np.testing.assert_allclose(found, 0.08 * 20.0 / 4.0, rtol=FOUR_ERRORS)
    assert np.all(run.final.omega[:2] == 0.0)


def drag(fluctuation=None):
    return Drag(50.0, ExponentialAtmosphere(4e-12, 4e5, 6e4), 6.378e6, fluctuation=fluctuation)


def test_a_fluctuation_of_the_density_multiplies_the_drag():
    y = BodyState(jnp.array([6.778e6, 0.0, 0.0]), jnp.array([0.0, 7.7e3, 0.0]))
    noise = Fluctuation.coloured(0.2, 600.0, 4.0, 6000.0, 60.0)
    for t in (0.0, 100.0, 3210.0):
        found = drag(noise).load(jnp.asarray(t), y, BODY).acceleration_N
        plain = drag().load(jnp.asarray(t), y, BODY).acceleration_N
        np.testing.assert_allclose(found, noise.factor(t) * plain, rtol=1e-13)
    assert 0.3 < float(noise.factor(100.0)) < 1.7
    # Without it no operation is added: the field is absent from the tree.
    assert len(jax.tree.leaves(drag())) == len(jax.tree.leaves(drag(noise))) - 4
    flat = Fluctuation.white(0.6, 4.0, 6000.0, 60.0)
    np.testing.assert_allclose(flat.deviation, 0.1, rtol=1e-12)


def test_gradients_by_the_parameters():
    """The velocity is linear in the deviation; its slope by tau agrees with differences."""

    def speed(sigma, tau):
        effect = RandomAcceleration.coloured(sigma * jnp.ones(3), tau, 5.0, 20.0, 0.5)
        run = simulate(Scene([effect], BODY), still(), jnp.array([0.0, 20.0]), accuracy=1e-9)
        return run.final.velocity[0]

    value, slope = jax.value_and_grad(speed)(0.1, 3.0)
    np.testing.assert_allclose(slope, value / 0.1, rtol=1e-7)
    by_tau = jax.grad(speed, 1)(0.1, 3.0)
    difference = (speed(0.1, 3.001) - speed(0.1, 2.999)) / 0.002
    np.testing.assert_allclose(by_tau, difference, rtol=1e-4)
    zero = jax.grad(lambda s: white(5.0, s).load(1.0, still(), BODY).acceleration_N[0])(0.0)
    assert np.isfinite(zero)


def test_times_behind_the_signal_and_bad_numbers():
    scene = Scene([white(5.0, 0.02, duration=10.0)], BODY)
    run = simulate(scene, still(), jnp.array([0.0, 20.0]), accuracy=1e-5, throw=False)
    assert run.status == Status.OUTSIDE_MODEL
    for given, sentence in (
        ((1.0, 10.0, -1.0), "RandomSignal.step is -1"),
        ((1.0, 0.0, 1.0), "RandomSignal.duration is 0"),
        ((1.0, 1e7, 1.0), "RandomSignal.step is 1: it must be at least 1/200000"),
        ((1.0, 10.0, 1.0, 0.5), "RandomSignal.step is 1: it must be at most the correlation"),
        ((np.nan, 10.0, 1.0), "RandomSignal.seed"),
    ):
        with pytest.raises(InputError, match=sentence):
            RandomSignal(*given)
    with pytest.raises(InputError, match="deviation is 0.5"):
        Fluctuation.coloured(0.5, 10.0, 1.0, 100.0, 1.0)


SCENE = """
accuracy = 1e-6
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"
[effects.point_gravity]
[effects.random_acceleration]
density = [1e-6, 0.0, 0.0]
seed = 1.0
step = "10 s"
duration = "10 min"
[effects.drag]
ballistic_coefficient = 50.0
[effects.drag.atmosphere]
density = 4e-12
reference_height = "400 km"
scale_height = "60 km"
[effects.drag.fluctuation]
deviation = "20 %"
correlation_time = "2 min"
seed = 2.0
step = "20 s"
duration = "10 min"
[initial]
position = ["6778 km", 0.0, 0.0]
velocity = [0.0, "7.67 km/s", 0.0]
[times]
end = "10 min"
[dispersion]
runs = 16
outputs = ["speed", "final.velocity.0"]
[dispersion.inputs]
"effects.random_acceleration.seed" = { distribution = "uniform", low = 0.0, high = 1e9 }
"effects.drag.fluctuation.seed" = { distribution = "uniform", low = 0.0, high = 1e9 }
"effects.drag.fluctuation.deviation" = { distribution = "uniform", low = 0.1, high = 0.2 }
"""


def test_a_file_disperses_the_noise_and_extends_without_a_change(tmp_path):
    (tmp_path / "noise.toml").write_text(SCENE)
    file = load(tmp_path / "noise.toml")
    assert "RandomAcceleration" in file.system.explain()
    campaign = file.campaign()
    store = tmp_path / "noise.zarr"
    few = disperse(campaign, 8, seed=4, store=store)
    # Read now, because the store is extended below.
    before = {name: np.array(x) for name, x in few.outputs.items()}
    assert np.all(few.good) and np.std(before["final.velocity.0"]) > 0.0
    disperse(campaign, 16, seed=4, store=store, resume=True)
    more = disperse(campaign, 16, seed=4)
    for name in before:
        np.testing.assert_array_equal(open_store(store).outputs[name], more.outputs[name])
        np.testing.assert_array_equal(before[name], more.outputs[name][:8])
