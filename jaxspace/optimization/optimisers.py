"""Optimisers of optax with the settings that a search of this package has use for, by name.

    "sqp"      quadratic programmes: not an optimiser of optax, but a name of `minimise`
    "lbfgs"    L-BFGS with a line search by strong Wolfe conditions; takes no rate
    "adam", "adamw", "nadam", "rmsprop", "sgd"     steps of a rate that falls by a cosine

`minimise` accepts any other optimiser of optax directly. A rate is in sizes of the unknowns: 0.01
is a hundredth of a size for each step of Adam. It falls to a thousandth of itself over the steps of
the search, without which the last steps are as long as the first ones.
"""

__all__ = ["NAMES", "lbfgs", "named_optimiser"]

import functools

from ..core import InputError
from ..minimisation.optimiser import SQP, Optimiser

RATES = {"adam": 0.02, "adamw": 0.02, "nadam": 0.02, "rmsprop": 0.01, "sgd": 0.05}
"""The rates by default: those with which the problems of the tests converge."""
NAMES = (SQP, "lbfgs", *RATES)
# Of the first rate, at the last step.
LAST_RATE = 1e-3


@functools.cache
def lbfgs() -> Optimiser:
    """L-BFGS of optax with its line search; one object, so that programs with it are compiled
    once."""
    import optax

    return optax.lbfgs()


@functools.cache
def named_optimiser(name: str, rate: float | None = None, max_steps: int = 200) -> Optimiser:
    """The optimiser with a name, for a search of `max_steps`.

    **Arguments**

    - `name`: one of `NAMES`.
    - `rate`: the first length of steps, in sizes of the unknowns; `None` for that of the name.
    - `max_steps`: over which the rate falls.

    **Raises** `InputError` for another name, or a rate that is not positive or not supported by the
    optimiser.
    """
    if name not in NAMES:
        raise InputError(
            f"optimiser is {name!r}: it must be one of {', '.join(NAMES)}."
            f"{InputError.hint(name, NAMES)}"
        )
    if name not in RATES:
        if rate is not None:
            raise InputError(f"rate is {rate:g}: {name} chooses its own step length, omit rate.")
        return lbfgs() if name == "lbfgs" else SQP
    first = RATES[name] if rate is None else rate
    if not first > 0.0:
        raise InputError(f"rate is {first:g}: it must be positive.")
    import optax

    return getattr(optax, name)(optax.cosine_decay_schedule(first, max_steps, LAST_RATE))
