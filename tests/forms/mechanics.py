"""Closed forms of mechanics, and the general theory on systems of its own."""

import jax.numpy as jnp
import twins

from jaxspace import mechanics as m

from .form import Form


def numbers(*found):
    """Scalars as outputs, each of its own size."""
    return tuple(jnp.reshape(jnp.asarray(f), (1,)) for f in found)


def described(x):
    """Momenta, mass matrix and energy of two coupled swings; of a spring too: 4 numbers, angles,
    rates."""
    one = m.CentrifugalPendulum(*x[:4])
    y = m.GeneralisedState(x[4:6], x[6:8])
    return one.momenta(0.0, y), one.mass_matrix(0.0, y).reshape(-1), *numbers(one.energy(0.0, y))


def rolling(x):
    """Reactions, consistent and projected rates of a disk on an incline: 4 numbers, places and
    rates."""
    disk = m.InclineDisk(*x[:4])
    y = m.GeneralisedState(x[4:8], x[8:12])
    found = disk.reactions(0.0, disk.consistent(y))
    return found.accelerations, found.forces, disk.consistent(y).rates


def rolled(x):
    """In closed form, and the state at the start, from 4 numbers, heading, two rates and time."""
    disk = m.InclineDisk(*x[:4])
    y = disk.state(*x[4:7])
    return disk.rolled(x[7], *x[4:7]), y.coordinates, y.rates


def turntable(x):
    """Place and velocity of a sphere on it: time, place, velocity, rate and ratio of inertia."""
    return m.rolling.turntable_motion(x[0], x[1:3], x[3:5], x[5], x[6])


def foucault(x):
    """The same of a pendulum over the turning earth."""
    return m.arm.foucault_motion(x[0], x[1:3], x[3:5], x[5], x[6])


def reduced(x):
    """The Routhian, the canonical energy and a force-free rate of a frame with a pendulum."""
    framed = m.FramedPendulum(*x[:4])
    y = m.GeneralisedState(x[4:6], x[6:8])
    rest = m.reduction.routh(m.FramedPendulum(1.0, 1.0, 1.0, 1.0), y)
    # The constant momenta with the numbers of this system.
    momenta = framed.momenta(0.0, y)
    canonical = m.Hamiltonian.of(framed)
    energy = canonical.energy(0.0, m.CanonicalState(y.coordinates, momenta))
    given = rest.lagrangian(0.0, y.coordinates[:1], y.rates[:1])
    return *numbers(energy, given), momenta


def struck(x):
    """Rates and impulses of a double pendulum after a blow, and after a wall was hit: 5 numbers,
    angles, rates, blow and restitution."""
    swing = m.DoublePendulum(*x[:5])
    y = m.GeneralisedState(x[5:7], x[7:9])
    after, contacts = m.impulse.apply_impact(
        swing, 0.0, y, lambda q: (x[2] * jnp.sin(q[0]) + x[3] * jnp.sin(q[1]))[None], x[11]
    )
    return m.impulse.apply_impulse(swing, 0.0, y, x[9:11]).rates, after.rates, contacts


def impacts(x):
    """Impulse, loss and pad: approach, inverse mass, restitution; weight, height, deceleration,
    strength and gravity."""
    blow = m.impact.contact_impulse(*x[:3]), m.impact.impact_energy_loss(*x[:3])
    return numbers(*blow, *m.impact.crushable_pad(*x[3:]))


def contact(x):
    """The inverse mass at a contact: mass, 6 elements of inertia, arm and normal."""
    a, b, c, d, e, f = x[1:7]
    inertia = jnp.stack([a, d, e, d, b, f, e, f, c]).reshape(3, 3)
    return numbers(m.impact.contact_inverse_mass(x[0], inertia, x[7:10], x[10:13]))


def about_points(x):
    """Moment about a moving point, and the momentum of two particles about one."""
    places, velocities = x[:6].reshape(3, 2), x[6:12].reshape(3, 2)
    momentum = m.moving_point.momentum_about(x[12:14], places, velocities, x[14:17], x[17:20])
    return m.moving_point.moment_about_moving_point(x[0:3], x[12], x[14:17], x[17:20]), momentum


def chain(x):
    return numbers(*m.variational.hanging_chain(*x))


def quickest_descent(x):
    return numbers(*m.variational.brachistochrone(*x))


def swing_rates(x):
    """Frequencies and periods: of a spring (4 numbers), a rim (4 and its rate), a simple swing
    (amplitude), a hoop (rate), a trailer (two lengths)."""
    elastic = m.ElasticPendulum(*x[:4])
    rim = m.CentrifugalPendulum(*x[4:8])
    return numbers(*elastic.frequencies, *rim.frequencies(x[8]))


