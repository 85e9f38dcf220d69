"""Thomson, chapter 9 and appendices: systems by their Lagrangian, impulses, beams, variations."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from reference_run import run
from scipy.optimize import brentq

from jaxspace.mechanics import (
    ArmPendulum,
    ArmState,
    CentrifugalPendulum,
    DoublePendulum,
    ElasticPendulum,
    FlexibleMissile,
    FramedPendulum,
    GeneralisedState,
    InclineDisk,
    Lagrangian,
    RotatingHoop,
    SimplePendulum,
    SliderCarrier,
    Trailer,
    TrailerState,
)
from jaxspace.mechanics.beams import beam_roots, beam_shape
from jaxspace.mechanics.constraints import degrees_of_freedom
from jaxspace.mechanics.impulse import apply_impact, apply_impulse
from jaxspace.mechanics.reduction import routh
from jaxspace.mechanics.rolling import rolling_loop, turntable_motion
from jaxspace.mechanics.variational import action, hanging_chain
from jaxspace.studies import modes

from .case import DEG, LINEAR, STEPS, Case, vec

G, G_FEET = 9.80665, 32.2


linear = eqx.filter_jit(modes)


def after(system, y0, t):
    """Coordinates and rates a time later."""
    states = run(system, y0, [0.0, t], rtol=3e-14, atol=1e-15)
    return states.coordinates[:, -1], states.rates[:, -1]


def freedom():
    """Particles at random places, bound at their distances."""
    places = jnp.asarray(np.random.default_rng(1).normal(size=9))

    def count(n, constraints):
        names = tuple(f"x{i}" for i in range(n))
        system = Lagrangian(
            lambda t, q, v, p: 0.5 * jnp.sum(v * v, axis=0),
            names,
            fixed=lambda t, q, p: jnp.stack(constraints(q)),
        )
        return float(degrees_of_freedom(system, system.state(places[:n])))

    def apart(q, i, j):
        d = q[3 * i : 3 * i + 3] - (q[3 * j : 3 * j + 3] if j is not None else 0.0)
        return jnp.sum(d * d, axis=0)

    return (
        count(9, lambda q: [apart(q, 0, 1), apart(q, 1, 2), apart(q, 0, 2)]),
        count(6, lambda q: [apart(q, 0, 1)]),
        count(6, lambda q: [apart(q, 0, None), apart(q, 0, 1)]),
        count(6, lambda q: [apart(q, 0, None), apart(q, 0, 1), q[2], q[5]]),
    )


def double_pendulum(m1, m2, l1, l2, t):
    system = DoublePendulum(m1, m2, l1, l2, G)
    y0 = system.state(0.1, -0.05)
    q, v = after(system, y0, t)
    x = l1 * jnp.sin(q[0]) + l2 * jnp.sin(q[1])
    depth = l1 * jnp.cos(q[0]) + l2 * jnp.cos(q[1])
    return q[0], q[1], v[0], v[1], system.energy(0.0, y0), x, depth


def double_frequencies(m1, m2, l1, l2):
    @jax.jit
    def both(m1, m2, l1, l2):
        system = DoublePendulum(m1, m2, l1, l2, G)
        w = modes(system, system.state(0.0, 0.0)).frequencies
        return w[0], w[2]

    return *both(m1, m2, l1, l2), *both(1.0, 1.0, 1.0, 1.0)


def oscillator_action(m, w, T, x0, xT):
    """The action of the motion, and what three variations add."""
    system = Lagrangian(lambda t, q, v, p: 0.5 * m * (v[0] ** 2 - w * w * q[0] ** 2), ("x",))

    def motion(t):
        return (x0 * jnp.sin(w * (T - t)) + xT * jnp.sin(w * t))[None] / jnp.sin(w * T)

    @jax.jit
    def change(k):
        # Of a quadratic Lagrangian the second variation is the action of the change.
        return action(system, lambda t: 0.05 * jnp.sin(k * jnp.pi * t / T)[None], 0.0, T)

    return action(system, motion, 0.0, T), change(1.0), change(2.0), change(3.0)


def incline(n, psi, phi_rate, t):
    disk = InclineDisk(1.0, 0.5, 10 * DEG, G_FEET)
    x, y, phi, rate = disk.rolled(t, psi, n, phi_rate)
    heading = psi + n * t
    state = GeneralisedState(vec(x, y, heading, phi), disk.state(heading, n, rate).rates)
    along, across = disk.reactions(0.0, state).multipliers
    c, s = jnp.cos(heading), jnp.sin(heading)
    return x, y, phi, rate, along * c + across * s, across * c - along * s


def rhombus(m, a, theta, impulse):
    """Four bars of length 2 a; the vertex lies 2 a cos(theta) above the centre."""
    system = Lagrangian(
        lambda t, q, v, p: 2.0 * m * v[0] ** 2 + 8.0 / 3.0 * m * a * a * v[1] ** 2, ("y", "theta")
    )
    push = impulse * vec(1.0, -2.0 * a * jnp.sin(theta))
    end = apply_impulse(system, 0.0, system.state([0.0, theta]), push)
    return end.rates[1], end.rates[0], system.energy(0.0, end)


def elastic(t):
    system = ElasticPendulum(1.0, 100.0, 0.8, G)
    y0 = system.state(0.9480665, 0.3)
    q, _ = after(system, y0, t)
    return *system.frequencies, q[0], q[1], system.energy(0.0, y0)


def centrifugal(t):
    system = CentrifugalPendulum(0.5, 0.2, 0.3, 0.1)
    q, v = after(system, system.state(40.0, 0.3), t)
    return (
        *system.frequencies(40.0),
        system.energy(0.0, system.state(40.0, 0.3, 2.0)),
        *(q[0], q[1], v[0], v[1]),
    )


def hoop(t):
    system = RotatingHoop(1.0, 0.5, 3.0, G)
    y0 = system.state(0.3)
    q, v = after(system, y0, t)
    end = GeneralisedState(q, v)
    jacobi = system.energy(0.0, y0)
    bottom = linear(system, system.state(0.0)).frequencies[0]
    return (
        *(q[0], v[0], jacobi),
        *(system.mechanical_energy(end), system.mechanical_energy(y0), bottom),
    )


def falling_bar(l, h, theta, e):
    """A bar of length 2 l; the end that strikes lies l sin(theta) below its centre."""
    system = Lagrangian(
        lambda t, q, v, p: 0.5 * (v[0] ** 2 + l * l / 3.0 * v[1] ** 2), ("height", "theta")
    )
    before = jnp.sqrt(2.0 * G * h)
    y = system.state([l * jnp.sin(theta), theta], [-before, 0.0 * before])
    end, impulse = apply_impact(system, 0.0, y, lambda q: (q[0] - l * jnp.sin(q[1]))[None], e)
    lost = system.energy(0.0, y) - system.energy(0.0, end)
    # The other end falls to the floor, while the bar turns and its centre falls.
    t = jnp.asarray(0.06)
    for _ in range(8):
        turned = theta + end.rates[1] * t
        height = y.coordinates[0] + end.rates[0] * t - 0.5 * G * t * t + l * jnp.sin(turned)
        rate = end.rates[0] - G * t + l * jnp.cos(turned) * end.rates[1]
        t = t - height / rate
    return (
        *(before, -end.rates[0], -end.rates[1], impulse[0]),
        *(t, (theta + end.rates[1] * t) / DEG, lost),
    )


def two_bars(m, l, impulse):
    """v + w x along each bar; the blow at the end of the first."""

    def kinetic(t, q, v, p):
        def bar(w, sign):
            return v[0] ** 2 * l + sign * v[0] * w * l * l + w * w * l**3 / 3.0

        return 0.5 * m / l * (bar(v[1], -1.0) + bar(v[2], 1.0))

    system = Lagrangian(kinetic, ("y", "a", "b"))
    end = apply_impulse(system, 0.0, system.state(vec(0, 0, 0)), impulse * vec(1.0, -l, 0.0))
    v = end.rates
    return v[0], v[1], v[2], v[0] - l * v[1], system.energy(0.0, end)


def framed(t):
    system = FramedPendulum(0.3, 1.0, 0.8, G)
    y0 = system.state(0.0, 0.2 / 0.8, 0.0, 2.0)
    q, v = after(system, y0, t)
    reduced = routh(system, y0)
    still = reduced.state([0.0])
    energy = jax.jit(lambda q, v: reduced.energy(0.0, GeneralisedState(q, v)))
    most = energy(vec(0.0), vec(0.25))

    def at_rest(theta):
        return float(energy(vec(theta), vec(0.0)) - most)

    top = brentq(at_rest, 0.05, 0.2, xtol=1e-15, rtol=1e-14)
    return q[0], q[1], v[0], v[1], top, linear(reduced, still).frequencies[0] ** 2


def arm(w):
    pendulum = ArmPendulum(3.0, 0.02, w, 0.4)
    s, light = pendulum.poles, pendulum.light_poles
    return (
        *(s[0].real, s[0].imag, s[1].real, s[1].imag),
        *(light[0].real, light[0].imag, light[1].real, light[1].imag),
        pendulum.rest,
    )


def arm_motion(t):
    """By the exponential of the linearised system."""
    pendulum = ArmPendulum(3.0, 0.02, 2.0, 0.4)
    rest = ArmState(vec(pendulum.rest, 0.0), vec(0.0, 0.0))
    a = linear(pendulum, rest).matrix
    away = jax.scipy.linalg.expm(a * t) @ vec(0.42 - pendulum.rest, 0.0, 0.0, 0.0)
    return rest.position[0] + away[0], away[1]


def trailer(c):
    system = Trailer(800.0, 1.0, 2.5, c, 20000.0, 20.0)
    found = linear(system, TrailerState(*(jnp.zeros(()) for _ in range(3))))
    roots = found.eigenvalues
    return found.growth, system.stability_margin, roots[0].real, roots[1].imag


def unwinding(m, r):
    """A disk that unwinds from a string: y - r theta = 0."""
    system = Lagrangian(
        lambda t, q, v, p: 0.5 * m * (v[0] ** 2 + 0.5 * (r * v[1]) ** 2) + m * G * q[0],
        ("y", "theta"),
        fixed=lambda t, q, p: (q[0] - r * q[1])[None],
    )
    found = system.reactions(0.0, system.state([0.0, 0.0]))
    return *found.accelerations, -found.multipliers[0]


def slider(t):
    system = SliderCarrier(10.0, 4.0, 1.0, 30.0, 0.6)
    y0 = GeneralisedState(vec(0, 0, 0, 0.8), vec(1.0, 0.0, 2.0, 0.0))
    q, v = after(system, y0, t)
    end = GeneralisedState(q, v)
    p = system.momenta(0.0, end)
    spin = p[2] + q[0] * p[1] - q[1] * p[0]
    return (
        *(*system.body_velocity(end), v[2], q[3], v[3], q[2], q[0], q[1]),
        *(p[0], p[1], spin, system.energy(0.0, end)),
    )


def missile(modes=3, thrust=0.0):
    return FlexibleMissile(20000.0, 20.0, 2e8, 1.5, 3e6, thrust, modes=modes)


def missile_modes():
    found = missile()
    shapes, slopes, s = found.hinge
    engine = found.engine
    tips = [beam_shape("free-free", b, 0.0) for b in found.roots]
    return (
        *(jnp.asarray(found.roots), found.frequencies, jnp.stack(tips), shapes, slopes, s),
        *(engine["mass"], engine["centre"], engine["moment"], found.inertia),
        *(engine["shift"], engine["turn"], engine["free_moment"]),
    )


def sprung_hinge(modes):
    return (np.sqrt(missile(modes).coupled_frequencies_squared.real)[:4],)


def exact_hinge():
    """Two free beams joined by a spring, from the exact determinant: bisected near each mode."""
    L, b, mu, EI, K = 20.0, 1.5, 1000.0, 2e8, 3e6

    def determinant(w):
        k = (mu * w * w / EI) ** 0.25

        def free(x):
            # Free at x = 0: cosh + cos and sinh + sin; deflection, slope, moment, shear.
            e, f = np.cosh(x) + np.cos(x), np.sinh(x) + np.sin(x)
            g, h = np.sinh(x) - np.sin(x), np.cosh(x) - np.cos(x)
            return np.array([[e, f], [k * g, k * e], [k**2 * h, k**2 * g], [k**3 * f, k**3 * h]])

        one, two = free(k * (L - b)), free(k * b)
        # From the other end slope and shear change their sign.
        two = two * np.array([1.0, -1.0, 1.0, -1.0])[:, None]
        rows = [
            np.r_[one[0], -two[0]],
            np.r_[one[2], -two[2]],
            np.r_[one[3], -two[3]],
            # The spring carries the moment: EI y'' = K (slope jump).
            np.r_[EI * one[2] / K + one[1], -two[1]],
        ]
        scale = [np.abs(row).max() for row in rows]
        return np.linalg.det(np.array([row / size for row, size in zip(rows, scale, strict=True)]))

    found = []
    for guess in sprung_hinge(12)[0]:
        low, high = 0.9999 * guess, guess * 1.000001
        sign = np.sign(determinant(low))
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.sign(determinant(middle)) == sign else (low, middle)
        found.append(0.5 * (low + high))
    return (np.array(found),)


def pushed(thrust):
    # The factor (1 - C_2) of the missile is taken from these rows: they are no independent check.
    found = missile(3, thrust)
    m, k = found.matrices
    return np.sqrt(found.coupled_frequencies_squared.real), -k[0, 0] / m[0, 0]


def lumped_mass(m, x, x0, y0, turn, y, y_rate, zeta, zeta_rate):
    """A mass on a missile: with and without its own deflection."""

    def kinetic(zeta, zeta_rate):
        return 0.5 * m * ((x0 - (y + zeta) * turn) ** 2 + (y0 + y_rate + zeta_rate + x * turn) ** 2)

    return kinetic(zeta, zeta_rate), kinetic(zeta, zeta_rate) - kinetic(0.0, 0.0)


def free_end():
    """Ritz: polynomials that vanish at the start, one step of Newton on the action less x(1)."""
    system = Lagrangian(lambda t, q, v, p: 0.5 * (v[0] ** 2 + q[0] ** 2), ("x",))

    k = jnp.arange(14.0)

    def total(c):
        # Chebyshev's polynomials, times t; at t = 1 each of them is 1.
        def path(t):
            return (t * jnp.sum(c * jnp.cos(k * jnp.arccos(2.0 * t - 1.0))))[None]

        return action(system, path, 0.0, 1.0, 1) - jnp.sum(c)

    @jax.jit
    def minimum(c):
        c = c - jnp.linalg.solve(jax.hessian(total)(c), jax.grad(total)(c))
        return jnp.sum(c), total(c), jnp.sum(c * jnp.cos(jnp.pi * k))

    return minimum(jnp.zeros(14))


CASES = [
    Case(
        "T9.2-dof",
        "Degrees of freedom of bound particles",
        (degrees_of_freedom,),
        {},
        freedom,
        {
            "rigid_body_3pts": 6.0,
            "two_bound_particles": 5.0,
            "double_pendulum_in_space_3D": 4.0,
            "double_pendulum_plane": 2.0,
        },
        1e-11,
    ),
    Case(
        "T9.3-double-small",
        "Double pendulum after 5 s",
        (DoublePendulum,),
        {"m1": 2.0, "m2": 1.0, "l1": 1.0, "l2": 0.8, "t": 5.0},
        double_pendulum,
        {
            "theta1 (rad)": 0.09053715784648414,
            "theta2 (rad)": -0.05458338434699783,
            "theta1_dot (rad/s)": -0.1481514046783598,
            "theta2_dot (rad/s)": 0.09620045361145217,
            "energy (J)": -37.10848818515309,
            "x2 (m)": 0.04676849236066405,
            "y2 (m)": 1.7947128678763047,
        },
        1e-10,
        why=STEPS,
    ),
    Case(
        "T9.3-double-lin",
        "Frequencies of the double pendulum; of equal rods and masses",
        (
            DoublePendulum,
            modes,
        ),
        {"m1": 2.0, "m2": 1.0, "l1": 1.0, "l2": 0.8},
        double_frequencies,
        {
            "w1 (rad/s)": 2.622418053497976,
            "w2 (rad/s)": 5.1205827112437,
            "w1_equal (rad/s)": 2.3967900551683465,
            "w2_equal (rad/s)": 5.786363057348382,
        },
        1e-12,
        why=LINEAR,
    ),
    Case(
        "T9.3-swing",
        "The same period as T9.3-simple by the plane pendulum",
        (SimplePendulum.period,),
        {"amplitude": 90 * DEG},
        lambda amplitude: (SimplePendulum(1.0, G).period(amplitude),),
        {
            "period (s)": 2.3682463462860097,
        },
        1e-12,
    ),
    Case(
        "T9.4",
        "A wheel that rolls around a circle comes back turned",
        (rolling_loop,),
        {"radius": 0.3, "turn_rate": 0.5, "roll_rate": 4.0},
        rolling_loop,
        {
            "path_radius (m)": 2.4,
            "loop_time (s)": 12.566370614359172,
            "phi_gain (rad)": 50.26548245743669,
        },
        1e-12,
    ),
    Case(
        "T9.6-P3-turntable",
        "Sphere on a turntable after 4 s",
        (turntable_motion,),
        {"t": 4.0},
        lambda t: (2 / 7 * 3.0, *turntable_motion(t, vec(0.5, 0.0), vec(0.0, 0.2), 3.0)[0]),
        {
            "orbit_rate (rad/s)": 0.8571428571428571,
            "x (m)": 0.04287586705928903,
            "y (m)": -0.06604636595252632,
        },
        1e-12,
    ),
    Case(
        "T9.7",
        "Action of an oscillator and three second variations",
        (
            action,
            Lagrangian,
        ),
        {"m": 1.5, "w": 2.0, "T": 1.1, "x0": 0.3, "xT": -0.2},
        oscillator_action,
        {
            "S (J*s)": 0.08069582230295966,
            "second_var_k1 (J*s)": 0.004286594660019339,
            "second_var_k2 (J*s)": 0.029521378640077357,
            "second_var_k3 (J*s)": 0.07157935194017405,
        },
        1e-12,
    ),
    Case(
        "T9.8-cantilever",
        "Roots of the clamped-free beam",
        (beam_roots,),
        {},
        lambda: (beam_roots("clamped-free", 3),),
        {
            "roots": [1.8751040687119611, 4.694091132974175, 7.854757438237613],
        },
        1e-12,
    ),
    Case(
        "T9.9-Ex1-general",
        "Disk that rolls on an incline, with its forces of contact: general",
        (
            InclineDisk.rolled,
            InclineDisk.reactions,
        ),
        {"n": 1.5, "psi": 0.4, "phi_rate": 2.0, "t": 5.0},
        incline,
        {
            "x (ft)": 0.7141018288286076,
            "y (ft)": 6.568725357755088,
            "phi (rad)": 3.5269004460118123,
            "phi_dot (rad/s)": 5.029449218926281,
            "rolling_friction_per_mass (ft/s^2)": 0.08573985540425554,
            "lateral_constraint_force_per_mass (ft/s^2)": 9.357638778328344,
        },
        1e-11,
    ),
    Case(
        "T9.9-Ex1-downhill",
        "Disk that rolls on an incline, with its forces of contact: downhill",
        (
            InclineDisk.rolled,
            InclineDisk.reactions,
        ),
        {"n": 0.001, "psi": 0.0, "phi_rate": 0.0, "t": 5.0},
        incline,
        {
            "x (ft)": 46.59520604530112,
            "y (ft)": 0.15531787121109525,
            "phi (rad)": 93.19099453312346,
            "phi_dot (rad/s)": 37.27632015404739,
            "rolling_friction_per_mass (ft/s^2)": -1.8638004758764188,
            "lateral_constraint_force_per_mass (ft/s^2)": 0.04659540019255924,
        },
        1e-11,
    ),
    Case(
        "T9.10-Ex1",
        "Rhombus of four bars struck along a diagonal",
        (apply_impulse,),
        {"m": 2.0, "a": 0.4, "theta": 35 * DEG, "impulse": 6.0},
        rhombus,
        {
            "theta_dot (rad/s)": -1.6131837272373168,
            "y0_dot (m/s)": 0.75,
            "T (J)": 4.470682016275868,
        },
        1e-12,
    ),
    Case(
        "T9.10-P8",
        "Elastic pendulum after 5 s",
        (ElasticPendulum,),
        {"t": 5.0},
        elastic,
        {
            "freq_bounce (rad/s)": 10.0,
            "freq_swing (rad/s)": 3.304502536357567,
            "r (m)": 0.9536595292164529,
            "theta (rad)": -0.24123874520804506,
            "energy (J)": -7.785919345018417,
        },
        1e-10,
        why=STEPS,
    ),
    Case(
        "T9.10-P11",
        "Centrifugal pendulum on a free flywheel after 0.5 s",
        (CentrifugalPendulum,),
        {"t": 0.5},
        centrifugal,
        {
            "freq_fixed_speed (rad/s)": 69.28203230275508,
            "freq_free_flywheel (rad/s)": 71.46467658920734,
            "T_at_phid2 (J)": 425.7937918103861,
            "theta (rad)": 19.997252516108777,
            "phi (rad)": -0.18016188994093232,
            "theta_dot (rad/s)": 39.721118082060336,
            "phi_dot (rad/s)": 17.036996110038686,
        },
        1e-09,
        why=STEPS,
    ),
    Case(
        "T9.10-P12-below",
        "Bead on a hoop below the bifurcation after 5 s",
        (
            RotatingHoop,
            modes,
        ),
        {"t": 5.0},
        hoop,
        {
            "theta (rad)": -0.22569567332941043,
            "theta_dot (rad/s)": 0.6495261269269169,
            "jacobi (J)": 0.1207509928448819,
            "energy_t (J)": 0.23342981930986056,
            "energy_0 (J)": 0.3172484260714938,
            "freq_bottom (rad/s)": 3.2578060101853823,
        },
        1e-09,
        why=STEPS,
    ),
    Case(
        "T9.10-P13",
        "A bar strikes the floor with one end, then with the other",
        (apply_impact,),
        {"l": 0.5, "h": 1.0, "theta": 30 * DEG, "e": 0.5},
        falling_bar,
        {
            "v_before (m/s)": 4.428690551393267,
            "v_centre_down (m/s)": 2.3846795276732977,
            "omega (rad/s)": 10.62099283294158,
            "impulse_per_mass (m/s)": 2.044011023719969,
            "t_second_impact (s)": 0.06394441516583917,
            "theta_second_impact_deg (deg)": -8.912610580896013,
            "energy_loss_per_mass (J/kg)": 2.2630730769230762,
        },
        1e-11,
    ),
    Case(
        "T9.10-P16",
        "A disk unwinds from a string: multiplier and accelerations",
        (Lagrangian,),
        {"m": 2.0, "r": 0.1},
        unwinding,
        {
            "y_acc (m/s^2)": 6.537766666666666,
            "theta_acc (rad/s^2)": 65.37766666666667,
            "tension (N)": 6.537766666666666,
        },
        1e-12,
    ),
    Case(
        "T9.10-P17",
        "Two hinged bars struck at one end",
        (apply_impulse,),
        {"m": 2.0, "l": 0.7, "impulse": 3.0},
        two_bars,
        {
            "hinge_velocity (m/s)": -1.5,
            "omega1 (rad/s)": -9.642857142857144,
            "omega2 (rad/s)": 3.2142857142857144,
            "end_velocity (m/s)": 5.25,
            "T (J)": 7.875,
        },
        1e-12,
    ),
    Case(
        "T9.10-P19-slow",
        "Pendulum in a free frame after 5 s; its small swing by Routh",
        (
            FramedPendulum,
            routh,
            modes,
        ),
        {"t": 5.0},
        framed,
        {
            "theta (rad)": 0.08235679039359177,
            "phi (rad)": 9.91947438502319,
            "theta_dot (rad/s)": -0.07802112439659976,
            "phi_dot (rad/s)": 1.971537019744026,
            "theta_max (rad)": 0.08665420508665221,
            "small_w2 (1/s^2)": 8.258312499999999,
        },
        1e-09,
        why=STEPS,
    ),
    Case(
        "T9.10-P20-w2.0",
        "Poles of a pendulum on an arm at 2.0 rad/s",
        (
            ArmPendulum.poles,
            ArmPendulum.light_poles,
        ),
        {"w": 2.0},
        arm,
        {
            "s1_re (1/s)": -0.10000444439490042,
            "s1_im (1/s)": -4.9996667074145655,
            "s2_re (1/s)": -0.019995555605099587,
            "s2_im (1/s)": 0.999666707414566,
            "s1_book_re (1/s)": -0.1,
            "s1_book_im (1/s)": -5.0,
            "s2_book_re (1/s)": -0.02,
            "s2_book_im (1/s)": 1.0,
            "x0 (m)": 0.32,
        },
        1e-11,
    ),
    Case(
        "T9.10-P20-w3.2",
        "Poles of a pendulum on an arm at 3.2 rad/s",
        (
            ArmPendulum.poles,
            ArmPendulum.light_poles,
        ),
        {"w": 3.2},
        arm,
        {
            "s1_re (1/s)": -0.12399823731947288,
            "s1_im (1/s)": -6.200082627925438,
            "s2_re (1/s)": 0.00399823731947288,
            "s2_im (1/s)": -0.19991737207456284,
            "s1_book_re (1/s)": -0.12400000000000001,
            "s1_book_im (1/s)": -6.2,
            "s2_book_re (1/s)": 0.0040000000000000036,
            "s2_book_im (1/s)": -0.20000000000000018,
            "x0 (m)": -3.3032258064516085,
        },
        1e-11,
    ),
    Case(
        "T9.10-P20-sim",
        "The same pendulum after 6 s",
        (
            ArmPendulum,
            modes,
        ),
        {"t": 6.0},
        arm_motion,
        {
            "x (m)": 0.3918881533016445,
            "y (m)": -0.012189200378960227,
        },
        1e-11,
        why=LINEAR,
    ),
    Case(
        "T9.10-P22-stable",
        "Trailer, stable",
        (
            Trailer,
            modes,
        ),
        {"c": 0.6},
        trailer,
        {
            "max_real_part (1/s)": -0.930601150029339,
            "stability_margin (m^2)": 0.5,
            "real_root (1/s)": -6.962327111706035,
            "abs_im (rad/s)": 12.760489568594213,
        },
        1e-10,
        1e-12,
        why=LINEAR,
    ),
    Case(
        "T9.10-P22-unstable",
        "Trailer, unstable",
        (
            Trailer,
            modes,
        ),
        {"c": 0.3},
        trailer,
        {
            "max_real_part (1/s)": 0.6512987545044355,
            "stability_margin (m^2)": -0.25,
            "real_root (1/s)": -6.807184664972173,
            "abs_im (rad/s)": 13.720763298075108,
        },
        1e-10,
        1e-12,
        why=LINEAR,
    ),
    Case(
        "T9.10-P22-neutral",
        "Trailer, neutral",
        (
            Trailer,
            modes,
        ),
        {"c": 0.4},
        trailer,
        {
            "max_real_part (1/s)": 0.0,
            "stability_margin (m^2)": 0.0,
            "real_root (1/s)": -6.8965517241379315,
            "abs_im (rad/s)": 13.46291201783626,
        },
        1e-10,
        1e-12,
        why=LINEAR,
    ),
    Case(
        "T9.11-slider",
        "Slider on a free carrier after 6 s, with what it keeps",
        (SliderCarrier,),
        {"t": 6.0},
        slider,
        {
            "vx (m/s)": 1.0133065771485728,
            "vy (m/s)": 0.1939389502872738,
            "omega (rad/s)": 2.0738182925980686,
            "s (m)": 0.6786747562209606,
            "sdot (m/s)": -0.6096318075850039,
            "theta (rad)": 12.386626742425415,
            "X (m)": 6.012023547568064,
            "Y (m)": 0.8837574389888755,
            "P_X (kg*m/s)": 11.0,
            "P_Y (kg*m/s)": 1.6,
            "H (kg*m^2/s)": 9.280000000000001,
            "energy (J)": 15.38,
        },
        1e-09,
        why=STEPS,
    ),
    Case(
        "T9.12-modes",
        "Uniform missile: modes, hinge and engine",
        (
            FlexibleMissile,
            beam_shape,
        ),
        {},
        missile_modes,
        {
            "roots": [4.730040744862704, 7.853204624095838, 10.995607838001671],
            "frequencies (rad/s)": [25.01409357093598, 68.9523121484866, 135.17410130606723],
            "at the tip": [2.0, 2.0, 2.0],
            "at the hinge": [1.3041365268211953, 0.8299508785150569, 0.3829096049535386],
            "slopes there (1/m)": [-0.46151458173346555, -0.7631247264947479, -1.0178821641006],
            "S (kg m)": [1988.6848126497814, 1808.6027118885236, 1634.0682072446834],
            "m_e (kg)": 1500.0,
            "z_e (m)": 0.75,
            "I_h (kg*m^2)": 1125.0,
            "I_0 (kg*m^2)": 666666.6666666666,
            "C1 (m)": 0.05625,
            "C2": 0.01603125,
            "J_delta (kg*m^2)": 890.384765625,
        },
        1e-10,
    ),
    Case(
        "T9.12-hinge-N1",
        "Sprung hinge without thrust, 1 modes",
        (FlexibleMissile,),
        {"modes": 1},
        sprung_hinge,
        {
            "frequencies (rad/s)": [24.43642240183486, 67.36798384973176],
        },
        1e-10,
    ),
    Case(
        "T9.12-hinge-N2",
        "Sprung hinge without thrust, 2 modes",
        (FlexibleMissile,),
        {"modes": 2},
        sprung_hinge,
        {
            "frequencies (rad/s)": [24.433404887439668, 55.947740195954204, 95.00866951359255],
        },
        1e-10,
    ),
    Case(
        "T9.12-hinge-N3",
        "Sprung hinge without thrust, 3 modes",
        (FlexibleMissile,),
        {"modes": 3},
        sprung_hinge,
        {
            "frequencies (rad/s)": [
                24.43282228352655,
                55.55372944306526,
                89.37766430987747,
                167.36111304846276,
            ],
        },
        1e-10,
    ),
    Case(
        "T9.12-hinge",
        "Sprung hinge without thrust, 12 modes",
        (FlexibleMissile,),
        {"modes": 12},
        sprung_hinge,
        {
            "frequencies (rad/s)": [
                24.43255763052034,
                55.395927166457994,
                88.2660656195447,
                157.47540735561228,
            ],
        },
        1e-10,
    ),
    Case(
        "T9.12-hinge-exact",
        "The same by the exact determinant of two beams",
        (FlexibleMissile,),
        {},
        exact_hinge,
        {
            "frequencies (rad/s)": [
                24.432557554599022,
                55.3958837522929,
                88.26579882428902,
                157.47436506615813,
            ],
        },
        1e-10,
    ),
    Case(
        "T9.12-thrust-235kN",
        "Sprung hinge under 235 kN",
        (FlexibleMissile,),
        {"thrust": 235000.0},
        pushed,
        {
            "frequencies (rad/s)": [
                24.693407970831185,
                55.36499914612812,
                88.96035705465991,
                167.13317988615,
            ],
            "rigid_delta_s2 (1/s^2)": -3333.1271823320762,
        },
        1e-10,
    ),
    Case(
        "T9.12-thrust-2000kN",
        "Sprung hinge under 2000 kN",
        (FlexibleMissile,),
        {"thrust": 2000000.0},
        pushed,
        {
            "frequencies (rad/s)": [
                26.933533400489097,
                53.576217219803375,
                85.74920595580764,
                165.4722903546097,
            ],
            "rigid_delta_s2 (1/s^2)": -3061.221776926671,
        },
        1e-10,
    ),
    Case(
        "T9.12-P1",
        "Kinetic energy of a lumped mass on a missile",
        (Lagrangian,),
        {
            "m": 500.0,
            "x": 2.0,
            "x0": 100.0,
            "y0": 1.0,
            "turn": 0.05,
            "y": 0.02,
            "y_rate": 0.3,
            "zeta": 0.1,
            "zeta_rate": -0.4,
        },
        lumped_mass,
        {
            "T_j (J)": 2499950.009,
            "T_added (J)": -489.9912499994971,
        },
        1e-12,
        why="closed form: the difference of large energies",
    ),
    Case(
        "TC-9",
        "Free end: a Ritz minimum of the action",
        (action,),
        {},
        free_end,
        {
            "x_end": 0.7615941559557649,
            "I_min": -0.3807970779778824,
            "xdot_0": 0.6480542736638853,
        },
        1e-12,
    ),
    Case(
        "TC-12",
        "Hanging chain",
        (hanging_chain,),
        {"span": 1.0, "length": 1.5},
        hanging_chain,
        {
            "parameter_a (m)": 0.3082364697360404,
            "sag (m)": 0.5026332616483151,
        },
        1e-12,
    ),
]
