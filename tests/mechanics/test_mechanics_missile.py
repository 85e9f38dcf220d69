"""The flexible missile: its mean axis, the tail-wags-dog zero, slosh and the autopilot's loop."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

from jaxspace.mechanics import FlexibleMissile
from jaxspace.mechanics.beams import beam_shape
from jaxspace.mechanics.missile_loop import MissileLoop
from jaxspace.studies import modes

THRUST = 4.0e5
MISSILE = FlexibleMissile(2e4, 20.0, 2e8, 1.5, 0.0, THRUST, actuator_stiffness=3e6)


def test_masses_and_thrust_are_those_about_the_mean_axis():
    """The factor (1 - C_2): the engine's deflection less its rigid part, by quadrature."""
    missile = MISSILE
    engine, hinge, length = missile.engine, float(missile.lever), 20.0
    nodes, weights = np.polynomial.legendre.leggauss(40)

    def integral(function, start, end):
        x = 0.5 * (start + end) + 0.5 * (end - start) * nodes
        return 0.5 * (end - start) * np.sum(weights * function(x)) * 2e4 / length

    shift, turn = float(engine["shift"]), float(engine["turn"])

    def deflection(x):
        return shift - turn * x + np.minimum(x + hinge, 0.0)

    def whole(function):
        return integral(function, -10.0, -hinge) + integral(function, -hinge, 10.0)

    def shape(k):
        return lambda x: beam_shape("free-free", missile.roots[k], jnp.asarray(0.5 + x / length))

    # It has no momentum and no angular momentum.
    assert_allclose(whole(deflection), 0.0, atol=1e-8)
    assert_allclose(whole(lambda x: x * deflection(x)), 0.0, atol=1e-7)
    m, k = missile.matrices
    assert_allclose(whole(lambda x: deflection(x) ** 2), m[0, 0], rtol=1e-12)
    for i in range(3):
        assert_allclose(whole(lambda x, i=i: deflection(x) * shape(i)(x)), m[0, i + 1], rtol=1e-9)
        # The thrust has the slope of the engine, and works on the hinge.
        slope = deflection(-hinge - 1.0) - deflection(-hinge - 2.0)
        assert_allclose(-k[i + 1, 0], THRUST * slope * shape(i)(-hinge), rtol=1e-12)


def test_tail_wags_dog_is_a_zero_of_the_pitch():
    stiff = eqx.tree_at(lambda m: m.bending_stiffness, MISSILE, jnp.asarray(2e14))
    found = modes(stiff, stiff.state(), inputs=("command",), outputs=("pitch",))
    zeros = np.asarray(found.zeros())
    expected = float(stiff.tail_wags_dog_frequency)
    # Nothing bends at these frequencies but by 1e-6.
    assert np.abs(zeros - 1j * expected).min() < 1e-4 * expected
    engine = stiff.engine
    by_hand = THRUST * (8.5 + engine["shift"]) / (engine["moment"] + engine["mass"] * 8.5 * 0.75)
    assert_allclose(expected, np.sqrt(by_hand), rtol=1e-14)


LOOP = MissileLoop(
    FlexibleMissile(
        *(2e4, 20.0, 2e8, 1.5, 0.0, THRUST),
        actuator_stiffness=3e6,
        actuator_damping=4e4,
        damping_ratio=0.005,
    ),
    pitch_gain=1.0,
    rate_gain=0.1,
)


def test_slosh_without_mass_follows_and_with_mass_keeps_the_momentum():
    tank = dict(slosh_mass=1500.0, slosh_frequency=2.5, tank_place=3.0)
    loop = eqx.tree_at(lambda s: s.missile.thrust, MissileLoop(MISSILE, **tank), jnp.asarray(0.0))
    y = eqx.tree_at(lambda y: y.slosh, loop.state(engine=0.02), jnp.asarray(0.1))
    rate = loop.vector_field(0.0, y)
    force = 1500.0 * 2.5**2 * 0.1
    engine = MISSILE.engine
    mean_turn = rate.missile.pitch_rate + engine["turn"] * rate.missile.engine_rate
    # Without thrust the missile feels the slosh alone, and the slosh its reaction.
    assert_allclose(mean_turn, 3.0 * force / MISSILE.inertia, rtol=1e-12)
    across = MISSILE.across(3.0)
    bent = jnp.concatenate([rate.missile.engine_rate[None], rate.missile.bending_rate])
    place = force / 2e4 + 3.0 * mean_turn + across @ bent
    assert_allclose(1500.0 * (rate.slosh_rate + place), -force, rtol=1e-12)


