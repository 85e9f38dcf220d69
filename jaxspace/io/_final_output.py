"""An output of a scene file at the end of a run, as a function for studies of that run."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import InputError, Scalar, State, output
from ._output_entries import read_output
from ._output_spec import FINAL, OutputSpec
from ._outputs import Outputs
from ._parsed import Parsed
from .units import WrittenUnits


class FinalOutput(NamedTuple):
    """An output of the final state of a run.

    - `function`: of the state `y` and its time `t`, s; its unit is the one of the file.
    - `si`: the unit in SI; `factor`: how many units of the file that is."""

    function: Callable[..., Array]
    si: str
    factor: float


def spec_of_end(name: str, file: Parsed, units: WrittenUnits) -> OutputSpec:
    """The output of this name at the end of a run; as of `SceneFile.final_output`."""
    try:
        spec = read_output("output", {"output": name}, file, units)
    # The name is the caller's, and no error of the file.
    except ValueError as error:
        raise InputError(str(error)) from None
    if spec.at >= 0:
        raise InputError(f"output is {name}: it must be one of the final state.")
    return spec


def function_of(outputs: Outputs, spec: OutputSpec) -> Callable[..., Array]:
    """The function of the output of the `spec`, which is among the `outputs`, for one run."""

    def of_end(y: State, t: Scalar) -> Array:
        # Outputs take runs on the last axis, so that this is a batch of one run.
        y, t = jax.tree.map(lambda x: jnp.asarray(x)[..., None], (y, t))
        return outputs.numbers({-1: y}, {-1: t}, {})[spec.name][0]

    # Its label does not repeat that it is final.
    of_end.__name__ = spec.name.removeprefix(f"{FINAL}.")
    return output(spec.unit)(of_end)
