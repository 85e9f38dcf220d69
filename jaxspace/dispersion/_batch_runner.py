"""Plan, run, check, refine: many runs at fixed steps, each of them accounted for.

Pilot runs, the nominal one among them, find with adaptive steps a plan of steps for every phase,
and the errors of a trial call show how much finer it has to be for runs that are no pilots. All
runs follow that plan in blocks; the embedded error estimate shows for every run whether it was fine
enough. The runs that missed the tolerance are repeated on finer plans, and those that still miss it
with adaptive steps, each by itself; where that fails too, their status says so.

One compiled program serves every call and every plan, whatever the number of runs, of chunks, of
cores and of processes: the plans are padded to one length, a call is always so many runs in blocks
of always the same runs, and cores share calls, never a call. The numbers of run i therefore depend
on the campaign, the seed and i alone, to the last bit (on one kind of processor).
"""

import hashlib
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..integration import Accuracy, Status
from ..simulation._blocks import Blocks
from ._campaign import Campaign
from ._isolation import isolate
from ._pilots import expected_steps, pilot_plans
from ._plans import FINENESS, TRIAL, padded, placeholders, refinement
from ._program import program
from ._run_results import PlannedCampaign, RunResults

# Runs in one call: enough to pay for the call, on a core and on an accelerator.
CALL, ACCELERATOR_CALL = 512, 2**14
# Runs in one call where each takes adaptive steps by itself: there are few of them.
ADAPTIVE_CALL = 8


