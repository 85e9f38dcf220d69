"""The hunt: searches for the inputs at which the closed forms are worst: `python tests/hunt.py`.

For each function random inputs, also close to the inputs of its hard cases, which lie on its
singular places; then steps from the worst of them to worse ones. The error is measured in roundings
of the value times the condition number, against the same formulas in forty digits (`mp_trace.py`),
and so are both modes of differentiation, against central differences in forty digits.

It writes the page of the manual `docs/explanation/hunt.md`, and ends with status 1 where a value is
off by more than 100."""

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import mp_trace
import numpy as np
from mpmath import mp, mpf

from jaxspace.verification import CASES

DIGITS = 40
STEP = mpf(10) ** -15
EPS = float(np.finfo(float).eps)
DEFECT = 100.0
PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "hunt.md"
# Runs are judged by `nan_hunt.py`; the optimum of stages is a root that lives in no jaxpr.
LEFT_OUT = ("simulation", "dispersion", "optimization")


@dataclass
class Worst:
    """The worst place found of one function: roundings, and the inputs there."""

    name: str
    places: int = 0
    value: float = 0.0
    inputs: tuple[float, ...] = ()
    slopes: float = 0.0
    slope_inputs: tuple[float, ...] = ()


class Subject:
    """One function, with what is needed to measure its error at a place."""

    def __init__(self, function: Callable, starts: list[tuple[float, ...]]):
        self.name = function.__name__
        self.starts = [np.asarray(s, float) for s in starts]
        self.trace = mp_trace.traced(function, self.starts[0])
        self.compiled = jax.jit(
            lambda x: (function(x), jax.jacfwd(function)(x), jax.jacrev(function)(x))
        )

    def exact(self, x) -> list[mpf]:
        inputs = np.empty(len(x), object)
        inputs[:] = [mpf(float(c)) if not isinstance(c, mpf) else c for c in x]
        return list(mp_trace.evaluate(self.trace, [inputs])[0])

    def error(self, x: np.ndarray) -> float:
        """Roundings of the value times its condition number; infinite for a number where there is
        none, and the other way round."""
        value, forward, _ = (np.asarray(y) for y in self.compiled(jnp.asarray(x)))
        truth = self.exact(x)
        size = np.abs(value) + np.abs(forward) @ np.abs(x)
        return _roundings(value, truth, size)

    def slope_error(self, x: np.ndarray) -> float:
        """The same of the derivatives in both modes; their condition from their change by a random
        rounding of the inputs."""
        _, *modes = (np.asarray(y) for y in self.compiled(jnp.asarray(x)))
        truth = self._differences([mpf(float(c)) for c in x])
        signs = np.random.default_rng(1).choice([-1, 1], (2, len(x)))
        small = mpf(10) ** -10
        condition = np.abs(np.asarray(truth, float))
        for sign in signs:
            moved = self._differences(
                [mpf(float(c)) * (1 + int(s) * small) for c, s in zip(x, sign, strict=True)]
            )
            condition = condition + np.abs(np.asarray((moved - truth) / small, float))
        size = np.max(condition, axis=1, keepdims=True)
        return max(_roundings(found, truth, size + 0.0 * found) for found in modes)

    def _differences(self, x: list[mpf]) -> np.ndarray:
        columns = []
        for number, c in enumerate(x):
            h = STEP * (abs(c) or mpf(1))
            ahead, behind = (
                self.exact([*x[:number], c + step, *x[number + 1 :]]) for step in (h, -h)
            )
            columns.append([(a - b) / (2 * h) for a, b in zip(ahead, behind, strict=True)])
        return np.asarray(columns, object).T


def _roundings(found: np.ndarray, truth, size: np.ndarray) -> float:
    """The largest |found - truth| in roundings of the largest size."""
    finite = size[np.isfinite(size)]
    largest = float(np.max(finite, initial=0.0)) or 1.0
    worst = 0.0
    for a, b in zip(np.ravel(found), np.ravel(np.asarray(truth, object)), strict=True):
        if not mp.isfinite(b):
            # Infinite there: a number here is an overflow of the other kind.
            worst = max(worst, 0.0 if not np.isfinite(a) or abs(a) > 1e15 else np.inf)
        elif not np.isfinite(a):
            worst = np.inf
        else:
            worst = max(worst, float(abs(mpf(float(a)) - b)) / (EPS * largest))
    return worst


