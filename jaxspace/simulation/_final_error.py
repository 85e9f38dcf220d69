"""The final error requested by a user, instead of a tolerance.

It complements `Accuracy`, which bounds the error of a step: the resulting error at the end depends
on the motion. `_to_final_error.py` finds the tolerance.
"""

import functools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, PyTree

from ..core import InputError
from ..core.checks import check_positive, is_concrete
from ..core.layout import run_axes_of
from ..core.printing import printed
from ..core.status import Status
from ..core.structure import HashedModule
from ..core.types import as_float
from ..integration.accuracy import DEFAULT, Accuracy, check_number
from .mission_result import Simulated
from .trajectory import Trajectory


class Measured(NamedTuple):
    """The compared quantities of a run: `values`, the error that each of them is `allowed`,
    (*runs,), whether the run is `good`, or steps `missed` its tolerance, (*runs,), whether it
    `jumps` at an event, (*runs,), and its `evaluations` of the vector field."""

    values: tuple[Array, ...]
    allowed: tuple[Array, ...]
    good: Bool[Array, "*runs"]
    missed: Bool[Array, "*runs"]
    jumps: Bool[Array, "*runs"]
    evaluations: Array


@final
@printed(relative="")
class FinalError(HashedModule):
    """The allowed error of a run at its end: `simulate(..., accuracy=FinalError(position=1.0))`.

    The verbs then repeat the run with smaller tolerances until the error estimated from the runs is
    below the requested one, and return the last run. Its `stats["final_error"]` is the estimate, in
    units of the requested error, `stats["final_error_evaluations"]` the evaluations of all runs,
    and `run.accuracy.rtol` the tolerance of the last. `stats["final_error_price"]` is the estimated
    factor on the evaluations of the last run for a tenth of its error. If the error cannot be
    reached the status is `FINAL_ERROR_MISSED`. The error of a closed form is its rounding error:
    the estimate is three times the change due to rounding of the initial state and of the times.

    **Arguments**

    - `relative`: of every block of the final state (position, velocity, mass, ...), relative to the
      largest length of this block at the save times, and a thousandth of its unit, as for a
      tolerance; or
    - `blocks`: by name, the error of a block in its unit: `position=1.0, velocity=1e-3`. Other
      blocks are not constrained. A block within another one has both names: `{"wheels.rate": 1e-3}`
      as keywords, `FinalError(**{...})`; or
    - `output`: a function of the trajectory that returns a number or a pytree of numbers, one for
      each run, such as an apogee height; together with
    - `within`: the allowed error of the `output`: one number for all, or a pytree with the same
      structure.
    - `accuracy`: method and limits of the steps, without `rtol` and `atol`, which are determined.

    **Raises** `InputError` for an error that is not positive, and unless exactly one of the three
    kinds of request is given."""

    relative: Float[Array | np.ndarray, ""] | None
    blocks: dict[str, Float[Array | np.ndarray, ""]]
    within: PyTree[Float[Array | np.ndarray, ""]]
    accuracy: Accuracy
    output: Callable[[Any], PyTree] | None = eqx.field(static=True)

    def __init__(
        self,
        relative: Float[ArrayLike, ""] | None = None,
        *,
        output: Callable[[Any], PyTree] | None = None,
        within: PyTree[Float[ArrayLike, ""]] = None,
        accuracy: Accuracy = DEFAULT,
        **blocks: Float[ArrayLike, ""],
    ):
        ways = [relative is not None, bool(blocks), output is not None]
        if sum(ways) != 1:
            raise InputError(
                "FinalError accepts exactly one kind of request: a relative error, "
                "FinalError(1e-9); errors of state blocks in their units, "
                f"FinalError(position=1.0); or an output with its error bound. {sum(ways)} are "
                "given."
            )
        # Not one of them by default: an output has no unit from which an error could follow.
        if (output is None) != (within is None):
            raise InputError("FinalError.output and FinalError.within must be given together.")
        if accuracy.rtol is not None or accuracy.atol is not None:
            raise InputError(
                "FinalError.accuracy sets a tolerance, which is derived from the requested error: "
                "specify only its method and limits."
            )
        self.relative = None if relative is None else _error("relative", relative)
        self.blocks = {name: _error(name, x) for name, x in blocks.items()}
        self.within = jax.tree.map(lambda x: _error("within", x), within)
        self.accuracy = accuracy
        self.output = output

    def measured(self, result: Simulated) -> Measured:
        """The compared quantities of a result. Raises `InputError` for a block that the state does
        not have."""
        last = result.phases[-1]
        axes = last.run_axes
        status = result.status
        ended = status <= Status.EVENT, status == Status.TOLERANCE_MISSED
        in_place = not all(phase.undisturbed for phase in result.phases)
        before = (phase.status == Status.EVENT for phase in result.phases[:-1])
        jumps = functools.reduce(jnp.logical_or, before, jnp.full_like(ended[0], in_place))
        counts = *ended, jumps, jnp.asarray(result.evaluations)
        if self.output is not None:
            values, form = jax.tree.flatten(self.output(result))
            within = jax.tree.leaves(self.within)
            if len(within) == 1:
                within = within * len(values)
            elif jax.tree.structure(self.within) != form:
                raise InputError(
                    f"FinalError.within is {self.within}: it must be one number, or a pytree with "
                    f"the structure of the output, {form}."
                )
            return _of_one_precision(values, within, *counts)
        finals = _named(result.final)
        if self.relative is not None:
            sizes = _sizes(result, last, axes).values()
            allowed = [jnp.asarray(self.relative, x.dtype) * (x + LEAST_SIZE) for x in sizes]
            return _of_one_precision(finals.values(), allowed, *counts)
        asked = {name: x for name in finals if (x := self._of_block(name)) is not None}
        self.check_blocks(result.final)
        return _of_one_precision([finals[name] for name in asked], asked.values(), *counts)

    def check_blocks(self, final: PyTree) -> None:
        """Raise `InputError` for an error of a block that the final state does not have."""
        known = list(_named(final))
        for name in self.blocks:
            if not any(_belongs(block, name) for block in known):
                raise InputError(
                    f"FinalError.{name} is given, and the final state has no such block: it has "
                    f"{', '.join(known)}.{InputError.hint(name, known)}"
                )

    def _of_block(self, block: str) -> Array | np.ndarray | None:
        found = [x for name, x in self.blocks.items() if _belongs(block, name)]
        return found[-1] if found else None

    def usual_tolerance(self, y0: PyTree, runs: tuple[int, ...] = ()) -> Array | np.ndarray | float:
        """The tolerance with which a motion that neither damps nor amplifies its errors would have
        this error; for each of the `runs` of a batch from its state."""
        if self.relative is not None:
            return self.relative
        axes = run_axes_of(y0, lambda x: min(x.ndim, 1)) if runs else jax.tree.map(lambda _: 0, y0)
        blocks = zip(_named(y0).items(), jax.tree.leaves(axes), strict=True)
        pairs = [(x, k, self._of_block(name)) for (name, x), k in blocks]
        asked = [(x, k, allowed) for x, k, allowed in pairs if allowed is not None]
        # With NumPy where the numbers are concrete: each operation would be a separate program.
        lib = np if all(is_concrete(x) and is_concrete(a) for x, _, a in asked) else jnp
        parts = []
        for x, k, allowed in asked:
            size = lib.max(lib.abs(x), axis=tuple(range(x.ndim - k)))
            # Of a block that starts at zero the size is not known.
            known = size > 0.0
            ratio = allowed / lib.where(known, size, 1.0)
            parts.append(lib.where(known, ratio, USUAL))
        # Of an output nothing is known before the first run.
        return functools.reduce(lib.minimum, parts) if parts else USUAL


