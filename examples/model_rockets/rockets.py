"""Three example rockets of RocketPy: common data for RocketPy and jaxspace.

The data are those of RocketPy 1.13 (https://github.com/RocketPy-Team/RocketPy, MIT licence,
Copyright (c) 2018 Giovani Hidalgo Ceotto): Calisto from its tests (tests/fixtures), NDRT 2020 and
Valetudo from its examples (docs/examples). Drag curves are thinned to within 0.012, the thrust of
Valetudo's motor to within 14 N at the same impulse; the files of the two other motors are complete.
The winds were added, and so was Valetudo's second parachute, which has no effect.

Stations are along the axis towards the nose, m, from the origin of the original data.
"""

from pathlib import Path

import numpy as np

HERE = Path(__file__).parent

# Heights above sea level, m, and the wind towards east and north there, m/s.
WIND = (
    [0.0, 300.0, 1500.0, 3000.0, 6000.0],
    [3.0, 3.0, 5.0, 7.0, 9.0],
    [1.5, 1.5, 1.0, -1.0, -2.0],
)

CALISTO = {
    "motor_file": "cesaroni_m1670.eng",
    "burn_time": 3.9,
    "radius": 0.0635,
    "mass": 14.426,
    "inertia": (6.321, 6.321, 0.034),
    "centre": 0.0,
    "case_mass": 1.815,
    "case_inertia": (0.125, 0.125, 0.002),
    "case_station": -1.373 + 0.317,
    "propellant_station": -1.373 + 0.397,
    # Number, density, outer and inner radius, height of one, gap.
    "grains": (5, 1815.0, 0.033, 0.015, 0.120, 0.005),
    "exit_station": -1.373,
    "exit_radius": 0.033,
    "drag": "calisto_drag.csv",
    "nose": {"shape": "von_karman", "length": 0.55829, "tip": 1.160},
    "fins": {"count": 4, "span": 0.100, "root_chord": 0.120, "tip_chord": 0.040,
             "sweep_length": 0.080, "radius": 0.0635, "leading_edge": -1.168},
    "tail": {"fore_radius": 0.0635, "aft_radius": 0.0435, "length": 0.060, "fore_end": -1.313},
    # Drag area, m^2, lag, s, and the height above the ground, m, of each parachute.
    "parachutes": ((1.0, 1.5, None), (10.0, 1.5, 800.0)),
    "site": {"latitude": 32.990254, "elevation": 1400.0, "rail_length": 5.2,
             "inclination": 85.0, "heading": 0.0},
}  # fmt: skip

NDRT = {
    "motor_file": "cesaroni_l1395.eng",
    "burn_time": 3.45,
    "radius": 0.1015,
    "mass": 18.998,
    "inertia": (73.316, 73.316, 0.15982),
    "centre": -1.3,
    "case_mass": 1.848,
    "case_inertia": (0.0, 0.0, 0.0),
    "case_station": -3.391 + 0.35,
    "propellant_station": -3.391 + 0.35,
    "grains": (5, 1519.708, 0.033, 0.015, 0.12, 0.003),
    "exit_station": -3.391,
    "exit_radius": 0.02475,
    "drag": 0.44,
    "nose": {"shape": "ogive", "length": 0.610, "tip": 0.0},
    "fins": {"count": 4, "span": 0.165, "root_chord": 0.152, "tip_chord": 0.0762,
             "sweep_length": 0.165 * float(np.tan(np.radians(13.0))), "radius": 0.0775,
             "leading_edge": -3.050},
    "tail": {"fore_radius": 0.1015, "aft_radius": 0.0775, "length": 0.127, "fore_end": -1.2},
    "parachutes": ((1.5 * np.pi * 0.6096**2 / 4.0, 1.0, None),
                   (2.2 * np.pi * 3.048**2 / 4.0, 1.0, 167.64)),
    "site": {"latitude": 41.775447, "elevation": 206.0, "rail_length": 3.353,
             "inclination": 87.0, "heading": 181.0},
}  # fmt: skip

