"""Plan, run, check, refine: many runs at fixed steps, with an error estimate for each of them.

Pilot runs with adaptive steps, the nominal run among them, give a plan of steps for every phase.
The errors of a trial call show how much finer this plan has to be for the other runs. All runs
follow the plan in blocks, and the embedded error estimate shows for every run whether it was fine
enough. Runs that missed the tolerance are repeated on finer plans, and those that still miss it
with adaptive steps, one by one; the status reports where that fails too.

One compiled program draws the inputs, and another runs the missions of every call and every plan,
whatever the numbers of runs, chunks, cores and processes are. For this the plans are padded to one
length, a call has a fixed number of runs in fixed blocks, and a call is never divided among cores.
The numbers of run i therefore depend on the campaign, the seed and i alone, to the last bit (on one
kind of processor): but for a step at the number of planned runs from which a program that takes
longer to compile, and flies faster, pays (`is_small`).
"""

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..core.processors import cores
from ..integration.accuracy import Accuracy
from ..integration.exact_part import exact
from ..integration.status import Status
from ..simulation.blocks import Blocks
from ..stores.results import RunResults
from ._campaign import Campaign
from ._chosen_times import warn_of_times_outside
from ._isolation import isolate
from ._outputs import check_apart, outputs_to_check
from ._pilots import StepsForTurns, check_nominal, expected_steps, pilot_plans
from ._planned import PlannedCampaign
from ._plans import FINENESS, TRIAL, Plans, padded, placeholders, refinement
from ._program import Drawn, draw_inputs, drawn_by, program
from ._saved_states import StatesToStore

# Runs in one call: enough to outweigh its overhead, on a core and on an accelerator.
CALL = 512
ACCELERATOR_CALL = 2**14
# Runs in one call with adaptive steps, of which there are few.
ADAPTIVE_CALL = 8


