"""Keys of structures that are equal in every process: those of functions, classes and values.

A program depends on more than the shapes of its arguments: on the code of functions, on static
fields, and on what closures capture. A key covers all of it, or there is none (`NoKey`). Functions
and classes are identified by their names where the versions of their packages, which a caller adds
to the key, determine their code.
"""

import builtins
import dataclasses
import enum
import functools
import hashlib
import itertools
import struct
import sys
import types
import typing
from collections.abc import Iterable, Mapping, Sequence, Set
from pathlib import PurePath
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.sharding import Mesh
from jaxtyping import PyTree

# Packages whose version, or whose sources, are part of the key of the environment.
OWN = "jaxspace"
LIBRARIES = (
    *("jax", "jaxlib", "equinox", "diffrax", "lineax", "optax", "optimistix", "numpy", "scipy"),
    "jaxtyping",
)
# Modules that come with Python.
_OF_PYTHON = frozenset(sys.stdlib_module_names)
# Their instances have no state beyond their names.
_NAMED = (type, types.BuiltinFunctionType, np.ufunc, types.WrapperDescriptorType)
# The attribute of a function with the name that its user has given it (`jaxspace.stored_as`).
NAME_OF_USER = "__stored_as__"
# Of a function that a module wraps: they follow from its code.
_WORDS = frozenset(("__annotations__", "__doc__"))


class NoKey(Exception):
    """A structure cannot be identified in another process; the message names the part."""


@final
class Place:
    """Stands for an array that is an argument of a program."""


PLACE = Place()
_CONSTANTS = (None, Ellipsis, NotImplemented, dataclasses.MISSING, PLACE)


def key_of(*parts: object) -> str:
    """The key of some values, in hexadecimal digits.

    **Raises** `NoKey` where one of them contains a function or an object that is not identified by
    names and values: one of a user, for example."""
    return identified(*parts)[0]


def identified(*parts: object) -> tuple[str, tuple[object, ...]]:
    """The key of some values as `key_of`, and the functions and objects in them, in an order that
    is the same for equal keys."""
    writer = _Writer()
    try:
        for part in parts:
            writer.write(part)
    # A structure that contains itself in any other way than through a function.
    except RecursionError:
        raise NoKey("a structure that contains itself") from None
    return writer.digest.hexdigest(), tuple(x for _, x in writer.known.values())