class BatchRunner:
    """Runs numbers of a planned campaign.

    **Arguments**

    - `devices`: accelerators share the calls; of CPUs the first one is used, with all its cores.
    - `in_flight`: how many calls are under way at a time; all of a chunk by default."""

    def __init__(
        self,
        planned: PlannedCampaign,
        devices: Sequence[jax.Device],
        in_flight: int | None = None,
    ):
        self.planned = planned
        self.call = call_size(devices)
        self.blocks = Blocks.on(devices[:1], self.call)
        # A second CPU device would compile the program once more, and add no core.
        self.devices = devices[:1] if devices[0].platform == "cpu" else devices
        self.in_flight = in_flight
        # A run of the trial, for names and shapes.
        self.example: RunResults | None = None
        key = jax.random.key(planned.seed)
        self.arguments = (planned.campaign, planned.accuracy, key, planned.samples)

    @classmethod
    def plan(
        cls,
        campaign: Campaign,
        accuracy: Accuracy,
        seed: int,
        devices: Sequence[jax.Device],
        samples: int = 0,
    ) -> "BatchRunner":
        """Plan a campaign by its pilots and a trial, and compile the program of all its runs.

        **Raises** `SimulationError` when the nominal run fails."""
        expected = placeholders(expected_steps(campaign, accuracy))
        planned = PlannedCampaign(campaign, accuracy, seed, (expected,), False, samples, "")
        # The program of all runs needs of the plans their lengths alone: it is compiled while the
        # pilots are. It takes longer, so that they wait for it to be traced.
        ahead, lowered = ThreadPoolExecutor(1), threading.Event()
        ahead.submit(cls(planned, devices).compile, lowered)
        try:
            lowered.wait()
            pilots, coupled = pilot_plans(campaign, accuracy, jax.random.key(seed))
            trial = padded(pilots, [TRIAL] * len(pilots))
            planned = planned._replace(plans=(trial,), coupled=coupled)
            runner = cls(planned, devices)
        finally:
            # What goes wrong there goes wrong again where it is called.
            ahead.shutdown(wait=True)
        # A whole call: all further ones reuse its program.
        results, errors = runner._call(np.arange(runner.call, dtype=np.uint32), 0)
        factors = [refinement(own) for own in np.asarray(errors)[:, :CALL]]
        plans = tuple(padded(pilots, [level * f for f in factors]) for level in FINENESS)
        runner.planned = planned._replace(plans=plans, digest=_digest(results))
        runner.example = jax.tree.map(lambda x: x[..., :1].copy(), results)
        return runner

    def chunk(self, wished: int) -> int:
        """Runs between two stores: `wished`, rounded up to whole calls."""
        return self.call * -(-wished // self.call)

    def run(self, first: int, count: int) -> RunResults:
        """`count` runs from the number `first` on, checked and refined."""
        whole = self.call * -(-count // self.call)
        results = self._results(np.arange(first, first + whole), 0)
        # A copy, because refined runs are written into it and arrays of jax are read-only.
        results = jax.tree.map(lambda x: x[..., :count].copy(), results)
        for level in range(1, len(self.planned.plans)):
            missed = np.flatnonzero(results.status == Status.TOLERANCE_MISSED)
            if missed.size == 0:
                break
            _replace(results, missed, self._again(first + missed, level))
        missed = np.flatnonzero(results.status == Status.TOLERANCE_MISSED)
        if missed.size:
            _replace(results, missed, self._adaptive(first + missed))
        return results

    def _again(self, numbers: np.ndarray, level: int) -> RunResults:
        """The runs of these `numbers` on a finer plan.

        In their own blocks where the runs of a block share adaptive steps."""
        size = self.blocks.size
        if not self.planned.coupled:
            filled = np.concatenate([numbers, np.full(-numbers.size % self.call, numbers[-1])])
            return jax.tree.map(lambda x: x[..., : numbers.size], self._results(filled, level))
        own = np.unique(numbers // size)
        filled = np.concatenate([own, np.full(-own.size % (self.call // size), own[-1])])
        results = self._results((filled[:, None] * size + np.arange(size)).reshape(-1), level)
        where = np.searchsorted(own, numbers // size) * size + numbers % size
        return jax.tree.map(lambda x: x[..., where], results)

    def _adaptive(self, numbers: np.ndarray) -> RunResults:
        """The runs of these `numbers` with adaptive steps, which they share with no other run."""
        alone = BatchRunner(self.planned, self.devices, self.in_flight)
        alone.call, alone.blocks = ADAPTIVE_CALL, self.blocks._replace(size=1)
        no_plans = (None,) * len(self.planned.plans[0])
        alone.planned = self.planned._replace(plans=(no_plans,))
        filled = np.concatenate([numbers, np.full(-numbers.size % alone.call, numbers[-1])])
        return jax.tree.map(lambda x: x[..., : numbers.size], alone._results(filled, 0))

    def _results(self, numbers: np.ndarray, level: int) -> RunResults:
        """The runs of these `numbers`, which fill whole calls."""
        calls = list(numbers.astype(np.uint32).reshape(-1, self.call))
        every = max(cores(), 2 * len(self.devices))
        width = min(len(calls), every if self.in_flight is None else self.in_flight)
        # A CPU computes the calls of one thread in turn, however many have been started.
        with ThreadPoolExecutor(width) as pool:
            results = list(pool.map(lambda k: self._call(calls[k], level, k)[0], range(len(calls))))
        return jax.tree.map(lambda *x: np.concatenate(x, axis=-1), *results)

    def compile(self, lowered: threading.Event) -> None:
        """Compile the program of all runs, which a call then finds compiled.

        `lowered` is set when nothing but the compiler is left to wait for."""
        numbers, flown = np.arange(self.call, dtype=np.uint32), np.ones(self.call, bool)
        try:
            traced = self._program.lower(*self._given(numbers, 0, flown, 0))
        finally:
            lowered.set()
        traced.compile()

    @property
    def _program(self) -> Callable[..., Any]:
        return program(self.devices[0].platform)

    def _given(self, numbers: np.ndarray, level: int, flown: np.ndarray, k: int) -> tuple[Any, ...]:
        """What the program takes for call number `k`."""
        device = self.devices[k % len(self.devices)]
        numbers_k, flown_k = jax.device_put((jnp.asarray(numbers), jnp.asarray(flown)), device)
        campaign, accuracy, key, samples = self.arguments
        plans = self.planned.plans[level]
        return campaign, accuracy, key, numbers_k, flown_k, plans, self.blocks, samples

    def _call(self, numbers: np.ndarray, level: int, k: int = 0) -> tuple[RunResults, np.ndarray]:
        """The results of call number `k`; of a run that raises, its own row says so."""

        def call(flown: np.ndarray) -> PyTree:
            return jax.tree.map(np.asarray, self._program(*self._given(numbers, level, flown, k)))

        return isolate(call, self.call)


def cores() -> int:
    """How many cores this process may use."""
    # Containers and clusters often give a process fewer cores than the machine has.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def call_size(devices: Sequence[jax.Device]) -> int:
    """How many runs one call has on these devices."""
    return CALL if devices[0].platform == "cpu" else ACCELERATOR_CALL


def _replace(results: RunResults, runs: np.ndarray, again: RunResults) -> None:
    """Put the repetitions of these `runs` in their places."""
    spent = results.evaluations[runs]
    for old, new in zip(jax.tree.leaves(results), jax.tree.leaves(again), strict=True):
        old[..., runs] = new
    # A repeated run has cost all attempts.
    results.evaluations[runs] += spent


def _digest(results: RunResults) -> str:
    hashed = hashlib.sha256()
    for name, x in (*sorted(results.inputs.items()), *sorted(results.outputs.items())):
        hashed.update(name.encode() + np.ascontiguousarray(x[:CALL]).tobytes())
    hashed.update(np.ascontiguousarray(results.status[:CALL]).tobytes())
    return hashed.hexdigest()