class BatchRunner:
    """Runs numbers of a planned campaign.

    **Arguments**

    - `devices`: accelerators share the calls; of CPUs the first one is used, with all its cores.
    - `in_flight`: number of calls that are started before their results are fetched; by default
      all of a chunk."""

    def __init__(
        self,
        planned: PlannedCampaign,
        devices: Sequence[jax.Device],
        in_flight: int | None = None,
    ):
        self.planned = planned
        self.call = call_size(devices)
        self.blocks = Blocks.on(devices[:1], self.call)
        # A second CPU device would compile the program again, and add no core.
        self.devices = devices[:1] if devices[0].platform == "cpu" else devices
        self.in_flight = in_flight
        # A run of the trial, for names and shapes.
        self.example: RunResults | None = None
        # The outputs of the nominal run, if it met the tolerance.
        self.nominal: dict[str, float] | None = None
        # The results of the first call, if those of the trial are the final ones.
        self.trial: RunResults | None = None
        self.key = jax.random.key(planned.seed)

    @classmethod
    def plan(
        cls,
        campaign: Campaign,
        accuracy: Accuracy,
        seed: int,
        devices: Sequence[jax.Device],
        samples: StatesToStore,
        runs: int,
    ) -> "BatchRunner":
        """Plan a campaign of so many runs by its pilots and a trial, and compile their program.

        Without pilots where no phase follows a plan and the outputs are those of the library: their
        program would take as long to compile as half of that of all runs.

        The exact part of the motion is in closed form where the steps would run out otherwise.
        Warns of times that none of the runs of the trial reaches. **Raises** `SimulationError` if
        the nominal run fails, and `InputError` for outputs that are not one number for each run."""
        size = Blocks.on(devices[:1], call_size(devices)).size
        steps, small = expected_steps(campaign, accuracy, samples, size, runs)
        expected = placeholders(steps)
        planned = PlannedCampaign(campaign, accuracy, seed, (expected,), small, samples, "")
        runner = cls(planned, devices)
        first = np.arange(runner.call, dtype=np.uint32)

        def draw(used: np.ndarray) -> Drawn:
            return runner._draw(first, used)

        used = np.ones(runner.call, bool)
        unplanned = all(plan is None for plan in expected)
        piloted = not unplanned or outputs_to_check(campaign.outputs) is not None
        drawn = eqx.filter_eval_shape(drawn_by, *runner._chosen(first, used, 0))
        lowered: Future[None] = Future()

        def plans_of_pilots() -> list[np.ndarray | None]:
            draw(used)
            # Traced first, because the program of all runs takes longest to compile. Errors of its
            # functions are raised here, before any mission runs.
            lowered.result()
            if not piloted:
                return [None] * len(expected)
            pilots, flown = pilot_plans(campaign, accuracy, draw, runner.call, samples)
            # Meanwhile the program of all runs is compiled.
            check_apart(campaign.outputs, campaign.along, flown)
            return pilots

        # That program needs of the plans their lengths alone, and is compiled while they are found.
        # Two threads, and none of them this one: where there are more threads than arenas for
        # memory, a new one often shares that of the main thread, and they wait for each other.
        with ThreadPoolExecutor(2) as pool:
            # An error of the compiler is raised again where the program is called.
            pool.submit(runner._compile, drawn, lowered)
            result = pool.submit(plans_of_pilots)
        try:
            pilots = result.result()
            trial = padded(pilots, [TRIAL] * len(pilots))
            with ThreadPoolExecutor(1) as pool:
                # One of the pilots, so that their plan is fine enough for it.
                nominal = pool.submit(runner._nominal, trial)
                # A whole call, whose program all further ones reuse.
                results, errors = runner._call(first, trial, runner.blocks)
            status, outputs = nominal.result()
            if not piloted:
                check_nominal(campaign, accuracy, status)
        except StepsForTurns:
            return cls.plan(campaign, exact(accuracy), seed, devices, samples, runs)
        if status != Status.TOLERANCE_MISSED:
            runner.nominal = outputs
        factors = [refinement(phase_errors) for phase_errors in np.asarray(errors)[:, :CALL]]
        plans = tuple(padded(pilots, [level * f for f in factors]) for level in FINENESS)
        runner.planned = planned._replace(plans=plans, digest=_digest(results))
        runner.example = jax.tree.map(lambda x: x[..., :1].copy(), results)
        # Runs without a plan take the same steps again.
        runner.trial = results if unplanned else None
        warn_of_times_outside(campaign, samples, results.trajectories)
        return runner

    def chunk(self, wished: int) -> int:
        """Runs between two stores: `wished`, rounded up to whole calls."""
        return self.call * -(-wished // self.call)

    def run(self, first: int, count: int) -> RunResults:
        """`count` runs from the number `first` on, checked and refined."""
        whole = self.call * -(-count // self.call)
        results = self._results(np.arange(first, first + whole), self.planned.plans[0])
        # A copy, because refined runs are written into it, and arrays of JAX are read-only.
        results = jax.tree.map(lambda x: x[..., :count].copy(), results)
        for plans in self.planned.plans[1:]:
            missed = np.flatnonzero(results.status == Status.TOLERANCE_MISSED)
            if missed.size == 0:
                break
            _replace(results, missed, self._again(first + missed, plans))
        missed = np.flatnonzero(results.status == Status.TOLERANCE_MISSED)
        if missed.size:
            _replace(results, missed, self._adaptive(first + missed))
        return results

    def _again(self, numbers: np.ndarray, plans: Plans) -> RunResults:
        """The runs of these `numbers` on finer plans."""
        results = self._results(_filled(numbers, self.call), plans)
        return jax.tree.map(lambda x: x[..., : numbers.size], results)

    def _adaptive(self, numbers: np.ndarray) -> RunResults:
        """The runs of these `numbers` with adaptive steps."""
        no_plans = (None,) * len(self.planned.plans[0])
        alone = self.blocks._replace(size=1)
        results = self._results(_filled(numbers, ADAPTIVE_CALL), no_plans, ADAPTIVE_CALL, alone)
        return jax.tree.map(lambda x: x[..., : numbers.size], results)

    def _results(
        self,
        numbers: np.ndarray,
        plans: Plans,
        call: int | None = None,
        blocks: Blocks | None = None,
    ) -> RunResults:
        """The runs of these `numbers`, which fill whole calls."""
        size, blocks = call or self.call, blocks or self.blocks
        calls = list(numbers.astype(np.uint32).reshape(-1, size))
        every = max(cores(), 2 * len(self.devices))
        trial = np.arange(self.call)
        width = min(len(calls), every if self.in_flight is None else self.in_flight)

        def one(k: int) -> RunResults:
            if self.trial is not None and size == self.call and np.array_equal(calls[k], trial):
                return self.trial
            return self._call(calls[k], plans, blocks, k)[0]

        # A CPU computes the calls of one thread one after the other, however many are started.
        with ThreadPoolExecutor(width) as pool:
            results = list(pool.map(one, range(len(calls))))
        return jax.tree.map(lambda *x: np.concatenate(x, axis=-1), *results)

    def _call(
        self, numbers: np.ndarray, plans: Plans, blocks: Blocks, k: int = 0
    ) -> tuple[RunResults, np.ndarray]:
        """The results of call number `k`; a run that raises has the status for it."""

        def call(used: np.ndarray) -> PyTree:
            drawn = self._draw(numbers, used, k)
            return jax.tree.map(np.asarray, self._program(*self._arguments(drawn, plans, blocks)))

        return isolate(call, numbers.size)

    def _draw(self, numbers: np.ndarray, used: np.ndarray, k: int = 0) -> Drawn:
        """The inputs of call number `k`, on its device."""
        return draw_inputs(*self._chosen(numbers, used, k))

    def _nominal(self, plans: Plans) -> tuple[int, dict[str, float]]:
        """The status of the nominal run and those of its outputs that are finite, by the program of
        all runs, in a call of copies of it."""
        size = self.call
        drawn = self._draw(np.arange(size, dtype=np.uint32), np.zeros(size, bool))
        # Those of the runs say that they were not used.
        zeros = np.zeros(size, drawn.status.dtype)
        drawn = drawn._replace(status=jax.device_put(zeros, self.devices[0]))
        given = self._arguments(drawn, plans, self.blocks)
        results, _ = isolate(lambda used: jax.block_until_ready(self._program(*given)), 1)
        outputs = {name: float(np.asarray(x)[0]) for name, x in results.outputs.items()}
        finite = {name: x for name, x in outputs.items() if np.isfinite(x)}
        return int(np.asarray(results.status)[0]), finite

    def _compile(self, drawn: Drawn, lowered: "Future[None]") -> None:
        """Compile the program of all runs for inputs of these shapes, where a call then finds it.

        `lowered` is done when nothing but the compiler is left to wait for, or has what was raised
        before."""
        try:
            # By NumPy, as what is read of a result: each shape would be a program of JAX.
            zeros = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), drawn)
            # On a device, as what is drawn: elsewhere the program would be another one.
            drawn = jax.device_put(zeros, self.devices[0])
            given = self._arguments(drawn, self.planned.plans[0], self.blocks)
            traced = self._program.lower(*given)
        except BaseException as error:
            lowered.set_exception(error)
            return
        lowered.set_result(None)
        traced.compile()

    @property
    def _program(self) -> Callable[..., PyTree]:
        return program(self.devices[0].platform)

    def _chosen(self, numbers: np.ndarray, used: np.ndarray, k: int) -> tuple[PyTree, ...]:
        """Arguments of `draw_inputs` for call number `k`."""
        device = self.devices[k % len(self.devices)]
        given = jax.device_put((jnp.asarray(numbers), jnp.asarray(used)), device)
        return self.planned.campaign, self.key, *given

    def _arguments(self, drawn: Drawn, plans: Plans, blocks: Blocks) -> tuple[PyTree, ...]:
        """Arguments of the compiled program of the missions."""
        planned = self.planned
        given = planned.campaign, planned.accuracy, drawn, plans, blocks
        return *given, planned.samples, planned.small


def call_size(devices: Sequence[jax.Device]) -> int:
    """Number of runs in one call on these devices."""
    return CALL if devices[0].platform == "cpu" else ACCELERATOR_CALL


def _filled(numbers: np.ndarray, size: int) -> np.ndarray:
    """The numbers, padded with the last one to a multiple of `size`."""
    return np.concatenate([numbers, np.full(-numbers.size % size, numbers[-1])])


def _replace(results: RunResults, runs: np.ndarray, again: RunResults) -> None:
    """Put the repetitions of these `runs` in their places."""
    spent = results.evaluations[runs]
    for old, new in zip(jax.tree.leaves(results), jax.tree.leaves(again), strict=True):
        old[..., runs] = new
    # The cost of a repeated run is that of all attempts.
    results.evaluations[runs] += spent


def _digest(results: RunResults) -> str:
    hashed = hashlib.sha256()
    for name, x in (*sorted(results.inputs.items()), *sorted(results.outputs.items())):
        hashed.update(name.encode() + np.ascontiguousarray(x[:CALL]).tobytes())
    hashed.update(np.ascontiguousarray(results.status[:CALL]).tobytes())
    return hashed.hexdigest()