# A block close to zero, in its unit: as for the steps.
LEAST_SIZE = 1e-3
# Of what nothing is known before the first run. A tighter one would cost loose errors more than it
# saves tight ones.
USUAL = 1e-7


def distance(a: Measured, b: Measured) -> Float[Array, "*runs"]:
    """The largest difference of two runs, for each run, in units of the allowed error."""
    axes = b.good.ndim

    def ratio(x: Array, y: Array, allowed: Array) -> Array:
        apart = x - y
        length = jnp.sqrt(jnp.sum(apart * apart, axis=tuple(range(apart.ndim - axes))))
        return length / allowed

    every = jnp.stack([ratio(*each) for each in zip(a.values, b.values, b.allowed, strict=True)])
    worst = jnp.max(every, axis=0)
    # Infinite and not NaN: the search compares it, and continues with smaller tolerances.
    return jnp.where(a.good & jnp.isfinite(worst), worst, jnp.inf)


def rounding(a: Measured) -> Float[Array, "*runs"]:
    """The rounding of the largest value, for each run, in units of the allowed error."""
    zero = a._replace(values=tuple(map(jnp.zeros_like, a.values)))
    return distance(a, zero) * jnp.finfo(a.values[0].dtype).eps


def _error(name: str, value: object) -> Array | np.ndarray:
    """A requested error, as an array; a NumPy array if it is concrete, also under `jit`."""
    check_number(f"FinalError.{name}", value)
    with jax.ensure_compile_time_eval():
        number = as_float(value)
    if number.ndim > 0:
        raise InputError(
            f"FinalError.{name} has the shape {number.shape}: it must be a scalar, common to all "
            "runs."
        )
    check_positive(f"FinalError.{name}", number)
    return np.asarray(number) if is_concrete(number) else number


def _of_one_precision(
    values: Iterable[Any],
    allowed: Iterable[Any],
    good: Bool[Array, "*runs"],
    missed: Bool[Array, "*runs"],
    jumps: Bool[Array, "*runs"],
    evaluations: Array,
) -> Measured:
    arrays = tuple(map(jnp.asarray, values))
    pairs = zip(allowed, arrays, strict=True)
    limits = tuple(jnp.asarray(a, x.dtype) for a, x in pairs)
    return Measured(arrays, limits, good, missed, jumps, evaluations)


def _named(state: PyTree) -> dict[str, Array]:
    """The blocks of a state by their names."""
    leaves = jax.tree_util.tree_flatten_with_path(state)[0]
    name = jax.tree_util.keystr
    return {name(path, simple=True, separator="."): x for path, x in leaves}


def _belongs(block: str, name: str) -> bool:
    """Whether a block has this name, or is part of one that has it."""
    # With the dot, because "wheels" is not a part of "wheels_left".
    return block == name or block.startswith(f"{name}.")


def _sizes(result: Simulated, last: Trajectory, axes: int) -> dict[str, Float[Array, "*runs"]]:
    """The largest length of each block of the final state at the save times of the last phase."""

    def largest(x: Array, kept: int) -> Array:
        length = jnp.sqrt(jnp.sum(x * x, axis=tuple(range(x.ndim - kept))))
        return jnp.max(length, axis=0) if kept > axes else length

    finals, on_the_way = _named(result.final), _named(last.states)
    sizes = {name: largest(x, axes) for name, x in finals.items()}
    # A jump at the end may leave other blocks, of which nothing was saved.
    if finals.keys() == on_the_way.keys():
        sizes = {n: jnp.maximum(x, largest(on_the_way[n], axes + 1)) for n, x in sizes.items()}
    return sizes
