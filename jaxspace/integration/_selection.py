"""Which method `"auto"` stands for: that of the first rule which holds.

A method for second-order systems is taken only where the traced vector field shows that it may be:
the rate of the position is the velocity itself, and no operation leads from the velocity to its
rate. What an effect says of itself does not matter.

Whether a run is stiff is told by its numbers (`_stiffness.py`): where they are not known, under
`jit` or in a derivative, and for the phases of a mission, the rules of structure decide alone."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.extend
import jax.numpy as jnp
import numpy as np

from ..core import AbstractSystem
from ..solvers import DOP853, RKN1210, ExponentialRosenbrock, Tsit5
from ._stiffness import Starts, is_stiff

# above this tolerance the method of order 5 needs fewer evaluations than those of high order
LOOSE = 1e-5


class Question(NamedTuple):
    """For what a method is sought: a system, a state (or their shapes), the largest tolerance (zero
    where it is not known), and the runs whose numbers may be looked at."""

    system: AbstractSystem
    y: Any
    rtol: float
    starts: Starts | None


@final
class Rule(NamedTuple):
    """`when` in words, the test, and the method."""

    when: str
    holds: Callable[[Question], bool]
    method: diffrax.AbstractSolver | Literal["auto"]


def is_second_order(system: AbstractSystem, y: Any) -> bool:
    """Whether the state is a position and a velocity alone, and the acceleration provably free of
    the velocity."""
    if len(jax.tree.leaves(y)) != 2 or any(
        getattr(y, part, None) is None for part in ("position", "velocity")
    ):
        return False
    leaves, tree = jax.tree.flatten(jax.tree.map(shape, (system, y)))
    return _is_second_order(tree, tuple(leaves))


def shape(x: Any, without: int = 0) -> Any:
    """The shape of an array, without as many of its first axes; anything else as it is."""
    if not isinstance(x, jax.Array | np.ndarray):
        return x
    return jax.ShapeDtypeStruct(
        x.shape[without:], x.dtype, weak_type=getattr(x, "weak_type", False)
    )


@functools.lru_cache(maxsize=256)
def _is_second_order(tree: Any, leaves: tuple[Any, ...]) -> bool:
    shapes, rest = eqx.partition(
        jax.tree.unflatten(tree, leaves), lambda x: isinstance(x, jax.ShapeDtypeStruct)
    )

    def rates(arrays: Any, r: Any, v: Any) -> tuple[Any, Any]:
        system, y = eqx.combine(arrays, rest)
        rate = system.vector_field(
            jnp.zeros((), r.dtype), dataclasses.replace(y, position=r, velocity=v)
        )
        return rate.position, rate.velocity

    jaxpr = jax.make_jaxpr(rates)(shapes, shapes[1].position, shapes[1].velocity).jaxpr
    velocity = jaxpr.invars[-1]
    moved = {velocity}
    for operation in jaxpr.eqns:
        if any(x in moved for x in operation.invars if not isinstance(x, jax.extend.core.Literal)):
            moved.update(operation.outvars)
    travel, acceleration = jaxpr.outvars
    return travel is velocity and acceleration not in moved


def _is_fast_and_linear(q: Question) -> bool:
    return (
        q.starts is not None and not is_second_order(q.system, q.y) and is_stiff(q.starts, q.rtol)
    )


RULES = (
    Rule("the system has a closed form", lambda q: q.system.closed_form() is not None, "auto"),
    Rule(
        "slow beside a fast linear motion or decay, over more than 1e4 of its radians",
        _is_fast_and_linear,
        ExponentialRosenbrock(),
    ),
    Rule("the tolerance is above 1e-5", lambda q: q.rtol > LOOSE, Tsit5()),
    Rule(
        "r' = v, v' = a(t, r), and nothing else moves",
        lambda q: is_second_order(q.system, q.y),
        RKN1210(),
    ),
    Rule("else", lambda q: True, DOP853()),
)


def chosen_method(
    system: AbstractSystem, y: Any, rtol: float, ts: Any = None
) -> diffrax.AbstractSolver | Literal["auto"]:
    """The method for a system and a state (or their shapes) and a relative tolerance; `"auto"` is
    left where the closed form is meant. Only with the times `ts`, s, a stiff run is known as such.
    """
    return by_rules(system, y, rtol, None if ts is None else Starts.of(system, y, jnp.asarray(ts)))


def by_rules(
    system: AbstractSystem, y: Any, rtol: float, starts: Starts | None
) -> diffrax.AbstractSolver | Literal["auto"]:
    """`chosen_method` for one run or many, of which `starts` are some."""
    question = Question(system, y, rtol, starts)
    return next(rule.method for rule in RULES if rule.holds(question))
