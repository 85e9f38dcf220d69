"""Compiled programs in a folder, which later processes load instead of tracing and compiling.

JAX's cache of compiled programs spares the compiler alone: a program has to be traced and lowered
before it is looked up, which takes most of a second start. Here it is looked up by the key of its
function and its arguments (`_structure_key`), so that nothing is traced. The numbers of arguments
are not part of the key.
"""

import contextlib
import functools
import hashlib
import importlib.metadata
import io
import itertools
import os
import pickle
import re
import sys
import threading
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, final

import jax
import jax.numpy as jnp
from jax.core import Trace, Tracer, eval_context
from jax.experimental import serialize_executable
from jax.experimental.compilation_cache import compilation_cache
from jax.extend.core import get_opaque_trace_state, set_current_trace
from jaxtyping import PyTree

from ._structure_key import LIBRARIES, NoKey, identified, key_of, with_leaves
from ._structure_key import NAME_OF_USER as NAME_OF_USER
from .processors import cores
from .program_folder import ProgramFolder

# Arguments of a program, and `None` in place of those that are not arrays.
Arrays: TypeAlias = tuple[Any, ...]

# Settings that do not change a program.
_IRRELEVANT = re.compile(
    "jax_(enable_)?(compilation_cache|persistent_cache|raise_persistent|log|dump).*"
)
# Custom calls whose code is part of jaxlib: annotations, and LAPACK, which is set up when a
# program that calls it is lowered. All others may refer to objects of the process.
_CALLS = re.compile(r"custom_call\s+@(\w+)")
_LAPACK = "lapack_"
_ANNOTATIONS = frozenset(
    ("Sharding", "SPMDFullToShardShape", "SPMDShardToFullShape", "annotate_device_placement")
)

# Of the process, as the settings of JAX are.
_folder: ProgramFolder | None = None


def store_in(folder: ProgramFolder | None) -> None:
    """Store the programs that this process compiles from now on in a folder, or in none."""
    global _folder  # noqa: PLW0603
    _folder = folder


def is_storing(*, has_loop: bool = False) -> bool:
    """Whether programs are stored, and the code that calls this function is not being traced.

    `has_loop`: whether the program contains a loop, and is compiled also where operations outside
    of loops are computed without a compiler (`evaluates_operations`)."""
    if _folder is None:
        return False
    state = get_opaque_trace_state()
    if state != _UNTRACED and not (has_loop and any(state == each for each in _EVALUATING)):
        return False
    # A mesh of devices would be part of the program.
    return not jax.config.jax_disable_jit and jax.sharding.get_abstract_mesh().empty


def evaluates_operations(trace: Trace) -> None:
    """Declare that a trace computes operations at once, and compiles loops."""
    with set_current_trace(trace):
        _EVALUATING.append(get_opaque_trace_state())


with eval_context():
    _UNTRACED = get_opaque_trace_state()
_EVALUATING: list[object] = []


def _nothing() -> None:
    """Nobody waits."""


@final
class StoredProgram:
    """The programs of a function with some static arguments, for each of the shapes of its
    arrays.

    `parts`: all that they follow from but the arrays."""

    def __init__(self, name: str, parts: tuple[object, ...]):
        self.name, self.parts = re.sub(r"\W", "", name).strip("_"), parts
        self.loaded: dict[Hashable, Callable | None] = {}
        self.lock = threading.Lock()

    def find(
        self, program: jax.stages.Wrapped, arrays: Arrays, traced: Callable[[], object] = _nothing
    ) -> Callable | None:
        """The compiled program for such arrays: loaded from the folder, or compiled and stored.

        `None` where it has no key, or an array is traced.

        **Arguments**

        - `program`: the function under `jax.jit`.
        - `traced`: called where there is a program, as soon as only the compiler remains."""
        shapes = _shapes_of(arrays)
        if shapes is None:
            return None
        if shapes not in self.loaded:
            # Another thread with the same shapes waits for the program.
            with self.lock:
                if shapes not in self.loaded:
                    with eval_context():
                        found = self._look_up(program, arrays, shapes, traced)
                    self.loaded[shapes] = found
                    return found
        found = self.loaded[shapes]
        if found is not None:
            traced()
        return found

    @functools.cached_property
    def key(self) -> tuple[str, tuple[object, ...]] | None:
        """The key of the parts, and the functions and objects in them, in a fixed order."""
        try:
            return identified(*self.parts)
        except NoKey as reason:
            _REFUSED.append((self.name, str(reason)))
            return None

    def _look_up(
        self,
        program: jax.stages.Wrapped,
        arrays: Arrays,
        shapes: tuple,
        traced: Callable[[], object],
    ) -> Callable | None:
        folder, key = _folder, self.key
        if folder is None or key is None or jax.default_backend() != "cpu":
            return None
        structure, objects = key
        whole = hashlib.blake2b(digest_size=20)
        whole.update("\n".join((_environment(), structure, repr(shapes[0]), _settings())).encode())
        name = f"{self.name}-{whole.hexdigest()}"
        entry = folder.read(name)
        if entry is not None:
            try:
                found = _loaded(entry, arrays, objects)
            # Whatever a damaged or foreign entry raises.
            except Exception as error:  # noqa: BLE001
                folder.discard(name, error)
            else:
                traced()
                return found
        lowered = program.lower(arrays)
        traced()
        with _compilations() as events:
            compiled = lowered.compile()
        if folder.writes and _is_portable(lowered):
            fresh = compiled if events == [_COMPILED] else _compiled_anew(lowered)
            entry = _entry_of(lowered, fresh, objects)
            if entry is not None:
                folder.write(name, entry)
        return compiled


