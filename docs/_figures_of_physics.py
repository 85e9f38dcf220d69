"""Pictures of the pages of the physics: each function draws one."""

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from jaxspace import (
    Accuracy,
    BodyState,
    Scene,
    simulate,
    simulate_batch,
)
from jaxspace.attitude import GravityGradient, Top, TorqueFreeBody
from jaxspace.attitude.gravity_gradient import pitch_libration_period
from jaxspace.bodies import BurningBody, PrincipalInertia, RigidBody
from jaxspace.constants import MU_EARTH, RADIUS_EARTH
from jaxspace.gyros import TwoGimbalGyro
from jaxspace.optimization import (
    SteeringProfile,
    optimal_staging,
    optimise_steering,
)
from jaxspace.optimization.ascent import Ascent, ConstantMassFlow
from jaxspace.optimization.steering import linear_tangent_steering
from jaxspace.orbits import (
    ClassicalElements,
    PointGravity,
    TwoBody,
)
from jaxspace.orbits.elements import state_from_elements
from jaxspace.orbits.lambert import lambert, least_duration
from jaxspace.rockets import JetDamping, Thrust
from jaxspace.rockets.jet_damping import jet_damping_ratio
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853


def top():
    """The path of a heavy top's axis seen from above, for three ways of letting it go."""
    system = Top(
        transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08
    )
    figure, panels = plt.subplots(
        1, 3, figsize=(9.6, 3.5), layout="constrained"
    )
    starts = (
        ("initial backward precession: loops", -4.0),
        ("released at rest: cusps", 0.0),
        ("initial forward precession: waves", 1.2),
    )
    circle = np.linspace(0.0, 2.0 * np.pi, 200)
    for panel, (title, rate) in zip(panels, starts, strict=True):
        tilt = jnp.radians(35.0)
        y0 = system.state(
            [0.0, tilt, 0.0], [rate, 0.0, 60.0 - rate * jnp.cos(tilt)]
        )
        states = simulate(
            system, y0, jnp.linspace(0.0, 2.6, 3000), accuracy=1e-10
        ).states
        x, y, _ = np.asarray(
            states.attitude.rotate(jnp.array([[0.0], [0.0], [1.0]]))
        )
        for angle in system.nutation(y0).turning_points:
            panel.plot(
                np.sin(angle) * np.cos(circle),
                np.sin(angle) * np.sin(circle),
                "--",
                color="0.6",
                lw=1.0,
            )
        panel.plot(x, y, lw=1.3)
        panel.plot(x[0], y[0], "o", ms=4, color="C3")
        panel.set(
            title=title,
            xlabel="x component of the axis direction",
            aspect="equal",
            xlim=(-0.8, 0.8),
            ylim=(-0.8, 0.8),
        )
        panel.set(xticks=[-0.5, 0.0, 0.5], yticks=[-0.5, 0.0, 0.5])
    panels[0].set_ylabel("y component of the axis direction")
    return figure


def two_body():
    """What accuracy costs: error, its estimate and the drift of the energy against evaluations."""
    system, e = TwoBody(MU_EARTH), 0.7
    elements = ClassicalElements.from_periapsis(RADIUS_EARTH + 500e3, e)
    y0 = BodyState(*state_from_elements(elements, MU_EARTH))
    a = float(elements.semi_latus_rectum) / (1.0 - e * e)
    ts = jnp.linspace(0.0, 10.0 * np.pi * np.sqrt(a**3 / MU_EARTH), 11)
    exact = simulate(system, y0, ts).final.position
    rows = []
    for rtol in 10.0 ** np.arange(-5.0, -13.5, -1.0):
        run = simulate(
            system, y0, ts, accuracy=Accuracy(rtol=rtol, method=DOP853())
        )
        error, estimate = (
            float(jnp.linalg.norm(x)) / a
            for x in (run.final.position - exact, run.error().position)
        )
        rows.append(
            (
                int(run.stats["evaluations"]),
                error,
                estimate,
                float(jnp.max(run.drift()["energy"])),
            )
        )
    cost, error, estimate, drift = np.array(rows).T
    figure, panel = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    panel.loglog(cost, error, "o-", label="error relative to the closed form")
    panel.loglog(
        cost, estimate, "x--", label="estimate of Trajectory.error()"
    )
    panel.loglog(cost, drift, "s:", label="relative drift of the energy")
    panel.set(
        xlabel="evaluations of the vector field",
        ylabel="relative error or drift",
    )
    panel.set_title("Five revolutions, eccentricity 0.7, DOP853")
    panel.set_xticks(
        [1000, 2000, 4000, 8000], labels=["1000", "2000", "4000", "8000"]
    )
    panel.minorticks_off()
    panel.grid(alpha=0.3)
    panel.legend()
    return figure


