"""Functions under `jit` with a low call overhead, of which only the most recent programs are
cached.

A function of a user (an event, an effect, a problem to minimise) is a static argument of a program:
each new one is compiled again, even if its code is the same. JAX caches the last 8192 programs, but
each requires about 10 MB and 150 memory maps, of which a process may have 65,530 on Linux. So those
of each function are limited here to the `KEPT` that were called last.
"""

import functools
from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeAlias, TypeVar, final

import equinox as eqx
import jax
import numpy as np
from jaxtyping import PyTree

from .stored import StoredProgram, is_storing

P = ParamSpec("P")
T = TypeVar("T")

CompilerOptions: TypeAlias = dict[str, Any]
Options: TypeAlias = dict[str, CompilerOptions]

# For programs that run a few times and take far longer to compile: it halves that time.
QUICK: Options = {"compiler_options": {"xla_backend_optimization_level": 0}}

KEPT = 32
"""Number of cached programs per function: at most 5,000 memory maps and 400 MB per verb, and more
than most scripts and notebooks use before they reuse one."""


@final
class _Program(Generic[T]):
    """A function under `jit` for one set of static arguments."""

    def __init__(
        self, function: Callable[..., T], static: tuple, options: Options, has_loop: bool = False
    ):
        self.has_loop = has_loop
        # Not methods, because a program that refers to itself is freed late.
        self.shapes: list[None] = []
        name = getattr(function, "__name__", type(function).__name__)
        self.stored = StoredProgram(name, (function, options, *static))
        self.make = functools.partial(_program, function, static, options, self.shapes)
        self.program = self.make()

    def __call__(self, arrays: tuple) -> T:
        # Each of the shapes of the arguments is another program of the compiler.
        if max(len(self.shapes), len(self.stored.loaded)) > KEPT:
            self.shapes.clear()
            self.stored.loaded.clear()
            self.program = self.make()
        storing = is_storing(has_loop=self.has_loop)
        program = self.stored.find(self.program, arrays) if storing else None
        arrays, rest = (program or self.program)(arrays)
        return eqx.combine(arrays, rest.value)

    def prepare(self, arrays: tuple, traced: Callable[[], object]) -> None:
        """Compile the program for such arrays, or load it."""
        if is_storing() and self.stored.find(self.program, arrays, traced) is not None:
            return
        lowered = self.program.lower(arrays)
        traced()
        lowered.compile()


def _program(
    function: Callable, static: tuple, options: Options, shapes: list[None]
) -> jax.stages.Wrapped:
    """The function of its arrays under `jit`, which adds an entry to `shapes` for each new one."""
    others, structure = static

    @functools.wraps(function)
    def program(arrays: tuple) -> tuple[PyTree, eqx.internal.Static]:
        shapes.append(None)
        leaves = [b if a is None else a for a, b in zip(arrays, others, strict=True)]
        args, kwargs = jax.tree.unflatten(structure, leaves)
        arrays, rest = eqx.partition(function(*args, **kwargs), eqx.is_array)
        return arrays, eqx.internal.Static(rest)

    # The names of arguments are those of the program, and not those of the function.
    del program.__wrapped__
    return jax.jit(program, **options)  # pyright: ignore[reportArgumentType]


def quick_jit(
    function: Callable[P, T], *, has_loop: bool = False, **options: CompilerOptions
) -> Callable[P, T]:
    """`equinox.filter_jit` of a function, in two thirds of its time, with its last `KEPT` programs.

    A short run takes less time than `equinox.filter_jit` needs to bind its arguments and to handle
    errors. Here an error is raised by a second call, which words it as `equinox` does.

    `has_loop`: whether the function always integrates, or has another loop, and so requires a
    compiler (`stored.is_storing`). `options`: the `compiler_options` of `jax.jit`.

    The result has a method `lower`, as that of `jax.jit` does, and a method
    `prepare(args, traced)`, which compiles the program for these arguments, or loads it, and calls
    `traced()` as soon as only the compiler remains."""

    @functools.lru_cache(maxsize=KEPT)
    def program_of(others: tuple, structure: PyTree) -> _Program[T]:
        return _Program(function, (others, structure), options, has_loop)

    def parts(args: tuple, kwargs: dict[str, PyTree]) -> tuple[_Program[T], tuple]:
        leaves, structure = jax.tree.flatten((args, kwargs))
        arrays = tuple(x if isinstance(x, jax.Array | np.ndarray) else None for x in leaves)
        others = tuple(None if isinstance(x, jax.Array | np.ndarray) else x for x in leaves)
        return program_of(others, structure), arrays

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        program, arrays = parts(args, kwargs)
        try:
            return program(arrays)
        except jax.errors.JaxRuntimeError:
            careful = eqx.filter_jit(function, **options)  # pyright: ignore[reportArgumentType]
            return careful(*args, **kwargs)

    def lower(*args: P.args, **kwargs: P.kwargs) -> jax.stages.Lowered:
        program, arrays = parts(args, kwargs)
        return program.program.lower(arrays)

    def prepare(args: tuple, traced: Callable[[], object]) -> None:
        program, arrays = parts(args, {})
        program.prepare(arrays, traced)

    call.prepare = prepare  # pyright: ignore[reportAttributeAccessIssue]
    call.lower = lower  # pyright: ignore[reportAttributeAccessIssue]
    return call


def jit_quickly(function: Callable[P, T]) -> Callable[P, T]:
    """The function under `quick_jit` with the options `QUICK`."""
    return quick_jit(function, has_loop=False, **QUICK)


# The programs of functions that are recreated for each use, by the options of the compiler.
_CALLS: dict[str, Callable] = {}


def compiled(function: Callable[P, T], **options: CompilerOptions) -> Callable[P, T]:
    """`quick_jit` of a function that is created for each use, like that of a user's problem: all of
    these functions together cache their last `KEPT` programs.

    The result is a tree, as is a function that is one: its arrays are arguments of the program,
    which other functions of the same structure then share."""
    call = _CALLS.setdefault(repr(options), quick_jit(_call, has_loop=False, **options))
    return eqx.Partial(call, function)


def _call(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    return function(*args, **kwargs)
