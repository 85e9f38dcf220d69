"""A scene file that has been checked, and what is built from it: one way for the nominal run and
for many."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..bodies import BodyState, BurningBody, PrincipalInertia, RigidBody
from ..core import AbstractSystem, State
from ..dispersion import Campaign
from ..scene import Scene
from ..simulation import Event, Mission, MissionTrajectory, Phase
from ._checks import acting
from ._inputs import distribution
from ._lanes import Lanes
from ._outputs import Outputs, nominal_states
from ._registry import Registry
from ._values import at, replaced


@final
@dataclass(frozen=True, eq=False)
class SceneFile:
    """A checked file: its `kind`, one of "system", "scene" and "mission", and its `values` in SI.

    `inputs`: for every dispersed number the name and the numbers of its distribution."""

    path: Path
    text: str
    kind: str
    values: dict[str, Any]
    inputs: dict[str, tuple[str, dict[str, float]]]
    registry: Registry

    @property
    def title(self) -> str:
        """The title, or the name of the file."""
        return self.values["title"] or self.path.stem

    @property
    def accuracy(self) -> float:
        """The relative tolerance of each step."""
        return self.values["accuracy"]

    def nominal(self) -> tuple[AbstractSystem | Mission, State, Array]:
        """System, initial state and times of the nominal run; mission, initial state and start
        where there are phases."""
        if self.kind == "system":
            values = replaced(self.values, {})
            system, y0 = self.registry.systems[values["system"]["name"]].build(values, Lanes())
            return system, y0, self.times()
        mission, y0 = self.nominal_mission()
        if self.kind == "mission":
            return mission, y0, jnp.zeros(())
        return mission.phases[0].system, y0, self.times()

    def times(self) -> Array:
        """The times of the states asked for, s."""
        times = self.values["times"]
        return jnp.linspace(times["start"], times["end"], max(times["samples"], 2))

    def scenes(self) -> dict[str, Scene]:
        """The scene of every phase, by the name of the phase; empty for a textbook system."""
        if self.kind == "system":
            return {}
        mission, _ = self.nominal_mission()
        return {
            phase.name: phase.system for phase in mission.phases if isinstance(phase.system, Scene)
        }

    def nominal_mission(self) -> tuple[Mission, BodyState]:
        """Mission and initial state of the nominal run; of a scene, a mission of one phase."""
        return eqx.filter_jit(lambda values: self.mission(values, Lanes()))(
            replaced(self.values, {})
        )

    def mission(self, values: dict[str, Any], lanes: Lanes) -> tuple[Mission, BodyState]:
        """Mission and initial state from values that are scalars or (runs,); a scene is a mission
        of one phase."""
        body = self.body(values, lanes)
        effects = {
            name: self.registry.effects[name].build(values, lanes) for name in acting(self.values)
        }
        initial = self.registry.initial.build(values, lanes)
        if any("mass_rate" in type(e).adds for e in effects.values()):
            initial = eqx.tree_at(
                lambda y: y.mass,
                initial,
                lanes.scalar(_mass(values["body"])),
                is_leaf=lambda x: x is None,
            )
        carry = initial.present()
        if self.kind == "scene":
            times = self.values["times"]
            return Mission(
                [
                    Phase(
                        Scene(tuple(effects.values()), body, carry),
                        times["end"] - times["start"],
                        name="scene",
                    )
                ]
            ), initial
        phases, start = [], 0.0
        for phase in values["phase"]:
            phases.append(self._phase(phase, start, values, effects, body, carry, lanes))
            end = phases[-1].until
            start = start + (0.0 if isinstance(end, Event) else end)
        return Mission(phases), initial

    def body(self, values: dict[str, Any], lanes: Lanes) -> RigidBody | BurningBody:
        """The body of the file, from values that are scalars or (runs,)."""
        return _body(values["body"], lanes)

    def _phase(
        self,
        phase: dict[str, Any],
        start: Any,
        values: Any,
        effects: Any,
        body: Any,
        carry: Any,
        lanes: Lanes,
    ) -> Phase:
        until: Any = phase["duration"]
        if phase["until"] == "burnout":
            until = effects["thrust"].ignition + effects["thrust"].burn_time - start
        elif phase["until"] is not None:
            condition, direction = self.registry.events[phase["until"]]
            until = Event(condition, direction, phase["within"])
        jumps = [
            self.registry.jumps[n].build(t, values, lanes)
            for n, t in phase["jump"].items()
            if t is not None
        ]
        scene = Scene(tuple(effects[name] for name in phase["effects"]), body, carry)
        return Phase(scene, until, jumps[0] if jumps else None, phase["name"])

    def outputs(self, flown: MissionTrajectory | None) -> Outputs:
        """The outputs that [dispersion] asks for, compared with the nominal run `flown`."""
        reference = None if flown is None else nominal_states(self.values, flown)
        return Outputs(
            self, replaced(self.values, {}), tuple(self.values["dispersion"]["outputs"]), reference
        )

    def nominal_outputs(self, flown: MissionTrajectory) -> dict[str, Array]:
        """The outputs of the nominal run `flown` itself, each (1,)."""
        numbers = eqx.filter_jit(lambda outputs, states: outputs.numbers(*states, {}))
        return numbers(self.outputs(None), nominal_states(self.values, flown))

    def campaign(self, flown: MissionTrajectory | None) -> Campaign:
        """What [dispersion] asks for, with the nominal run `flown` as the reference of the outputs
        that compare."""
        wanted = self.values["dispersion"]["outputs"]
        spread = {
            path: distribution(*how, at(self.values, path)) for path, how in self.inputs.items()
        }
        units = {path: at(self.values, path).quantity.unit for path in spread}
        units |= {name: self.registry.outputs[name].unit for name in wanted}
        start = 0.0 if self.kind == "mission" else self.values["times"]["start"]
        return Campaign(
            Build(self, replaced(self.values, {})),
            spread,
            self.outputs(flown),
            units,
            start,
            self.text,
        )


class Build(eqx.Module):
    """The `build` of a campaign. The numbers of the file are leaves: another number compiles
    nothing anew."""

    file: SceneFile = eqx.field(static=True)
    values: dict[str, Any]

    def __call__(self, samples: dict[str, Array]) -> tuple[Mission, State]:
        runs = next(iter(samples.values())).shape[0]
        return self.file.mission(replaced(self.values, samples), Lanes(runs))


def _mass(body: dict[str, Any]) -> Any:
    return body["mass"] if body["dry_mass"] is None else body["dry_mass"] + body["propellant_mass"]


def _body(body: dict[str, Any], lanes: Lanes) -> RigidBody | BurningBody:
    inertia = None if body["inertia"] is None else PrincipalInertia(lanes.vector(body["inertia"]))
    if body["dry_mass"] is None:
        return RigidBody(body["mass"], inertia)
    radii = lanes.vector(body["gyration_radii"])
    return BurningBody(body["dry_mass"], inertia, radii, body["propellant_station"])