def test_stability_of_the_loop_by_modes():
    """Bending that the gyro feels with the wrong sign unsettles the loop, and so does slosh between
    the mass centre and the centre of percussion."""
    loop = eqx.tree_at(
        lambda s: (s.slosh_frequency, s.slosh_damping), LOOP, (jnp.asarray(2.5), jnp.asarray(5e-3))
    )

    @eqx.filter_jit
    def found(gyro, mass, tank):
        made = eqx.tree_at(
            lambda s: (s.gyro_place, s.slosh_mass, s.tank_place), loop, (gyro, mass, tank)
        )
        return modes(made, made.state()).eigenvalues

    def growth(gyro=0.0, mass=0.0, tank=0.0):
        roots = found(*(jnp.asarray(x) for x in (gyro, mass, tank)))
        return float(roots.real.max()), roots

    damped, roots = growth()
    assert damped < 0.0
    # The rigid loop: th'' = -a (k_p th + k_r th'), within the delay of the actuator.
    missile = LOOP.missile
    authority = THRUST * (missile.lever + missile.engine["shift"]) / missile.inertia
    assert np.abs(np.abs(roots) / np.sqrt(authority) - 1.0).min() < 0.05
    # At the nose the second mode grows, at the tail the first one does.
    assert growth(gyro=9.9)[0] > 1.0
    assert growth(gyro=-8.0)[0] > 0.1
    assert growth(mass=3e3, tank=2.0)[0] > 0.005
    assert growth(mass=3e3, tank=-2.0)[0] < 0.0 > growth(mass=3e3, tank=8.0)[0]


def test_a_batch_of_as_many_missiles_as_they_have_modes():
    """Each is a missile of its own: every parameter scatters, and its place beside the modes is
    that of the runs."""
    modes = 3
    factors = 1.0 + 0.1 * np.arange(modes)
    numbers = eqx.filter(LOOP.missile, eqx.is_array)
    batch = eqx.combine(jax.tree.map(lambda x: x * factors, numbers), LOOP.missile)
    assert batch.modes == modes

    @eqx.filter_jit
    def all_of(missile, engine):
        y = missile.state(engine, 0.1 * engine)
        y = eqx.tree_at(lambda y: y.bending, y, y.bending + 0.01 * (1.0 + engine))
        places = missile.across(2.0), missile.slopes(2.0), missile.hinge
        return missile.vector_field(0.0, y), places, missile.coupled_frequencies_squared

    engine = jnp.asarray(0.03 * factors)
    together = all_of(batch, engine)
    for k in range(modes):
        one = jax.tree.map(lambda x, k=k: x[k], eqx.filter(batch, eqx.is_array))
        expected = all_of(eqx.combine(one, LOOP.missile), engine[k])
        for found, value in zip(jax.tree.leaves(together), jax.tree.leaves(expected), strict=True):
            # A share that all missiles have alike needs no axis of runs.
            found = found[..., k] if found.ndim > value.ndim else found
            # A few roundings of sums that cancel, of the size of the largest.
            assert_allclose(found, value, rtol=1e-10, atol=1e-12 * np.max(np.abs(value)))


def test_coupled_frequencies_are_traced():
    """Against NumPy, and the derivative by the thrust against central differences."""

    def squares(thrust):
        missile = eqx.tree_at(lambda m: m.thrust, MISSILE, thrust)
        return missile.coupled_frequencies_squared.real

    m, k = map(np.asarray, MISSILE.matrices)
    values = np.sort(np.linalg.eigvals(np.linalg.solve(m, k)).real)
    run = jax.jit(lambda f: (squares(f), jax.jacfwd(squares)(f), jax.jacrev(squares)(f)))
    found, forward, reverse = run(jnp.asarray(THRUST))
    assert_allclose(found, values, rtol=1e-10)
    assert_allclose(forward, reverse, rtol=1e-8)
    h = 1e-3 * THRUST
    difference = (squares(jnp.asarray(THRUST + h)) - squares(jnp.asarray(THRUST - h))) / (2.0 * h)
    # Truncation of the order of h^2, with slopes that change by percents over the thrust.
    assert_allclose(forward, difference, rtol=1e-4)
