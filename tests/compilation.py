"""The amount of compilation of first calls, in numbers that do not depend on the load of a machine.

    python tests/compilation.py             measure, and print the table
    python tests/compilation.py --renew     write it to tests/compilation.csv

All calls are made in one process, in the order of the table; what an earlier one has traced or
compiled, a later one finds. The columns:

- `programs`: functions that are compiled.
- `equations`: operations that are traced, each as often as it is traced.
- `operations`: those of StableHLO in the lowered programs, for any processor.
- `instructions`: those of the optimised programs, which depend on the processor.
"""

import csv
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
from jax._src import compiler
from jax._src.interpreters import partial_eval

import jaxspace
from jaxspace import BodyState, Event, simulate, simulate_batch
from jaxspace.dispersion import disperse
from jaxspace.io import load
from jaxspace.optimization import Criterion, minimise
from jaxspace.orbits import TwoBody
from jaxspace.simulation import simulate_compact

SCENES = Path(__file__).parents[1] / "examples/scenes"
TABLE = Path(__file__).with_suffix(".csv")
COLUMNS = ("programs", "equations", "operations", "instructions")
# The parts of a traced function that may contain further operations.
_TRACES = ("process_primitive", "process_custom_jvp_call", "process_custom_vjp_call")


@contextmanager
def counted() -> Iterator[dict[str, int]]:
    """The counts of the columns within a context, complete at its end."""
    counts = dict.fromkeys(COLUMNS, 0)
    compile_it = compiler.backend_compile_and_load
    trace = partial_eval.DynamicJaxprTrace
    processes = {name: getattr(trace, name) for name in _TRACES}

    def compile_and_count(backend, module, *args, **kwargs):
        counts["operations"] += _operations(module.operation)
        program = compile_it(backend, module, *args, **kwargs)
        counts["programs"] += 1
        texts = [one.to_string() for one in program.hlo_modules()]
        counts["instructions"] += sum(text.count(" = ") for text in texts)
        return program

    def counting(process: Callable) -> Callable:
        def process_and_count(*args, **kwargs):
            counts["equations"] += 1
            return process(*args, **kwargs)

        return process_and_count

    compiler.backend_compile_and_load = compile_and_count
    for name, process in processes.items():
        setattr(trace, name, counting(process))
    try:
        yield counts
    finally:
        compiler.backend_compile_and_load = compile_it
        for name, process in processes.items():
            setattr(trace, name, process)


def _operations(operation) -> int:
    """The number of operations in one of StableHLO."""
    inner = (each for region in operation.regions for block in region for each in block)
    return 1 + sum(_operations(each.operation) for each in inner)


SYSTEM = TwoBody(1.0)
TIMES = jnp.array([0.0, 1.0, 3.0])


def _state(x: float = 1.2) -> BodyState:
    return BodyState(jnp.array([x, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))


def _batch() -> BodyState:
    return jax.tree.map(lambda x: jnp.stack(8 * [x], axis=-1), _state())


def _height(t, y: BodyState):
    return y.position[1]


def _distance(y0: BodyState):
    return jnp.sum(simulate(SYSTEM, y0, TIMES, accuracy=1e-8).final.position ** 2)


def _rosenbrock(x) -> Criterion:
    return Criterion((1.0 - x[0]) ** 2 + 100.0 * (x[1] - x[0] ** 2) ** 2)


def _scene(name: str) -> Callable[[], object]:
    return lambda: load(SCENES / f"{name}.toml").simulate()


def _ascent() -> object:
    file = load(SCENES / "pad_to_orbit.toml")

    def end(mass):
        y0 = eqx.tree_at(lambda y: y.mass, file.y0, mass)
        return jnp.sum(simulate_compact(file.mission, y0, steps=40).final.position ** 2)

    return jax.jit(jax.grad(end))(file.y0.mass)


CALLS: dict[str, Callable[[], object]] = {
    "simulate": lambda: simulate(SYSTEM, _state(), TIMES, accuracy=1e-8),
    "simulate to an event": lambda: simulate(
        SYSTEM, _state(), TIMES, events=(Event(_height, -1),), accuracy=1e-8
    ),
    "simulate_batch": lambda: simulate_batch(SYSTEM, _batch(), TIMES, accuracy=1e-8),
    "gradient of simulate": lambda: jax.grad(_distance)(_state()),
    "minimise": lambda: minimise(_rosenbrock, jnp.array([-1.0, 1.0])),
    **{
        f"scene {name}": _scene(name)
        for name in (
            *("two_body", "top", "two_gimbal_gyro", "gyrocompass", "dual_spin", "double_pendulum"),
            *("explorer_7", "gravity_turn", "kick_stage", "stable_platform", "thrown_disk"),
            *("wheel_slew", "sampled_slew", "settling_coin", "air_brake", "booster_return"),
            *("molniya", "lunar_distance", "flexible_stage", "inertial_navigator"),
        )
    },
    "gradient of the ascent": _ascent,
    "search of launch": lambda: load(SCENES / "launch.toml").optimize(),
    "campaign of kick_stage": lambda: disperse(
        load(SCENES / "kick_stage.toml").campaign(warn=False), 20
    ),
}


def measured() -> dict[str, dict[str, int]]:
    """The counts of all calls."""
    jaxspace.enable_x64()
    # A program from a cache is not compiled.
    jax.config.update("jax_enable_compilation_cache", False)
    result = {}
    for name, call in CALLS.items():
        with counted() as counts:
            jax.block_until_ready(jax.tree.leaves(call()))
        result[name] = counts
    return result


def read() -> dict[str, dict[str, int]]:
    """The counts of the table."""
    with TABLE.open() as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {row["call"]: {name: int(row[name]) for name in COLUMNS} for row in rows}


def write(counts: dict[str, dict[str, int]]) -> None:
    """Write the table, with the comments at its head as they are."""
    head = [line for line in TABLE.read_text().splitlines() if line.startswith("#")]
    rows = [",".join(map(str, (name, *row.values()))) for name, row in counts.items()]
    TABLE.write_text("\n".join([*head, ",".join(("call", *COLUMNS)), *rows]) + "\n")


if __name__ == "__main__":
    found = measured()
    if "--renew" in sys.argv[1:]:
        write(found)
    for call, row in found.items():
        print(f"{call:<32}" + "".join(f"{x:>10}" for x in row.values()))
