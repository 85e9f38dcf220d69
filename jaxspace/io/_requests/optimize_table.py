"""The table [optimize] of a file: objective, design variables and constraints.

[optimize]
maximise = "final.mass"                         or minimise; an output as in [dispersion]
[optimize.free]
"initial.velocity.0" = { low = "1 km/s", high = "3 km/s" }
"effects.steered_thrust.steering.angles.*" = { low = "0 deg", high = "90 deg" }
[[optimize.constraint]]
output = "periapsis_altitude"
at_least = "185 km"                             or at_most, or equal

optimiser = "adam", rate = 0.02, max_steps = 2000 search by Adam of optax, whose rate falls to a
thousandth over these steps. `circular_orbit = "300 km"` is short for the three constraints of a
circular orbit of that altitude.

over = "dispersion"                             the runs of [dispersion], and not the nominal one
minimise = { output = "propellant", take = "99 %" }         what 99 % of them stay below; else the
                                                            mean (`run_statistics.py`)
[[optimize.constraint]]
output = "speed"
at_most = "6 m/s"
share = "99 %"                                  in 99 % of them; or `take`, as in the objective
"""

from collections.abc import Mapping
from fnmatch import fnmatchcase
from typing import NamedTuple

from ...core import argument
from ...optimization.optimisers import NAMES, named_optimiser
from .._kinds.errors import hint, missing, shown, unknown, wrong
from .._kinds.kind import Entry, Kind, Reading, Schema, Value
from .._kinds.tables import AnyTable, Table
from .._kinds.values import ListOf, Measure, Number, OneName, Whole
from .._mission.building import at
from .._mission.parsed import Parsed
from ..units import WrittenUnits, in_unit, read_number
from .inputs import measures
from .output_entries import read_output, read_share, unit_of
from .output_spec import BEGAN, INITIAL, NOMINAL, OutputSpec, needs
from .run_statistics import QUANTILE, RunStatistic, read_statistic, split_take

GOALS = ("minimise", "maximise")
SHARE, TAKE = "share", "take"
OUTPUT = ("output", "at", TAKE, "unit", "name")
OF_RUNS = "of_runs"
"""The statistic over the runs, in addition to the extreme along each of them, in an entry that was
read."""
NOMINAL_RUN, DISPERSION = OVER = ("nominal", "dispersion")
LIMITS = ("equal", "at_least", "at_most")
OWN_TABLES = ("dispersion", "optimize")
RATE = Number(argument("", positive=True, fixed=True, doc="rate"))
MAY_FAIL = Number(argument("", low=0.0, high=0.5, fixed=True, doc="share of the runs"))
ALTITUDE = Number(argument("m", fixed=True, doc="altitude"))


class Free(NamedTuple):
    """A design variable of the file: its path, value, bounds, scale and unit."""

    path: str
    start: Measure
    low: float
    high: float
    scale: float | None
    unit: str
    factor: float


class Demand(NamedTuple):
    """A constraint: the output, its kind (one of `LIMITS`), the target in SI units, and the
    statistic over the runs; `None` for the mean."""

    spec: OutputSpec
    limit: str
    target: float
    of_runs: RunStatistic | None = None


class Task(NamedTuple):
    """The content of [optimize]; `sign` is -1 for a maximum.

    - `dispersed`: whether it applies to the runs of [dispersion].
    - `of_runs`: the statistic of the objective over them; `None` for the mean."""

    objective: OutputSpec
    sign: float
    free: tuple[Free, ...]
    demands: tuple[Demand, ...]
    dispersed: bool = False
    of_runs: RunStatistic | None = None


