"""Eleven measured flights of student rockets: rocket, atmosphere, and measured apogee.

Data, thrust curves, drag curves and logs are from the examples of RocketPy
(https://github.com/RocketPy-Team/RocketPy at d41dd11e, docs/examples and data, MIT licence,
Copyright (c) 2018 Giovani Hidalgo Ceotto), contributed by the teams. Digitised drag curves are
averaged over 0.02 of the Mach number and thinned to within 0.006, long thrust curves to within 1.2
percent of their peak at the same impulse; the motor files are complete.

The air (`measured/*_air.csv`) is that of ERA5, at the hour of the flight and between the four
points about the site, at its pressure levels from 1000 to 600 hPa: contains modified Copernicus
Climate Change Service information 2020, 2022 and 2023. Neither the European Commission nor ECMWF is
responsible for any use of it. For rockets without such a file, the atmosphere is the calm standard
atmosphere.

Stations are along the axis towards the nose, m, from the origin of the original data, as in
`rockets`.
"""

import numpy as np
from rockets import NDRT, VALETUDO

CALM = "measured/standard_air.csv"
EUROC = {"rail_length": 12.0, "inclination": 84.0, "heading": 133.0}
# The case mass is zero: it is included in the mass of the rocket.
NO_CASE = {"case_mass": 0.0, "case_inertia": (0.0, 0.0, 0.0)}

BELLA_LUI = {
    "motor_file": "measured/bella_lui_thrust.csv",
    "radius": 0.078,
    "mass": 18.226,
    "inertia": (0.78267, 0.78267, 0.064244),
    "centre": 0.0,
    "case_mass": 0.001,
    "case_inertia": (0.0, 0.0, 0.0),
    "case_station": -0.8356,
    "propellant_station": -0.8356,
    "grains": (3, 782.4, 0.042799, 0.033147, 0.1524, 0.003),
    "exit_station": -1.1356,
    "exit_radius": 0.04445,
    "drag": "measured/bella_lui_drag.csv",
    "nose": {"shape": "ogive", "length": 0.242, "tip": 1.542},
    "fins": {"count": 3, "span": 0.200, "root_chord": 0.280, "tip_chord": 0.125,
             "sweep_length": 0.155, "radius": 0.078, "leading_edge": -0.75},
    "tail": {"fore_radius": 0.078, "aft_radius": 0.0675, "length": 0.050, "fore_end": -1.0856},
    "site": {"latitude": 47.213476, "elevation": 407.0, "rail_length": 4.2,
             "inclination": 89.0, "heading": 45.0},
}  # fmt: skip

ANDROMEDA = {
    **NO_CASE,
    "motor_file": "measured/andromeda_thrust.csv",
    "radius": 0.07535,
    "mass": 20.9767,
    "inertia": (11.249, 11.249, 0.12377),
    "centre": 1.3998,
    "case_station": 0.5,
    "propellant_station": 0.56139,
    "grains": (1, 1468.908, 0.0375, 0.01875, 0.893, 0.0),
    "exit_station": 0.0,
    "exit_radius": 0.028125,
    "drag": "measured/andromeda_drag.csv",
    "nose": {"shape": "von_karman", "length": 0.3, "tip": 2.4996},
    "fins": {"count": 3, "span": 0.185, "root_chord": 0.23, "tip_chord": 0.11,
             "sweep_length": 0.12, "radius": 0.07535, "leading_edge": 0.3546},
    "tail": None,
    "site": {"latitude": 39.388692, "elevation": 160.0, **EUROC},
}  # fmt: skip

ASTRA = {
    **NO_CASE,
    "motor_file": "measured/astra_thrust.csv",
    "radius": 0.047,
    "mass": 10.6462,
    "inertia": (6.6986, 6.6986, 0.040824),
    "centre": 1.3957,
    "case_station": 0.714616,
    "propellant_station": 0.957616,
    "grains": (1, 1256.7753, 0.0375, 0.01875, 0.486, 0.0),
    "exit_station": 0.714616,
    "exit_radius": 0.028125,
    "drag": "measured/astra_drag.csv",
    "nose": {"shape": "von_karman", "length": 0.27, "tip": 2.5214},
    "fins": {"count": 4, "span": 0.117, "root_chord": 0.2, "tip_chord": 0.118,
             "sweep_length": 0.082, "radius": 0.047, "leading_edge": 0.9134},
    "tail": None,
    "site": {"latitude": 39.3897, "elevation": 160.0, **EUROC},
}  # fmt: skip