def hung_bars(x):
    """Frequencies of a bar on a spring, and on a string: mass, stiffness, free length, bar,
    gravity and string."""
    spring = m.BarOnSpring(*x[:5])
    string = m.BarOnString(x[0], x[5], x[3], x[4])
    return numbers(*spring.frequencies, *string.frequencies, spring.rest_length)


def work_of_a_force(x):
    """Of a spring towards a point and of a drag along an arc: stiffness, drag, radius, angle."""

    def arc(s):
        return x[2] * jnp.stack([jnp.cos(s), jnp.sin(s), 0.3 * s])

    def force(r):
        away = jnp.stack([r[0], 0.5 * r[1], r[2] - 1.0])
        return -x[0] * away - x[1] * jnp.stack([-r[1], r[0], 1.0 + 0.0 * r[2]])

    return numbers(m.work.work_along(force, arc, 0.0, x[3]))


def assumed(x):
    """Frequencies of a cantilever in two powers: length, stiffness and mass per length."""
    return m.beams.assumed_modes(lambda z: jnp.stack([z**2, z**3]), *x)[0]


def pendulum_swing(x):
    return numbers(m.SimplePendulum(x[0], x[1]).period(x[2]))


def hoop(x):
    """Rest angle and energy of a bead: radius, rate, gravity, angle and its rate."""
    one = m.RotatingHoop(1.0, *x[:3])
    return numbers(one.rest_angle, one.mechanical_energy(m.RotatingHoop.state(x[3], x[4])))


def wheels(x):
    """A loop of a wheel, the margin of a trailer and the velocity of a carrier."""
    trailer = m.Trailer(1.0, x[3], x[4], x[5], 1.0, 1.0)
    y = m.GeneralisedState(x[6:10], x[10:14])
    moving = m.SliderCarrier.body_velocity(y)
    return numbers(*m.rolling.rolling_loop(*x[:3]), trailer.stability_margin, *moving)


def arm(x):
    """Poles, as parts, and the place of rest: frequency, damping, rate and arm."""
    one = m.ArmPendulum(*x)
    poles, light = one.poles, one.light_poles
    return poles.real, poles.imag, light.real, light.imag, *numbers(one.rest)


def shapes(x):
    """A mode of a free beam and its slopes at two places and inside, and an integral of it."""
    root = float(m.beams.beam_roots("free-free", 2)[1])
    places = jnp.stack([x[0], x[1], 0.3 * x[0] + 0.4 * x[1] + 0.1])
    parts = [m.beams.beam_shape("free-free", root, places, k) for k in range(4)]
    # The first mode of two spans, right to the digits of its root.
    spans = float(m.beams.beam_roots("clamped-free", 1, 0.6)[0])
    parts += [m.beams.beam_shape("clamped-free", spans, places, k, 0.6) for k in range(2)]
    whole = m.beams.beam_integral(
        lambda z: m.beams.beam_shape("clamped-free", 1.8751040687119611, z), *x
    )
    return *parts, *numbers(whole)


def missile(x):
    """Frequencies, matrices, shapes and accelerations of a flexible missile: 8 numbers, place,
    state of 5, command."""
    one = m.FlexibleMissile(*x[:5], thrust=x[5], actuator_stiffness=x[6], modes=2)
    zero = 0.0 * x[:2]
    y = m.MissileState(x[8], x[9:11], x[11], x[12], zero, x[13])
    found = one.accelerations(y, x[14], 0.1 * x[14], x[7])
    engine = numbers(*one.engine.values(), one.lever, one.inertia, found[1])
    masses, stiffnesses = one.matrices
    arrays = (one.frequencies, *one.hinge, one.across(x[7]), one.slopes(x[7]), found[0])
    dog = numbers(one.tail_wags_dog_frequency)
    return *engine, *arrays, *dog, masses.reshape(-1), stiffnesses.reshape(-1)


def felt(x):
    """Pitch and its rate at the gyro of a loop, and at the nose: place, two bends, pitch, rates."""
    body = m.FlexibleMissile(2e4, 20.0, 2e8, 1.5, 0.0, 4e5, actuator_stiffness=3e6, modes=2)
    still = 0.0 * x[0]
    y = m.MissileState(still, x[1:3], x[3], still, x[4:6], x[6])
    found = [
        m.missile_loop.MissileLoop(body, 1.0, 0.1, place, 1500.0, 2.5, 0.01, 4.0).felt_pitch(y)
        for place in (x[0], 9.0 + still)
    ]
    return tuple(jnp.stack(pair) for pair in zip(*found, strict=True))


