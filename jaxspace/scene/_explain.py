"""The effects of a scene, and the share of each in the arithmetic of an evaluation."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.stages import Compiled
from jaxtyping import PyTree

from ..bodies import BodyState
from ..bodies.state import sample_state
from ..core import AbstractSystem, Scalar
from ..core.printing import printed
from ..core.structure import once_per_structure
from ._interface import AbstractScene


@printed()
class EffectRow(NamedTuple):
    """One effect of a scene.

    - `effect`: its name; `reads`, `adds`: parts of the state, and contributions of its load.
    - `operations`: floating-point operations of one evaluation that it costs.
    - `share`: their share in the whole scene.
    """

    effect: str
    reads: tuple[str, ...]
    adds: tuple[str, ...]
    operations: int
    share: float


def compile_vector_field(system: AbstractSystem, t: PyTree, y: PyTree) -> Compiled:
    """The compiled vector field of a system, as a function of its arrays, the time and the state.

    **Arguments**

    - `system`: any system.
    - `t`, s, and `y`: a time and a state, or their shapes and precision.
    """
    # The parameters are arguments, because the compiler would fold constants into the operations
    # that are to be counted.
    arrays, rest = eqx.partition(system, _has_shape)
    return (
        jax.jit(lambda arrays, t, y: eqx.combine(arrays, rest).vector_field(t, y))
        .lower(arrays, t, y)
        .compile()
    )


def _has_shape(x: object) -> bool:
    return eqx.is_array(x) or isinstance(x, jax.ShapeDtypeStruct)


@once_per_structure
def operation_count(system: AbstractSystem, t: PyTree, y: PyTree) -> int:
    """Floating-point operations of one compiled evaluation; a transcendental function is one. The
    phases of a mission are mostly scenes of one structure, which is compiled once.

    Arguments as in `compile_vector_field`; only the shapes of the arrays are used."""
    cost = compile_vector_field(system, t, y).cost_analysis()
    return int(cost.get("flops", 0.0) + cost.get("transcendentals", 0.0)) if cost else 0


def budget(scene: AbstractScene, t: Scalar = 0.0, y: BodyState | None = None) -> list[EffectRow]:
    """The arithmetic of each effect of a scene: the saving of an evaluation without it.

    **Arguments**

    - `scene`: the scene.
    - `t`, s, and `y`: a time and a state, for their shapes; by default one run.

    **Returns** a row for each effect, in the order of the scene, and a last one for the equations
    of motion themselves.
    """
    t = jnp.asarray(t, float)
    y = scene.start(sample_state(scene.parts)) if y is None else y
    whole = operation_count(scene, t, y)
    # Constant loads cost no operation at all.
    divisor = max(whole, 1)
    rows = []
    for k, (effect, reading) in enumerate(zip(scene.effects, scene.readings, strict=True)):
        rest = scene.with_effects(scene.effects[:k] + scene.effects[k + 1 :], scene.parts)
        saved = max(whole - operation_count(rest, t, y), 0)
        rows.append(
            EffectRow(
                type(effect).__name__,
                tuple(sorted(reading.needs)),
                tuple(sorted(reading.adds)),
                saved,
                saved / divisor,
            )
        )
    # Effects may share work that none of them saves alone: it counts to the equations of motion.
    own = max(whole - sum(row.operations for row in rows), 0)
    return [*rows, EffectRow("equations of motion", scene.parts, (), own, own / divisor)]


def explain(scene: AbstractScene, names: Sequence[str] = ()) -> str:
    """A table of the effects: their inputs, their contributions and their share of the arithmetic
    of one evaluation.

    **Arguments**

    - `scene`: the scene.
    - `names`: of the effects, in their order; by default those of their classes."""
    *effects, own = budget(scene)
    if names:
        effects = [row._replace(effect=name) for row, name in zip(effects, names, strict=True)]
    rows = [*effects, own]
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
