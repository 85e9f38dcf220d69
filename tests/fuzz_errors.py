"""Fuzz test: searches for the inputs at which the closed forms and the systems are worst.

`python tests/fuzz_errors.py [--seconds S] [NAME ...]`: S of search for each function (`forms/`).

For each function random inputs, also close to its singular places; then steps from the worst of
them to worse ones. The error is measured in roundings of the value times the condition number, for
which a vector is rounded by its length, against the same formulas in forty digits (`mp_trace.py`),
and so are both modes of differentiation, against central differences in forty digits.

What it finds it keeps in `fuzz_errors.json`, from which it writes the page of the manual
`docs/explanation/fuzz_testing.md`; with names it renews their rows alone. It ends with status 1
where a value or a derivative is off by more than 100 and no note says why."""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import fuzz_page
import jax
import jax.numpy as jnp
import mp_trace
import numpy as np
from forms import forms
from forms.form import Form
from mpmath import mp, mpf

DIGITS = 40
# Derivatives by differences of these steps, and their change by this share of the inputs.
SLOPE_DIGITS = 60
STEP = mpf(10) ** -25
CHANGE = mpf(10) ** -28
EPS = float(np.finfo(float).eps)
SECONDS = 15.0
# Along so many directions the condition of a derivative is looked at.
MOST_DIRECTIONS = 40


class Limits(NamedTuple):
    """How long the search for one function goes on: whatever comes first."""

    places: int = 400
    ascents: int = 200
    slopes: int = 24
    seconds: float = SECONDS


@dataclass
class Worst:
    """The worst places found of one function: roundings, and the inputs there."""

    name: str
    package: str = ""
    computes: tuple[str, ...] = ()
    places: int = 0
    value: float = 0.0
    inputs: tuple[float, ...] = ()
    slope_places: int = 0
    slopes: float = 0.0
    slope_inputs: tuple[float, ...] = field(default=())


