"""The effects of a scene, or of the scenes of a mission, by name: found, scaled, removed.

The effects of the same name in several phases of a mission are one effect."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import TypeAlias

from ..core import AbstractSystem, InputError, Scalar
from ..scene import Scene, scaled
from ..simulation import Mission, Phase
from ..simulation.legs import legs_of

Runnable: TypeAlias = AbstractSystem | Mission


def scenes(system: Runnable) -> list[tuple[int, str, Scene]]:
    """Number, name and scene of every phase that has one."""
    if isinstance(system, Scene):
        return [(0, "scene", system)]
    legs = legs_of(system)[0] if isinstance(system, Mission) else ()
    result = ((k, leg.name, leg.phase.system) for k, leg in enumerate(legs))
    return [(k, name, system) for k, name, system in result if isinstance(system, Scene)]


def effect_names(scene: Scene) -> list[str]:
    """A name for every effect: its class, with a number from the second of a class on."""
    return numbered([type(effect).__name__ for effect in scene.effects])


def numbered(names: Sequence[str]) -> list[str]:
    """The names, with a number from the second of the same name on."""
    return [
        name if name not in names[:k] else f"{name} {names[:k].count(name) + 1}"
        for k, name in enumerate(names)
    ]


def phases_by_effect(system: Runnable) -> dict[str, tuple[str, ...]]:
    """Every effect by name, with the phases in which it acts.

    **Raises** `InputError` when there is none."""
    result: dict[str, tuple[str, ...]] = {}
    for _, phase, scene in scenes(system):
        for name in effect_names(scene):
            result[name] = (*result.get(name, ()), phase)
    if not result:
        raise InputError(
            f"scene is a {type(system).__name__} without effects: it must be a Scene, or a Mission "
            f"of scenes, with at least one."
        )
    return result


def scale_effects(system: Runnable, factors: dict[str, Scalar]) -> Runnable:
    """The scene or mission with the effects of these names multiplied by their factors."""

    def change(scene: Scene) -> Scene:
        named = zip(effect_names(scene), scene.effects, strict=True)
        # With all parts, so that one initial state is valid for the scene with any factors.
        return scene.with_effects([scaled(e, factors[name]) for name, e in named], scene.parts)

    return _map_scenes(system, change)


def remove_effects(system: Runnable, removed: Sequence[str]) -> Runnable:
    """The scene or mission without the effects of these names.

    The state retains its parts, including those required only by a removed effect."""

    def change(scene: Scene) -> Scene:
        named = zip(effect_names(scene), scene.effects, strict=True)
        return scene.with_effects([e for name, e in named if name not in removed], scene.parts)

    return _map_scenes(system, change)


def _map_scenes(system: Runnable, change: Callable[[Scene], Scene]) -> Runnable:
    """The scene changed, or the mission with each of its scenes changed."""
    if isinstance(system, Mission):
        return _map_mission(system, change)
    return change(system) if isinstance(system, Scene) else system


def _map_mission(mission: Mission, change: Callable[[Scene], Scene]) -> Mission:
    phases = [_map_phase(phase, change) for phase in mission.phases]
    return dataclasses.replace(mission, phases=phases)


def _map_phase(phase: Phase, change: Callable[[Scene], Scene]) -> Phase:
    # A phase may also run a system without effects, which stays.
    system = change(phase.system) if isinstance(phase.system, Scene) else phase.system
    branches = [_map_mission(branch, change) for branch in phase.branches]
    return dataclasses.replace(phase, system=system, branches=branches)