class OneOutput(Kind):
    """The name of an output, or a table of it, as in a list of outputs."""

    def __init__(self, outputs: Kind, more: tuple[str, ...] = ()):
        self.outputs, self.more = outputs, more
        # Of the objective no share of the runs is required.
        self.options = (*more, SHARE) if more else ()

    def read(self, value: object, path: str, reading: Reading) -> Value:
        options: dict[str, Value] = {}
        if isinstance(value, Mapping):
            options = {key: value[key] for key in self.options if key in value}
            known = (*OUTPUT, *self.options)
            # Outputs of a campaign have more keys, which are irrelevant here.
            reading.errors += [
                unknown(f"{path}.{key}", key, known) for key in value if key not in known
            ]
            value = {key: x for key, x in value.items() if key in OUTPUT}
            if self.more and not set(options) & set(self.more):
                reading.errors.append(missing(path, f"one of {', '.join(self.more)}"))
            along, of_runs = split_take(value.pop(TAKE, None))
            value |= {} if along is None else {TAKE: along}
            options |= {} if of_runs is None else {OF_RUNS: of_runs}
        trial = Reading()
        read = self.outputs.read([value], path, trial)
        # A list of this one entry, whose number is not in the file.
        reading.errors += [line.replace(f"{path}.0", path, 1) for line in trial.errors]
        return {**read[0], **options} if read else None

    def expected(self) -> str:
        return self.outputs.expected()

    def schema(self) -> Schema:
        one = self.outputs.schema()["items"]
        assert isinstance(one, dict)
        name, table = one["anyOf"]
        limits = {key: {"type": ["number", "string"]} for key in self.options}
        text = {"type": "string"}
        # Along each run, and then over the runs.
        both = {"type": "array", "items": text, "minItems": 2, "maxItems": 2}
        own = {**limits, TAKE: {"anyOf": [text, both]}}
        properties = {key: table["properties"][key] for key in OUTPUT}
        table = {**table, "properties": {**properties, **own}}
        return table if self.more else {"anyOf": [name, table]}


def optimize_table(outputs: Kind, tolerance: Number) -> Table:
    """The form of the table; `outputs`: the kind of a list of outputs."""
    goal = OneOutput(outputs)
    return Table(
        {
            "minimise": Entry(
                goal, None, doc="the output to minimise; take: statistic over the runs"
            ),
            "maximise": Entry(goal, None, doc="the output to maximise; take: likewise"),
            "over": Entry(
                OneName(OVER), NOMINAL_RUN, doc="scope: the nominal run or the runs of [dispersion]"
            ),
            # As many as the shares need.
            "runs": Entry(Whole(), None, doc="number of runs of [dispersion] used by the search"),
            "may_fail": Entry(
                MAY_FAIL, 0.0, doc="share of these runs that may fail and are left out"
            ),
            "free": Entry(
                AnyTable(), doc="design variables by path, each with low, high and scale"
            ),
            "constraint": Entry(
                ListOf(OneOutput(outputs, LIMITS)),
                (),
                doc="constraints on outputs: equal, at_least, ...",
            ),
            "circular_orbit": Entry(
                ALTITUDE, None, doc="altitude of a circular orbit in which the mission ends"
            ),
            # The intervals between the breaks of a phase share its steps.
            "steps": Entry(Whole(), 40, doc="number of integration steps of each phase"),
            "tolerance": Entry(
                tolerance, 1e-6, doc="of the scaled gradient and constraint violation"
            ),
            "max_steps": Entry(Whole(), 200, doc="maximum number of search steps"),
            "optimiser": Entry(
                OneName(NAMES),
                NAMES[0],
                doc="sequential quadratic programming, or an optimiser of optax",
            ),
            # It falls to a thousandth over max_steps.
            "rate": Entry(
                RATE,
                None,
                doc="initial step length, in units of the scales of the design variables",
            ),
        }
    )


