"""Soft landing for 99 % of all winds
A landing in the wind

A stage lands with a throttle program that depends only on time, with
dispersed thrust, drag, speed and wind. With the nine throttle settings and
the ignition altitude that are optimal for the nominal run, 99 % of all runs
touch down at up to 49 m/s; with those optimised for the dispersed runs, at up
to 18 m/s."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import jaxspace
from jaxspace.robust import assess_designs

jaxspace.enable_x64()
file = jaxspace.load(Path("examples") / "scenes" / "windy_landing.toml")
best = file.optimize_design()
nominal = file.optimize_design(nominal=True)
assessment = assess_designs(best, {"nominal": nominal.x})
print(assessment)

figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.2))
times = np.asarray(
    file.values["effects"]["steered_thrust"]["schedule"]["times"]
)
for name, design in assessment.designs.items():
    speed = design.runs.outputs["speed"]
    left.hist(speed, np.linspace(0.0, 60.0, 80), alpha=0.5, label=name)
    throttles = [x for path, x in design.x.items() if "throttles" in path]
    altitude = design.x["phase.0.until.at_altitude.altitude"]
    right.plot(times, throttles, label=f"ignition at {float(altitude):.0f} m")
left.set(xlabel="touchdown speed, m/s", ylabel="number of runs (of 4,096)")
right.set(xlabel="time since ignition, s", ylabel="throttle")
left.legend()
right.legend()
plt.show()
