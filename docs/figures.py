"""Draws the manual's pictures by the library itself: `python docs/figures.py [NAME ...]` writes
docs/figures/NAME.png."""

import runpy
import sys
from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from _uses import BLOCK
from PIL import Image

import jaxspace
from jaxspace import (
    Accuracy,
    BodyState,
    Mission,
    Phase,
    Scene,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.attitude import GravityGradient, Top, TorqueFreeBody, YoYo
from jaxspace.attitude.gravity_gradient import pitch_libration_period
from jaxspace.bodies import BurningBody, PrincipalInertia, RigidBody
from jaxspace.constants import MU_EARTH, RADIUS_EARTH
from jaxspace.control.attitude_laws import error_vector
from jaxspace.dispersion import disperse
from jaxspace.estimation import kalman_filter
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
    Oblateness,
    PointGravity,
    TwoBody,
)
from jaxspace.orbits.elements import apoapsis_radius, state_from_elements
from jaxspace.orbits.lambert import lambert, least_duration
from jaxspace.plots import (
    accuracy_cost_figure,
    dispersion_figure,
    effect_budget_figure,
    footprint_figure,
)
from jaxspace.rockets import JetDamping, Thrust
from jaxspace.rockets.jet_damping import jet_damping_ratio
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853
from jaxspace.studies import accuracy_cost, effect_budget

HERE = Path(__file__).parent / "figures"
EXAMPLES = Path(__file__).parents[1] / "examples"


def top():
    """The path of a heavy top's axis seen from above, for three ways of letting it go."""
    system = Top(
        transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08
    )
    figure, panels = plt.subplots(
        1, 3, figsize=(9.6, 3.5), layout="constrained"
    )
    starts = (
        ("let go backwards: loops", -4.0),
        ("let go at rest: cusps", 0.0),
        ("let go forwards: waves", 1.2),
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
            xlabel="x component of the axis, 1",
            aspect="equal",
            xlim=(-0.8, 0.8),
            ylim=(-0.8, 0.8),
        )
        panel.set(xticks=[-0.5, 0.0, 0.5], yticks=[-0.5, 0.0, 0.5])
    panels[0].set_ylabel("y component of the axis, 1")
    return figure


def kick_stage():
    """What the code at the top of the home page draws."""
    stage = jaxspace.load(EXAMPLES / "scenes" / "kick_stage.toml")
    result = disperse(stage.campaign(), 10_000, seed=1)
    pair = ("apoapsis_altitude", "inclination")
    return dispersion_figure(result, ["inclination"], scatter=pair)


def rocket_to_the_ground():
    """What the last block of the tutorial of this name draws."""
    page = HERE.parent / "tutorials" / "rocket_to_the_ground.md"
    code = "\n".join(BLOCK.findall(page.read_text()))
    names = {}
    # The last line of the last block writes a file.
    exec(code.rpartition("footprint_figure")[0], names)
    return footprint_figure(names["result"])


def dark(picture):
    """The dark version of a picture, as `manual.css` makes it in the browser: light and dark change
    places, hues stay, and white becomes the dark of the page that GitHub shows."""
    page = np.array([13, 17, 23]) / 255.0
    # Half a turn of the hue in the matrix of the CSS filter, after the inversion.
    luminance = np.array([0.213, 0.715, 0.072])
    rgb = 1.0 - np.asarray(picture.convert("RGB")) / 255.0
    rgb = np.clip(2.0 * (rgb @ luminance)[..., None] - rgb, 0.0, 1.0)
    screen = 1.0 - (1.0 - rgb) * (1.0 - page)
    return Image.fromarray(np.round(255.0 * screen).astype(np.uint8))


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
    panel.loglog(cost, error, "o-", label="error against the closed form")
    panel.loglog(cost, estimate, "x--", label="what Trajectory.error() says")
    panel.loglog(cost, drift, "s:", label="relative drift of the energy")
    panel.set(
        xlabel="evaluations of the vector field",
        ylabel="error / semi-major axis, or drift",
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
        xlabel="duration / period of the inner circle",
        ylabel="both impulses / speed on the inner circle",
        ylim=(0.0, 4.0),
    )
    panel.set_title("To a circle of twice the radius, 120 deg ahead")
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
        xlabel="angular momentum / its size, to the right, 1",
    )
    panel.set_ylabel("angular momentum / its size, upwards, 1")
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
        ylabel="rate across the axis / initial rate",
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
        label="closed form of the drift",
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
        title="Path of the rotor's axis",
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
        label="direct shooting, six nodes",
    )
    right.set(
        xlabel="time, s",
        ylabel="thrust angle, deg",
        title="Steering to the greatest velocity at 150 km",
    )
    right.legend()
    for panel in (left, right):
        panel.grid(alpha=0.3)
    return figure