def near(x: np.ndarray, key: np.random.Generator) -> np.ndarray:
    """A neighbour: some of the inputs moved by a share from 1e-16 to 1, zeros too."""
    size = np.where(x == 0.0, 1.0, np.abs(x))
    share = 10.0 ** key.uniform(-16.0, 0.0, x.shape) * key.choice([-1.0, 1.0], x.shape)
    moved = x + size * share * (key.uniform(size=x.shape) < 0.5)
    # What is positive stays so: moments, masses, gravitational parameters.
    return np.where(x > 0.0, np.abs(moved), moved)


def legal(subject: Subject, x: np.ndarray) -> bool:
    """Whether the function has a value there, in double precision and in forty digits."""
    value = np.asarray(subject.compiled(jnp.asarray(x))[0])
    return bool(np.all(np.isfinite(value)))


def hunt(subject: Subject, places: int, ascents: int, slopes: int, seed: int = 0) -> Worst:
    """The worst of so many random places and steps from the worst on."""
    key = np.random.default_rng(seed)
    seen: list[tuple[float, np.ndarray]] = []

    def look(x: np.ndarray) -> float:
        if not legal(subject, x):
            return -1.0
        error = subject.error(x)
        seen.append((error, x))
        return error

    for number in range(places):
        look(near(subject.starts[number % len(subject.starts)], key))
    if not seen:
        return Worst(subject.name)
    best, x = max(seen, key=lambda pair: pair[0])
    for _ in range(ascents):
        moved = near(x, key)
        if (error := look(moved)) > best:
            best, x = error, moved
    found = Worst(subject.name, len(seen), best, tuple(map(float, x)))
    seen.sort(key=lambda pair: -pair[0])
    for _, x in [*seen[: slopes // 2], *seen[-(slopes - slopes // 2) :]][:slopes]:
        # Off the exact switch of a series, across which differences mean nothing.
        x = x * (1.0 + 1e-12 * key.uniform(0.5, 1.0, x.shape))
        if (error := subject.slope_error(x)) > found.slopes:
            found.slopes, found.slope_inputs = error, tuple(map(float, x))
    return found


def subjects(names: Sequence[str] = ()) -> Iterator[Subject]:
    """The closed forms of these names among the hard cases, or all."""
    starts: dict[Callable, list[tuple[float, ...]]] = {}
    for case in CASES:
        if not case.name.startswith(LEFT_OUT):
            starts.setdefault(case.function, []).append(case.inputs)
    for function, places in starts.items():
        if not names or function.__name__ in names:
            yield Subject(function, places)


HEAD = """# The hunt

`make hunt` searches for the inputs at which the closed forms are worst, and writes this page:
random inputs, also close to the singular places of the [hard cases](../reference/hard_cases.md),
and steps from the worst ones to worse ones. Errors are in roundings (2.2e-16) times the condition
number of the place: what the rounding of the inputs alone would do is about 1. Above 100 is a
defect.

The truth is an evaluation of the same formulas in forty digits. It sees every rounding,
cancellation and overflow, and by differences every wrong rule of a derivative. It does not see
the truncation of a series, a quadrature or a fixed number of steps, which it repeats; the hard
cases, whose truths come from other formulas, do. Next to a singular place the condition of a
derivative is estimated by two random directions, so that its figure is rougher.

| Function | Places | Value | Derivatives | Inputs of the worst value | of the worst derivative |
|---|---|---|---|---|---|
"""


def page(rows: list[Worst]) -> str:
    def shown(x: tuple[float, ...]) -> str:
        return ", ".join(f"{c:.17g}" for c in x)

    lines = [
        f"| `{r.name}` | {r.places} | {r.value:.3g} | {r.slopes:.3g} | {shown(r.inputs)} | "
        f"{shown(r.slope_inputs)} |"
        for r in rows
    ]
    return HEAD + "\n".join(lines) + "\n"


def main() -> int:
    jax.config.update("jax_enable_x64", True)
    mp.dps = DIGITS
    names = sys.argv[1:]
    rows = []
    for subject in subjects(names):
        started = time.perf_counter()
        rows.append(hunt(subject, 60, 60, 8))
        seconds = time.perf_counter() - started
        print(json.dumps({**vars(rows[-1]), "seconds": round(seconds, 1)}), flush=True)
    if not names:
        PAGE.write_text(page(rows))
    return int(any(row.value > DEFECT for row in rows))


if __name__ == "__main__":
    sys.exit(main())