def transfers():
    """From one circular orbit to another 120 degrees on: the impulses needed against the duration,
    by every way there is."""
    far = 2.0
    r1 = jnp.array([1.0, 0.0, 0.0])
    angle = jnp.radians(120.0)
    r2 = far * jnp.stack([jnp.cos(angle), jnp.sin(angle), 0.0 * angle])
    u1, u2 = (
        jnp.array([0.0, 1.0, 0.0]),
        jnp.stack([-jnp.sin(angle), jnp.cos(angle), 0.0 * angle])
        / jnp.sqrt(far),
    )
    figure, panel = plt.subplots(figsize=(6.4, 4.0), layout="constrained")

    def draw(ts, label, colour, style="-", **which):
        v1, v2 = lambert(r1[:, None], r2, ts, 1.0, **which)
        speed = jnp.linalg.norm(v1 - u1[:, None], axis=0) + jnp.linalg.norm(
            u2[:, None] - v2, axis=0
        )
        panel.plot(
            ts / (2.0 * np.pi), speed, style, color=colour, label=label
        )

    ends = 2.0 * np.pi * 5.0
    ts = jnp.geomspace(0.6, ends, 400)
    draw(ts, "short way", "C0")
    draw(ts, "long way", "C1", normal=jnp.array([0.0, 0.0, -1.0]))
    for n in (1, 2):
        least = float(least_duration(r1, r2, 1.0, n))
        ts = least + (ends - least) * jnp.linspace(0.0, 1.0, 300) ** 2
        draw(
            ts,
            f"{n} revolution{'s' * (n > 1)}, low",
            f"C{n + 1}",
            revolutions=n,
        )
        draw(
            ts,
            f"{n} revolution{'s' * (n > 1)}, high",
            f"C{n + 1}",
            "--",
            revolutions=n,
            low=False,
        )
    panel.set(
        xlabel="duration / period of the inner orbit",
        ylabel="total impulse / initial circular speed",
        ylim=(0.0, 4.0),
    )
    panel.set_title("Transfer to twice the radius, target 120 deg ahead")
    panel.grid(alpha=0.3)
    figure.legend(loc="outside right center")
    return figure


