"""One closed form for the fuzz test: a function of numbers, and the inputs at which it starts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Form:
    """A function of an array of numbers.

    - `function`: returns an array, or a tuple of arrays: each is measured by its own size.
    - `computes`: the public names whose formulas it evaluates, "package.name" or
      "package.Class.method".
    - `starts`: inputs on and beside the singular places, and at an ordinary place.
    - `blocks`: of a function that returns one array, how many outputs belong to one size.
    - `vectors`: how many inputs belong to one vector, for all inputs: their condition is that of a
      rounding of its length. Without them each input is rounded by itself.
    - `exact`: the outputs in mpmath, for what no trace can show, such as the root of an iteration;
      without it the function itself is traced.
    - `label`: of a system, its name in the registry."""

    function: Callable
    computes: tuple[str, ...]
    starts: Sequence[tuple[float, ...]]
    blocks: tuple[int, ...] = ()
    vectors: tuple[int, ...] = ()
    exact: Callable | None = None
    label: str = ""

    @property
    def name(self) -> str:
        """The label, or the name of the function."""
        return self.label or self.function.__name__

    @property
    def package(self) -> str:
        """That of the first name, or "systems"."""
        return "systems" if self.label else self.computes[0].partition(".")[0]