class _Writer:
    """Writes values into a digest, so that different values never write the same bytes."""

    def __init__(self) -> None:
        self.digest = hashlib.blake2b(digest_size=20)
        # Numbers of the functions and objects that have been written, by their identity: code may
        # compare them by it, and they may refer to themselves. The objects are kept alive.
        self.known: dict[int, tuple[int, object]] = {}

    def text(self, *texts: str) -> None:
        for text in texts:
            data = text.encode("utf-8", "surrogatepass")
            self.digest.update(struct.pack("<q", len(data)) + data)

    def write(self, x: object) -> None:
        """One value with its type."""
        if any(x is constant for constant in _CONSTANTS):
            self.text("constant", type(x).__name__)
        elif type(x) in (bool, int, float, complex, str, bytes):
            # The shortest text that returns the same number, and the sign of zero.
            self.text(type(x).__name__, repr(x))
        elif isinstance(x, Tracer):
            raise NoKey("a traced number outside of the arguments")
        elif isinstance(x, enum.Enum):
            self.name("enum", type(x))
            self.text(x.name or repr(x.value))
        elif isinstance(x, _NAMED):
            self.name("name", x)
        elif isinstance(x, np.ndarray | np.generic | jax.Array):
            self.numbers(x)
        elif isinstance(x, PurePath):
            self.name("path", type(x))
            self.text(str(x))
        elif isinstance(x, np.dtype):
            self.text("dtype", repr(x))
        elif isinstance(x, jax.ShapeDtypeStruct):
            self.text("shape", repr((x.shape, str(x.dtype), x.weak_type, x.sharding)))
        elif isinstance(x, Mesh | jax.Device):
            self.devices(x)
        else:
            self.structure(x)

    def structure(self, x: object) -> None:
        """A value that contains others."""
        if isinstance(x, slice):
            self.sequence("slice", (x.start, x.stop, x.step))
        elif type(x) in (tuple, list):
            self.sequence(type(x).__name__, x)  # pyright: ignore[reportArgumentType]
        elif isinstance(x, tuple) and hasattr(x, "_fields"):
            self.name("named tuple", type(x))
            self.sequence("fields", x)
        elif isinstance(x, Mapping) and type(x) in (dict, types.MappingProxyType):
            # In their order, which a function may follow.
            self.sequence("dict", [item for pair in x.items() for item in pair])
        elif isinstance(x, Set) and type(x) in (set, frozenset):
            self.text("set", type(x).__name__, *sorted(key_of(item) for item in x), "end")
        elif isinstance(x, types.ModuleType):
            self.module(x.__name__)
            self.text("module", x.__name__)
        elif isinstance(x, types.UnionType | types.GenericAlias):
            self.sequence("annotation", (typing.get_origin(x), *typing.get_args(x)))
        elif isinstance(x, types.CodeType):
            self.code(x)
        elif isinstance(x, jax.tree_util.PyTreeDef):
            self.text("treedef")
            self.write(with_leaves(x, itertools.repeat(PLACE)))
        elif id(x) in self.known:
            self.text("again", str(self.known[id(x)][0]))
        else:
            # Modules are values, which a transformation creates again.
            if not isinstance(x, eqx.Module):
                self.known[id(x)] = (len(self.known), x)
            self.described(x)

    def described(self, x: object) -> None:
        """A function, or an object of a class of the packages."""
        if isinstance(x, types.FunctionType):
            self.function(x)
        elif isinstance(x, types.MethodType):
            owner, name = x.__self__, getattr(x, "__name__", "")
            # A class method follows from its class, as that follows from its name.
            own = isinstance(owner, type) and getattr(owner, name, None) == x
            self.sequence("method", (name if own else x.__func__, owner))
        elif isinstance(x, functools.partial) and not isinstance(x, jax.tree_util.Partial):
            self.sequence("partial", (x.func, x.args, x.keywords))
        elif isinstance(x, jax.tree_util.Partial):
            self.name("partial", type(x))
            self.sequence("parts", (x.func, x.args, x.keywords))
        elif self.is_named(x):
            self.name("object", x)
        elif isinstance(x, functools._lru_cache_wrapper):
            # What it remembers, its function returns as well.
            self.sequence("cached", (x.__wrapped__,))
        elif isinstance(x, eqx.Module):
            self.name("module", type(x))
            self.items({k: value for k, value in vars(x).items() if k not in _WORDS})
        elif dataclasses.is_dataclass(x) and not isinstance(x, type):
            # Other fields of a class of the package follow from those that are compared: programs
            # within a process are reused by the same comparison.
            self.name("dataclass", type(x))
            own = _root(type(x).__module__) == OWN
            fields = [f.name for f in dataclasses.fields(x) if f.compare or not own]
            self.items({name: getattr(x, name) for name in fields})
        else:
            self.instance(x)

    def instance(self, x: object) -> None:
        """An object by its class and its state."""
        kind = type(x)
        self.name("instance", kind)
        # Objects of Python itself, such as files and locks, have a state outside of Python.
        if _root(kind.__module__) in _OF_PYTHON:
            raise NoKey(f"an object of {kind.__module__}.{kind.__qualname__}")
        if (kind.__reduce__, kind.__reduce_ex__) != (object.__reduce__, object.__reduce_ex__):
            raise NoKey(f"an object of {kind.__module__}.{kind.__qualname__}")
        try:
            # Refuses objects whose state is not in their attributes.
            made = object.__reduce_ex__(x, 2)
        except TypeError:
            raise NoKey(f"an object of {kind.__module__}.{kind.__qualname__}") from None
        assert isinstance(made, tuple)
        self.sequence("state", [*made[1:3], *(list(part or ()) for part in made[3:5])])

    def function(self, x: types.FunctionType) -> None:
        """A Python function: by its name, or by its code and what it captures."""
        if self.is_named(x):
            self.name("function", x)
            return
        # Not `__module__`, which a decorator copies from the function that it wraps.
        home = x.__globals__.get("__name__", "")
        # Its user answers for all that a function with a name refers to.
        if NAME_OF_USER not in vars(x):
            self.module(home)
            if getattr(sys.modules.get(home), "__dict__", None) is not x.__globals__:
                raise NoKey(f"the function {x.__qualname__} of another {home}")
        self.text("code", home, x.__qualname__)
        self.code(x.__code__)
        self.sequence("defaults", (x.__defaults__, x.__kwdefaults__))
        cells = [_content(cell) for cell in x.__closure__ or ()]
        self.sequence("cells", cells)
        self.items(vars(x))

    def code(self, x: types.CodeType) -> None:
        self.text("code", x.co_qualname, str(x.co_firstlineno), str(x.co_flags), repr(x.co_code))
        self.text(repr((x.co_names, x.co_varnames, x.co_freevars, x.co_cellvars)))
        self.text(repr((x.co_argcount, x.co_posonlyargcount, x.co_kwonlyargcount)))
        self.sequence("constants", x.co_consts)

    def numbers(self, x: np.ndarray | np.generic | jax.Array) -> None:
        """An array that is not an argument: a constant of the program."""
        if jnp.issubdtype(x.dtype, jax.dtypes.extended):
            raise NoKey("a random key outside of the arguments")
        if x.dtype.hasobject:
            raise NoKey("an array of objects")
        self.text("array", str(isinstance(x, jax.Array)), str(x.dtype), str(x.shape))
        self.text(str(getattr(x, "weak_type", False)))
        if isinstance(x, jax.Array) and not x.is_fully_addressable:
            raise NoKey("an array of other processes")
        self.digest.update(np.ascontiguousarray(x).tobytes())

    def devices(self, x: Mesh | jax.Device) -> None:
        if isinstance(x, Mesh):
            self.text("mesh", repr((x.axis_names, x.axis_types, x.devices.shape)))
            self.sequence("devices", list(x.devices.flat))
        else:
            self.text("device", x.platform, x.device_kind, str(x.id), str(x.process_index))

    def sequence(self, kind: str, items: Iterable[object]) -> None:
        items = list(items)
        self.text(kind, str(len(items)))
        for item in items:
            self.write(item)

    def items(self, values: Mapping[str, object]) -> None:
        self.text("items", str(len(values)))
        for name in sorted(values):
            self.text(name)
            self.write(values[name])

    def is_named(self, x: object) -> bool:
        """Whether a name in a module of the packages refers to `x`."""
        home, name = getattr(x, "__module__", None), getattr(x, "__qualname__", None)
        if not isinstance(home, str) or not isinstance(name, str) or not _is_known(home):
            return False
        return _looked_up(home, name) is x

    def name(self, kind: str, x: object) -> None:
        """A class, a function or an object of a module of the packages, by its name."""
        home = getattr(x, "__module__", None)
        name = getattr(x, "__qualname__", getattr(x, "__name__", None))
        if home is None and isinstance(x, np.ufunc):
            home = "numpy"
        # Such as the type of `None`, which has another name there.
        if home == "builtins" and getattr(types, str(name), None) is x:
            home = "types"
        # Methods of built-in types have no module.
        if home is None and getattr(builtins, str(name), None) is x:
            home = "builtins"
        if not isinstance(home, str) or not isinstance(name, str):
            raise NoKey(f"an object of {type(x).__module__}.{type(x).__qualname__}")
        self.module(home)
        if _looked_up(home, name) is not x:
            raise NoKey(f"{home}.{name}, which is defined within a function")
        self.text(kind, home, name)

    def module(self, name: str) -> None:
        if not _is_known(name):
            raise NoKey(f"code of the module {name}")


def with_leaves(structure: jax.tree_util.PyTreeDef, leaves: Iterable[object]) -> PyTree:
    """The tree of a structure with the first of these leaves."""
    return jax.tree.unflatten(structure, itertools.islice(leaves, structure.num_leaves))


def _is_known(module: str) -> bool:
    root = _root(module)
    # What a user runs is called __main__, which is one of the modules of Python.
    return root == OWN or root in LIBRARIES or (root in _OF_PYTHON and root != "__main__")


def _root(module: str) -> str:
    return module.partition(".")[0]


def _looked_up(module: str, name: str) -> object:
    """The object of this name in a module that has been imported, or `None`."""
    found: object = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    return found


def _content(cell: types.CellType) -> Sequence[object]:
    """The content of a variable, or nothing where it has none yet."""
    try:
        return (cell.cell_contents,)
    except ValueError:
        return ()
