"""Payload for 99 % mission success
Payload of a transfer stage with a reserve

The heaviest payload that reaches geostationary altitude: for the nominal run,
and for 99 % of the runs with dispersed thrust, specific impulse and parking
orbit. Half of the flights with the nominal payload fall short (dashed)."""

from pathlib import Path

import matplotlib.pyplot as plt

import jaxspace
from jaxspace.robust import assess_designs

jaxspace.enable_x64()
file = jaxspace.load(Path("examples") / "scenes" / "transfer_payload.toml")
best = file.optimize_design()
nominal = file.optimize_design(nominal=True)
assessment = assess_designs(best, {"nominal": nominal.x})
print(assessment)

figure, axes = plt.subplots(figsize=(6.4, 3.4))
for name, design in assessment.designs.items():
    apoapsis = design.runs.outputs["apoapsis_altitude"]
    payload = design.x["body.mass"] - 2050.0 - 250.0
    axes.hist(
        apoapsis, 60, alpha=0.5, label=f"{name}: {float(payload):.0f} kg"
    )
axes.axvline(35786.0, color="k", ls="--", lw=0.8)
axes.set(xlabel="apoapsis altitude, km", ylabel="number of runs (of 4,096)")
axes.legend()
plt.show()
