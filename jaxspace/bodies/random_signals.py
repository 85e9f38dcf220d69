"""Random signals of the time: coloured and white noise, one signal for each seed.

    x_{k+1} = q x_k + sqrt(1 - q^2) z_k,   q = exp(-h/tau)              coloured, R = exp(-|s|/tau)
    x_k = z_k                                                           white up to 1/(2 h)

    symbol   meaning                                                    unit
    x_k      value at the time k h, of variance one                     1
    h, tau   step of the signal, correlation time                       s
    z_k      independent standard normal numbers                        1
    R        correlation of two values a time s apart                   1

A coloured signal is an Ornstein-Uhlenbeck process, sampled exactly. A white one has the two-sided
spectral density S = sigma^2 h for values with the standard deviation sigma, below 1/(2 h) in Hz:
its integral over a time T has the variance S T, to the order h/T.

The values come from the seed and their number alone, and not from the steps of an integration or
from other runs: a run has the same signal alone, in a batch, on another machine and after a
restart. Between the values the signal is cubic with a continuous slope (`hermite.py`), so that
no time is a break, and adaptive methods resolve it. That removes a few hundredths of the variance
between two values where tau is a few steps. Derivatives by the deviation and the correlation time
are those of the path with these numbers z.

Source: Gardiner, Handbook of Stochastic Methods, 4.4; Gillespie, Phys. Rev. E 54, 1996, 2084.
"""

__all__ = ["Fluctuation", "RandomSignal"]

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import (
    AbstractParameters,
    NumberField,
    OptionalNumberField,
    Scalar,
    argument,
    check,
    constructor,
    quantity,
)
from ..core.checks import is_concrete
from ..core.field_types import check_types
from ..core.hermite import taken, weights, with_slopes
from ..core.limits import Limit
from ..core.quantities import check_declared
from ..core.random_paths import longitudinal, normal_numbers
from ..core.safe import safe_sqrt
from ..core.types import Flag, as_float, as_optional_float

MOST_VALUES = 200_000
LARGEST_DEVIATION = 0.3

SEED = argument(
    "", doc="any number: each one gives another signal; in a campaign, one for each run"
)
DURATION = argument("s", positive=True, fixed=True, doc="of the signal, which starts at t = 0")
STEP = argument("s", positive=True, fixed=True, doc="between the values of the signal")
CORRELATION_TIME = argument(
    "s", positive=True, doc="after which the correlation has fallen by the factor e; a few steps"
)


