"""The same work at widths of ten thousand to ten million runs on one device, in both precisions,
with the error of a sample, and what limits each row.

`python -m benchmarks --device gpu` measures it, on any machine with `--device cpu`, and with
`--widths 10000 100000` at other widths. The arithmetic and the memory traffic are those that the
compiler counts: a row far below what the device can do of both is limited by the starts of its
kernels."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.lambert import lambert
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import Stormer

from . import kepler, low_orbits
from . import lambert as transfers
from ._measure import exact_position, in_turn, worst

WIDTHS = (10_000, 100_000, 1_000_000, 10_000_000)
PRECISIONS = ("float64", "float32")
CHECKED = 16
# Enough for 1e-8 over the day of the low orbits.
STEPS = Stormer(12, steps=1310)


def moved(r, v, t):
    """Positions of two-body motion at later times."""
    return kepler_flow(r, v, t, 1.0)[0]


def slopes(r, v, t):
    """Derivatives of a sum of them with respect to the positions, in reverse mode."""
    return jax.grad(lambda r: jnp.sum(moved(r, v, t)))(r)


def departures(start, end, duration):
    """Velocities at the start of transfers."""
    return lambert(start, end, duration, 1.0)[0]


def days(y0):
    """Positions of low orbits under oblateness a day later, in fixed steps."""
    ts = jnp.array([0.0, low_orbits.DAY], y0.position.dtype)
    accuracy = Accuracy(rtol=1.0, method=STEPS)
    return simulate_batch(low_orbits.SCENE, y0, ts, accuracy=accuracy).final.position


def error_of_motion(found, given) -> float:
    """The worst relative error of positions against forty digits."""
    r, v, t = (np.asarray(x, float) for x in given)
    exact = [exact_position(r[:, k], v[:, k], t[k]) for k in range(CHECKED)]
    return worst(found, np.stack(exact, axis=1))


def error_of_transfers(found, given) -> float:
    """How far the worst transfer misses its end, in the distance of the end."""
    start, end, duration = (np.asarray(x, float) for x in given)
    exact = [exact_position(start[:, k], found[:, k], duration[k]) for k in range(CHECKED)]
    return worst(np.stack(exact, axis=1), end[:, :CHECKED])


def in_double(work: Callable[..., Any]) -> Callable[..., float]:
    """The worst relative difference from the same work in double precision."""

    def error(found, given) -> float:
        return worst(found, work(*cut(given, CHECKED, "float64")))

    return error


# Work, what it starts from, and the error of its first runs.
WORKS: dict[str, tuple[Callable[..., Any], Callable[[], Any], Callable[..., float]]] = {
    "kepler": (moved, kepler.states, error_of_motion),
    "lambert": (departures, transfers.pairs, error_of_transfers),
    "gradients of kepler": (slopes, kepler.states, in_double(slopes)),
    "low_orbits": (days, lambda: (low_orbits.orbits(),), in_double(days)),
}


def cut(tree: Any, width: int, precision: str) -> Any:
    """As many runs of arrays with the runs last, repeated where there are fewer."""

    def some(x):
        return np.take(np.asarray(x), np.arange(width) % x.shape[-1], axis=-1).astype(precision)

    return jax.tree.map(lambda x: jnp.asarray(some(x)), tree)


def measure(
    device: str, widths: Sequence[int] = WIDTHS, names: Sequence[str] = tuple(WORKS)
) -> dict[str, dict[str, float]]:
    """Runs a second, error, and work of the compiler's count, of each work, width and precision."""
    place, rows = jax.devices(device)[0], {}
    for name in names:
        work, starts, error = WORKS[name]
        whole = starts()
        for precision in PRECISIONS:
            for width in widths:
                given = jax.device_put(cut(whole, width, precision), place)
                program = jax.jit(work).lower(*given).compile()
                label = f"{name}, {width} runs, {precision}"
                row = in_turn({label: lambda: program(*given)}, width)[label]  # noqa: B023
                rows[label] = {
                    "runs_per_second": row["runs_per_second"],
                    "worst_relative_error": error(
                        np.asarray(program(*given), float)[:, :CHECKED], given
                    ),
                    **counted(program, row["runs_per_second"] / width),
                }
    return rows


def counted(program: Any, calls_per_second: float) -> dict[str, float]:
    """Arithmetic and memory traffic a second, of one pass through each loop, as XLA counts."""
    seen = program.cost_analysis() or {}
    return {
        "1e9_operations_per_second": seen.get("flops", np.nan) * calls_per_second / 1e9,
        "1e9_bytes_per_second": seen.get("bytes accessed", np.nan) * calls_per_second / 1e9,
    }
