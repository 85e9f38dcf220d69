"""The formulas of chapters 1 to 4 at a hundred thousand inputs each, random and hostile: wherever a
value is finite, its derivatives in both modes are, but at the ends that the functions name."""

import inspect
import zlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import mechanics, orbits, rotations
from jaxspace.core.modules import public_names
from jaxspace.orbits import ClassicalElements, EquinoctialElements, ModifiedEquinoctialElements
from jaxspace.rotations import MovingFrame, Quaternion

SAMPLES = 100_000
# Of each kind of input: how it is drawn, and its hostile values. Lengths, times, masses and
# gravitational parameters are positive and of any size within six decades.
TINY = (1e-30, 1e-16, 1e-9)
QUARTERS = tuple(s * k * np.pi / 2 for k in range(5) for s in (1.0, -1.0))
KINDS = {
    "size": (lambda g, n: 10.0 ** g.uniform(-3.0, 3.0, n), (1.0, 1e-3, 1e3)),
    "angle": (lambda g, n: g.uniform(-6.3, 6.3, n), (*QUARTERS, *TINY, 1e-4)),
    "latitude": (lambda g, n: g.uniform(-1.57, 1.57, n), (0.0, 1e-9, 0.5 * np.pi, -0.5 * np.pi)),
    "tilt": (lambda g, n: g.uniform(0.0, 3.14, n), (0.0, 1e-9, 1e-30, 0.5 * np.pi, np.pi)),
    "ellipse": (lambda g, n: g.uniform(0.0, 0.99, n), (0.0, 1e-30, 1e-12, 1e-6, 0.99)),
    "conic": (lambda g, n: g.uniform(0.0, 3.0, n), (0.0, 1e-12, 1.0, 1.0 - 1e-12, 1.0 + 1e-9)),
    "share": (lambda g, n: g.uniform(0.0, 1.0, n), (0.0, 1.0, 1e-12)),
    "any": (lambda g, n: g.normal(size=n) * 10.0 ** g.uniform(-3.0, 2.0, n), (0.0, *TINY)),
}


def draw(kind: str, key: np.random.Generator) -> np.ndarray:
    """Samples of one kind, every tenth of them hostile: of a vector with components that vanish, of
    a turn the quarters of one."""
    if kind == "vector":
        return np.stack([draw("any", key) for _ in range(3)])
    if kind == "place":
        # Of another body: anywhere but at the centre.
        v = np.round(key.normal(size=(3, SAMPLES)), 1) + 0.0
        v[0] += np.all(v == 0.0, axis=0)
        return draw("size", key) * v
    if kind == "turn":
        wxyz = np.round(key.normal(size=(4, SAMPLES)), 1) + 0.0
        wxyz[0] += np.all(wxyz == 0.0, axis=0)
        return wxyz / np.linalg.norm(wxyz, axis=0)
    sample, hostile = KINDS[kind]
    x = sample(key, SAMPLES)
    return np.where(key.uniform(size=SAMPLES) < 0.1, key.choice(hostile, SAMPLES), x)


def elements(*x):
    return ClassicalElements(*x[:6]), x[6]


def frame(q, *x):
    return MovingFrame(Quaternion(q), *x[:5])