class Subject:
    """One function, with what is needed to measure its error at a place."""

    def __init__(self, form: Form):
        self.form = form
        self.starts = [np.asarray(s, float) for s in form.starts]
        self.blocks = form.blocks
        self.vectors = form.vectors or (1,) * len(self.starts[0])

        def flat(x):
            found = form.function(x)
            parts = found if isinstance(found, tuple) else (found,)
            if len(parts) > 1 or not self.blocks:
                self.blocks = tuple(part.size for part in parts)
            return jnp.concatenate([jnp.ravel(part) for part in parts])

        self.trace = None if form.exact else mp_trace.traced(flat, self.starts[0])
        self.compiled = jax.jit(lambda x: (flat(x), jax.jacfwd(flat)(x), jax.jacrev(flat)(x)))

    def exact(self, x) -> list[mpf]:
        numbers = [c if isinstance(c, mpf) else mpf(float(c)) for c in x]
        if self.form.exact:
            return list(self.form.exact(numbers))
        inputs = np.empty(len(numbers), object)
        inputs[:] = numbers
        return list(mp_trace.evaluate(self.trace, [inputs])[0])

    def lengths(self, x) -> np.ndarray:
        """The size of what each input is rounded with: itself, or the vector that it belongs to.

        A component that is nearly zero is that in these axes alone. No formula that is the same in
        all axes can use more digits of it than a rounding of the whole vector leaves."""
        parts = np.split(np.asarray(x), np.cumsum(self.vectors)[:-1])
        # Not a sum of squares, which could leave the range of floats.
        return np.concatenate([np.full(len(part), np.max(np.abs(part))) for part in parts])

    def moved(self, x: Sequence[mpf], shares: Sequence[float | mpf]) -> list[mpf]:
        """The inputs, each moved by a share of its `lengths`."""
        return [c + s * size for c, s, size in zip(x, shares, self.lengths(x), strict=True)]

    def error(self, x: np.ndarray) -> float | None:
        """Roundings of the value times its condition number; infinite for a number where there is
        none, and the other way round. `None` where the function has no value."""
        value, forward, _ = (np.asarray(y) for y in self.compiled(jnp.asarray(x)))
        truth = self.exact(x)
        exists = all(mp.isfinite(b) and abs(b) < 1e300 for b in truth)
        if np.all(np.isfinite(value)) and exists:
            if np.any(np.isinf(forward)):
                # The end of a square root: any rounding of the inputs moves the value at will.
                return None
            size = np.abs(value) + np.abs(forward) @ self.lengths(x)
            found = _roundings(value, truth, size, self.blocks)
            # Within some roundings of a jump, as by the sign of a half turn, either is right.
            if found > fuzz_page.DEFECT and any(
                _roundings(value, beside, size, self.blocks) < fuzz_page.DEFECT
                for beside in self._beside(x)
            ):
                return None
            return found
        # Within some roundings of the end of its range either answer is right.
        if np.all(np.isfinite(value)) == exists or self._near_an_end(x, exists):
            return None
        return np.inf

    def _near_an_end(self, x: np.ndarray, exists: bool) -> bool:
        """Whether moving by some roundings decides if the function has a value."""
        return any(all(mp.isfinite(b) for b in beside) != exists for beside in self._beside(x))

    def _beside(self, x: np.ndarray) -> Iterator[list[mpf]]:
        """The values at places that are some roundings away."""
        for number in range(8):
            signs = np.random.default_rng(number).choice([-1, 1], len(x))
            yield self.exact(
                self.moved([mpf(float(c)) for c in x], [8 * EPS * int(s) for s in signs])
            )

    def slope_error(self, x: np.ndarray, key: np.random.Generator) -> float | None:
        """The same of the derivatives in both modes, each times its input or the length of its
        vector: roundings of the largest one of its block and of what a rounding of the inputs
        changes in those looked at. `None` where there is no derivative."""
        _, *modes = (np.asarray(y) for y in self.compiled(jnp.asarray(x)))
        scales = self._scales(x)
        some = key.permutation(len(x))[:4]
        size = np.max(np.nan_to_num(np.abs(modes[0])) * scales, axis=1)
        with mp.workdps(SLOPE_DIGITS):
            at = [mpf(float(c)) for c in x]
            truth = self._differences(at, some, STEP)
            if not all(mp.isfinite(c) for c in truth.flat):
                return None

            def error(directions) -> float:
                """With a condition number from the changes along these directions."""
                nonlocal size
                for signs in directions:
                    moved = self.moved(at, [int(s) * CHANGE for s in signs])
                    change = (self._differences(moved, some, STEP) - truth) / CHANGE
                    size = size + np.max(np.abs(np.nan_to_num(change.astype(float))), axis=1)
                return max(
                    _roundings((found * scales)[:, some], truth, size, self.blocks)
                    for found in modes
                )

            found = error(key.choice([-1, 1], (2, len(x))))
            if found < 0.3 * fuzz_page.DEFECT:
                return found
            # Differences that depend on their step are no derivative: a kink, a square root's end.
            other = self._differences(at, some, STEP / 64)
            if any(abs(a - b) > 1e-6 * abs(b) for a, b in zip(truth.flat, other.flat, strict=True)):
                return None
            # Two directions may miss what counts.
            alone = np.eye(len(x), dtype=int)
            if len(x) <= MOST_DIRECTIONS:
                return error(alone)
            # Tables have a thousand inputs: of each alone it would take half an hour.
            return error([*alone[some], *key.choice([-1, 1], (MOST_DIRECTIONS, len(x)))])

    def _scales(self, x) -> np.ndarray:
        """What the derivatives by each input are multiplied by: its `lengths`, or 1 for zero."""
        lengths = self.lengths(x)
        return np.where(lengths == 0, 1, lengths)

    def _differences(self, x: list[mpf], columns: Sequence[int], step: mpf) -> np.ndarray:
        """Derivatives times `_scales`."""
        found = []
        scales = self._scales(x)
        for number in columns:
            scale = scales[number]
            ahead, behind = (
                self.exact([*x[:number], x[number] + h, *x[number + 1 :]])
                for h in (step * scale, -step * scale)
            )
            found.append([(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)])
        return np.asarray(found, object).T