EREBUS = {
    **NO_CASE,
    "motor_file": "measured/erebus_thrust.csv",
    "radius": 0.04575,
    "mass": 5.82,
    "inertia": (2.571, 2.571, 0.0056233),
    "centre": 1.192,
    "case_station": 0.211668,
    "propellant_station": 0.511668,
    "grains": (1, 1196.6353, 0.027, 0.0135, 0.572, 0.0),
    "exit_station": 0.211668,
    "exit_radius": 0.02025,
    "drag": "measured/erebus_drag.csv",
    "nose": {"shape": "von_karman", "length": 0.391113, "tip": 2.3841},
    "fins": {"count": 4, "span": 0.08, "root_chord": 0.12, "tip_chord": 0.05,
             "sweep_length": 0.07, "radius": 0.04575, "leading_edge": 0.395787},
    "tail": {"fore_radius": 0.04575, "aft_radius": 0.03575, "length": 0.079119,
             "fore_end": 0.290787},
    "site": {"latitude": 39.3897, "elevation": 160.0, **EUROC},
}  # fmt: skip

# The drag curve is in the page of the example; two percent higher while the motor burns.
PROMETHEUS_DRAG = (
    np.array([0.15, 0.45, 0.77, 0.82, 0.88, 0.94, 0.99, 1.04, 1.24, 1.33, 1.49]),
    np.array([0.422, 0.38, 0.32, 0.30, 0.30, 0.32, 0.37, 0.44, 0.43, 0.42, 0.39]),
)
PROMETHEUS = {
    "motor_file": "measured/prometheus_thrust.csv",
    "radius": 0.06985,
    "mass": 13.93,
    "inertia": (4.87, 4.87, 0.05),
    "centre": 0.9549,
    "case_mass": 2.981,
    "case_inertia": (0.0, 0.0, 0.0),
    "case_station": 0.274,
    "propellant_station": 0.274,
    # A full cylinder of 3.737 kg.
    "grains": (1, 3.737 / (np.pi * 0.064**2 * 0.548), 0.064, 0.0, 0.548, 0.0),
    "exit_station": 0.0,
    "exit_radius": 0.027,
    "drag": (PROMETHEUS_DRAG[0], 1.02 * PROMETHEUS_DRAG[1]),
    "coasting_drag": PROMETHEUS_DRAG,
    "nose": {"shape": "von_karman", "length": 0.742, "tip": 2.229},
    "fins": {"count": 3, "span": 0.13, "root_chord": 0.268, "tip_chord": 0.136,
             "sweep_length": 0.066, "radius": 0.06985, "leading_edge": 0.273},
    "tail": None,
    "site": {"latitude": 32.939377, "elevation": 1401.0, "rail_length": 5.18,
             "inclination": 80.0, "heading": 75.0},
}  # fmt: skip

CAVOUR = {
    **NO_CASE,
    "motor_file": "measured/cavour_thrust.csv",
    "radius": 0.052,
    "mass": 8.219,
    "inertia": (4.449, 4.449, 0.014634),
    "centre": 1.1994,
    "case_station": 1.1994,
    "propellant_station": 0.19966,
    "grains": (3, 1653.53, 0.0325, 0.011375, 0.13244, 0.001),
    "exit_station": 0.0,
    "exit_radius": 0.0335,
    "drag": "measured/cavour_drag.csv",
    "coasting_drag": "measured/cavour_drag_off.csv",
    "nose": {"shape": "von_karman", "length": 0.52, "tip": 2.7224},
    "fins": {"count": 4, "span": 0.1, "root_chord": 0.2, "tip_chord": 0.07,
             "sweep_length": 0.13, "radius": 0.052, "leading_edge": 0.2104},
    "tail": None,
    "site": {"latitude": 39.388692, "elevation": 150.0, **EUROC},
}  # fmt: skip

GENESIS = {
    **NO_CASE,
    # The same motor.
    "motor_file": "measured/cavour_thrust.csv",
    "radius": 0.047,
    "mass": 9.214,
    "inertia": (7.5046, 7.5046, 0.042241),
    "centre": 0.895,
    "case_station": 0.895,
    "propellant_station": 0.243,
    "grains": (3, 1815.0, 0.033, 0.015, 0.12, 0.005),
    "exit_station": 0.0,
    "exit_radius": 0.042354,
    "drag": 0.55,
    "nose": {"shape": "von_karman", "length": 0.27, "tip": 2.372},
    "fins": {"count": 4, "span": 0.105, "root_chord": 0.2, "tip_chord": 0.11,
             "sweep_length": 0.09, "radius": 0.047, "leading_edge": 0.25},
    "tail": None,
    "site": {"latitude": 39.38895, "elevation": 160.0, **EUROC},
}  # fmt: skip

