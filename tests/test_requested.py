"""What is asked of a run beside what is met: the second method, two scenes, and the page."""

import math
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from jaxspace import BodyState, FinalError  # noqa: E402
from jaxspace.orbits import TwoBody  # noqa: E402
from jaxspace.orbits.kepler import kepler_flow  # noqa: E402
from validation import _gauss, requested  # noqa: E402
from validation.at_the_end import AtTheEnd  # noqa: E402


def test_the_second_method_follows_a_closed_form():
    """An ellipse of e = 0.5 over two revolutions: to what rounding leaves of 13 radians."""
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, math.sqrt(1.5), 0.0]))
    span = 4.0 * math.pi * 2.0**1.5
    end = _gauss.end_of(TwoBody(1.0), y0, np.array([0.0, span]))
    assert end.apart(BodyState(*kepler_flow(y0.position, y0.velocity, span, 1.0))) < 1e-13
    # At the apoapsis it is slowest, and farthest.
    assert np.asarray(end.sizes) == pytest.approx([3.0, math.sqrt(1.5)], rel=1e-2)


@pytest.mark.parametrize("name", ["Two-gimbal gyro at 24,000 rpm", "Settling coin"])
def test_a_scene_meets_what_is_asked(name):
    """Within ten times, and as many times more as the motion enlarges what a step errs."""
    motion = requested.MOTIONS[name]()
    exact = _gauss.end_of(*motion)
    larger = max(1.0, requested.stored()[name].growth)
    for rtol in (1e-8, 1e-10):
        met = requested.error(motion, "float64", rtol, exact)
        assert met < requested.PROMISE * rtol * larger
    for within in (1e-6, 1e-9):
        run = motion.run(FinalError(within))
        assert run.status == 0 and exact.apart(run.final) < within


def test_the_page_is_that_of_the_record():
    found = requested.stored()
    assert list(found) == list(requested.MOTIONS) and len(found) == 12
    drawn = requested.stored_drawn()
    assert len(drawn) == 20 and requested.PAGE.read_text() == requested.text(found, drawn)
    ends = [one.ends for one in found.values()] + list(drawn.values())
    # Where a run says that its error is met, it is.
    assert all(one.error <= 1.0 for scene in ends for p in scene.values() for one in p if one.met)
    for name, one in found.items():
        assert [len(errors) for errors in one.errors.values()] == list(
            map(len, requested.ASKED.values())
        )
        # What errors are measured against is known better than they are.
        assert one.reference < 0.5 * min(e for e in one.errors["float64"] if e > 1e-11), name


def test_a_miss_is_bold_and_needs_a_reason(monkeypatch):
    errors = {"float64": [1e-4, 2e-5, 1e-9, 1e-11, 1e-12], "float32": [1e-3, math.nan, 1e-5]}
    ends = {"float64": [AtTheEnd(0.5, True, 3.0, 2.0), AtTheEnd(1.5, True, 1.0, 0.7)]}
    one = requested.Measured(errors, 1e-15, 30.0, ends)
    assert requested.missed(one)[0] == ("float64", 1e-6, 2e-5)
    with pytest.raises(KeyError):
        requested.text({"A scene": one}, {})
    monkeypatch.setitem(
        requested.NOTES, "A scene", "the motion amplifies errors by a factor of thirty."
    )
    page = requested.text({"A scene": one}, {"another": ends})
    assert (
        "**2.0e-05**" in page
        and "**fails**" in page
        and "In 6 of 8 runs the error is within" in page
    )
    # Of the errors at the end half are beyond what was asked.
    assert (
        "In 2 scenes, 4 of 4 runs report that the requested error was reached. "
        "2 of these errors are within" in page
    )
    assert "**2 (1)**" in page and "For the whole search its median is 2 and" in page