def torque_free_body():
    """Angular momentum of one size on its sphere in the body: circles about two axes, and the flips
    about the third."""
    moments = np.array([1.0, 2.0, 3.0])
    # From the greatest axis towards the least: the separatrix, the path of the middle axis, is
    # crossed at 30 degrees.
    angles = np.radians([8, 16, 23, 28, 33, 42, 55, 70])
    directions = [np.array([np.sin(p), 0.0, np.cos(p)]) for p in angles]
    h = np.concatenate([s * np.array(directions) for s in (1.0, -1.0)])
    n = len(h)
    y0s = BodyState(
        attitude=Quaternion(
            jnp.tile(jnp.array([[1.0], [0.0], [0.0], [0.0]]), (1, n))
        ),
        omega=jnp.asarray((h / moments).T),
    )
    system = TorqueFreeBody(PrincipalInertia(jnp.asarray(moments)))
    ts = jnp.linspace(0.0, 60.0, 1500)
    omega = np.asarray(simulate_batch(system, y0s, ts).states.omega)
    # Seen from a direction (east and north span the page) between the three axes.
    azimuth, elevation = np.radians([48.0, 28.0])
    east = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    towards = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    north = np.cross(towards, east)
    figure, panel = plt.subplots(figsize=(5.4, 5.2), layout="constrained")
    panel.add_patch(
        plt.Circle(
            (0.0, 0.0), 1.0, facecolor="0.95", edgecolor="0.5", zorder=0
        )
    )
    for path in np.moveaxis(omega, 0, -1).swapaxes(0, 1) * moments:
        color = "C0" if np.sum(path[0] ** 2 / moments) > 0.5 else "C3"
        front = np.where((path @ towards > 0.0)[:, None], path, np.nan)
        panel.plot(front @ east, front @ north, color=color, lw=1.4)
    for axis, name in zip(
        np.eye(3), ("least", "middle", "greatest"), strict=True
    ):
        tip = np.array([axis @ east, axis @ north])
        panel.plot(*tip, "ko", ms=4)
        panel.annotate(
            f"{name} axis",
            tip,
            xytext=(0, 6),
            textcoords="offset points",
            ha="center",
            # Curves pass behind the words.
            bbox={"boxstyle": "round,pad=0.1", "fc": "0.95", "ec": "none"},
        )
    panel.set(
        xlim=(-1.08, 1.08),
        ylim=(-1.08, 1.08),
        aspect="equal",
        xlabel="angular momentum, horizontal component (normalised)",
    )
    panel.set_ylabel("angular momentum, vertical component (normalised)")
    panel.set_title("Polhodes, moments of inertia 1 : 2 : 3")
    return figure


def gravity_gradient():
    """Libration in pitch on a circular orbit: the angle to the vertical for four amplitudes, and
    the periods in closed form."""
    moments, radius = (
        jnp.array([400.0, 1000.0, 1200.0]),
        6.778e6,
    )  # outwards, along the velocity, along the normal
    n = jnp.sqrt(MU_EARTH / radius**3)
    scene = Scene(
        [PointGravity(MU_EARTH), GravityGradient(MU_EARTH)],
        RigidBody(inertia=moments),
    )
    ts = jnp.linspace(0.0, 4.0 * jnp.pi / n, 400)
    figure, panel = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for k, degrees in enumerate((10.0, 40.0, 70.0, 85.0)):
        amplitude = jnp.radians(degrees)
        r, v = (
            jnp.array([radius, 0.0, 0.0]),
            jnp.array([0.0, n * radius, 0.0]),
        )
        y0 = BodyState(
            r, v, Quaternion.about(2, amplitude), jnp.array([0.0, 0.0, n])
        )
        q = simulate(scene, y0, ts, accuracy=1e-10).states.attitude.wxyz
        lean = np.degrees(np.unwrap(2.0 * np.arctan2(q[3], q[0]) - n * ts))
        panel.plot(
            n * ts / (2.0 * np.pi),
            lean,
            color=f"C{k}",
            label=f"{degrees:.0f} deg",
        )
        period = pitch_libration_period(
            amplitude, moments[jnp.array([1, 2, 0])], n
        )
        panel.plot(
            n * period / (2.0 * np.pi), degrees, "o", ms=5, color=f"C{k}"
        )
    panel.set(
        xlabel="revolutions of the orbit",
        ylabel="angle to the vertical, deg",
        yticks=range(-90, 91, 30),
    )
    panel.set_title(
        "Libration in pitch: simulated (lines), period in closed form (dots)"
    )
    panel.grid(alpha=0.3)
    figure.legend(title="amplitude", loc="outside right center")
    return figure


def rockets():
    """Jet damping: the rate across the axis while a motor burns, simulated and in closed form."""
    figure, panel = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for k, lever in enumerate((0.5, 1.0, 1.5, 2.0)):
        gyration = 1.0  # m
        body = BurningBody(
            1.0, [gyration**2] * 3, gyration_radii=[gyration] * 3
        )
        motor = Thrust(
            mean_thrust=1.0, exhaust_velocity=100.0, burn_time=90.0
        )  # 0.01 kg/s
        scene = Scene(
            [motor, JetDamping(motor.mass_rate, exit_station=-lever)], body
        )
        at_rest, turning = jnp.zeros(3), jnp.array([1.0, 0.0, 0.0])
        y0 = BodyState(
            at_rest, at_rest, Quaternion.identity(), turning, jnp.array(2.0)
        )
        run = simulate(scene, y0, jnp.linspace(0.0, 90.0, 19), accuracy=1e-9)
        xi = np.linspace(1.0, 0.55, 100)
        panel.plot(
            xi,
            jet_damping_ratio(xi, lever / gyration),
            color=f"C{k}",
            label=f"l / k = {lever:.1f}",
        )
        panel.plot(
            run.states.mass / 2.0,
            run.states.omega[0],
            "o",
            ms=4,
            color=f"C{k}",
        )
    panel.invert_xaxis()
    panel.set(
        xlabel="mass / initial mass",
        ylabel="transverse rate / initial rate",
    )
    panel.set_title("Jet damping: closed form (lines), simulated (dots)")
    panel.grid(alpha=0.3)
    panel.legend()
    return figure


