"""Which method `"auto"` stands for: that of the first rule which holds.

A method for second-order systems is taken only where the traced vector field shows that it may be: the rate of the position is
the velocity itself, and no operation leads from the velocity to its rate. What an effect says of itself does not matter."""

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

from .._core import AbstractClosedFormSystem, AbstractSystem
from ..solvers import DOP853, RKN1210, Tsit5

LOOSE = 1e-5  # above this tolerance the method of order 5 needs fewer evaluations than those of high order


@final
class Rule(NamedTuple):
    """`when` in words, the test of a system, a state and the largest tolerance (zero where it is not known), and the method."""

    when: str
    holds: Callable[[AbstractSystem, Any, float], bool]
    method: diffrax.AbstractSolver | Literal["auto"]


def is_second_order(system: AbstractSystem, y: Any) -> bool:
    """Whether the state is a position and a velocity alone, and the acceleration provably free of the velocity."""
    if len(jax.tree.leaves(y)) != 2 or any(getattr(y, part, None) is None for part in ("position", "velocity")):
        return False
    leaves, tree = jax.tree.flatten(jax.tree.map(shape, (system, y)))
    return _is_second_order(tree, tuple(leaves))


def shape(x: Any, without: int = 0) -> Any:
    """The shape of an array, without as many of its first axes; anything else as it is."""
    if not isinstance(x, jax.Array | np.ndarray):
        return x
    return jax.ShapeDtypeStruct(x.shape[without:], x.dtype, weak_type=getattr(x, "weak_type", False))


@functools.lru_cache(maxsize=256)
def _is_second_order(tree: Any, leaves: tuple[Any, ...]) -> bool:
    shapes, rest = eqx.partition(jax.tree.unflatten(tree, leaves), lambda x: isinstance(x, jax.ShapeDtypeStruct))

    def rates(arrays: Any, r: Any, v: Any) -> tuple[Any, Any]:
        system, y = eqx.combine(arrays, rest)
        rate = system.vector_field(jnp.zeros((), r.dtype), dataclasses.replace(y, position=r, velocity=v))
        return rate.position, rate.velocity

    jaxpr = jax.make_jaxpr(rates)(shapes, shapes[1].position, shapes[1].velocity).jaxpr
    velocity = jaxpr.invars[-1]
    moved = {velocity}
    for operation in jaxpr.eqns:
        if any(x in moved for x in operation.invars if not isinstance(x, jax.extend.core.Literal)):
            moved.update(operation.outvars)
    travel, acceleration = jaxpr.outvars
    return travel is velocity and acceleration not in moved


RULES = (
    Rule("the system has a closed form", lambda system, y, rtol: isinstance(system, AbstractClosedFormSystem), "auto"),
    Rule("the tolerance is above 1e-5", lambda system, y, rtol: rtol > LOOSE, Tsit5()),
    Rule("r' = v, v' = a(t, r), and nothing else moves", lambda system, y, rtol: is_second_order(system, y), RKN1210()),
    Rule("else", lambda system, y, rtol: True, DOP853()),
)


def chosen_method(system: AbstractSystem, y: Any, rtol: float) -> diffrax.AbstractSolver | Literal["auto"]:
    """The method for a system and a state (or their shapes) and a relative tolerance; `"auto"` is left where the closed form is
    meant."""
    return next(rule.method for rule in RULES if rule.holds(system, y, rtol))