# The names of programs without a key, and the reasons.
_REFUSED: list[tuple[str, str]] = []


def refused() -> list[tuple[str, str]]:
    """The programs of this process that have no key, by name, and the reasons."""
    return list(_REFUSED)


class _Entry(NamedTuple):
    """A stored program.

    - `executable`: from `serialize_executable`.
    - `result`: its result with places in place of the arrays.
    - `devices`: the numbers of its devices.
    - `lapack`: whether it calls LAPACK."""

    executable: bytes
    result: bytes
    devices: tuple[int, ...]
    lapack: bool


def _is_portable(lowered: jax.stages.Lowered) -> bool:
    """Whether a program calls no functions of this process, such as callbacks."""
    return all(call in _ANNOTATIONS or call.startswith(_LAPACK) for call in _calls(lowered))


def _calls(lowered: jax.stages.Lowered) -> set[str]:
    return set(_CALLS.findall(lowered.as_text()))


def _compiled_anew(lowered: jax.stages.Lowered) -> jax.stages.Compiled | None:
    """The program from the compiler and not from JAX's cache: what is read from there lacks its
    functions when it is written again. `None` if it came from a cache all the same."""
    enabled = jax.config.jax_enable_compilation_cache
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    try:
        with _compilations() as events:
            # An option without an effect, because JAX remembers the program without options.
            compiled = lowered.compile(compiler_options={"xla_dump_max_hlo_modules": -1})
    finally:
        jax.config.update("jax_enable_compilation_cache", enabled)
        compilation_cache.reset_cache()
    return compiled if events == [_COMPILED] else None


@contextlib.contextmanager
def _compilations() -> Iterator[list[str]]:
    """The compilations within a context, and the programs that JAX's cache had."""
    events: list[str] = []
    _listen()
    _EVENTS.append((threading.get_ident(), events))
    try:
        yield events
    finally:
        _EVENTS.remove((threading.get_ident(), events))


_COMPILED, _READ = "/jax/core/compile/backend_compile_duration", "/jax/compilation_cache/cache_hits"
# The threads that wait for events of JAX, and the events of each.
_EVENTS: list[tuple[int, list[str]]] = []


@functools.cache
def _listen() -> None:
    def note(event: str, **details: str | int) -> None:
        del details
        if event in (_COMPILED, _READ):
            for thread, events in _EVENTS:
                if thread == threading.get_ident():
                    events.append(event)

    jax.monitoring.register_event_listener(note)
    jax.monitoring.register_event_duration_secs_listener(lambda event, *_, **__: note(event))


