"""The effects of a scene, or of the scenes of a mission, by name: found, scaled, left out.

The effects of the same name in several phases of a mission are one effect."""

from collections.abc import Callable
from typing import Any

from ..core import InputError
from ..scene import Scene, scaled
from ..simulation import Mission, Phase


def scenes(system: Any) -> list[tuple[int, str, Scene]]:
    """Number, name and scene of every phase that has one."""
    if isinstance(system, Scene):
        return [(0, "scene", system)]
    phases = system.phases if isinstance(system, Mission) else ()
    return [(k, p.name, p.system) for k, p in enumerate(phases) if isinstance(p.system, Scene)]


def labels(scene: Scene) -> list[str]:
    """A name for every effect: its class, with a number from the second of a class on."""
    kinds = [type(e).__name__ for e in scene.effects]
    return [
        kind if kind not in kinds[:k] else f"{kind} {kinds[:k].count(kind) + 1}"
        for k, kind in enumerate(kinds)
    ]


def members(system: Any) -> dict[str, tuple[str, ...]]:
    """Every effect by name, with the phases that it acts in. Raises `InputError` when there is
    none."""
    found: dict[str, tuple[str, ...]] = {}
    for _, phase, scene in scenes(system):
        for label in labels(scene):
            found[label] = (*found.get(label, ()), phase)
    if not found:
        kind = type(system).__name__
        raise InputError(
            f"scene is a {kind} without effects: it must be a Scene, or a Mission of scenes, with at least one."
        )
    return found


def _rebuilt(system: Any, change: Callable[[Scene], Scene]) -> Any:
    """The scene, or the mission with each of its scenes changed."""
    if isinstance(system, Scene):
        return change(system)
    phases = system.phases
    return Mission(
        [
            Phase(
                change(p.system) if isinstance(p.system, Scene) else p.system,
                p.until,
                p.then,
                p.name,
            )
            for p in phases
        ]
    )


def with_factors(system: Any, names: tuple[str, ...], factors: list[Any]) -> Any:
    """The scene or mission with the effects of these names multiplied."""
    by_name = dict(zip(names, factors, strict=True))

    def change(scene: Scene) -> Scene:
        effects = [
            scaled(e, by_name[label]) for e, label in zip(scene.effects, labels(scene), strict=True)
        ]
        return Scene(effects, scene.body, scene.parts)

    return _rebuilt(system, change)


def without(system: Any, dropped: tuple[str, ...]) -> Any:
    """The scene or mission without the effects of these names."""

    def change(scene: Scene) -> Scene:
        kept = [
            e for e, label in zip(scene.effects, labels(scene), strict=True) if label not in dropped
        ]
        return Scene(kept, scene.body, scene.parts)

    return _rebuilt(system, change)
