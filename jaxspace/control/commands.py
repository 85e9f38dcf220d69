"""Systems under a command: by the fields `command` of their parts, or by a function."""

__all__ = ["with_command"]

import dataclasses
from collections.abc import Callable
from typing import TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import AbstractSystem, InputError, Scalar, State

Actuate: TypeAlias = Callable[[AbstractSystem, PyTree], AbstractSystem]


def _driven(x: object) -> bool:
    """Whether a part of a system is driven by a command."""
    return dataclasses.is_dataclass(x) and any(f.name == "command" for f in dataclasses.fields(x))


def _commands(system: PyTree) -> list[PyTree]:
    parts = jax.tree.leaves(system, is_leaf=_driven)
    return [part.command for part in parts if _driven(part)]


def with_command(system: AbstractSystem, command: PyTree) -> AbstractSystem:
    """The system under a command.

    **Arguments**

    - `system`: with one part or more that has a field `command`, such as `CommandedTorque`.
    - `command`: of the one part; of several a tuple, in their order.

    **Returns** the system with that command. **Raises** `InputError` if the system has no actuator,
    or a number of actuators other than that of the commands."""
    # Counted, so that a command of one part may itself be a tuple.
    result = len(_commands(system))
    given = list(command) if result > 1 and isinstance(command, tuple | list) else [command]
    if result == 0:
        raise InputError(
            f"{type(system).__name__} has no actuator: give it an effect such as CommandedTorque, "
            "or define with actuate=... how a command acts on it."
        )
    if result != len(given):
        raise InputError(
            f"The controller returned {len(given)} command for {result} actuators: it must return "
            f"a tuple of {result}."
        )
    return eqx.tree_at(_commands, system, given)


@final
class ZeroOrderHold(AbstractSystem):
    """A system between two samples, under a command that is constant or linear in time.

    `limit` bounds the linear command."""

    system: AbstractSystem
    actuate: Actuate = eqx.field(static=True)
    command: PyTree
    slope: PyTree
    since: Scalar
    limit: PyTree

    def at(self, t: Scalar) -> AbstractSystem:
        """The system under the command of the time `t`, s."""
        if self.slope is None:
            return self.actuate(self.system, self.command)
        passed = t - self.since
        line = jax.tree.map(lambda u, s: u + s * passed, self.command, self.slope)
        # The line may leave the limits between two samples.
        return self.actuate(self.system, clipped(line, self.limit))

    def vector_field(self, t: Scalar, y: State) -> State:
        return self.at(t).vector_field(t, y)

    def breaks(self) -> Array | None:
        return self.system.breaks()

    # A command does work: what the system conserves alone need not stay.
    def invariants(self, t: Scalar, y: State) -> dict[str, Array]:
        del t, y
        return {}


def clipped(command: PyTree, limit: PyTree) -> PyTree:
    """The command within plus and minus the `limit`; `None` means no limit."""
    if limit is None:
        return command
    return jax.tree.map(lambda u: jnp.clip(u, -limit, limit), command)


def rounded(command: PyTree, quantum: PyTree) -> PyTree:
    """The command rounded to whole quanta; `None` leaves it.

    It has the derivative of the command, because the derivative of rounding is zero or does not
    exist."""
    if quantum is None:
        return command

    def leaf(u: Array) -> Array:
        return u + jax.lax.stop_gradient(quantum * jnp.round(u / quantum) - u)

    return jax.tree.map(leaf, command)
