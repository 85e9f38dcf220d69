"""How long the next step is, by the error of the one before."""

import jax.numpy as jnp
import pytest

from jaxspace.core.types import as_float
from jaxspace.solvers.step_control import GROW, StepControl, StepController
from jaxspace.solvers.tolerances import Tolerance

SMALL, LARGE = 1e-9, 10.0
ORDER = 5.0


def proposals(errors, begun=True):
    """The lengths that follow steps with these errors, in turn, in units of the first."""
    tolerance = Tolerance(rtol=as_float(1e-9), atol=as_float(1e-12), run_axes=0)
    controller = StepController(tolerance, jnp.ones(1))
    start, end = jnp.asarray(1e-3), jnp.asarray(1e-3 + 1e-6)
    control = StepControl(end - start, jnp.asarray(begun), jnp.asarray(False))
    lengths = []
    for error in errors:
        after = controller.following(start, end, jnp.asarray(error), jnp.asarray(ORDER), control)
        start, end, control = after.start, after.end, after.state
        lengths.append(float(end - start) / 1e-6)
    return lengths


def test_a_step_with_a_small_error_grows():
    # To the rounding of the times, of which the steps are a millionth.
    assert proposals([SMALL]) == [pytest.approx(GROW, rel=1e-6)]


def test_a_step_after_a_rejected_one_does_not_grow_back():
    """What it was rejected for still lies ahead; the step after it may grow as any other."""
    rejected, behind, further = proposals([LARGE, SMALL, SMALL])
    assert rejected < 1.0
    assert behind < 1.0
    assert further == pytest.approx(GROW * behind, rel=1e-6)


def test_a_first_step_found_by_trial_grows_back():
    rejected, behind = proposals([LARGE, SMALL], begun=False)
    assert behind == pytest.approx(GROW * rejected, rel=1e-6)
