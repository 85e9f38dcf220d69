"""An edge case: one row of a table, and the origin of its reference values."""

import functools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias, final

from jaxtyping import Array, Float

CaseFunction: TypeAlias = Callable[[Float[Array, " inputs"]], Float[Array, " outputs"]]
Rows: TypeAlias = tuple[tuple[float, ...], ...]

TRUTHS = Path(__file__).parent / "truths.json"


@final
@dataclass(frozen=True)
class Case:
    """One place at which a formula is easily wrong.

    - `name`: "package: difficulty".
    - `function`: from the inputs, (inputs,), to the outputs, (outputs,). Cases of one function
      share one compiled program.
    - `inputs`: numbers that are exactly representable in double precision.
    - `why`: origin of the tolerances.
    - `roundings`: the error allowed in the value, in roundings times the condition number.
    - `slope_roundings`: the error allowed in the derivatives, in roundings of the largest one of
      the same output.
    - `value`, `slopes`: reference in closed form. Where `value` is `None`, the truth is stored in
      `truths.json`, to twenty digits; `tests/truths.py` computes it. `slopes` has a row for each
      output and is empty where the value has no derivatives.
    - `single`: the reason why float32 cannot represent this case; empty if it can."""

    name: str
    function: CaseFunction
    inputs: tuple[float, ...]
    why: str = "a few operations"
    roundings: float = 8.0
    slope_roundings: float = 32.0
    value: tuple[float, ...] | None = None
    slopes: Rows = ()
    single: str = ""

    def truth(self) -> tuple[tuple[float, ...], Rows]:
        """The right outputs, (outputs,), and derivatives, (outputs, inputs)."""
        if self.value is not None:
            return self.value, self.slopes
        stored = _stored()[self.name]
        return tuple(map(float, stored["value"])), tuple(
            tuple(map(float, row)) for row in stored["slopes"]
        )

    def conditioning(self) -> float:
        """Change by one rounding of every input and output, in roundings of one: the largest of
        |f_i| + sum_j |df_i/dx_j x_j|."""
        value, slopes = self.truth()
        sizes = []
        for number, f in enumerate(value):
            # An infinite slope gives no measure of finite changes.
            row = slopes[number] if slopes else ()
            parts = (abs(s * x) for s, x in zip(row, self.inputs, strict=bool(row)))
            sizes += [size for size in [abs(f) + sum(p for p in parts if p < math.inf)]]
        # Of zeros without finite slopes the error counts as it is.
        return max((s for s in sizes if 0.0 < s < math.inf), default=1.0)


@functools.cache
def _stored() -> dict[str, dict[str, list]]:
    return json.loads(TRUTHS.read_text())["cases"]