@final
class RandomSignal(AbstractParameters):
    """A signal with the standard deviation one, of one or of several independent components.

    - `duration`, s: of the signal, which starts at t = 0.
    - `step`, s: between its values.
    - `components`: their number.

    Raises `InputError` for a number outside of its range, for more than 200,000 values, and for a
    step beyond the correlation time."""

    seed: NumberField = quantity(
        "", doc="any number: each one gives another signal; in a campaign, one for each run"
    )
    # Static: they set how many values there are. The checker takes the quantity for a default.
    duration: float = eqx.field(static=True)  # pyright: ignore[reportGeneralTypeIssues]
    step: float = eqx.field(static=True)  # pyright: ignore[reportGeneralTypeIssues]
    correlation_time: OptionalNumberField = quantity(
        "s", positive=True, optional=True, doc="without it the noise is white"
    )
    components: int = eqx.field(static=True, default=1)
    data: Float[Array, "values numbers *#runs"] = eqx.field(default=None)

    def __init__(
        self,
        seed: Scalar,
        duration: float,
        step: float,
        correlation_time: Scalar | None = None,
        components: int = 1,
    ):
        self.seed, self.correlation_time = as_float(seed), as_optional_float(correlation_time)
        self.duration, self.step, self.components = duration, step, components
        check_types(self, "duration", "step", "components")
        check_declared(self, "seed", "correlation_time")
        for name in ("duration", "step"):
            x = getattr(self, name)
            ok = is_concrete(x) and np.ndim(x) == 0 and 0.0 < float(x) < np.inf
            check(ok, f"RandomSignal.{name}", x, "a single number, positive and finite, in s")
        single = is_concrete(components) and np.ndim(components) == 0 and components > 0
        check(single, "RandomSignal.components", components, "a single whole number from 1 on")
        self.duration, self.step, self.components = float(duration), float(step), int(components)
        few = self.duration / self.step <= MOST_VALUES
        what = f"at least 1/{MOST_VALUES} of the duration, in s"
        check(few, "RandomSignal.step", self.step, what)
        tau = self.correlation_time
        if tau is not None and is_concrete(tau):
            slow = bool(np.all(np.asarray(tau) >= self.step))
            check(slow, "RandomSignal.step", self.step, "at most the correlation time, in s")
        count = int(np.ceil(self.duration / self.step)) + 1
        x = normal_numbers(self.seed, (count, self.components))
        if tau is not None:
            steps = jnp.broadcast_to(self.step / tau, (count - 1, *jnp.shape(tau)))
            rows = [longitudinal(steps, x[:, k]) for k in range(self.components)]
            x = jnp.stack(rows, axis=1)
        self.data = with_slopes((self.step * np.arange(count)).astype(x.dtype), x)

    def at(self, t: Scalar) -> Float[Array, "components *#runs"]:
        """The signal at the time `t`, s; before its start and behind its end that of the end."""
        last = self.data.shape[0] - 2
        t = as_float(t)
        place = jnp.clip(t / self.step, 0.0, last + 1.0)
        k = jnp.minimum(jnp.floor(place), float(last))
        low, high = weights(self.step, self.step * (place - k))
        k = k.astype(jnp.int32)
        total = 0.0
        for (value, slope), number in ((low, k), (high, k + 1)):
            row = taken(self.data, number)
            # In the precision of the run: the seed is a plain number, whose own would be double.
            row = row if t.weak_type else row.astype(t.dtype)
            total = total + value * row[: self.components] + slope * row[self.components :]
        return jnp.asarray(total)

    def limits(self, t: Scalar, where: Flag = True) -> Sequence[Limit]:
        """The times of the signal, beyond which a run is outside of the model."""
        name = "the time of the random signal"
        margin = 1e-6 * self.step
        return (Limit(name, "s", t, 0.0, self.duration, margin, where),)


def deviation_of_white(density: Scalar, step: float) -> Scalar:
    """Standard deviation of the values, a `step` apart, of a noise with a spectral `density`."""
    return safe_sqrt(as_float(density) / step)


@final
class Fluctuation(AbstractParameters):
    """A random factor 1 + sigma x(t) with the mean one, on a density or a thrust.

    - `signal`: x, of one component."""

    signal: RandomSignal
    deviation: NumberField = quantity(
        "",
        low=0.0,
        high=LARGEST_DEVIATION,
        doc="standard deviation sigma of the factor, small enough for it to remain positive",
    )

    @classmethod
    @constructor(seed=SEED, duration=DURATION, step=STEP, correlation_time=CORRELATION_TIME)
    def coloured(
        cls,
        deviation: Scalar,
        correlation_time: Scalar,
        seed: Scalar,
        duration: float,
        step: float,
    ) -> "Fluctuation":
        """Coloured noise.

        **Arguments**

        - `deviation`: of the factor.
        - `correlation_time`, `duration`, `step`: s; `seed`: of the signal (`RandomSignal`)."""
        return cls(RandomSignal(seed, duration, step, correlation_time), deviation)

    @classmethod
    @constructor(
        sets=("deviation",),
        density=argument("s", non_negative=True, doc="two-sided spectral density of the factor"),
        seed=SEED,
        duration=DURATION,
        step=STEP,
    )
    def white(cls, density: Scalar, seed: Scalar, duration: float, step: float) -> "Fluctuation":
        """White noise up to 1/(2 step), in Hz.

        **Arguments**

        - `density`: two-sided spectral density of the factor, 1/Hz.
        - `seed`, `duration`, `step`: as in `coloured`."""
        return cls(RandomSignal(seed, duration, step), deviation_of_white(density, step))

    def factor(self, t: Scalar) -> Scalar:
        """The factor at the time `t`, s."""
        return 1.0 + self.deviation * self.signal.at(t)[0]

    def limits(self, t: Scalar, where: Flag = True) -> Sequence[Limit]:
        """As of `RandomSignal`."""
        return self.signal.limits(t, where)