# Function, and the kinds of its inputs.
ROTATIONS = {
    "frame, to inertial": (
        lambda q, *x: frame(q, *x).to_inertial(*x[5:]), "turn" + 8 * " vector"),
    "frame, from inertial": (
        lambda q, *x: frame(q, *x).from_inertial(*x[5:]), "turn" + 8 * " vector"),
    "polar_components": (rotations.moving_frame.polar_components, "size any any any any"),
    "path_components": (rotations.moving_frame.path_components, "vector vector"),
    "instantaneous_centre": (rotations.moving_frame.instantaneous_centre, "vector vector vector"),
    "cosine_rates": (
        lambda q, w: rotations.direction_cosines.cosine_rates(Quaternion(q).matrix(), w),
        "turn vector"),
    "from_euler_angles": (lambda a: rotations.from_euler_angles(a).wxyz, "vector"),
    "to_euler_angles": (lambda q: rotations.to_euler_angles(Quaternion(q)), "turn"),
    "omega_from_euler_rates": (rotations.euler_angles.omega_from_euler_rates, "vector vector"),
    "rotation_vector": (lambda q: Quaternion(q).rotation_vector(), "turn"),
    "from_rotation_vector": (lambda v: Quaternion.from_rotation_vector(v).wxyz, "vector"),
    "projectile_position": (orbits.projectile.projectile_position, "vector any vector vector"),
    "plumb_line_deviation": (
        orbits.rotating_earth.plumb_line_deviation, "latitude size size share"),
    "navigation_rates": (orbits.rotating_earth.navigation_rates, "latitude any any any any any"),
    "ground_point": (lambda *x: orbits.ground_track.ground_point(*x)[:], "vector angle size"),
}  # fmt: skip
IMPACTS = {
    "contact_impulse": (mechanics.impact.contact_impulse, "any size share"),
    "impact_energy_loss": (mechanics.impact.impact_energy_loss, "any size share"),
    "crushable_pad": (mechanics.impact.crushable_pad, "size size size size size"),
    "moment_about_moving_point": (
        mechanics.moving_point.moment_about_moving_point, "vector size vector vector"),
}  # fmt: skip
FORCES = {
    "point_gravity": (orbits.point_gravity.point_gravity, "vector size"),
    "point_gravity_potential": (orbits.point_gravity.point_gravity_potential, "vector size"),
    "power_law": (orbits.central_force.power_law, "vector any angle"),
    "power_law_potential": (orbits.central_force.power_law_potential, "size any angle"),
    "shell_gravity": (orbits.central_force.shell_gravity, "vector size size"),
    "shell_potential": (orbits.central_force.shell_potential, "size size size"),
    "sphere_gravity": (orbits.central_force.sphere_gravity, "vector size size"),
    "sphere_potential": (orbits.central_force.sphere_potential, "size size size"),
    "oblateness": (orbits.oblateness.oblateness, "vector size any size"),
    "third_body": (orbits.third_body.third_body, "vector place size"),
    "to_relative": (orbits.two_masses.to_relative, "size size vector vector"),
    "from_relative": (orbits.two_masses.from_relative, "size size vector vector"),
    "reduced_mass": (orbits.two_masses.reduced_mass, "size size"),
    "sphere_of_influence": (orbits.two_masses.sphere_of_influence, "size size size"),
    "secular_rates": (
        lambda *x: tuple(orbits.secular_rates.secular_rates(*x)),
        "size ellipse tilt size any size"),
}  # fmt: skip
ELEMENTS = {
    "elements_from_state": (orbits.elements.elements_from_state, "vector vector size"),
    "state_from_elements": (
        lambda *x: orbits.elements.state_from_elements(*elements(*x)),
        "size ellipse tilt angle angle angle size"),
    "modified equinoctial": (
        lambda *x: ModifiedEquinoctialElements.of_state(*x).state(x[2]), "vector vector size"),
    "equinoctial": (
        lambda *x: EquinoctialElements.of_state(*x).state(x[2]), "vector vector size"),
    "kepler_flow": (orbits.kepler.kepler_flow, "vector vector any size"),
    "specific_energy": (orbits.elements.specific_energy, "vector vector size"),
    "eccentricity_vector": (orbits.elements.eccentricity_vector, "vector vector size"),
    "semi_major_axis": (orbits.elements.semi_major_axis, "vector vector size"),
    "periapsis_radius": (orbits.elements.periapsis_radius, "vector vector size"),
    "apoapsis_radius": (orbits.elements.apoapsis_radius, "vector vector size"),
    "inclination": (orbits.elements.inclination, "vector vector"),
    "conic_radius": (orbits.conic.conic_radius, "size conic angle"),
    "eccentric_anomaly": (orbits.conic.eccentric_anomaly, "angle ellipse"),
    "mean_anomaly": (orbits.conic.mean_anomaly, "angle ellipse"),
    "true_anomaly": (orbits.conic.true_anomaly, "angle ellipse"),
    "elements_from_burnout": (orbits.burnout.elements_from_burnout, "size size latitude size"),
    "orbit_from_radius": (
        orbits.initial.orbit_from_radius, "size size ellipse tilt angle angle angle"),
    "period": (orbits.time_of_flight.period, "any size"),
    "semi_major_axis_of_period": (orbits.time_of_flight.semi_major_axis_of_period, "size size"),
    "escape_speed": (orbits.burnout.escape_speed, "size size"),
    "vis_viva_speed": (orbits.burnout.vis_viva_speed, "size size size"),
    "time_of_flight": (orbits.time_of_flight.time_of_flight, "angle angle size ellipse size"),
    "true_anomaly_after": (orbits.time_of_flight.true_anomaly_after, "angle any size conic size"),
}  # fmt: skip
TRANSFERS = {
    "hohmann_transfer": (lambda *x: tuple(orbits.transfers.hohmann_transfer(*x)), "size size size"),
    "bielliptic_transfer": (
        lambda *x: tuple(orbits.transfers.bielliptic_transfer(*x)), "size size size size"),
    "coaxial_transfer": (
        lambda *x: tuple(orbits.transfers.coaxial_transfer(*x)), "size size size size size"),
    "departure_phase": (orbits.planets.departure_phase, "size size"),
    "synodic_period": (orbits.planets.synodic_period, "size size size"),
    "tangential_impulse": (
        lambda *x: tuple(orbits.impulses.tangential_impulse(*x)), "size ellipse angle any"),
    "plane_change_impulse": (orbits.impulses.plane_change_impulse, "size size angle"),
    "impulse_change": (orbits.small_impulse.impulse_change, "vector vector vector size"),
    "lambert": (orbits.lambert.lambert, "vector vector size size"),
    "clohessy_wiltshire_flow": (
        orbits.clohessy_wiltshire.clohessy_wiltshire_flow, "vector vector any size"),
    "ballistic_flight": (
        lambda *x: tuple(orbits.ballistic.ballistic_flight(*x)), "size size latitude size"),
    "ballistic_impact": (
        lambda *x: tuple(orbits.ballistic.ballistic_impact(*x)),
        "size size latitude angle latitude size"),
    "least_energy_launch": (orbits.ballistic.least_energy_launch, "size tilt size"),
    "projectile_envelope": (orbits.projectile.projectile_envelope, "any size size"),
}  # fmt: skip
# At an end of the range that they name, their slope is infinite, and no NaN.
ENDS = {"least_energy_launch"}
FORMULAS = ROTATIONS | IMPACTS | FORCES | ELEMENTS | TRANSFERS