def action_of_a_swing(x):
    """The action of a swing through an amplitude at a frequency, in a time."""
    swing = m.SimplePendulum(x[2], x[3])
    return numbers(
        m.variational.action(swing, lambda t: jnp.sin(x[1] * t)[None] * x[0], 0.0, x[4], pieces=1)
    )


def variational(x):
    """Two steps of the variational integrator: length, gravity, angle, rate and time."""
    swing = m.SimplePendulum(x[0], x[1])
    y = m.SimplePendulum.state(x[2], x[3])
    ts = jnp.stack([0.0 * x[4], x[4]])
    found = m.discrete.variational_motion(swing, y, ts, steps=2, order=2)
    return found.coordinates[:, -1], found.rates[:, -1]


SWING = (0.5, 0.2, 0.3, 0.1)
DISK = (1.0, 0.3, 0.4, 9.8)
MISSILE = (2e4, 20.0, 2e8, 1.5, 1e5, 4e5, 3e6)


def of(kind, *methods):
    """ "mechanics.kind.method" for each."""
    return tuple(f"mechanics.{kind}.{method}" for method in methods)


def free(*functions):
    return tuple(f"mechanics.{function}" for function in functions)


FORMS = (
    Form(
        described,
        of("AbstractLagrangian", "momenta", "mass_matrix", "energy"),
        [
            (*SWING, 0.1, 0.7, 10.0, 0.3),
            (*SWING, 0.0, 0.0, 10.0, 0.0),
            (*SWING, 0.0, 3.1415926, 1.0, 1.0),
        ],
    ),
    Form(
        rolling,
        of("AbstractLagrangian", "reactions", "consistent"),
        [
            (*DISK, 0.1, 0.2, 0.5, 0.7, 0.3, 0.2, 1.1, 2.0),
            (*DISK, 0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 2.0),
        ],
    ),
    Form(
        rolled,
        of("InclineDisk", "rolled", "state"),
        [(*DISK, 0.3, 1.1, 2.0, 1.5), (*DISK, 0.3, 1e-7, 2.0, 1.5), (*DISK, 0.0, 0.0, 2.0, 1.5)],
    ),
    Form(
        turntable,
        free("turntable_motion"),
        [
            (2.0, 0.3, 0.1, 0.2, -0.4, 3.0, 0.4),
            (2.0, 0.3, 0.1, 0.2, -0.4, 1e-9, 0.4),
            (2.0, 0.3, 0.1, 0.2, -0.4, 10.9955743, 0.4),
        ],
    ),
    Form(
        foucault,
        free("foucault_motion"),
        [
            (20.0, 0.3, 0.1, 0.2, -0.4, 0.8, 5e-5),
            (20.0, 0.3, 0.1, 0.2, -0.4, 0.8, 0.0),
            (0.0, 0.3, 0.1, 0.2, -0.4, 0.8, 5e-5),
        ],
    ),
    Form(
        reduced,
        (*free("routh"), *of("Hamiltonian", "energy", "of")),
        [(0.3, 1.0, 0.8, 9.8, 0.7, 0.1, 0.2, 1.5), (0.3, 1.0, 0.8, 9.8, 0.0, 0.0, 0.0, 1.5)],
    ),
    Form(
        struck,
        free("apply_impulse", "apply_impact"),
        [
            (2.0, 1.0, 1.0, 0.8, 9.8, 0.6, 0.5, -0.1, -0.3, 0.3, 0.1, 0.5),
            (2.0, 1.0, 1.0, 0.8, 9.8, 0.6, 0.6, -0.1, -0.3, 0.0, 0.0, 0.0),
        ],
    ),
    Form(
        impacts,
        free("contact_impulse", "impact_energy_loss", "crushable_pad"),
        [
            (-2.0, 0.4, 0.5, 900.0, 10.0, 50.0, 2e5, 9.8),
            (-2.0, 0.4, 1.0, 900.0, 1e-6, 9.9, 2e5, 9.8),
            (-2.0, 0.4, 0.999999, 900.0, 10.0, 50.0, 2e5, 9.8),
        ],
    ),
    Form(
        contact,
        free("contact_inverse_mass"),
        [
            (2.0, 3.0, 2.0, 1.5, 0.1, -0.2, 0.15, 0.3, 0.1, -0.4, 0.0, 0.6, 0.8),
            (2.0, 3.0, 2.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8, 0.0, 0.6, 0.8),
        ],
    ),
    Form(
        about_points,
        free("moment_about_moving_point", "momentum_about"),
        [
            (
                1.0,
                2.0,
                0.3,
                -1.0,
                0.5,
                0.4,
                0.1,
                -0.2,
                0.6,
                0.3,
                -0.5,
                0.2,
                2.0,
                3.0,
                0.1,
                0.2,
                0.3,
                0.4,
                0.5,
                -0.6,
            ),
            (
                1.0,
                -1.0,
                0.0,
                0.0,
                0.5,
                -0.5,
                0.1,
                -0.1,
                0.6,
                -0.6,
                0.2,
                -0.2,
                2.0,
                2.0,
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
            ),
        ],
    ),
    Form(
        chain,
        free("hanging_chain"),
        [(10.0, 12.0), (10.0, 10.0001), (1.0, 300.0), (10.0, 10.00000001)],
    ),
    Form(
        quickest_descent,
        free("brachistochrone"),
        [(3.0, 2.0, 9.8), (1e-6, 2.0, 9.8), (300.0, 1.0, 9.8), (3.1415926, 2.0, 9.8)],
    ),
    Form(
        swing_rates,
        (
            *of("ElasticPendulum", "frequencies", "state"),
            *of("CentrifugalPendulum", "frequencies", "state"),
        ),
        [(1.0, 100.0, 0.8, 9.8, *SWING, 10.0), (1.0, 100.0, 0.8, 9.8, *SWING, 0.0)],
    ),
    Form(
        hung_bars,
        (*of("BarOnSpring", "frequencies", "rest_length"), *of("BarOnString", "frequencies")),
        [(2.0, 300.0, 0.5, 1.2, 9.8, 0.7), (2.0, 300.0, 0.5, 1e-3, 9.8, 10.0)],
    ),
    Form(
        work_of_a_force,
        free("work_along"),
        [(3.0, 0.2, 1.5, 0.8), (3.0, 0.0, 1.5, 0.8), (3.0, 0.2, 1.5, 0.0)],
    ),
    Form(
        assumed,
        free("assumed_modes"),
        [(2.0, 300.0, 1.5), (20.0, 2e8, 1000.0)],
        exact=twins.assumed,
    ),
    Form(
        pendulum_swing,
        of("SimplePendulum", "period", "state"),
        [(1.0, 9.8, 1.2), (1.0, 9.8, 0.0), (1.0, 9.8, 3.1415926), (1.0, 9.8, 3.14159265358979)],
    ),
    Form(
        hoop,
        of("RotatingHoop", "rest_angle", "mechanical_energy", "state"),
        [
            (0.5, 6.0, 9.8, 0.7, 0.3),
            (0.5, 4.4271888, 9.8, 0.0, 0.0),
            (0.5, 4.0, 9.8, 1e-8, 0.0),
            (0.5, 1e6, 9.8, 3.1415926, 0.0),
        ],
    ),
    Form(
        wheels,
        (
            *free("rolling_loop"),
            *of("Trailer", "stability_margin"),
            *of("SliderCarrier", "body_velocity"),
        ),
        [
            (0.3, 0.2, 2.0, 1.0, 2.5, 0.6, 0.1, 0.2, 0.5, 0.7, 0.3, -0.1, 0.4, 0.2),
            (0.3, 0.2, 2.0, 1.0, 2.0, 0.5, 0.1, 0.2, 0.0, 0.7, 0.3, 0.0, 0.4, 0.2),
        ],
    ),
    Form(
        arm,
        of("ArmPendulum", "poles", "light_poles", "rest"),
        [
            (3.0, 0.02, 2.0, 0.4),
            (3.0, 0.0, 2.0, 0.4),
            (3.0, 1.0, 2.0, 0.4),
            (3.0, 1e-9, 3.0001, 0.4),
        ],
        exact=twins.arm,
    ),
    Form(
        shapes,
        free("beam_shape", "beam_integral"),
        [(0.3, 0.8), (0.0, 1.0), (1.0, 0.0), (0.5, 0.5), (0.774955, 0.9)],
    ),
    Form(
        missile,
        of(
            "FlexibleMissile",
            "frequencies",
            "matrices",
            "hinge",
            "across",
            "slopes",
            "engine",
            "lever",
            "inertia",
            "accelerations",
            "tail_wags_dog_frequency",
        ),
        [(*MISSILE, 4.0, 0.02, 1e-3, 2e-3, 0.1, 0.01, 0.02, 0.03)],
    ),
    Form(
        felt,
        of("MissileLoop", "felt_pitch"),
        [(2.0, 1e-3, 2e-3, 0.1, 1e-2, 2e-2, 0.01), (0.0, 1e-3, 0.0, 0.0, 0.0, 1e-2, 0.0)],
    ),
    Form(action_of_a_swing, free("action"), [(0.3, 3.1, 1.0, 9.8, 1.0), (0.0, 3.1, 1.0, 9.8, 1.0)]),
    Form(
        variational,
        free("variational_motion"),
        [(1.0, 9.8, 1.2, 0.4, 0.1), (1.0, 9.8, 0.0, 0.0, 0.1)],
    ),
)
