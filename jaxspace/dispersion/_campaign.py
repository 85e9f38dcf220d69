"""A campaign: maps random inputs to a mission, and its result to outputs."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Integer

from ..core import InputError, State
from ..core.checks import check_finite
from ..core.quantities import Quantity
from ..core.types import as_float
from ..core.user_functions import user_function
from ..integration.accuracy import Accuracy
from ..sampling.designs import AbstractDesign, draw
from ..sampling.distributions import AbstractDistribution, Constant, fixed
from ..sampling.joint import AbstractJoint
from ..sampling.sweeps import Sweep
from ..simulation import Mission
from ..statistics.requirements import requirement_of
from ..stores.results import RunResults
from ._exact_parts import with_exact_parts
from ._interface import AbstractCampaign, BuildFunction, Limits, OutputFunction
from .names import check_names
from .purpose import ByPurpose, CampaignAccuracy, as_campaign_accuracy
from .replay import Replay, replay

T = TypeVar("T")

RUNS = 1000
"""Default number of runs: enough for a mean and a standard deviation to a few percent."""


def _as_pairs(limits: dict[str, T] | Sequence[tuple[str, T]]) -> tuple[tuple[str, T], ...]:
    """A dict as pairs, which can be hashed, as a static field has to be."""
    return tuple(limits.items()) if isinstance(limits, dict) else tuple(limits)


def _check_runs(built: tuple[Mission, State], samples: Mapping[str, Array]) -> None:
    """Raise `InputError` if no array of the mission and its state is batched."""
    runs = next(iter(samples.values())).shape
    leaves = jax.tree.leaves(built)
    # A function may close over the inputs.
    if not runs or any(callable(leaf) for leaf in leaves):
        return
    shapes = [np.shape(leaf) for leaf in leaves if eqx.is_array(leaf)]
    if not any(shape[-1:] == runs for shape in shapes):
        raise InputError(
            "Campaign.build ignores its inputs: no array of the mission or of y0 has the batch "
            f"axis {runs}. It must use {', '.join(samples)}."
        )


def _as_optional_accuracy(x: object) -> Any:
    # A placeholder of a tree transformation passes.
    return as_campaign_accuracy(x) if isinstance(x, int | float | str | Accuracy) else x


@final
class Campaign(AbstractCampaign):
    """A mission that is run many times with random inputs.

    - `build`: a function `build(samples) -> (mission, y0)` that returns the mission and its initial
      state, from a dict of the inputs, each (runs,). The batch axis is last: parameters are scalars
      or (runs,), vectors (3, runs) or (3, 1).
    - `inputs`: the distribution of each input, by name.
    - `outputs`: a function `outputs(result, samples) -> dict` that returns the outputs, each
      (runs,), from a `MissionTrajectory`, whose phases contain numbers only and no systems, and
      the inputs.
    - `units`: the unit of every input and output, by name; a name without one is dimensionless.
    - `start`, s: the time at which the mission starts.
    - `description`: free text for the record, such as the scene file.
    - `limits`: for inputs by name, the quantity and the range that its class allows; a run with an
      input outside of it is rejected (`allowed`).
    - `requirements`: for outputs by name, the least and the greatest allowed value, `None` for no
      limit, as a pair or a `Requirement`, which may allow a share of violations; statistics and
      reports count violations and give a verdict.
    - `design`: sampling design of the runs (`LatinHypercube`, `Sobol`); random by default.
    - `num_saved`: number of states of each phase that `outputs` reads, evenly spaced from its start
      to its end; by default the two ends. `greatest` and `least` require more.
    - `files`: texts of the files that the description names, by name, for the record.
    - `modules`: texts of the Python files (`core.run_module`) whose classes and functions the
      campaign uses, by name: workers run them, and the record has them with their hashes.
    - `accuracy`: the default of the relative tolerance of each step, an `Accuracy`, or "by purpose"
      (`ByPurpose`); a campaign of a scene file has that of the file.
    - `sweep`: explicit values of some inputs, which replace their draws (`at`).

    `build` and `outputs` are traced once; as modules they may contain arrays. Raises `InputError`
    for an input that is not a distribution or has a reserved name, for empty inputs, and for fewer
    than two states along a phase."""

    build: BuildFunction
    inputs: dict[str, AbstractDistribution]
    outputs: OutputFunction
    units: dict[str, str] = eqx.field(default_factory=dict)
    start: Float[Array, ""] = eqx.field(converter=as_float, default=0.0)
    description: str = eqx.field(static=True, default="")
    limits: tuple[tuple[str, Quantity], ...] = eqx.field(
        static=True, converter=_as_pairs, default=()
    )
    design: AbstractDesign | None = None
    requirements: tuple[tuple[str, Limits], ...] = eqx.field(
        static=True, converter=_as_pairs, default=()
    )
    num_saved: int = eqx.field(static=True, default=2)
    files: tuple[tuple[str, str], ...] = eqx.field(static=True, converter=_as_pairs, default=())
    accuracy: Accuracy | ByPurpose | None = eqx.field(converter=_as_optional_accuracy, default=None)
    modules: tuple[tuple[str, str], ...] = eqx.field(static=True, converter=_as_pairs, default=())
    sweep: Sweep | None = None

    def __check_init__(self):
        if not self.inputs:
            raise InputError("Campaign.inputs is empty: it must name at least one input.")
        check_names("Campaign.inputs", self.inputs)
        for name, distribution in self.inputs.items():
            if isinstance(distribution, AbstractJoint):
                raise InputError(
                    f"Campaign.inputs[{name!r}] is a joint distribution of {distribution.size} "
                    "inputs: its method inputs names them, as in {**joint.inputs('a', 'b'), ...}."
                )
            if not isinstance(distribution, AbstractDistribution):
                raise InputError(
                    f"Campaign.inputs[{name!r}] is {distribution!r}: it must be a distribution."
                )
        for name, limits in self.requirements:
            requirement_of(limits).check(f"Campaign.requirements[{name!r}]")
        check_finite("Campaign.start", self.start)
        if self.num_saved < 2:
            raise InputError(f"Campaign.num_saved is {self.num_saved}: it must be 2 or more.")

    def accuracy_for(self, given: CampaignAccuracy) -> Accuracy:
        """The accuracy of a call: the one `given`, or else that of the campaign; by purpose without
        a tolerance.

        `Accuracy.decoupled` is set if the nominal run rotates so fast that it would reach the
        maximum number of steps.
        """
        asked = as_campaign_accuracy(self.accuracy if given is None else given)
        return with_exact_parts(self, asked.accuracy if isinstance(asked, ByPurpose) else asked)

    def nominal(self, runs: int = 1) -> dict[str, Float[Array, " runs"]]:
        """The mean of every input, (runs,)."""
        # With its type, as what is drawn: a weak one leads to other traces.
        return {
            name: jnp.full((runs,), d.mean, jnp.result_type(d.mean))
            for name, d in self.inputs.items()
        }

    def samples(
        self, key: Array, numbers: Integer[Array, " runs"]
    ) -> dict[str, Float[Array, " runs"]]:
        """The inputs of the runs with these numbers.

        **Arguments**

        - `key`: of the campaign.
        - `numbers`: of the runs, (runs,).

        **Returns** the inputs by name, (runs,).
        """
        if self.sweep is None:
            return draw(self.inputs, self.design, key, numbers)
        drawn = draw(self.inputs, self.design, key, numbers // self.sweep.rows)
        return drawn | self.sweep.values(numbers)

    def at(self, rows: Mapping[str, ArrayLike | Sequence[float]]) -> "Campaign":
        """The campaign at explicit values of some inputs, with the other inputs dispersed.

        `disperse(campaign.at(rows), 1000)` computes 1000 runs in each row, which differ in the
        other inputs only; all rows share these draws. Where no other input is random, it computes
        one run in each row. Run i belongs to the row i mod r of r rows.

        **Arguments**

        - `rows`: the values of each swept input, (rows,), by its name; `grid` makes the rows of
          all combinations.

        **Returns** the campaign, in which these inputs are constant except for the sweep.

        **Raises** `InputError` for a name that is not an input, for columns of different lengths,
        and for values that are not finite."""
        sweep = Sweep(dict(rows))
        inputs = dict(self.inputs)
        for name in sweep.columns:
            if name not in inputs:
                raise InputError(
                    f"rows has the column {name!r}: it must be one of the inputs "
                    f"{', '.join(inputs)}.{InputError.hint(name, inputs)}"
                )
            source = inputs[name].source
            left = [n for n, d in inputs.items() if d.source == source and n not in sweep.columns]
            if source and left:
                raise InputError(
                    f"rows has the column {name!r}, which is drawn together with "
                    f"{', '.join(left)}: sweep all of them."
                )
        # The nominal run is that of the mean, as without the sweep.
        inputs |= {name: fixed(inputs[name].mean) for name in sweep.columns}
        return dataclasses.replace(self, inputs=inputs, sweep=sweep)

    @property
    def rows(self) -> int:
        """Number of rows of the sweep; 1 without one."""
        return 1 if self.sweep is None else self.sweep.rows

    def total_runs(self, runs: int) -> int:
        """The number of all runs for this number of them in each row of the sweep: the number
        itself without a sweep, and one in each row where no input is random."""
        if self.sweep is None:
            return runs
        random = any(not isinstance(d, Constant) for d in self.inputs.values())
        return self.rows * (runs if random else 1)

    def mission(self, samples: dict[str, Float[Array, " *runs"]]) -> tuple[Mission, State]:
        """Build the mission and the initial state from the inputs of runs, each (runs,).

        Raises `InputError` if `build` reads an unknown input, does not return a mission and a
        state, or does not use the inputs."""
        try:
            with user_function("Campaign.build"):
                built = self.build(samples)
        except KeyError as error:
            name = error.args[0] if error.args else None
            # From a dict other than the inputs, such as a user-defined table.
            if name in samples or not isinstance(name, str):
                raise
            raise InputError(
                f"Campaign.build requests the unknown input {name!r}: the inputs are "
                f"{', '.join(samples)}.{InputError.hint(name, samples)}"
            ) from error
        pair = isinstance(built, tuple) and len(built) == 2 and isinstance(built[0], Mission)
        if not pair:
            raise InputError(
                f"Campaign.build returns an object of type {type(built).__name__}: it must return "
                f"(mission, y0), a Mission and its initial state."
            )
        _check_runs(built, samples)
        return built

    def allowed(self, samples: dict[str, Float[Array, " runs"]]) -> Bool[Array, " runs"]:
        """Whether all inputs of a run are in the ranges allowed by their classes, for each run."""
        runs = next(iter(samples.values())).shape
        within = jnp.ones(runs, bool)
        # Traced, unlike the check of a class, so that a bad draw only marks its run.
        for name, limit in self.limits:
            within = within & limit.contains(samples[name])
        return within

    def refusal(self, samples: Mapping[str, ArrayLike]) -> str:
        """The reason why a run with these inputs, each a number, is rejected; empty if it is
        allowed."""
        for name, limit in self.limits:
            if not np.all(limit.contains(np.asarray(samples[name]))):
                value = float(np.asarray(samples[name]))
                return f"{name} is {value:.6g}: it must be {limit.allowed()}."
        return ""

    def replay(
        self,
        number: int,
        *,
        seed: int = 0,
        accuracy: CampaignAccuracy = None,
        num_saved: int = 200,
        runs: int = RUNS,
    ) -> Replay:
        """Run one sample again, in full detail.

        **Arguments**

        - `number`, `seed`: of the run and of the campaign.
        - `accuracy`: the relative tolerance of each step, or an `Accuracy`; by default that of the
          campaign. One by purpose is in the result: `dispersion.purpose.tolerance`.
        - `num_saved`: number of states of each phase that are saved.
        - `runs`: number of runs of the campaign, from which its program follows (`rolls_stages`).

        **Returns** a `Replay`: inputs and outputs, bit-identical to those of the campaign, and the
        trajectory. A run that fails has the status for it.

        **Raises** `InputError` for a negative number and for a rejected run whose mission cannot be
        built, and `SimulationError` where a function of the campaign that is called back raises an
        error."""
        return replay(self, number, seed, self.accuracy_for(accuracy), num_saved, runs)

    def text(self) -> str:
        """A description of the inputs, one on each line, and of the design."""
        lines = []
        for name, distribution in self.inputs.items():
            unit = f" [{self.units[name]}]" if self.units.get(name) else ""
            lines.append(f"{name}{unit}: {distribution.text()}")
        # In the text, because another design makes another campaign.
        if self.design is not None:
            lines.append(f"design: {type(self.design).__name__}")
        if self.sweep is not None:
            lines.append(self.sweep.text())
        return "\n".join(lines)


def check_no_sweep(campaign: Campaign, method: str) -> None:
    """Raise `InputError` for a campaign with a sweep, whose rows the `method` would ignore."""
    if campaign.sweep is not None:
        raise InputError(
            f"The campaign has a sweep, and {method} applies to one distribution of the inputs: "
            "call it without Campaign.at, or [sweep] in its file."
        )


def in_order(campaign: Campaign, names: Iterable[str]) -> list[str]:
    """The names of outputs in the order of the campaign; JAX sorts the keys of a dict."""
    place = {name: number for number, name in enumerate(campaign.units)}
    return sorted(names, key=lambda name: (place.get(name, len(place)), name))


def ordered(results: RunResults, campaign: Campaign) -> RunResults:
    """The results with their names in the order of the campaign."""
    outputs = in_order(campaign, results.outputs)
    inputs = {name: results.inputs[name] for name in campaign.inputs}
    return results._replace(
        inputs=inputs, outputs={name: results.outputs[name] for name in outputs}
    )