def test_the_functions_are_public():
    packages = (orbits, rotations, mechanics)
    for function, _ in FORMULAS.values():
        if inspect.isfunction(function) and function.__module__.startswith("jaxspace"):
            found = [public_names(package).get(function.__name__) for package in packages]
            assert function in found, function.__name__


@pytest.mark.sweep
@pytest.mark.parametrize("name", FORMULAS)
def test_derivatives_are_finite(name):
    function, kinds = FORMULAS[name]
    key = np.random.default_rng(zlib.crc32(name.encode()))
    inputs = tuple(jnp.asarray(draw(kind, key)) for kind in kinds.split())

    def flat(inputs):
        found = [jnp.asarray(x) for x in jax.tree.leaves(function(*inputs))]
        # What depends on no input carries no samples.
        each = [jnp.broadcast_to(x, (*x.shape[:-1], SAMPLES)) for x in found]
        return jnp.concatenate([x.reshape(-1, SAMPLES) for x in each])

    @jax.jit
    def both(inputs):
        ones = jax.tree.map(jnp.ones_like, inputs)
        value, forward = jax.jvp(flat, (inputs,), (ones,))
        good = jnp.all(jnp.isfinite(value), axis=0)
        _, pull_back = jax.vjp(flat, inputs)
        reverse = pull_back(jnp.ones_like(value))[0]
        lost = jnp.isnan if name in ENDS else lambda x: ~jnp.isfinite(x)
        bad = jnp.any(lost(forward), axis=0)
        for x in reverse:
            bad = bad | jnp.any(lost(jnp.atleast_2d(x)), axis=0)
        return good, good & bad

    good, bad = (np.asarray(x) for x in both(inputs))
    assert np.mean(good) > 0.3
    worst = np.flatnonzero(bad)[:3]
    assert not bad.any(), (int(bad.sum()), [[np.asarray(x)[..., k] for x in inputs] for k in worst])