def two_gimbal_gyro():
    """Gimbal walk: the outer gimbal of a nutating gyro drifts although nothing acts on it."""
    gyro = TwoGimbalGyro(
        1.0e-4,
        1.8e-4,
        2500.0,
        inner_xi=0.6e-4,
        inner_eta=0.5e-4,
        inner_zeta=0.6e-4,
        outer=1.2e-4,
    )
    tilt, rate = jnp.radians(60.0), 60.0
    walk = gyro.walk(tilt, rate)
    ts = jnp.linspace(0.0, 12.0 * walk.period, 2000)
    run = simulate(gyro, gyro.state(tilt, 0.0, rate, 0.0), ts, accuracy=1e-10)
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(9.0, 3.6), layout="constrained"
    )
    left.plot(ts * 1e3, jnp.degrees(run.states.psi), label="simulated")
    left.plot(
        ts * 1e3,
        jnp.degrees(walk.drift * ts),
        "--",
        color="C3",
        label="mean drift, closed form",
    )
    left.set(
        xlabel="time, ms",
        ylabel="outer gimbal psi, deg",
        title="Gimbal walk",
        ylim=(-1.0, 4.0),
    )
    left.legend()
    right.plot(
        jnp.degrees(run.states.psi), jnp.degrees(run.states.theta), lw=1.0
    )
    right.set(
        xlabel="outer gimbal psi, deg",
        ylabel="inner gimbal theta, deg",
        title="Path of the rotor axis",
    )
    for panel in (left, right):
        panel.grid(alpha=0.3)
    return figure


def optimization():
    """Payload against velocity for one to three stages; the best steering found in two ways."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(9.4, 3.8), layout="constrained"
    )
    for stages in (1, 2, 3):
        u, b = jnp.full((stages,), 3000.0), jnp.full((stages,), 0.12)
        # Dense towards the velocity at which no payload is left.
        limit = -jnp.sum(u * jnp.log(b))
        v = limit - jnp.geomspace(limit - 500.0, 1e-3, 400)
        left.semilogy(
            v / 1e3,
            optimal_staging(u, b, v).payload_ratio,
            label=f"{stages} stage{'s' if stages > 1 else ''}",
        )
    left.set(
        xlabel="total velocity, km/s",
        ylabel="payload / initial mass",
        xlim=(0.0, 17.5),
        ylim=(1e-4, 1.0),
        title="Optimal staging",
    )
    left.legend()
    ascent = Ascent(
        ConstantMassFlow(3000.0, 150.0), 100.0, 0.0, 0.0, 150e3, 9.81
    )
    best = linear_tangent_steering(ascent)
    t = jnp.linspace(0.0, 100.0, 200)
    nodes = jnp.linspace(0.0, 100.0, 6)
    found = optimise_steering(
        ascent, SteeringProfile(nodes, jnp.full((6,), 0.5)), 0.5
    )
    right.plot(t, jnp.degrees(best.angle(t)), label="linear-tangent law")
    right.plot(
        nodes,
        jnp.degrees(found.steering.angles),
        "o",
        label="direct shooting with six nodes",
    )
    right.set(
        xlabel="time, s",
        ylabel="thrust angle, deg",
        title="Steering for maximum velocity at 150 km",
    )
    right.legend()
    for panel in (left, right):
        panel.grid(alpha=0.3)
    return figure
