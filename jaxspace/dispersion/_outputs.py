"""The outputs of a campaign: one real number for each run, by name, or the error message."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import InputError
from ..core.jit import quick_jit
from ..core.status import SimulationError
from ..simulation.mission_result import MissionTrajectory
from ._interface import OutputFunction
from ._isolation import RAISED, callbacks, reason
from .names import check_names


def outputs_of(
    function: OutputFunction,
    result: MissionTrajectory,
    samples: dict[str, Float[Array, " runs"]],
) -> dict[str, Float[Array, " runs"]]:
    """The outputs of runs by the `function` of their campaign, each (runs,).

    **Raises** `InputError` for anything but a dict of one real number for each run, or for all."""
    outputs = function(result, samples)
    if not isinstance(outputs, Mapping):
        raise InputError(
            f"Campaign.outputs returns {_kind(outputs)}: it must return a dict of outputs by name."
        )
    check_names("The outputs of the campaign", outputs)
    for name in set(outputs) & set(samples):
        raise InputError(
            f"The output {name!r} has the name of an input: it must have a different name."
        )
    runs = next(iter(samples.values())).shape
    return {name: _of_each_run(name, x, runs) for name, x in outputs.items()}


def _of_each_run(name: str, x: object, runs: tuple[int, ...]) -> Array:
    allowed = f"it must be one real number for each run, {runs}, or one for all, ()."
    if not eqx.is_array_like(x):
        raise InputError(f"The output {name!r} is {_kind(x)}: {allowed}")
    x = jnp.asarray(x)
    if not (jnp.issubdtype(x.dtype, jnp.number) or x.dtype == bool):
        raise InputError(f"The output {name!r} is of the type {x.dtype}: {allowed}")
    if jnp.issubdtype(x.dtype, jnp.complexfloating):
        raise InputError(f"The output {name!r} is complex: {allowed}")
    # An output that no input reaches is one number for all runs.
    if x.shape not in ((), (1,), runs):
        raise InputError(f"The output {name!r} has the shape {x.shape}: {allowed}")
    return jnp.broadcast_to(x, runs)


def _kind(x: object) -> str:
    if x is None or isinstance(x, str):
        return repr(x)
    return "an array" if eqx.is_array(x) else f"an object of type {type(x).__name__}"


def raised(
    what: str,
    function: OutputFunction,
    result: MissionTrajectory,
    samples: dict[str, Array],
    error: Exception,
) -> SimulationError:
    """The exception for runs in which the `function` of the outputs of a campaign raises an error.

    **Arguments**

    - `what`: the subject of the message.
    - `result`, `samples`: of these runs.
    - `error`: the error."""
    # One after the other, to find the one that raises.
    for name in eqx.filter_eval_shape(outputs_of, function, result, samples):
        try:
            with callbacks():
                jax.block_until_ready(_one(function, result, samples, name))
        except RAISED as own:
            return SimulationError(
                f"{what} cannot be evaluated: the output {name!r} raises an error ({reason(own)}) "
                "instead of returning a number."
            )
    return SimulationError(f"{what} cannot be evaluated: {reason(error)}.")


@quick_jit
def _one(
    function: OutputFunction, result: MissionTrajectory, samples: dict[str, Array], name: str
) -> Array:
    return outputs_of(function, result, samples)[name]
