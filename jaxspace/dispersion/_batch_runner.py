"""Drawing, simulation and checks of many runs of a campaign, each with individual steps.

One compiled program draws the inputs, and another runs the missions of every call, whatever the
numbers of runs, chunks, cores and processes are: a call has a fixed number of runs in fixed blocks,
and is never divided among cores. The results of run i therefore depend on the campaign, the seed
and i only, bit for bit (on one kind of processor), except for a change at the number of planned
runs from which a faster program with a longer compilation pays off (`rolls_stages`).
"""

import hashlib
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..core.processors import cores
from ..core.status import SimulationError, Status
from ..engines import AbstractRunner
from ..integration.accuracy import Accuracy
from ..integration.exact_part import exact
from ..simulation.blocks import Blocks
from ..stores.results import RunResults
from ._campaign import Campaign, ordered
from ._chosen_times import warn_of_times_outside
from ._exact_parts import for_turns
from ._independence import check_outputs
from ._interface import for_programs
from ._isolation import isolate
from ._program import (
    CALL,
    Drawn,
    call_size,
    draw_inputs,
    drawn_by,
    program,
    runs_with_rolled_stages,
)
from ._saved_states import StatesToStore


class PreparedCampaign(NamedTuple):
    """Everything on which the numbers of a run depend; it can be sent to another process.

    - `rolled`: whether the stages are rolled (`rolls_stages`).
    - `samples`: number of saved states of each phase, 0 for none; or their times.
    - `digest`: of the results of the first call, which differs between campaigns, versions or
      processors with different results."""

    campaign: Campaign
    accuracy: Accuracy
    seed: int
    rolled: bool
    samples: StatesToStore
    digest: str