VALETUDO = {
    "motor_file": "keron.csv",
    "burn_time": 5.274,
    "radius": 0.04045,
    "mass": 8.257,
    "inertia": (3.675, 3.675, 0.007),
    "centre": 0.0,
    "case_mass": 0.001,
    "case_inertia": (0.0, 0.0, 0.0),
    "case_station": -1.024 + 0.42,
    "propellant_station": -1.024 + 0.42,
    "grains": (6, 1707.0, 0.0214, 0.00965, 0.120, 0.006),
    "exit_station": -1.024,
    "exit_radius": 0.021642,
    "drag": "valetudo_drag_on.csv",
    "coasting_drag": "valetudo_drag_off.csv",
    "nose": {"shape": "ogive", "length": 0.274, "tip": 1.134},
    "fins": {"count": 3, "span": 0.077, "root_chord": 0.058, "tip_chord": 0.018,
             "sweep_length": 0.040, "radius": 0.04045, "leading_edge": -0.906},
    "tail": None,
    "parachutes": ((0.349 * 1.3, 1.0, None), (0.349 * 1.3, 1.0, 300.0)),
    "site": {"latitude": -23.363611, "elevation": 668.0, "rail_length": 5.7,
             "inclination": 84.7, "heading": 53.0},
}  # fmt: skip

ROCKETS = {"Calisto": CALISTO, "NDRT 2020": NDRT, "Valetudo": VALETUDO}


def curve(given) -> tuple[np.ndarray, np.ndarray]:
    """Mach numbers and coefficients, as given, of a file, or of a number."""
    if isinstance(given, tuple):
        return given
    if isinstance(given, str):
        mach, values = np.loadtxt(HERE / given, delimiter=",").T
        return mach, values
    return np.array([0.0]), np.array([given])


def refined(x: np.ndarray, y: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The same polygon with `count` points: rockets with as many can be stacked in one batch."""
    while len(x) < count:
        k = int(np.argmax(np.diff(x))) if len(x) > 1 else 0
        new = 0.5 * (x[k] + x[k + 1]) if len(x) > 1 else x[0] + 1.0
        y = np.insert(y, k + 1, np.interp(new, x, y))
        x = np.insert(x, k + 1, new)
    return x, y


def propellant_mass(rocket: dict) -> float:
    """Of all grains, kg."""
    number, density, outer, inner, height, _ = rocket["grains"]
    return number * density * np.pi * (outer**2 - inner**2) * height


def vehicle(rocket: dict, points: int = 0):
    """The rocket as a `jaxspace.vehicles.Vehicle`; its tables have at least so many `points`."""
    from jaxspace.rockets import read_motor
    from jaxspace.vehicles import FinSet, NoseCone, RadiusChange, Vehicle
    from jaxspace.vehicles.coefficient import MachTable

    number, _, outer, inner, height, gap = rocket["grains"]
    same = ("radius", "mass", "inertia", "centre", "case_mass", "case_inertia", "case_station")
    same = (*same, "propellant_station", "exit_station", "exit_radius")
    # A tail without a change of radius has no force.
    plain = {"fore_radius": rocket["radius"], "aft_radius": rocket["radius"]}
    tail = rocket["tail"] or {**plain, "length": 1.0, "fore_end": 0.0}
    motor = read_motor(HERE / rocket["motor_file"])
    times, thrusts = refined(motor.times, motor.thrusts, points)
    drag = refined(*curve(rocket["drag"]), points)
    coasting = refined(*curve(rocket.get("coasting_drag", rocket["drag"])), points)
    nose = {k: rocket["nose"][k] for k in ("tip", "length", "shape")}
    return Vehicle.model_rocket(
        motor._replace(times=times, thrusts=thrusts),
        propellant_mass=propellant_mass(rocket),
        grain=(outer, inner, number * height + (number - 1) * gap),
        drag=MachTable(*drag),
        coasting_drag=MachTable(*coasting),
        nose=NoseCone.of_shape(rocket["radius"], **nose),
        fins=FinSet(**rocket["fins"]),
        tail=RadiusChange(**tail),
        **{name: rocket[name] for name in same},
    )


def site(rocket: dict):
    """The site of the launch, with its sounding where it has one and the wind of all others, as a
    `jaxspace.vehicles.LaunchSite`."""
    from jaxspace.vehicles import LaunchSite, Wind
    from jaxspace.vehicles.sounding import read_sounding

    given = dict(rocket["site"])
    for name in ("latitude", "inclination", "heading"):
        given[name] = np.radians(given[name])
    if "air" not in rocket:
        return LaunchSite(**given, wind=Wind(*WIND))
    air = read_sounding(HERE / rocket["air"])
    return LaunchSite(**given, wind=air.wind(), atmosphere=air.atmosphere())


def stacked(items: list):
    """One object for several of one structure, with the runs on the last axis."""
    import jax
    import jax.numpy as jnp

    return jax.tree.map(lambda *x: jnp.stack([jnp.asarray(a, float) for a in x], -1), *items)


def recovery(rocket: dict) -> list:
    """The parachutes."""
    from jaxspace.vehicles import Recovery

    return [Recovery(*chute) for chute in rocket["parachutes"]]