def read_task(file: Parsed, units: WrittenUnits) -> tuple[Task | None, list[str]]:
    """The request of the table, or its errors."""
    table = file.values["optimize"]
    errors = []
    goals = [goal for goal in GOALS if table[goal] is not None]
    if len(goals) != 1:
        return None, ["optimize must have exactly one of minimise and maximise."]
    try:
        named_optimiser(table["optimiser"], table["rate"], table["max_steps"])
    except ValueError as error:
        errors.append(f"optimize.{error}")
    # Errors are collected, so that one check of a file names every mistake.
    objective = None
    demands = []
    try:
        objective = _output(f"optimize.{goals[0]}", table[goals[0]], file, units)
    except ValueError as error:
        errors.append(str(error))
    for number, entry in enumerate(table["constraint"]):
        try:
            demands += _demands(f"optimize.constraint.{number}", entry, file, units)
        except ValueError as error:
            errors.append(str(error))
    try:
        demands += _circle(file, units)
    except ValueError as error:
        errors.append(str(error))
    free, more = _free(table["free"], file, units)
    errors += more
    of_runs = None
    try:
        if objective is not None:
            of_runs = _of_runs(f"optimize.{goals[0]}", table[goals[0]], objective, file)
    except ValueError as error:
        errors.append(str(error))
    if errors or objective is None:
        return None, errors
    sign = -1.0 if goals[0] == "maximise" else 1.0
    dispersed = table["over"] == DISPERSION
    task = Task(objective, sign, free, tuple(demands), dispersed, of_runs)
    return task, _over_errors(task, goals[0], file)


def _over_errors(task: Task, goal: str, file: Parsed) -> list[str]:
    """Errors of entries incompatible with the runs of the task."""
    if not task.dispersed:
        table = file.values["optimize"]
        entries = {f"optimize.{goal}": table[goal]}
        entries |= {f"optimize.constraint.{k}": x for k, x in enumerate(table["constraint"])}
        return [
            f"{key}.{name} is {shown(entry[own])}, over the runs, which requires optimize.over = "
            f'"{DISPERSION}".'
            for key, entry in entries.items()
            for name, own in ((SHARE, SHARE), (TAKE, OF_RUNS))
            if own in entry
        ]
    if file.values["dispersion"] is None:
        return [missing("dispersion", "a table with inputs, over whose runs optimize searches")]
    return [
        f"optimize.constraint of {d.spec.name} is equal: over dispersion it must be at_least or "
        f"at_most."
        for d in task.demands
        if d.limit == "equal"
    ]


def dispersed_and_free(task: Task, inputs: Mapping[str, object]) -> list[str]:
    """Free numbers of a task over [dispersion] that are among its `inputs`, a sentence each."""
    return [
        f"optimize.free.{free.path} is also an input of dispersion: a number cannot be both a "
        "design variable and random."
        for free in task.free
        if task.dispersed and free.path in inputs
    ]


def _output(key: str, entry: Value, file: Parsed, units: WrittenUnits) -> OutputSpec:
    # The same keys would be requirements of an output of a campaign.
    values = {k: x for k, x in entry.items() if k not in (*LIMITS, SHARE, OF_RUNS)}
    spec = read_output(key, values, file, units)
    if needs((spec,), NOMINAL) or needs((spec,), INITIAL):
        raise ValueError(f"{key} depends on the nominal run, which the search changes.")
    if needs((spec,), BEGAN):
        raise ValueError(
            f"{key} depends on the start of its phase, which is not available to a search."
        )
    return spec


def _of_runs(key: str, entry: Value, spec: OutputSpec, file: Parsed) -> RunStatistic | None:
    """The statistic of an output over the runs. Raises `ValueError` with the complete message."""
    share = read_share(f"{key}.{SHARE}", entry.get(SHARE))
    if OF_RUNS not in entry:
        return None if share is None else RunStatistic(QUANTILE, share)
    if share is not None:
        raise ValueError(
            f"{key}.{SHARE} is {shown(entry[SHARE])} and {key}.{TAKE} is {shown(entry[OF_RUNS])}: "
            f"over the runs it must have only one of them."
        )
    return read_statistic(f"{key}.{TAKE}", entry[OF_RUNS], spec, file)


def _demands(key: str, entry: Value, file: Parsed, units: WrittenUnits) -> list[Demand]:
    spec = _output(key, entry, file, units)
    of_runs = _of_runs(key, entry, spec, file)
    result = []
    for limit in LIMITS:
        if limit in entry:
            target = _target(f"{key}.{limit}", entry[limit], spec, of_runs, file)
            result.append(Demand(spec, limit, target, of_runs))
    return result


