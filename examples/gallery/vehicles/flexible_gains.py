"""Gains of a flexible stage under dispersions
Gains for 95 % of all flexible stages

Two gains of an autopilot that minimise the engine deflection while the stage
is within a quarter of a degree of its target and at rest after four seconds.
The optimal gains of the nominal stage miss this in half of all runs. The
roots of the loop in 500 of them, with slosh and bending, are all stable."""

from pathlib import Path

import equinox as eqx
import matplotlib.pyplot as plt
import numpy as np

import jaxspace
from jaxspace.robust import assess_designs
from jaxspace.studies import modes

jaxspace.enable_x64()
file = jaxspace.load(Path("examples") / "scenes" / "flexible_gains.toml")
best = file.optimize_design()
nominal = file.optimize_design(nominal=True)
assessment = assess_designs(best, {"nominal": nominal.x})
print(assessment)

figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.2))
for k, (name, design) in enumerate(assessment.designs.items()):
    lean = design.runs.outputs["lean"]
    left.hist(lean, np.linspace(0.15, 0.35, 80), alpha=0.5, label=name)
    inputs = {key: x[:500] for key, x in design.runs.inputs.items()}
    mission, _ = best.problem.campaign(design.x).mission(inputs)
    loop = mission.phases[0].system.effects[-1].loop
    state = loop.state(np.zeros(500))
    roots = np.ravel(eqx.filter_jit(modes)(loop, state).eigenvalues)
    right.plot(roots.real, roots.imag, f"C{k}.", ms=1.5, alpha=0.5)
left.axvline(0.25, color="0.4", lw=0.8)
right.axvline(0.0, color="0.4", lw=0.8)
left.set(
    xlabel="axis error after 4 s, deg", ylabel="number of runs (of 4,096)"
)
right.set(xlim=(-0.8, 0.1), ylim=(0.0, 14.0))
right.set(
    xlabel="decay rate of a root, 1/s", ylabel="frequency of the root, rad/s"
)
left.legend()
plt.show()
