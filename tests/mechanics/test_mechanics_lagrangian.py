"""Systems from a Lagrangian: constraints, symmetries, reduced and canonical forms, impacts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Accuracy, simulate
from jaxspace.core import InputError
from jaxspace.gyros import Gyrocompass
from jaxspace.mechanics import (
    BarOnSpring,
    BarOnString,
    CanonicalState,
    DoublePendulum,
    FramedPendulum,
    GeneralisedState,
    Hamiltonian,
    InclineDisk,
    Lagrangian,
    LandingLegs,
    SimplePendulum,
    SliderCarrier,
)
from jaxspace.mechanics.impulse import apply_impact
from jaxspace.mechanics.reduction import routh
from jaxspace.mechanics.variational import brachistochrone
from jaxspace.mechanics.work import work_along

DOUBLE = DoublePendulum(2.0, 1.0, 1.0, 0.8, 9.8)
FRAMED = FramedPendulum(0.3, 1.0, 0.8, 9.8)


def free_point(t, q, v, p):
    return 0.5 * jnp.sum(v * v, axis=0) - p * q[-1]


def circle(t, q, p):
    return (jnp.sum(q * q, axis=0) - 1.0)[None]


def rod(**more):
    """A point on a rod in Cartesian coordinates, with a constraint for the rod."""
    return Lagrangian(free_point, ("x", "z"), 9.8, fixed=circle, decay=5.0, **more)


def test_a_constraint_holds_to_rounding_over_many_periods():
    period = SimplePendulum(1.0, 9.8).period(jnp.pi / 2)
    system = rod()
    ts = jnp.stack([0.0 * period, 20.0 * period])
    run = simulate(system, system.state([1.0, 0.0]), ts, accuracy=1e-12)
    x, z = run.states.coordinates
    # The drift of the constraint does not grow: 1e-15 also after 100 periods.
    assert_allclose(x * x + z * z, 1.0, atol=1e-13)
    # 20 periods of 60 steps at 1e-12.
    assert_allclose([x[-1], z[-1]], [1.0, 0.0], atol=1e-8)
    assert run.drift()["energy"].max() < 1e-9


def test_reactions_and_consistent_states():
    system = rod()
    # At the bottom, with the speed v: the rod carries m (g + v^2), as 2 lambda z.
    found = system.reactions(0.0, system.state([0.0, -1.0], [2.0, 0.0]))
    assert_allclose(found.forces, [0.0, 9.8 + 4.0], atol=1e-14)
    off = system.consistent(system.state([0.6, 0.9], [1.0, 0.3]))
    assert_allclose(circle(0.0, off.coordinates, None), 0.0, atol=1e-15)
    assert_allclose(jnp.sum(off.coordinates * off.rates), 0.0, atol=1e-15)

    @jax.jit
    def pull(g):
        system = Lagrangian(free_point, ("x", "z"), g, fixed=circle)
        return system.reactions(0.0, system.state([0.6, -0.8], [0.8, 0.6])).multipliers[0]

    # lambda = -(v^2 + g z) / 2 per unit of mass, in closed form and its slope.
    assert_allclose(pull(9.8), -0.5 * (1.0 + 9.8 * 0.8), rtol=1e-14)
    assert_allclose(jax.grad(pull)(9.8), -0.4, rtol=1e-14)


def test_redundant_and_vanishing_constraints():
    twice = dict(fixed=lambda t, q, p: jnp.concatenate([circle(t, q, p)] * 2))
    refused = Lagrangian(free_point, ("x", "z"), 9.8, **twice)
    y = refused.state([0.6, -0.8], [0.8, 0.6])
    with pytest.raises(InputError, match="1 of the 2 constraints are independent"):
        refused.consistent(y)
    served = Lagrangian(free_point, ("x", "z"), 9.8, redundant=True, **twice)
    both, one = served.reactions(0.0, y), rod().reactions(0.0, y)
    assert_allclose(both.accelerations, one.accelerations, rtol=1e-12)
    assert_allclose(both.multipliers, 0.5 * jnp.repeat(one.multipliers, 2), rtol=1e-12)
    flat = Lagrangian(free_point, ("x", "z"), 9.8, fixed=lambda t, q, p: (q[0] ** 2)[None])
    with pytest.raises(InputError, match="no gradient"):
        flat.consistent(flat.state([0.0, 1.0]))


def test_symmetries_are_found_and_none_wrongly():
    assert FRAMED.cyclic == ("phi",)
    kept = FRAMED.invariants(0.0, FRAMED.state(0.4, 0.1, 0.0, 2.0))
    assert set(kept) == {"energy", "momentum_phi"}
    assert SliderCarrier(10.0, 4.0, 1.0, 30.0, 0.6).cyclic == ("x", "y")
    # Rolling holds x, y and phi; the heading is free.
    assert InclineDisk(1.0, 0.5, 0.2, 9.8).cyclic == ("psi",)

    def make(function, **more):
        system = Lagrangian(function, ("x", "z"), 9.8, **more)
        return set(system.invariants(0.0, system.state([0.1, 0.2])))

    assert make(free_point) == {"energy", "momentum_x"}
    assert make(lambda t, q, v, p: free_point(t, q, v, p) * (1.0 + t * t)) == {"momentum_x"}
    # A spring that acts on one side only, and friction.
    contact = make(lambda t, q, v, p: free_point(t, q, v, p) - jnp.maximum(q[0], 0.0) ** 2)
    assert contact == {"energy"}
    drag = make(free_point, rayleigh=lambda t, q, v, p: 0.5 * v[1] ** 2)
    assert drag == {"momentum_x"}
    moving = make(free_point, fixed=lambda t, q, p: (q[1] - jnp.sin(t))[None])
    assert moving == {"momentum_x"}
    # Under a trace the same is found.
    assert eqx.filter_jit(lambda s: s.invariants(0.0, FRAMED.state(0.4)))(FRAMED).keys() == {
        "energy",
        "momentum_phi",
    }


def test_forces_and_friction():
    system = Lagrangian(
        free_point,
        ("x", "z"),
        9.8,
        forces=lambda t, q, v, p: jnp.stack([3.0 + 0.0 * v[0], v[0]]),
        rayleigh=lambda t, q, v, p: 0.5 * 0.4 * jnp.sum(v * v, axis=0),
    )
    rate = system.vector_field(0.0, system.state([0.0, 0.0], [1.0, 2.0]))
    assert_allclose(rate.rates, [3.0 - 0.4, 1.0 - 9.8 - 0.8], rtol=1e-14)


def test_reduced_and_canonical_forms_move_alike():
    y = FRAMED.state(0.4, 0.1, 0.0, 2.0)
    full = FRAMED.vector_field(0.0, y)
    reduced = routh(FRAMED, y)
    part = eqx.filter_jit(reduced.vector_field)(0.0, reduced.state([0.4], [0.1]))
    assert_allclose(part.rates[0], full.rates[0], rtol=1e-12)
    with pytest.raises(InputError, match="0 of the 2 coordinates are cyclic"):
        routh(DOUBLE, DOUBLE.state(0.1, 0.2))
    canonical = Hamiltonian.of(FRAMED)
    p = FRAMED.momenta(0.0, y)
    rate = eqx.filter_jit(canonical.vector_field)(0.0, CanonicalState(y.coordinates, p))
    assert_allclose(rate.coordinates, y.rates, rtol=1e-12)
    assert_allclose(rate.momenta[1], 0.0, atol=1e-14)
    assert_allclose(
        canonical.energy(0.0, CanonicalState(y.coordinates, p)), FRAMED.energy(0.0, y), rtol=1e-13
    )


def test_a_batch_of_parameters_meets_one_state():
    masses = jnp.array([0.5, 1.0, 2.0])
    many = DoublePendulum(2.0, masses, 1.0, 0.8, 9.8)
    y = DOUBLE.state(0.7, -0.4, 0.3, 1.1)
    rates = eqx.filter_jit(many.vector_field)(0.0, y).rates
    single = jax.jit(lambda m: DoublePendulum(2.0, m, 1.0, 0.8, 9.8).vector_field(0.0, y).rates)
    for i in range(3):
        assert_allclose(rates[:, i], single(masses[i]), rtol=1e-13)


def test_more_coordinates_than_are_written_out():
    """A chain of eight springs, by LAPACK, against its matrix."""
    n = 8

    def chain(t, q, v, p):
        gaps = jnp.diff(q, axis=0)
        return 0.5 * jnp.sum(v * v, axis=0) - 0.5 * jnp.sum(gaps * gaps, axis=0)

    system = Lagrangian(chain, tuple(f"x{i}" for i in range(n)))
    q = jnp.linspace(0.0, 1.0, n) ** 2
    laplace = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    laplace[0, 0] = laplace[-1, -1] = 1.0
    rate = eqx.filter_jit(system.vector_field)(0.0, GeneralisedState(q, 0.0 * q))
    assert_allclose(rate.rates, -laplace @ q, atol=1e-14)


def test_gyrocompass_is_its_routhian():
    """The hand-written instrument against derivatives of I_h w_h^2/2 + I_e w_e^2/2 + H w_u less the
    potential of the bail."""
    compass = Gyrocompass(3.0, 0.8, 1.1, 75.0, 0.8, speed=300.0, course=0.4)
    east, north, up = (float(x) for x in compass.frame_rate)

    def routhian(t, q, v, p):
        (sa, ca), (sp, cp) = (jnp.sin(q[0]), jnp.cos(q[0])), (jnp.sin(q[1]), jnp.cos(q[1]))
        level = north * cp - east * sp
        w_u = ca * level + sa * up + v[1] * sa
        w_h = -(east * cp + north * sp) - v[0]
        w_e = ca * up - sa * level + v[1] * ca
        return 0.5 * (0.8 * w_h**2 + 1.1 * w_e**2) + 3.0 * w_u + 75.0 * ca

    by_derivatives = Lagrangian(routhian, ("tilt", "azimuth"))
    rate = by_derivatives.vector_field(0.0, by_derivatives.state([0.3, 0.7], [0.2, -0.5]))
    by_hand = compass.vector_field(0.0, compass.state(0.3, 0.7, 0.2, -0.5))
    assert_allclose([by_hand.tilt_rate, by_hand.azimuth_rate], rate.rates, rtol=1e-12)


def test_a_bar_falls_flat_on_two_supports():
    l = 0.5

    def kinetic(t, q, v, p):
        return 0.5 * (v[0] ** 2 + l * l / 3.0 * v[1] ** 2)

    def ends(q):
        return jnp.stack([q[0] - l * jnp.sin(q[1]), q[0] + l * jnp.sin(q[1])])

    system = Lagrangian(kinetic, ("height", "theta"))
    hit = jax.jit(lambda y: apply_impact(system, 0.0, y, ends, 0.5))
    end, impulses = hit(system.state([0.0, 0.0], [-2.0, 0.0]))
    assert_allclose(end.rates, [1.0, 0.0], atol=1e-15)
    assert_allclose(impulses, [1.5, 1.5], rtol=1e-14)
    # Nothing touches: nothing happens; and one end alone as in the closed form of a free bar.
    end, impulses = hit(system.state([0.0, 0.0], [2.0, 0.0]))
    assert_allclose([*end.rates, *impulses], [2.0, 0.0, 0.0, 0.0])
    end, impulses = hit(system.state([0.0, 0.0], [-1.0, -6.0]))
    # The first end opens by itself: of the other -(1 + e) u / (1 + 3), u = -1 - 3.
    assert_allclose(impulses, [0.0, 1.5], rtol=1e-14)


def struck_bar(x):
    """State and impulses of a bar after two feet of it have met the ground: of height, angle, their
    rates, restitution, half the length and the place of the feet."""
    l, a = x[5:]

    def kinetic(t, q, v, p):
        return 0.5 * (v[0] ** 2 + l * l / 3.0 * v[1] ** 2)

    def feet(q):
        return jnp.stack([q[0] - a * jnp.sin(q[1]), q[0] + a * jnp.sin(q[1])])

    system = Lagrangian(kinetic, ("height", "theta"))
    after, impulses = apply_impact(system, 0.0, system.state(x[:2], x[2:4]), feet, x[4])
    return jnp.concatenate([after.coordinates, after.rates, impulses])


# Both feet hit; one does and the other opens; the blow on one, near the middle of the bar, lifts
# the other, which came down as well.
BLOWS = np.array(
    [
        [0.02, 0.1, -2.0, 0.3, 0.5, 0.5, 0.5],
        [0.10, 0.3, -1.0, -2.5, 0.7, 0.5, 0.5],
        [0.10, 0.3, -1.0, 5.0, 0.2, 0.5, 0.15],
    ]
)


def test_an_impact_has_the_derivatives_of_its_differences():
    @jax.jit
    def every(x):
        step = 1e-5
        sides = jnp.concatenate([jnp.eye(7), -jnp.eye(7)]) * step
        beside = jax.vmap(lambda d: struck_bar(x + d))(sides)
        differences = (beside[:7] - beside[7:]).T / (2.0 * step)
        return jax.jacfwd(struck_bar)(x), jax.jacrev(struck_bar)(x), differences, struck_bar(x)

    forward, reverse, differences, found = jax.vmap(every)(BLOWS)
    # A step of 1e-5 leaves its square in each difference, and the roundings over the step.
    assert_allclose(forward, differences, rtol=1e-7, atol=1e-8)
    assert_allclose(reverse, forward, rtol=1e-13, atol=1e-13)
    # The three are what they are said to be.
    np.testing.assert_array_equal(found[:, 4:] > 0.0, [[True, True], [False, True], [True, False]])


LEGS = LandingLegs(900.0, 12.0, 2.0, 0.6, 4e3, 1.62)


def test_landing_legs_touch_down_as_by_an_impact():
    """The closed form against the blow on a body with hinged legs: height, angle, foot."""

    def kinetic(t, q, v, p):
        # A leg's centre lies half a leg below and beside its hinge.
        z, x = v[0] + 1.0 * jnp.sin(q[1]) * v[1], 1.0 * jnp.cos(q[1]) * v[1]
        legs = 4.0 * (12.0 * (z * z + x * x) + 12.0 * 4.0 / 12.0 * v[1] ** 2)
        return 0.5 * (900.0 * v[0] ** 2 + legs)

    fall = Lagrangian(kinetic, ("height", "theta"))
    y = fall.state([2.0 * np.cos(0.6), 0.6], [-3.0, 0.0])
    end, _ = apply_impact(fall, 0.0, y, lambda q: (q[0] - 2.0 * jnp.cos(q[1]))[None], 0.0)
    assert_allclose(LEGS.touchdown(3.0).rates[0], end.rates[1], rtol=1e-13)
    lost = fall.energy(0.0, y) - fall.energy(0.0, end)
    assert_allclose(LEGS.touchdown_loss(3.0), lost, rtol=1e-12)


def test_landing_legs_spread_as_far_and_as_long_as_by_quadrature():
    spread, time = LEGS.greatest_spread(3.0), LEGS.spreading_time(3.0)
    run = simulate(LEGS, LEGS.touchdown(3.0), jnp.stack([0.0, time]), accuracy=1e-12)
    assert_allclose(run.final.coordinates[0], spread, rtol=1e-11)
    assert_allclose(run.final.rates[0], 0.0, atol=1e-9)
    assert 0.7 < spread < 1.5
    # dt/dv by the quadrature, whose end moves, against differences; harder: they lie flat.
    slope = jax.jit(jax.grad(LEGS.spreading_time))(3.0)
    ahead, behind = (LEGS.spreading_time(v) for v in (3.0 + 1e-4, 3.0 - 1e-4))
    assert_allclose(slope, (ahead - behind) / 2e-4, rtol=1e-6)
    assert_allclose(LEGS.greatest_spread(30.0), 0.5 * np.pi, rtol=1e-12)


def test_landing_legs_spread_from_a_slow_touchdown():
    # Next to rest the motion starts beside a root of its speed: by 30 digits of mpmath (`spread` of
    # twins.py), with the slopes by the speed. A plain quadrature is off by 8e-3.
    truths = {
        1e-3: ("1.08060872173883493141", "-0.61731969729619"),
        0.0: ("1.08122602407618312465", "-0.6172839506173"),
    }
    legs = LandingLegs(900.0, 12.0, 2.0, 0.6, 4e3, 1.62)
    both = jax.jit(jax.value_and_grad(legs.spreading_time))
    for speed, (time, slope) in truths.items():
        found, change = both(speed)
        assert_allclose(found, float(time), rtol=2e-15)
        assert_allclose(change, float(slope), rtol=1e-12)
    assert_allclose(jax.jit(jax.jacfwd(legs.spreading_time))(0.0), -0.6172839506173, rtol=1e-12)


def test_legs_without_mass_lose_nothing_at_touchdown():
    # The difference of the energies is a rounding of them where the legs weigh next to nothing.
    light = LandingLegs(900.0, 1e-12, 2.0, 0.6, 4e3, 1.62)
    assert LandingLegs(900.0, 0.0, 2.0, 0.6, 4e3, 1.62).touchdown_loss(2.0) == 0.0
    # To first order in the mass: (n m/6) v^2 / sin^2(theta_0).
    assert_allclose(light.touchdown_loss(2.0), 4e-12 / 6.0 * 4.0 / np.sin(0.6) ** 2, rtol=1e-13)


def test_brachistochrone_against_a_straight_slide():
    radius, angle, time = brachistochrone(2.0, 1.0, 9.8)
    assert_allclose(radius * (angle - np.sin(angle)), 2.0, rtol=1e-13)
    assert_allclose(radius * (1.0 - np.cos(angle)), 1.0, rtol=1e-13)
    assert time < np.sqrt(2.0 * 5.0 / 9.8)
    # To the lowest point of the cycloid: half a turn.
    assert_allclose(brachistochrone(np.pi, 2.0, 9.8)[1], np.pi, rtol=1e-13)


@pytest.mark.sweep
def test_energy_of_a_double_pendulum_over_a_thousand_seconds():
    accuracy = Accuracy(1e-12, max_steps=10**6)
    y = DOUBLE.state(1.2, 0.7, 0.1, -0.3)
    run = simulate(DOUBLE, y, jnp.linspace(0.0, 1000.0, 101), accuracy=accuracy)
    # Chaotic, so that the energy alone is known; 4e5 stages of rounding.
    energy = DOUBLE.energy(0.0, run.states)
    assert_allclose(energy, energy[0], atol=1e-11 * 2.0 * 3.0 * 9.8)


def test_the_brachistochrone_keeps_its_digits_in_a_short_arch():
    """r = 1 and p = 1e-4: p - sin p = p^3/6 (1 - p^2/20), 1 - cos p = p^2/2 (1 - p^2/12)."""
    p = 1e-4
    distance, drop = p**3 / 6.0 * (1.0 - p * p / 20.0), p * p / 2.0 * (1.0 - p * p / 12.0)
    found = brachistochrone(distance, drop, 9.8)
    np.testing.assert_allclose(found, [1.0, p, p / np.sqrt(9.8)], rtol=1e-14)


def swings(system, still):
    """The angular frequencies of small motions about a rest: eigenvalues of the linear motion."""

    def rate(x):
        n = x.shape[0] // 2
        found = system.vector_field(0.0, GeneralisedState(x[:n], x[n:]))
        return jnp.concatenate([found.coordinates, found.rates])

    roots = np.linalg.eigvals(jax.jacfwd(rate)(jnp.concatenate([still, 0.0 * still])))
    assert_allclose(roots.real, 0.0, atol=1e-9)  # the root of rounding: pairs of equal size
    return np.sort(np.abs(roots.imag))[::2]


def test_a_bar_on_a_string():
    """9.10-P9: Lagrange's equations of the book, and the frequencies of its small swings, with the
    limits of a short string (physical pendulum, w^2 = 3 g/(2 b)) and of a short bar (g/a)."""
    m, a, b, g = 2.0, 0.7, 1.2, 9.8
    bar = BarOnString(m, a, b, g)
    assert_allclose(bar.frequencies, swings(bar, jnp.zeros(2)), rtol=1e-10)
    assert_allclose(BarOnString(m, 1e-9, b, g).frequencies[0], np.sqrt(1.5 * g / b), rtol=1e-8)
    assert_allclose(BarOnString(m, a, 1e-9, g).frequencies[0], np.sqrt(g / a), rtol=1e-8)
    q, v = np.array([0.4, -0.7]), np.array([0.9, 1.3])
    acceleration = bar.vector_field(0.0, GeneralisedState(jnp.asarray(q), jnp.asarray(v))).rates
    apart = q[0] - q[1]
    mass = [[a * a, 0.5 * a * b * np.cos(apart)], [0.5 * a * b * np.cos(apart), b * b / 3.0]]
    gyro = 0.5 * a * b * np.sin(apart) * np.array([-(v[1] ** 2), v[0] ** 2])
    weight = -g * np.array([a * np.sin(q[0]), 0.5 * b * np.sin(q[1])])
    assert_allclose(acceleration, np.linalg.solve(mass, gyro + weight), rtol=1e-13)


def test_a_bar_on_a_spring():
    """9.10-P10: the bounce and the swings about its rest; the energy of a state."""
    m, k, l0, b, g = 2.0, 300.0, 0.5, 1.2, 9.8
    bar = BarOnSpring(m, k, l0, b, g)
    r = l0 + m * g / k
    assert_allclose(bar.rest_length, r, rtol=1e-15)
    found = swings(bar, jnp.array([r, 0.0, 0.0]))
    assert_allclose(np.sort(bar.frequencies), found, rtol=1e-10)
    assert_allclose(bar.frequencies[1:], BarOnString(m, r, b, g).frequencies, rtol=1e-15)
    # Of the velocity of the middle in Cartesian coordinates.
    (r, ph, th), (r_rate, ph_rate, th_rate) = np.array([[0.6, 0.3, -0.4], [0.2, 0.7, 1.1]])
    x = r_rate * np.sin(ph) + r * ph_rate * np.cos(ph) + 0.5 * b * th_rate * np.cos(th)
    z = r_rate * np.cos(ph) - r * ph_rate * np.sin(ph) - 0.5 * b * th_rate * np.sin(th)
    energy = 0.5 * m * (x * x + z * z + (b * th_rate) ** 2 / 12.0) + 0.5 * k * (r - l0) ** 2
    energy -= m * g * (r * np.cos(ph) + 0.5 * b * np.cos(th))
    y = bar.state(0.6, 0.3, -0.4, 0.2, 0.7, 1.1)
    assert_allclose(bar.energy(0.0, y), energy, rtol=1e-13)


def test_the_work_of_a_force_along_a_path():
    """4.4-P3: a conservative force works the same on every path, the fall of its potential; one
    with a curl does not, and backwards the sign changes."""

    def helix(s):
        return jnp.stack([jnp.cos(s), jnp.sin(s), 0.5 * s])

    def chord(s):
        return jnp.stack([1.0 - 2.0 * s, 0.0 * s, 0.5 * jnp.pi * s])

    def attraction(r):
        return -r / jnp.sum(r * r, axis=0) ** 1.5

    def swirl(r):
        return jnp.stack([-r[1], r[0], 0.0 * r[2]])

    # Potential -1/|r| at both ends; of Gauss's 24 nodes, to 1e-9 as the path turns half around.
    fall = 1.0 / np.sqrt(1.0 + 0.25 * np.pi**2) - 1.0
    end = jnp.pi
    assert_allclose(work_along(attraction, helix, 0.0, end), fall, rtol=1e-9)
    # The straight way passes the centre at a distance of a half: it bends more.
    assert_allclose(work_along(attraction, chord), fall, rtol=1e-4)
    assert_allclose(work_along(swirl, helix, 0.0, end), np.pi, rtol=1e-14)
    assert_allclose(work_along(swirl, chord), 0.0, atol=1e-15)
    ends = jnp.array([0.5, 2.0, -1.0])
    assert_allclose(work_along(swirl, helix, 0.0, ends), ends, rtol=1e-14)
    assert_allclose(work_along(swirl, helix, ends, 0.0), -ends, rtol=1e-14)
    for mode in (jax.jacfwd, jax.jacrev):
        slope = jax.jit(mode(lambda s: work_along(attraction, helix, 0.0, s)))(1.0)
        # The power at the end: -r . r'/|r|^3.
        assert_allclose(slope, -0.25 / 1.25**1.5, rtol=1e-9)
    with pytest.raises(InputError, match="end is nan"):
        work_along(swirl, helix, 0.0, float("nan"))