def _entry_of(
    lowered: jax.stages.Lowered, compiled: jax.stages.Compiled | None, objects: tuple[object, ...]
) -> bytes | None:
    """A compiled program as bytes; `None` for one that cannot be."""
    if compiled is None:
        return None
    tree, loaded = compiled.out_tree, compiled.runtime_executable()
    if loaded is None:
        return None
    try:
        executable, _, _ = serialize_executable.serialize(compiled)
        result = _pickled(with_leaves(tree, itertools.count()), objects)
        if jax.tree.structure(_unpickled(result, objects)) != tree:
            return None
    # JAX and classes of results raise errors of many types for what they cannot pickle.
    except Exception:  # noqa: BLE001
        return None
    lapack = any(call.startswith(_LAPACK) for call in _calls(lowered))
    devices = tuple(d.id for d in loaded.local_devices())
    return pickle.dumps(tuple(_Entry(executable, result, devices, lapack)))


def _loaded(entry: bytes, arrays: Arrays, objects: tuple[object, ...]) -> Callable:
    executable, result, numbers, lapack = pickle.loads(entry)
    if lapack:
        _set_up_lapack()
    devices = {d.id: d for d in jax.local_devices()}
    return serialize_executable.deserialize_and_load(
        executable,
        jax.tree.structure(((arrays,), {})),
        jax.tree.structure(_unpickled(result, objects)),
        execution_devices=[devices[number] for number in numbers],
    )


@functools.cache
def _set_up_lapack() -> None:
    """Have JAX look up the functions of LAPACK, as it does when it lowers one."""
    jax.jit(jnp.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), jnp.float32))


class _Pickler(pickle.Pickler):
    """Refers to functions and objects of the arguments by their numbers."""

    def __init__(self, file: io.BytesIO, objects: tuple[object, ...]):
        super().__init__(file)
        self.numbers = {id(x): number for number, x in enumerate(objects)}

    def persistent_id(self, x: object) -> int | None:
        return self.numbers.get(id(x))

    def reducer_override(self, x: object) -> object:
        if isinstance(x, jax.tree_util.PyTreeDef):
            # As a tree, because its own form does not keep markers of `equinox` by identity.
            return jax.tree.structure, (with_leaves(x, itertools.count()),)
        return NotImplemented


def _pickled(tree: PyTree, objects: tuple[object, ...]) -> bytes:
    file = io.BytesIO()
    _Pickler(file, objects).dump(tree)
    return file.getvalue()


class _Unpickler(pickle.Unpickler):
    def __init__(self, data: bytes, objects: tuple[object, ...]):
        super().__init__(io.BytesIO(data))
        self.objects = objects

    def persistent_load(self, number: int) -> object:
        return self.objects[number]


def _unpickled(data: bytes, objects: tuple[object, ...]) -> PyTree:
    return _Unpickler(data, objects).load()


def _shapes_of(arrays: Arrays) -> tuple[tuple, tuple] | None:
    """All that a program depends on besides its function and static arguments; `None` where an
    array is traced."""
    shapes: list[Hashable] = []
    for x in arrays:
        if x is None:
            continue
        if not isinstance(x, jax.Array):
            shapes.append((x.shape, x.dtype))
        elif isinstance(x, Tracer):
            return None
        else:
            # A setting determines the device of an array without a fixed one.
            place = x.sharding if x.committed else None
            shapes.append((x.shape, x.dtype, getattr(x, "weak_type", False), place))
    # All settings, because contexts may change those that matter.
    return tuple(shapes), tuple(jax.config.values.values())


def _settings() -> str:
    values = jax.config.values
    return repr([(name, str(x)) for name, x in values.items() if not _IRRELEVANT.fullmatch(name)])


@functools.cache
def _environment() -> str:
    """All that any program depends on besides its function, arguments and settings."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in LIBRARIES]
    flags = [f"{k}={x}" for k, x in sorted(os.environ.items()) if k.startswith(("XLA_", "LIBTPU"))]
    devices = [f"{d.platform} {d.device_kind} {d.id}" for d in jax.devices()]
    # The compiler divides work by the number of cores.
    process = [sys.version, str(sys.flags.optimize), str(cores())]
    return key_of([*versions, *flags, *devices, *process, _sources()])


def _sources() -> str:
    """A digest of the sources of the package, which differ between versions and in a clone."""
    digest = hashlib.blake2b(digest_size=20)
    root = Path(__file__).parents[1]
    for folder, folders, names in os.walk(root):
        folders.sort()
        for name in sorted(names):
            if name.endswith((".py", ".toml", ".json")):
                content = (Path(folder) / name).read_bytes()
                digest.update(f"{os.path.relpath(folder, root)}/{name} {len(content)}\n".encode())
                digest.update(content)
    return digest.hexdigest()