JUNO_3 = {
    **NO_CASE,
    "motor_file": "measured/juno_3_thrust.csv",
    "radius": 0.0655,
    "mass": 24.05,
    "inertia": (15.07, 15.07, 0.067),
    "centre": 0.0,
    "case_station": -0.683,
    "propellant_station": -0.683,
    "grains": (5, 1748.9, 0.0465, 0.016, 0.156, 0.006),
    "exit_station": -1.294,
    "exit_radius": 0.0335,
    "drag": "measured/juno_3_drag.csv",
    "nose": {"shape": "von_karman", "length": 0.565, "tip": 1.477},
    # Flat fins: the example has a table of the lift of their section.
    "fins": {"count": 4, "span": 0.130, "root_chord": 0.20, "tip_chord": 0.12,
             "sweep_length": 0.08, "radius": 0.0655, "leading_edge": -0.928},
    "tail": {"fore_radius": 0.0655, "aft_radius": 0.0535, "length": 0.068, "fore_end": -1.226},
    "site": {"latitude": 32.939377, "elevation": 1480.0, "rail_length": 5.2,
             "inclination": 85.0, "heading": 105.0},
}  # fmt: skip

LINCE = {
    **NO_CASE,
    "motor_file": "measured/lince_thrust.csv",
    "radius": 0.052,
    "mass": 10.6851352,
    "inertia": (4.9939475, 4.9939475, 0.0213204),
    "centre": 1.061,
    "case_station": 1.061,
    "propellant_station": 0.315533,
    "grains": (4, 1363.0, 0.035, 0.01, 0.16, 0.0),
    "exit_station": 0.0,
    "exit_radius": 0.0335,
    "drag": "measured/lince_drag.csv",
    "nose": {"shape": "von_karman", "length": 0.28, "tip": 2.109417},
    "fins": {"count": 4, "span": 0.0825, "root_chord": 0.17, "tip_chord": 0.0425,
             "sweep_length": 0.1275, "radius": 0.052, "leading_edge": 0.17},
    "tail": {"fore_radius": 0.052, "aft_radius": 0.04852, "length": 0.022, "fore_end": 0.0},
    "site": {"latitude": 39.3897, "elevation": 158.0, **EUROC},
}  # fmt: skip

# The apogee above the ground, m: computed by RocketPy 1.13 with the data of this file (`python
# benchmarks/_rocketpy.py measured`), with its centre of mass on the correct side as explained
# in `rockets`; from the simulation in the pages of RocketPy; and measured.
APOGEES = {
    "Valetudo, 2019": (809.87, 825.39, 860.0),
    "Bella Lui, 2020": (460.59, 460.50, 458.97),
    "NDRT, 2020": (1300.15, 1296.77, 1316.75),
    "Andromeda, 2022": (3606.74, 3614.95, 3443.0),
    "Astra, 2022": (3040.81, 3043.07, 3250.0),
    "Erebus, 2022": (2748.31, 2750.90, 3020.0),
    "Prometheus, 2022": (4077.48, 4190.05, 3898.37),
    "Cavour, 2023": (2820.45, 2818.90, 2789.0),
    "Juno III, 2023": (3128.63, 3026.05, 3213.0),
    "Genesis, 2023": (3049.53, 3076.45, 2916.0),
    "Lince, 2023": (3289.38, 3284.12, 3587.0),
}
FLIGHTS = {
    "Valetudo, 2019": {**VALETUDO, "air": CALM},
    "Bella Lui, 2020": {**BELLA_LUI, "air": "measured/bella_lui_air.csv"},
    # Upright, as the example has it.
    "NDRT, 2020": {
        **NDRT,
        "site": {**NDRT["site"], "inclination": 90.0},
        "air": "measured/ndrt_air.csv",
    },
    "Andromeda, 2022": {**ANDROMEDA, "air": "measured/andromeda_air.csv"},
    "Astra, 2022": {**ASTRA, "air": "measured/astra_air.csv"},
    "Erebus, 2022": {**EREBUS, "air": "measured/erebus_air.csv"},
    "Prometheus, 2022": {**PROMETHEUS, "air": CALM},
    "Cavour, 2023": {**CAVOUR, "air": "measured/cavour_air.csv"},
    "Juno III, 2023": {**JUNO_3, "air": CALM},
    "Genesis, 2023": {**GENESIS, "air": "measured/genesis_air.csv"},
    "Lince, 2023": {**LINCE, "air": "measured/lince_air.csv"},
}
"""Of each flight its rocket, site and air."""
