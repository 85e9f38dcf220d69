"""Twenty scenes drawn at random, once and for all, from the registry of systems of the tests.

Systems with a closed form are integrated all the same."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

TESTS = Path(__file__).parent.parent / "tests"
SEED, COUNT = 52, 20
# Of the span in which a system of the registry does something worth seeing.
SHARES = (0.5, 1.0)


def scenes() -> dict[str, Callable[[], tuple[Any, Any, Any]]]:
    """System, state and times of each scene, by name."""
    sys.path.append(str(TESTS))
    from systems import SAMPLES, Integrated

    random = np.random.default_rng(SEED)
    known = [sample for sample in SAMPLES if not sample.sweep]
    chosen = random.permutation(len(known))[:COUNT]
    shares = random.uniform(*SHARES, COUNT)

    def scene(sample: Any, share: float) -> Callable[[], tuple[Any, Any, Any]]:
        exact = sample.system.closed_form() is not None
        system = Integrated(sample.system) if exact else sample.system
        return lambda: (system, sample.state, jnp.array([0.0, share * sample.span]))

    pairs = zip(chosen, shares, strict=True)
    return {known[k].name.replace("_", " "): scene(known[k], share) for k, share in pairs}