def spinning_stage():
    """A stage of 3200 kg in a parking orbit of 185 km, along its path, at one turn a second."""
    radius = RADIUS_EARTH + 185e3
    return BodyState(
        position=jnp.array([radius, 0.0, 0.0]),
        velocity=jnp.array([0.0, jnp.sqrt(MU_EARTH / radius), 0.0]),
        attitude=Quaternion.about(0, -jnp.pi / 2.0),
        omega=jnp.array([0.0, 0.0, 2.0 * jnp.pi]),
        mass=jnp.array(3200.0),
    )


def missions():
    """A kick stage: spin and apogee through burn, coast and yo-yo."""
    body = BurningBody(
        1200.0,
        [900.0, 900.0, 420.0],
        gyration_radii=[0.45, 0.45, 0.4],
        propellant_station=-1.2,
    )
    gravity = PointGravity(MU_EARTH)
    motor = Thrust.of_motor(
        5.8e6, 84.0, 2000.0, point=[2e-3, 0.0, -2.0], misalignment=[1e-3, 0.0]
    )
    burn = Scene(
        [
            gravity,
            motor,
            JetDamping(motor.mass_rate, exit_station=-2.5, exit_radius=0.35),
        ],
        body,
    )
    coast = Scene([gravity], body, carry=("attitude", "mass"))
    yo_yo = YoYo(axial_inertia=420.0, radius=0.7, mass=4.0, cord_length=10.0)
    phases = [
        Phase(burn, 84.0, name="burn"),
        Phase(coast, 30.0, yo_yo, name="coast"),
        Phase(coast, 40.0, name="despun"),
    ]
    start = spinning_stage()
    flight = simulate_mission(
        Mission(phases), start, accuracy=1e-8, num_saved=200
    )
    figure, panels = plt.subplots(
        3, 1, figsize=(6.4, 6.2), sharex=True, layout="constrained"
    )
    for k, name in enumerate(flight.names):
        t, y = flight[name].ts, flight[name].states
        farthest = apoapsis_radius(y.position, y.velocity, MU_EARTH)
        apogee = farthest - RADIUS_EARTH
        for panel, values in zip(
            panels,
            (apogee / 1e3, y.omega[2], jnp.degrees(y.omega[0])),
            strict=True,
        ):
            panel.plot(t, values, color=f"C{k}", label=name)
    for panel, label in zip(
        panels,
        ("apogee height, km", "spin, rad/s", "rate across it, deg/s"),
        strict=True,
    ):
        panel.set_ylabel(label)
        panel.grid(alpha=0.3)
    panels[0].legend()
    panels[0].set_title("Kick stage: burn, coast, yo-yo")
    panels[-1].set_xlabel("time, s")
    return figure


def closed_loops():
    """The slew and the landing of the scene files under sampled control."""
    scenes = Path(__file__).parents[1] / "examples" / "scenes"
    slew = jaxspace.load(scenes / "sampled_slew.toml").simulate()
    landing = jaxspace.load(scenes / "powered_landing.toml").simulate()
    figure, axes = plt.subplots(
        2, 2, figsize=(9.0, 6.0), layout="constrained"
    )
    t = np.asarray(slew.ts) / 60.0
    error = error_vector(slew.states.attitude, jnp.full(4, 0.5))
    axes[0, 0].plot(t, np.degrees(np.asarray(error)).T, label=["x", "y", "z"])
    axes[0, 0].set(
        ylabel="error, deg", title="Slew by wheels, two samples a second"
    )
    axes[1, 0].step(t, np.asarray(slew.commands).T, where="post", lw=0.8)
    axes[1, 0].set(xlabel="time, min", ylabel="torque on each wheel, N m")
    axes[0, 0].legend(frameon=False)
    x, y, z = np.asarray(landing.states.position)
    axes[0, 1].plot(np.hypot(x, y), z)
    axes[0, 1].set(
        xlabel="distance, m", ylabel="height, m", title="Landing on the Moon"
    )
    thrust = np.linalg.norm(np.asarray(landing.commands), axis=0) / 1e3
    axes[1, 1].step(np.asarray(landing.ts), thrust, where="post", lw=1.0)
    axes[1, 1].axhline(6.5, color="0.6", lw=0.8, ls="--")
    axes[1, 1].set(
        xlabel="time, s", ylabel="commanded thrust, kN", ylim=(0.0, None)
    )
    for ax in axes.flat:
        ax.grid(color="0.92")
    return figure


def what_accuracy_costs():
    """Error against time and arithmetic of twenty revolutions of a two-body orbit, and of their
    gradient."""
    e, mu = 0.3, 1.0
    y0 = BodyState(
        *state_from_elements(ClassicalElements.from_periapsis(1.0 - e, e), mu)
    )
    cost = accuracy_cost(
        TwoBody(mu),
        y0,
        jnp.array([0.0, 40.0 * np.pi]),
        gradient=True,
        repeats=20,
    )
    return accuracy_cost_figure(
        cost, title="Twenty revolutions of a two-body orbit, eccentricity 0.3"
    )


