"""The numbers of interest at the end of a run, for every run of a campaign.

An output is a declared function of a state (`jaxspace.core.output`) or the path of a number of the
state, `final.omega.2`, in which the name of a phase may stand for `final`."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..bodies import BodyState
from ..core import Quantity, State
from ..simulation import MissionResult
from ._catalog import OutputFunction, part_quantities, state_class
from ._checks import Parsed
from ._errors import hint, unknown, wrong
from ._kinds import Values
from ._objects import at
from ._units import in_unit, read_number

FINAL = "final"
NOMINAL = "nominal"
SPECIAL = ("y", "t", "body", "initial", NOMINAL)


class OutputSpec(NamedTuple):
    """One output: its `name`, where it is taken (`at`: the number of a phase, or -1 for the end),
    its `unit`, and how many of these one unit of SI is (`factor`).

    - `function` of a state, or `path` of a number of it.
    - `shared`: entries of the file for arguments of the function.
    - `required`: the least and the greatest value that is allowed, in `unit`; `None` for none."""

    name: str
    at: int
    unit: str
    factor: float
    function: OutputFunction | None
    path: tuple[str, ...]
    shared: tuple[tuple[str, str], ...]
    required: tuple[float | None, float | None] = (None, None)

    def arguments(self) -> tuple[str, ...]:
        """The names of the arguments of the function."""
        return () if self.function is None else arguments_of(self.function)


def arguments_of(function: Callable[..., object]) -> tuple[str, ...]:
    """The names of the arguments of a declared output."""
    return tuple(inspect.signature(function).parameters)


def needs_nominal(specs: tuple[OutputSpec, ...]) -> bool:
    """Whether one of the outputs compares with the nominal run."""
    return any(NOMINAL in spec.arguments() for spec in specs)


def read_outputs(
    file: Parsed, units: Mapping[str, str]
) -> tuple[tuple[OutputSpec, ...], list[str]]:
    """The outputs that [dispersion] asks for; or what is wrong. `units`: as the file writes them,
    by their unit in SI."""
    specs, errors = [], []
    for number, entry in enumerate(file.values["dispersion"]["outputs"]):
        key = f"dispersion.outputs.{number}"
        try:
            spec = read_output(key, entry, file, units)
        except ValueError as error:
            errors.append(str(error))
            continue
        # Two outputs of one name would overwrite each other in the store.
        if spec.name in {other.name for other in specs}:
            errors.append(wrong(f"{key}.name", spec.name, "another name: this one is taken"))
        specs.append(spec)
    return tuple(specs), errors


def read_output(key: str, entry: Values, file: Parsed, units: Mapping[str, str]) -> OutputSpec:
    """The output that an entry asks for. Raises `ValueError` with the whole sentence."""
    name, catalog = entry["output"], file.catalog.outputs
    places = _places(file)
    head, dot, rest = name.partition(".")
    # A path comes before a name, for no declared function has a dot in its name.
    if dot and head in places:
        at_phase, function, shared = places[head], None, ()
        path = tuple(rest.split("."))
        si = _unit_of_path(f"{key} = {name}", path, file)
    elif name in catalog:
        where = entry.get("at", FINAL)
        if where not in places:
            raise ValueError(unknown(f"{key}.at", where, places, "phase"))
        at_phase, function, path = places[where], catalog[name], ()
        si, shared = function.output.unit, tuple(function.output.shared.items())
        for error in _lacking(name, function, file):
            raise ValueError(error)
    else:
        expected = f"one of {', '.join(catalog)}, or a path such as final.position.0"
        raise ValueError(wrong(key, name, expected) + hint(name, catalog))
    # By default in the unit in which the author wrote quantities of this kind.
    unit = entry.get("unit", units.get(si, si))
    try:
        factor = in_unit(si, unit)
    except ValueError as error:
        raise ValueError(wrong(f"{key}.unit", unit, str(error))) from None
    shown_name = entry.get("name", name)
    low, high = (_limit(f"{key}.{k}", entry.get(k), si, factor) for k in ("at_least", "at_most"))
    return OutputSpec(shown_name, at_phase, unit, factor, function, path, shared, (low, high))


def _limit(key: str, value: object, si: str, factor: float) -> float | None:
    """A limit of an output in its unit. Raises `ValueError` with the whole sentence."""
    if value is None:
        return None
    try:
        return factor * read_number(value, Quantity(si, "limit"))[0]
    except ValueError as error:
        raise ValueError(wrong(key, value, str(error))) from None


def unit_of(spec: OutputSpec, file: Parsed) -> str:
    """The unit of an output in SI."""
    if spec.function is not None:
        return spec.function.output.unit
    return _unit_of_path(spec.name, spec.path, file)


def _places(file: Parsed) -> dict[str, int]:
    """The places at which an output can be taken: the end, or the end of a phase before its
    jump."""
    phases = file.values.get("phase", [])
    return {FINAL: -1, **{phase["name"]: k for k, phase in enumerate(phases)}}


def state_of(file: Parsed) -> type:
    """The class of the states of the file."""
    if file.kind != "system":
        return BodyState
    return state_class(file.catalog.systems[file.values["system"]["name"]])


def given_parts(file: Parsed) -> set[str]:
    """The parts of the states of a run of the file."""
    cls = state_of(file)
    if cls is not BodyState or "initial" in file.makers:
        parts = set(part_quantities(cls))
        # A system's own maker of states says nothing about the parts; a body's are those of it.
        return parts if cls is not BodyState else {"attitude", "omega"}
    losing = ("mass_rate" in file.catalog.effects[e].adds for e in file.active_effects())
    return file.parts() | ({"mass"} if any(losing) else set())


def _unit_of_path(key: str, path: tuple[str, ...], file: Parsed) -> str:
    declared, parts = part_quantities(state_of(file)), given_parts(file)
    if path[0] not in parts:
        raise ValueError(unknown(key, path[0], sorted(parts), "part of the state"))
    quantity = declared[path[0]]
    # The declaration of an attitude says that it is an object, and not how many numbers it has.
    shape = quantity.shape or ((4,) if path[0] == "attitude" else ())
    indices = path[1:]
    good = len(indices) == len(shape) and all(
        i.isdigit() and (n is None or int(i) < n) for i, n in zip(indices, shape, strict=True)
    )
    if not good:
        counts = " and ".join(f"0 to {n - 1}" for n in shape if n is not None)
        what = f"followed by {counts}" if shape else "without a number behind it"
        raise ValueError(f"{key}: {path[0]} must be {what}.")
    return quantity.unit


def _lacking(name: str, function: OutputFunction, file: Parsed) -> list[str]:
    """What an output needs and the file does not have."""
    parts, shared, found = given_parts(file), function.output.shared, []
    for argument in arguments_of(function):
        if argument in shared:
            if at(file.values, shared[argument]) is None:
                found.append(f"{shared[argument]} is missing: the output {name} needs it.")
        elif argument == "body" and file.kind == "system":
            found.append(f"A system has no body: the output {name} needs one.")
        elif argument not in SPECIAL and argument != "mass" and argument not in parts:
            found.append(f"initial has no {argument}: the output {name} needs it.")
    return found


def applicable_outputs(file: Parsed, units: Mapping[str, str]) -> tuple[OutputSpec, ...]:
    """Every output that the file has all for, of the end of the run alone."""
    found = []
    for name, function in file.catalog.outputs.items():
        # For the nominal run itself a comparison with the nominal run is zero, and says nothing.
        compares = {NOMINAL, "initial"} & set(arguments_of(function))
        if not compares and not _lacking(name, function, file):
            si = function.output.unit
            unit = units.get(si, si)
            shared = tuple(function.output.shared.items())
            found.append(OutputSpec(name, -1, unit, in_unit(si, unit), function, (), shared))
    return tuple(found)


class Outputs(eqx.Module):
    """The `outputs` of a campaign of the `file`: those of the `specs`.

    - `values`: the numbers of the file.
    - `reference`: the states of the nominal run by phase (-1: the end), with an axis of one run;
      `None` where no output compares with them."""

    # A `SceneFile`, whose module imports this one.
    file: Any = eqx.field(static=True)
    specs: tuple[OutputSpec, ...] = eqx.field(static=True)
    values: Values
    reference: dict[int, State] | None

    def __call__(self, result: MissionResult, samples: dict[str, Array]) -> dict[str, Array]:
        states, ends = {-1: result.final}, {-1: result.end}
        for spec in self.specs:
            # Only phases that are asked for: states of the others are not kept by the compiled
            # program.
            if spec.at >= 0:
                states[spec.at] = last_state(result.phases[spec.at].states)
                ends[spec.at] = result.phases[spec.at].ts[-1]
        return self.numbers(states, ends, samples)

    def numbers(
        self, states: dict[int, State], ends: dict[int, Array], samples: dict[str, Array]
    ) -> dict[str, Array]:
        """The outputs, each (runs,), from the states by phase and the times at their ends, s."""
        runs = jax.tree.leaves(states[-1])[0].shape[-1]
        found = {}
        for spec in self.specs:
            value = self._value(spec, states, ends, samples, runs)
            # An output of shared numbers alone has no runs, but a column of the store has.
            found[spec.name] = jnp.broadcast_to(spec.factor * value, (runs,))
        return found

    def _value(
        self,
        spec: OutputSpec,
        states: dict[int, State],
        ends: dict[int, Array],
        samples: dict[str, Array],
        runs: int,
    ) -> Array:
        y = states[spec.at]
        if spec.function is None:
            return at_path(y, spec.path)
        arguments, shared = {}, dict(spec.shared)
        for name in spec.arguments():
            if name in shared:
                arguments[name] = at(self.file.replaced(self.values, samples), shared[name])
            elif name == "y":
                arguments[name] = y
            elif name == "t":
                arguments[name] = ends[spec.at]
            elif name == "body":
                arguments[name] = self.file.body(self.values, samples, runs)
            elif name == "initial":
                arguments[name] = self.file.intended(self.values)
            elif name == NOMINAL:
                # Shapes are the same, and no output that compares is asked for without a
                # reference.
                arguments[name] = y if self.reference is None else self.reference[spec.at]
            else:
                arguments[name] = getattr(y, name)
        return spec.function(**arguments)


def last_state(states: State) -> State:
    """The state at the last of the times of a phase of a batch, runs last."""
    return jax.tree.map(lambda x: x[..., -1, :], states)


def at_path(y: State, path: tuple[str, ...]) -> Array:
    """A number of a state: the name of a part, then indices."""
    part = getattr(y, path[0])
    (array,) = jax.tree.leaves(part)
    for index in path[1:]:
        array = array[int(index)]
    return array
