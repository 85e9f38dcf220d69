"""The rockets of `examples/model_rockets` flown by RocketPy.

`python benchmarks/_rocketpy.py` prints apogee above the ground, when it is reached, where the
flight ends, and the seconds a flight takes, as JSON; with a number behind it, of so many flights up
to the apogee alone; with `measured` behind it, the apogees of the flights that were measured."""

import json
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "model_rockets"))

from rockets import HERE, ROCKETS, WIND, curve

NOSES = {"von_karman": "von karman", "ogive": "tangent"}


def environment(rocket: dict):
    """Its site, with its sounding, or with the standard atmosphere and the wind."""
    import rocketpy

    given = rocket["site"]
    air = rocketpy.Environment(
        latitude=given["latitude"], longitude=0.0, elevation=given["elevation"], datum="WGS84"
    )
    heights, east, north = WIND
    state = {"pressure": None, "temperature": None}
    if "air" in rocket:
        table = np.loadtxt(HERE / rocket["air"], delimiter=",", skiprows=1)
        heights, pressure, celsius, angle, speed = table.T
        # From where it blows.
        east, north = -speed * np.sin(np.radians(angle)), -speed * np.cos(np.radians(angle))
        state = {"pressure": pairs(heights, 100.0 * pressure)}
        state["temperature"] = pairs(heights, celsius + 273.15)
    air.set_atmospheric_model(
        type="custom_atmosphere",
        **state,
        wind_u=pairs(heights, east),
        wind_v=pairs(heights, north),
    )
    return air


def pairs(x, y) -> list[list[float]]:
    """A table as RocketPy takes it."""
    return np.column_stack([x, y]).tolist()


def drag(given):
    """Its curve of drag."""
    import rocketpy

    mach, values = curve(given)
    if len(mach) == 1:
        return float(values[0])
    return rocketpy.Function(
        pairs(mach, values), "Mach", "C", interpolation="linear", extrapolation="constant"
    )


def rocket(given: dict):
    """Its rocket, with the motor, the parts and the parachutes."""
    import rocketpy

    number, density, outer, inner, height, gap = given["grains"]
    nozzle = given["exit_station"]
    motor = rocketpy.SolidMotor(
        thrust_source=str(HERE / given["motor_file"]),
        burn_time=given.get("burn_time"),
        dry_mass=given["case_mass"],
        dry_inertia=given["case_inertia"],
        center_of_dry_mass_position=given["case_station"] - nozzle,
        grains_center_of_mass_position=given["propellant_station"] - nozzle,
        grain_number=number,
        grain_density=density,
        grain_outer_radius=outer,
        grain_initial_inner_radius=inner,
        grain_initial_height=height,
        grain_separation=gap,
        nozzle_radius=given["exit_radius"],
        nozzle_position=0,
        interpolation_method="linear",
        coordinate_system_orientation="nozzle_to_combustion_chamber",
    )
    made = rocketpy.Rocket(
        radius=given["radius"],
        mass=given["mass"],
        inertia=given["inertia"],
        power_off_drag=drag(given.get("coasting_drag", given["drag"])),
        power_on_drag=drag(given["drag"]),
        center_of_mass_without_motor=given["centre"],
        coordinate_system_orientation="tail_to_nose",
    )
    made.add_motor(motor, position=nozzle)
    nose, fins, tail = given["nose"], given["fins"], given["tail"]
    made.add_nose(length=nose["length"], kind=NOSES[nose["shape"]], position=nose["tip"])
    made.add_trapezoidal_fins(
        n=fins["count"],
        span=fins["span"],
        root_chord=fins["root_chord"],
        tip_chord=fins["tip_chord"],
        sweep_length=fins["sweep_length"],
        radius=fins["radius"],
        position=fins["leading_edge"],
    )
    if tail:
        made.add_tail(
            top_radius=tail["fore_radius"],
            bottom_radius=tail["aft_radius"],
            length=tail["length"],
            position=tail["fore_end"],
        )
    for k, (area, lag, below) in enumerate(given.get("parachutes", ())):
        trigger = "apogee" if below is None else below
        # Without the noise of the barometer, so that a flight is the same every time.
        made.add_parachute(
            f"{k}", cd_s=area, trigger=trigger, sampling_rate=105, lag=lag, noise=(0, 0, 0)
        )
    return made


