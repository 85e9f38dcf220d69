"""Pictures of the pages about runs: campaigns, missions, loops, studies, filters."""

import runpy
from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from _uses import BLOCK

import jaxspace
from jaxspace import (
    BodyState,
    Mission,
    Phase,
    Scene,
    simulate,
    simulate_mission,
)
from jaxspace.attitude import YoYo
from jaxspace.bodies import BurningBody
from jaxspace.constants import MU_EARTH, RADIUS_EARTH
from jaxspace.control.attitude_laws import error_vector
from jaxspace.dispersion import disperse
from jaxspace.estimation import kalman_filter
from jaxspace.orbits import (
    ClassicalElements,
    Oblateness,
    PointGravity,
    TwoBody,
)
from jaxspace.orbits.elements import apoapsis_radius, state_from_elements
from jaxspace.plots import (
    accuracy_cost_figure,
    dispersion_figure,
    effect_budget_figure,
    footprint_figure,
)
from jaxspace.rockets import JetDamping, Thrust
from jaxspace.rotations import Quaternion
from jaxspace.studies import accuracy_cost, effect_budget

HERE = Path(__file__).parent / "figures"
EXAMPLES = Path(__file__).parents[1] / "examples"


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
        ("apogee height, km", "spin rate, rad/s", "transverse rate, deg/s"),
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
        ylabel="error, deg",
        title="Slew with reaction wheels, sampled at 2 Hz",
    )
    axes[1, 0].step(t, np.asarray(slew.commands).T, where="post", lw=0.8)
    axes[1, 0].set(xlabel="time, min", ylabel="wheel torque, N m")
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
        panel.plot(
            ts, known[:, k], "--", color="C7", label="without the network"
        )
        panel.plot(ts, learned[:, k], color="C0", label="with the network")
        panel.plot(ts, true[:, k], "o", ms=3, color="C3", label="truth")
        panel.set(xlabel="time")
        panel.grid(alpha=0.3)
    axes[0].set(ylabel="angle, rad")
    axes[1].set(title="Test trajectories")
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
        ylabel="residual / standard deviation",
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
    right.plot(ts, error, label="filter error")
    right.plot(ts, sigma, "--", color="C3", label="3 sigma")
    right.plot(ts, -sigma, "--", color="C3")
    right.set(
        xlabel="time",
        ylabel="x",
        title="Orbit filter with a wrong initial state",
        ylim=(-0.16, 0.16),
    )
    right.legend()
    for panel in (left, right):
        panel.grid(alpha=0.3)
    return figure
