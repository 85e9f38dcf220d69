"""What a scene is made of, and what each part of it costs."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..bodies import BodyState, sample_state
from ..core import AbstractSystem, Scalar, State
from ._scene import Scene


class EffectRow(NamedTuple):
    """One effect of a scene: its name, what it reads and adds, and its share of the arithmetic of
    one evaluation."""

    effect: str
    reads: tuple[str, ...]
    adds: tuple[str, ...]
    operations: int
    share: float


def compile_vector_field(system: AbstractSystem, t: Scalar, y: State) -> Any:
    """The compiled vector field of a system, with its parameters, the time and the state as
    arguments."""
    numbers, rest = eqx.partition(system, eqx.is_array)
    return (
        jax.jit(lambda n, t, y: eqx.combine(n, rest).vector_field(t, y))
        .lower(numbers, t, y)
        .compile()
    )


def operation_count(system: AbstractSystem, t: Scalar, y: State) -> int:
    """Floating-point operations of one evaluation as compiled, a transcendental function counted as
    one."""
    cost = compile_vector_field(system, t, y).cost_analysis()
    return int(cost.get("flops", 0.0) + cost.get("transcendentals", 0.0)) if cost else 0


def budget(scene: Scene, t: Scalar = 0.0, y: BodyState | None = None) -> list[EffectRow]:
    """A row for each effect, in the order of the scene, and a last one for the equations of motion
    themselves.

    The share of an effect is what one evaluation saves when it is left out of the whole."""
    t, y = jnp.asarray(t, float), sample_state(scene.parts) if y is None else y
    whole = operation_count(scene, t, y)
    least = max(whole, 1)  # constant loads cost no operation at all
    rows = []
    for k, effect in enumerate(scene.effects):
        rest = Scene(scene.effects[:k] + scene.effects[k + 1 :], scene.body, scene.parts)
        saved = max(whole - operation_count(rest, t, y), 0)
        rows.append(
            EffectRow(
                type(effect).__name__,
                tuple(sorted(effect.needs)),
                tuple(sorted(effect.adds)),
                saved,
                saved / least,
            )
        )
    own = max(
        whole - sum(row.operations for row in rows), 0
    )  # effects may share work that none of them saves alone
    return [*rows, EffectRow("equations of motion", scene.parts, (), own, own / least)]


def explain(scene: Scene) -> str:
    """A table of the scene: each effect, what it reads and adds, and its share of the arithmetic of
    one evaluation."""
    rows = budget(scene)
    lines = [("effect", "reads", "adds", "operations", "share")]
    lines += [
        (
            r.effect,
            ", ".join(r.reads),
            ", ".join(r.adds),
            str(r.operations),
            f"{100.0 * r.share:.0f} %",
        )
        for r in rows
    ]
    width = [max(len(line[k]) for line in lines) for k in range(5)]
    text = "\n".join(
        "  ".join(cell.ljust(w) for cell, w in zip(line, width, strict=True)).rstrip()
        for line in lines
    )
    return f"{text}\nstate: {', '.join(scene.parts)}"
