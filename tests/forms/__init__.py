"""The closed forms that the fuzz test searches: those of the hard cases, and those of the other
public formulas. `public.py` says which public names that leaves out, and why."""

from collections.abc import Callable

import twins

from jaxspace.verification import CASES

from . import (
    attitude,
    flights,
    floor,
    gimbals,
    instruments,
    mechanics,
    motions,
    moving,
    orbits,
    paths,
    rockets,
    solids,
    stages,
    transfers,
    vehicles,
)
from .form import Form

# What the functions of the hard cases compute, and how many of their outputs belong to one size.
OF_CASES: dict[str, tuple[str, tuple[int, ...]]] = {
    "root": ("core.safe_sqrt", ()),
    "end_root": ("core.end_sqrt", ()),
    "arctangent": ("core.safe_atan2", ()),
    "exponential_quotient": ("core.phi1", ()),
    "sine_quotient": ("core.sinc_squared", ()),
    "stumpff_functions": ("core.stumpff", (1, 1, 1, 1)),
    "elliptic_k": ("core.complete_elliptic", ()),
    "elliptic_third": ("core.complete_third", ()),
    "length": ("core.norm", ()),
    "direction": ("core.unit", ()),
    "rotation_exp": ("rotations.Quaternion.from_rotation_vector", ()),
    "rotation_log": ("rotations.Quaternion.rotation_vector", ()),
    "euler_angles": ("rotations.to_euler_angles", (1, 1, 1)),
    "turned_there_and_back": ("rotations.from_euler_angles", (1, 1, 1)),
    "kepler": ("orbits.kepler_flow", (3, 3)),
    "elements": ("orbits.elements_from_state", (1,) * 6),
    "state": ("orbits.state_from_elements", (3, 3)),
    "radii": ("orbits.periapsis_radius", ()),
    "sizes": ("orbits.semi_major_axis orbits.apoapsis_radius", (1, 1)),
    "tilt": ("orbits.inclination", ()),
    "transfer": ("orbits.lambert", (3, 3)),
    "late_transfer": ("orbits.lambert", (3, 3)),
    "shortest": ("orbits.least_duration", ()),
    "bulge": ("orbits.oblateness", ()),
    "free_flight": ("bodies.free_turn", (9, 3)),
    "polhode_period": ("attitude.Polhode.period", ()),
    "cones": ("attitude.cone_angles", (1, 1)),
    "nutation": (
        "attitude.Top.nutation attitude.Nutation.turning_points attitude.Nutation.precession",
        (1, 1, 1, 1),
    ),
    "cubic_period": ("attitude.Nutation.period", ()),
    "steady_rates": ("attitude.Top.steady_precession_rates", (1, 1)),
    "least_spin": ("attitude.Top.least_spin", ()),
    "pendulum_period": ("attitude.SphericalPendulum.plane_period", ()),
    "libration_period": ("attitude.pitch_libration_period", ()),
    "tide": ("attitude.gravity_gradient_torque", ()),
    "cord": ("attitude.cord_length", ()),
    "unwound": ("attitude.YoYo.spin_rate attitude.YoYo.tension", (1, 1)),
    "gimbal_walk": ("gyros.GimbalWalk.period gyros.GimbalWalk.drift", (1, 1)),
    "gain": ("rockets.rocket_equation", ()),
    "ratio_for": ("rockets.mass_ratio_for", ()),
    "burnout_height": ("rockets.vertical_burnout_height", ()),
    "coast": ("rockets.coast_height", ()),
    "spun_angle": ("rockets.spin_angle", ()),
    "damping": ("rockets.jet_damping_ratio", ()),
    "spin_left": ("rockets.spin_ratio", ()),
    "density": ("bodies.exponential_density", ()),
    "two_stages": ("optimization.optimal_staging", (2, 1, 1)),
    "quickest": ("optimization.minimum_time_steering", (1, 1)),
}
# Their inputs that are vectors: (position, velocity or second place, duration, mu), a direction.
VECTORS = {
    "direction": (3,),
    **dict.fromkeys(("kepler", "transfer", "late_transfer"), (3, 3, 1, 1)),
    "shortest": (3, 3, 1),
}
# A root that halvings find to the digits of float64 and not of forty.
TWINS = {"two_stages": twins.two_stages, "quickest": twins.quickest}


def forms() -> list[Form]:
    """All that the fuzz test searches, without the systems."""
    starts: dict[Callable, list[tuple[float, ...]]] = {}
    for case in CASES:
        if case.function.__name__ in OF_CASES:
            starts.setdefault(case.function, []).append(case.inputs)
    of_cases = []
    for function, places in starts.items():
        names, blocks = OF_CASES[function.__name__]
        vectors = VECTORS.get(function.__name__, ())
        exact = TWINS.get(function.__name__)
        of_cases.append(Form(function, tuple(names.split()), places, blocks, vectors, exact))
    first = floor, solids, orbits, paths, transfers, attitude, moving, vehicles, rockets
    packages = *first, flights, mechanics, instruments, gimbals, stages, motions
    return [*of_cases, *(form for package in packages for form in package.FORMS)]