def flight(given: dict, made=None, air=None, *, to_apogee: bool = False, inclination=None):
    """Its flight."""
    import rocketpy

    site = given["site"]
    return rocketpy.Flight(
        rocket=made or rocket(given),
        environment=air or environment(given),
        rail_length=site["rail_length"],
        inclination=site["inclination"] if inclination is None else inclination,
        heading=site["heading"],
        terminate_on_apogee=to_apogee,
        rtol=1e-8,
        atol=6 * [1e-6] + 4 * [1e-9] + 3 * [1e-6],
        # A motor that builds up slowly is missed by longer steps on the rail.
        max_time_step=0.05,
    )


def corrected(made):
    """Its rocket with centre of mass and nozzle behind the centre of dry mass.

    RocketPy 1.13 gives both to its equations of motion as if they were ahead of it
    (`com_to_cdm_function` and `nozzle_to_cdm` count towards the tail, its body axis towards the
    nose), which makes the rocket more stable; and it takes a quarter of the square of the nozzle's
    lever in the jet damping (`evaluate_nozzle_gyration_tensor`). RocketPy's issue 1186 reports the
    signs, and its pull request 1196 corrects them."""
    from rocketpy.mathutils.vector_matrix import Matrix

    along = 0.5 * made.motor.nozzle_radius**2
    across = 0.5 * along + made.nozzle_to_cdm**2
    made.nozzle_gyration_tensor = Matrix([[across, 0, 0], [0, across, 0], [0, 0, along]])
    made.com_to_cdm_function = -1 * made.com_to_cdm_function
    made.nozzle_to_cdm = -made.nozzle_to_cdm
    return made


def summary(given: dict, *, correct: bool = False) -> dict[str, float]:
    """The numbers of a flight."""
    made = rocket(given)
    flown = flight(given, corrected(made) if correct else made)
    return {
        "apogee": float(flown.apogee - given["site"]["elevation"]),
        "apogee_time": float(flown.apogee_time),
        "apogee_east": float(flown.x(flown.apogee_time)),
        "apogee_north": float(flown.y(flown.apogee_time)),
        "rail_exit_speed": float(flown.out_of_rail_velocity),
        "end_time": float(flown.t_final),
        "east": float(flown.x_impact),
        "north": float(flown.y_impact),
    }


def seconds(flights: int) -> dict[str, float]:
    """Seconds of one flight of Calisto to its apogee, as RocketPy flies it by default: the median
    of some, and the worst error of three of their apogees against tight tolerances; the rocket and
    the air are built once, and the time of that is left out."""
    import rocketpy

    given = ROCKETS["Calisto"]
    made, air, site = rocket(given), environment(given), given["site"]

    def fly(inclination: float, **tolerances) -> float:
        flown = rocketpy.Flight(
            rocket=made,
            environment=air,
            rail_length=site["rail_length"],
            inclination=inclination,
            heading=site["heading"],
            terminate_on_apogee=True,
            **tolerances,
        )
        return float(flown.apogee - site["elevation"])

    taken, used = [], []
    for k in range(flights + 1):
        wall, cpu = time.perf_counter(), time.process_time()
        fly(site["inclination"] - 0.1 * k)
        taken.append(time.perf_counter() - wall)
        used.append(time.process_time() - cpu)
    tight = {"rtol": 1e-10, "atol": 6 * [1e-8] + 4 * [1e-11] + 3 * [1e-8], "max_time_step": 0.01}
    errors = [abs(fly(angle) / fly(angle, **tight) - 1.0) for angle in (80.0, 84.0, 88.0)]
    return {
        "seconds": float(np.median(taken[1:])),
        "cpu_seconds": float(np.median(used[1:])),
        "worst_relative_error": max(errors),
        "flights": flights,
    }


def measured() -> dict[str, float]:
    """The apogees above the ground, m, of the flights of `measured`, corrected."""
    from measured import FLIGHTS

    def apogee(given: dict) -> float:
        found = flight(given, corrected(rocket(given)), to_apogee=True)
        return float(found.apogee - given["site"]["elevation"])

    return {name: apogee(given) for name, given in FLIGHTS.items()}


if __name__ == "__main__":
    if sys.argv[1:] == ["measured"]:
        print(json.dumps(measured(), indent=4))
    elif len(sys.argv) > 1:
        print(json.dumps(seconds(int(sys.argv[1]))))
    else:
        found = {
            "as shipped": {name: summary(given) for name, given in ROCKETS.items()},
            "corrected": {name: summary(given, correct=True) for name, given in ROCKETS.items()},
        }
        print(json.dumps(found, indent=4))