def which_effects_matter():
    """The effects of a spinning stage in its burn, by what they do to the final velocity."""
    body = BurningBody(
        1191.0, [1031.0, 1002.0, 521.0], [0.45, 0.45, 0.44], -1.69
    )
    motor = Thrust(
        6.9e4, 2865.0, 84.1, point=[0.0, 0.0, -2.39], misalignment=[1e-3, 0.0]
    )
    bulge = Oblateness(MU_EARTH, 1.08262668e-3, RADIUS_EARTH)
    scene = Scene(
        [
            PointGravity(MU_EARTH),
            bulge,
            motor,
            JetDamping(motor.mass_rate, -3.16, 0.265),
        ],
        body,
    )
    start = spinning_stage()
    budget = effect_budget(
        scene,
        start,
        jnp.array([0.0, 84.1]),
        output="velocity",
        tolerance=5.0,
        accuracy=1e-8,
    )
    return effect_budget_figure(budget, title="A spinning stage at burnout")


def hybrid():
    """A pendulum with unknown friction: data, physics alone, physics with a trained network."""
    made = runpy.run_path(str(EXAMPLES / "13_hybrid_network.py"))
    ts, test, paths = made["ts"], made["test"], made["paths"]
    known = paths(made["Pendulum"](), test)
    learned = paths(made["Pendulum"](made["network"]), test)
    true = paths(made["truth"], test)
    figure, axes = plt.subplots(
        1, 3, figsize=(9.0, 3.0), layout="constrained", sharey=True
    )
    swings = np.argsort(-np.ptp(np.asarray(true), axis=0))[[0, 4, 10]]
    for k, panel in zip(swings, axes, strict=True):
        panel.plot(ts, known[:, k], "--", color="C7", label="physics alone")
        panel.plot(ts, learned[:, k], color="C0", label="with the network")
        panel.plot(ts, true[:, k], "o", ms=3, color="C3", label="truth")
        panel.set(xlabel="time")
        panel.grid(alpha=0.3)
    axes[0].set(ylabel="angle, rad")
    axes[1].set(title="Paths that the network never saw")
    axes[0].legend(fontsize=8)
    return figure


def estimation():
    """Residuals of a radar pass, and a filter beside the truth."""
    made = runpy.run_path(
        str(EXAMPLES / "10_orbit_from_ranges_and_angles.py")
    )
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(9.0, 3.6), layout="constrained"
    )
    for name, r in made["found"].residuals.items():
        left.plot(made["ts"], r, "o-", ms=4, lw=0.8, label=name)
    left.axhspan(-1.0, 1.0, color="C7", alpha=0.15)
    left.set(
        xlabel="time, s",
        ylabel="residual over its standard deviation",
        title="GEOS-3 over Kaena Point",
    )
    left.legend()
    swing = TwoBody(1.0)
    ts = jnp.linspace(0.0, 8.0, 81)
    start = BodyState(jnp.array([1.0, 0.0, 0.1]), jnp.array([0.0, 1.0, 0.2]))
    wrong = BodyState(
        jnp.array([1.05, 0.03, 0.05]), jnp.array([0.04, 0.95, 0.22])
    )
    run = simulate(swing, start, ts)
    noise = np.random.default_rng(0).normal(size=(2, ts.size))
    z = run.states.position[:2] + 0.02 * noise
    found = kalman_filter(
        swing,
        wrong,
        0.05**2 * jnp.eye(6),
        ts,
        z,
        lambda t, y: y.position[:2],
        noise=jnp.array([0.02, 0.02]),
        accuracy=1e-8,
    )
    error = found.states.position[0] - run.states.position[0]
    sigma = 3.0 * found.std[0]
    right.plot(ts, z[0] - run.states.position[0], ".", color="C7", ms=3)
    right.plot(ts, error, label="error of the filter")
    right.plot(ts, sigma, "--", color="C3", label="three sigma")
    right.plot(ts, -sigma, "--", color="C3")
    right.set(
        xlabel="time",
        ylabel="x",
        title="A filter on an orbit, started wrong",
        ylim=(-0.16, 0.16),
    )
    right.legend()
    for panel in (left, right):
        panel.grid(alpha=0.3)
    return figure


PAGES = (
    top,
    two_body,
    transfers,
    torque_free_body,
    gravity_gradient,
    rockets,
    two_gimbal_gyro,
    optimization,
    missions,
)
DRAWN = {
    f.__name__: f
    for f in (
        *PAGES,
        kick_stage,
        rocket_to_the_ground,
        closed_loops,
        what_accuracy_costs,
        which_effects_matter,
        hybrid,
        estimation,
    )
}

if __name__ == "__main__":
    jaxspace.enable_x64()
    plt.switch_backend("agg")
    HERE.mkdir(exist_ok=True)
    for name in sys.argv[1:] or DRAWN:
        DRAWN[name]().savefig(HERE / f"{name}.png", dpi=110)
        plt.close("all")
        # A page of GitHub has no style of ours.
        if name == "kick_stage":
            light = Image.open(HERE / "kick_stage.png")
            dark(light).quantize(256).save(HERE / "kick_stage_dark.png")