def _target(
    key: str, value: Value, spec: OutputSpec, of_runs: RunStatistic | None, file: Parsed
) -> float:
    """The target of a constraint, SI. Raises `ValueError` with the complete message."""
    if of_runs is not None and of_runs.is_share:
        share = read_share(key, value)
        assert share is not None
        return share
    try:
        return read_number(value, argument(unit_of(spec, file), doc="target"))[0]
    except ValueError as error:
        raise ValueError(wrong(key, value, str(error))) from None


def _circle(file: Parsed, units: WrittenUnits) -> list[Demand]:
    """The constraints of a circular orbit at the end, where the table asks for one."""
    height = file.values["optimize"]["circular_orbit"]
    if height is None:
        return []
    key = "optimize.circular_orbit"
    radius = at(file.values, "planet.radius")
    if radius is None:
        raise ValueError(missing("planet.radius", f"a length, to which {key} refers"))
    targets = {"altitude": height, "radial_speed": 0.0, "semi_major_axis": radius + height}
    entries = [{"output": name, "equal": float(x)} for name, x in targets.items()]
    return [demand for entry in entries for demand in _demands(key, entry, file, units)]


def _free(
    entries: Mapping[str, Value], file: Parsed, units: WrittenUnits
) -> tuple[tuple[Free, ...], list[str]]:
    """The design variables, or their errors; a `*` in a path matches any of its steps."""
    # Settings of the search, or of a campaign, cannot be free.
    numbers = {p: m for p, m in measures(file.values) if p.split(".")[0] not in OWN_TABLES}
    result: dict[str, Free] = {}
    errors = []
    for pattern, entry in entries.items():
        key = f"optimize.free.{pattern}"
        paths = [p for p in numbers if fnmatchcase(p, pattern)]
        if not paths:
            errors.append(f"{key} is not a number of this file.{hint(pattern, numbers)}")
        elif not isinstance(entry, Mapping):
            errors.append(wrong(key, entry, "a table, such as { low = ..., high = ... }"))
        else:
            errors += [
                unknown(f"{key}.{k}", k, ("low", "high", "scale"))
                for k in entry
                if k not in ("low", "high", "scale")
            ]
            for path in paths:
                try:
                    result[path] = _one_free(key, path, entry, numbers[path], units)
                except ValueError as error:
                    errors.append(str(error))
    if not result and not errors:
        errors.append(missing("optimize.free", "a table whose keys are paths of numbers"))
    # Once each: a pattern with a star gives the same sentence for many paths.
    return tuple(result.values()), list(dict.fromkeys(errors))


def _one_free(
    key: str, path: str, entry: Mapping[str, Value], start: Measure, units: WrittenUnits
) -> Free:
    """A design variable. Raises `ValueError` with the complete message."""
    quantity = start.quantity

    def read(name: str, default: float | None) -> float | None:
        if name not in entry:
            return default
        try:
            # A bound may be a limit of the allowed range, a size is any number.
            wide = quantity._replace(strict=False)
            if name == "scale":
                wide = argument(quantity.unit, positive=True, doc="size")
            return read_number(entry[name], wide)[0]
        except ValueError as error:
            raise ValueError(wrong(f"{key}.{name}", entry[name], str(error))) from None

    # Without a bound in the file, the limit of the class is the bound.
    low, high = read("low", quantity.low), read("high", quantity.high)
    assert low is not None and high is not None
    if not low < high:
        raise ValueError(f"{key}.low is {low:g} and high is {high:g}: low must be below high.")
    if not low <= start <= high:
        raise ValueError(
            f"{key}: {path} is {float(start):g} {quantity.unit}, which is the start of the search: "
            f"it must be between {low:g} and {high:g}."
        )
    # For the report: the unit of this number in the file, or of others of its kind.
    unit = start.unit or units.of(path, quantity.unit)
    return Free(path, start, low, high, read("scale", None), unit, in_unit(quantity.unit, unit))