class BatchRunner(AbstractRunner):
    """Runs numbers of a prepared campaign.

    **Arguments**

    - `devices`: accelerators share the calls; of CPUs the first one is used, with all its cores.
    - `in_flight`: number of calls that are started before their results are fetched; by default
      all of a chunk."""

    def __init__(
        self,
        prepared: PreparedCampaign,
        devices: Sequence[jax.Device],
        in_flight: int | None = None,
    ):
        self.prepared = prepared
        self.modules = prepared.campaign.modules
        self.units = dict(prepared.campaign.units)
        self.campaign = for_programs(prepared.campaign)
        self.call = call_size(devices)
        self.blocks = Blocks.on(devices[:1], self.call)
        # A second CPU device would compile the program again, and add no core.
        self.devices = devices[:1] if devices[0].platform == "cpu" else devices
        self.in_flight = in_flight
        # The outputs of the nominal run, if it met the tolerance.
        self.nominal: dict[str, float] | None = None
        # The results of the first call, which `prepare` makes.
        self.first: RunResults | None = None
        self.key = jax.random.key(prepared.seed)

    @classmethod
    def prepare(
        cls,
        campaign: Campaign,
        accuracy: Accuracy,
        seed: int,
        devices: Sequence[jax.Device],
        samples: StatesToStore,
        runs: int,
        rolled: bool | None = None,
    ) -> "BatchRunner":
        """Compile the program of a campaign of so many runs, and run its first call.

        `rolled`: that of a store that is resumed, whose number of runs may have been another one.

        The exact part of the motion is in closed form where the steps would run out otherwise.
        Warns of times that none of the runs of the first call reaches. **Raises** `SimulationError`
        if the nominal run fails, and `InputError` for outputs that are not one number for each run,
        or that mix runs."""
        block = Blocks.on(devices[:1], call_size(devices)).size
        if rolled is None:
            rolled = runs_with_rolled_stages(campaign, accuracy, block, runs)
        prepared = PreparedCampaign(campaign, accuracy, seed, rolled, samples, "")
        runner = cls(prepared, devices)
        runner._compile_and_check()
        status, nominal = runner._run_first()
        if for_turns(campaign, accuracy, status) is not None:
            return cls.prepare(campaign, exact(accuracy), seed, devices, samples, runs, rolled)
        if status in (Status.NOT_FINITE, Status.MAX_STEPS):
            raise SimulationError(f"The nominal run cannot be simulated. {Status(status).sentence}")
        if status != Status.TOLERANCE_MISSED:
            runner.nominal = nominal
        first = runner.first
        assert first is not None
        runner.prepared = prepared._replace(digest=_digest(first))
        warn_of_times_outside(campaign, samples, first.trajectories)
        return runner

    @classmethod
    def in_worker(cls, prepared: PreparedCampaign, devices: Sequence[jax.Device]) -> "BatchRunner":
        # One call at a time: the processes together have a thread for each core.
        return cls(prepared, devices, in_flight=1)

    @property
    def example(self) -> RunResults:
        assert self.first is not None
        first = jax.tree.map(lambda x: x[..., :1].copy(), self.first)
        return ordered(first, self.prepared.campaign)

    def chunk(self, wished: int) -> int:
        """Runs between two stores: `wished`, rounded up to whole calls."""
        return self.call * -(-wished // self.call)

    def run(self, first: int, count: int) -> RunResults:
        whole = self.call * -(-count // self.call)
        numbers = np.arange(first, first + whole, dtype=np.uint32)
        calls = list(numbers.reshape(-1, self.call))
        every = max(cores(), 2 * len(self.devices))
        width = min(len(calls), every if self.in_flight is None else self.in_flight)

        def one(k: int) -> RunResults:
            # The runs of the first call are there since it was prepared.
            known = self.first if calls[k][0] == 0 else None
            return self._call(calls[k], k) if known is None else known

        # A CPU computes the calls of one thread one after the other, however many are started.
        with ThreadPoolExecutor(width) as pool:
            results = list(pool.map(one, range(len(calls))))
        joined = jax.tree.map(lambda *x: np.concatenate(x, axis=-1), *results)
        return jax.tree.map(lambda x: x[..., :count], joined)

    def _compile_and_check(self) -> None:
        """Compile the program of all runs, and meanwhile check the outputs on the first of them."""
        prepared = self.prepared
        first = np.arange(self.call, dtype=np.uint32)

        def draw(used: np.ndarray) -> Drawn:
            return self._draw(first, np.pad(used, (0, self.call - used.size)))

        drawn = eqx.filter_eval_shape(drawn_by, *self._chosen(first, np.ones(self.call, bool), 0))
        lowered: Future[None] = Future()

        def check() -> None:
            # Compiles the draws.
            self._draw(first, np.ones(self.call, bool))
            # Traced first, because the program of all runs takes longest to compile. Errors of its
            # functions are raised here, before any mission runs.
            lowered.result()
            check_outputs(prepared.campaign, prepared.accuracy, draw)

        # Two threads, and none of them this one: where there are more threads than arenas for
        # memory, a new one often shares that of the main thread, and they wait for each other.
        with ThreadPoolExecutor(2) as pool:
            pool.submit(self._compile, drawn, lowered)
            checked = pool.submit(check)
        checked.result()

    def _run_first(self) -> tuple[int, dict[str, float]]:
        """The first call, and meanwhile the nominal run: its status and outputs."""
        with ThreadPoolExecutor(1) as pool:
            nominal = pool.submit(self._nominal)
            self.first = self._call(np.arange(self.call, dtype=np.uint32))
        return nominal.result()

    def _call(self, numbers: np.ndarray, k: int = 0) -> RunResults:
        """The results of call number `k`; a run that raises has the status for it."""

        def call(used: np.ndarray) -> PyTree:
            given = self._arguments(self._draw(numbers, used, k))
            return jax.tree.map(np.asarray, self._program(*given))

        return isolate(call, numbers.size)

    def _draw(self, numbers: np.ndarray, used: np.ndarray, k: int = 0) -> Drawn:
        """The inputs of call number `k`, on its device."""
        return draw_inputs(*self._chosen(numbers, used, k))

    def _nominal(self) -> tuple[int, dict[str, float]]:
        """The status of the nominal run and those of its outputs that are finite, by the program of
        all runs, in a call of copies of it."""
        size = self.call
        drawn = self._draw(np.arange(size, dtype=np.uint32), np.zeros(size, bool))
        # The statuses of the runs show that they were not used.
        zeros = np.zeros(size, drawn.status.dtype)
        drawn = drawn._replace(status=jax.device_put(zeros, self.devices[0]))
        given = self._arguments(drawn)
        results = isolate(lambda used: jax.block_until_ready(self._program(*given)), 1)
        outputs = {name: float(np.asarray(x)[0]) for name, x in results.outputs.items()}
        finite = {name: x for name, x in outputs.items() if np.isfinite(x)}
        return int(np.asarray(results.status)[0]), finite

    def _compile(self, drawn: Drawn, lowered: "Future[None]") -> None:
        """Compile or load the program of all runs for inputs of these shapes, where a call then
        finds it.

        `lowered` is done when only the compiler remains, or holds an earlier exception."""
        try:
            # By NumPy, as what is read of a result: each shape would be a program of JAX.
            zeros = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), drawn)
            # On a device, as what is drawn: elsewhere the program would be another one.
            drawn = jax.device_put(zeros, self.devices[0])
            given = self._arguments(drawn)
            self._program.prepare(given, lambda: lowered.set_result(None))
        except BaseException as error:
            # An error of the compiler is raised again where the program is called.
            if not lowered.done():
                lowered.set_exception(error)

    @property
    def _program(self) -> Any:
        return program(self.devices[0].platform)

    def _chosen(self, numbers: np.ndarray, used: np.ndarray, k: int) -> tuple[PyTree, ...]:
        """Arguments of `draw_inputs` for call number `k`."""
        device = self.devices[k % len(self.devices)]
        given = jax.device_put((jnp.asarray(numbers), jnp.asarray(used)), device)
        return self.campaign, self.key, *given

    def _arguments(self, drawn: Drawn) -> tuple[PyTree, ...]:
        """Arguments of the compiled program of the missions."""
        _, accuracy, _, rolled, samples, _ = self.prepared
        return self.campaign, accuracy, drawn, self.blocks, samples, rolled


def _digest(results: RunResults) -> str:
    hashed = hashlib.sha256()
    for name, x in (*sorted(results.inputs.items()), *sorted(results.outputs.items())):
        hashed.update(name.encode() + np.ascontiguousarray(x[:CALL]).tobytes())
    hashed.update(np.ascontiguousarray(results.status[:CALL]).tobytes())
    return hashed.hexdigest()