def _roundings(found: np.ndarray, truth, size: np.ndarray, blocks: Sequence[int]) -> float:
    """The largest |found - truth| in roundings of the largest size of its block."""
    worst, first = 0.0, 0
    truth = np.asarray(truth, object)
    for number in blocks:
        rows = slice(first, first + number)
        sizes = size[rows][np.isfinite(size[rows])]
        largest = float(np.max(sizes, initial=0.0)) or 1.0
        for a, b in zip(np.ravel(found[rows]), np.ravel(truth[rows]), strict=True):
            if not mp.isfinite(b):
                # Infinite there: a number here is an overflow of the other kind.
                error = 0.0 if not np.isfinite(a) or abs(a) > 1e15 else np.inf
            elif not np.isfinite(a):
                error = np.inf
            else:
                error = float(abs(mpf(float(a)) - b)) / (EPS * largest)
            worst = max(worst, error)
        first += number
    return worst


def near(x: np.ndarray, key: np.random.Generator) -> np.ndarray:
    """A neighbour: some of the inputs moved by a share from 1e-16 to 1, zeros too."""
    size = np.where(x == 0.0, 1.0, np.abs(x))
    share = 10.0 ** key.uniform(-16.0, 0.0, x.shape) * key.choice([-1.0, 1.0], x.shape)
    moved = x + size * share * (key.uniform(size=x.shape) < 0.5)
    # What is positive stays so: moments, masses, gravitational parameters.
    return np.where(x > 0.0, np.abs(moved), moved)


def search(subject: Subject, limits: Limits, seed: int = 0) -> Worst:
    """The worst of random places and of steps from the worst on."""
    key = np.random.default_rng(seed)
    seen: list[tuple[float, np.ndarray]] = []
    found = Worst(subject.form.name, subject.form.package, subject.form.computes)
    # Not the time that the first evaluation takes to compile.
    subject.error(subject.starts[0])
    # Of this process: others may share the machine.
    started = time.process_time()

    def late(share: float) -> bool:
        return time.process_time() - started > share * limits.seconds

    def look(x: np.ndarray) -> bool:
        error = subject.error(x)
        if error is None:
            return False
        seen.append((error, x))
        found.places += 1
        if error > found.value or not found.inputs:
            found.value, found.inputs = error, tuple(map(float, x))
            return True
        return False

    for number in range(limits.places):
        start = subject.starts[number % len(subject.starts)]
        # First the places themselves.
        look(start if number < len(subject.starts) else near(start, key))
        if late(0.4):
            break
    for _ in range(limits.ascents if seen else 0):
        if late(0.6) or found.value == np.inf:
            break
        look(near(np.asarray(found.inputs), key))
    # From the best and the worst of the values in turn.
    seen.sort(key=lambda pair: pair[0])
    for number in range(min(limits.slopes, len(seen))):
        _, x = seen[number // 2 if number % 2 else -1 - number // 2]
        # Off the exact switch of a series, across which differences mean nothing.
        x = x * (1.0 + 1e-12 * key.uniform(0.5, 1.0, x.shape))
        error = subject.slope_error(x, key)
        if error is not None:
            found.slope_places += 1
            if error > found.slopes:
                found.slopes, found.slope_inputs = error, tuple(map(float, x))
        if late(1.0):
            break
    return found


def subjects(names: Sequence[str] = ()) -> Iterator[Subject]:
    """The closed forms and the systems of these names, or all."""
    for form in every():
        if not names or form.name in names:
            yield Subject(form)


def every() -> list[Form]:
    """All that is searched."""
    # Here, because its arrays are made on import, in the precision that is set by then.
    from forms.systems import forms as systems

    return [*forms(), *systems()]


def main() -> int:
    jax.config.update("jax_enable_x64", True)
    mp.dps = DIGITS
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="functions; all without any")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, help="of search for each function"
    )
    asked = parser.parse_args()
    defect = False
    for subject in subjects(asked.names):
        started = time.perf_counter()
        row = search(subject, Limits(seconds=asked.seconds))
        seconds = round(time.perf_counter() - started, 1)
        print(f"{row.name}: {row.value:.3g}, derivatives {row.slopes:.3g}; {seconds} s", flush=True)
        fuzz_page.keep(row)
        explained = row.name in fuzz_page.NOTES
        defect = defect or max(row.value, row.slopes) > fuzz_page.DEFECT and not explained
    fuzz_page.write([form.name for form in every()])
    return int(defect)


if __name__ == "__main__":
    sys.exit(main())
