"""Covariance through events, jumps and phases: beside transition matrices and simulated noise."""

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Accuracy, Event, Mission, Phase
from jaxspace.control import ClosedLoop
from jaxspace.core import AbstractSystem, InputError
from jaxspace.simulation import Status
from jaxspace.solvers import Tsit5
from jaxspace.studies import propagate_covariance, sensitivity

FINE = Accuracy(1e-10, method=Tsit5(), max_steps=512)
FAST = Accuracy(1e-7, method=Tsit5(), max_steps=256)


class Ball(AbstractSystem):
    """A ball under gravity in air: z'' = -1 - k z'."""

    k: float = 0.0

    def vector_field(self, t, y):
        return {"v": -1.0 - self.k * y["v"], "z": y["v"]}

    def invariants(self, t, y):
        return {}


def bounce(t, y):
    """With a wall that moves in time, so that the jump depends on its time, too."""
    return {"v": -0.8 * y["v"] + 0.1 * t, "z": y["z"]}


GROUND = Event(lambda t, y: y["z"] - 0.05 * t, direction=-1, within=5.0)
MISSION = Mission(
    [
        Phase(Ball(), GROUND, bounce, "down"),
        Phase(Ball(0.4), 0.9, name="again"),
        Phase(Ball(0.4), GROUND, bounce, "last"),
    ]
)
START = {"v": jnp.array(0.4), "z": jnp.array(1.0)}
P0 = np.array([[2e-4, 1e-5], [1e-5, 3e-4]])


def test_without_noise_it_is_that_of_the_transition_matrices():
    """Through two events, a phase that starts late and ends late, and jumps that know the time."""
    run, found = propagate_covariance(MISSION, START, 0.0, P0, accuracy=FINE, num_saved=3)
    plain, change = sensitivity(MISSION, START, 0.0, accuracy=FINE, num_saved=3)
    assert run.status <= 1 and plain.status <= 1
    assert_allclose(run.end, plain.end, rtol=1e-9)
    # At the end the derivatives are of the state when each run gets there, as `final` is.
    expected = change.end.covariance(P0)[..., 0]
    assert_allclose(found.final, expected, rtol=1e-7, atol=1e-14)
    times = change.end.times[:, 0]
    assert_allclose(found.time, times @ P0 @ times, rtol=1e-7)
    assert_allclose(found.phases[0][..., 0], P0)
    assert found.phases[2].shape == (2, 2, 3)


def test_with_noise_it_is_that_of_many_noisy_runs():
    """Twenty thousand balls with noise in the velocity, stepped exactly, beside both variances."""
    q, runs, h = 4e-4, 20_000, 2e-3
    mission = Mission([Phase(Ball(), GROUND, bounce, "down"), Phase(Ball(), 0.8, name="again")])
    noise = [np.diag([q, 0.0]), np.diag([2.0 * q, 0.0])]
    _, found = propagate_covariance(mission, START, 0.0, P0, noise=noise, accuracy=FAST)
    rng = np.random.default_rng(11)
    v, z = np.random.default_rng(12).multivariate_normal([0.4, 1.0], P0, runs).T
    L = np.linalg.cholesky([[h, h**2 / 2], [h**2 / 2, h**3 / 3]])
    left, landed, t = np.full(runs, np.inf), np.zeros(runs, bool), 0.0
    ends = np.zeros((2, runs))
    while not np.all(left <= 0.0):
        density = np.where(landed, 2.0 * q, q)
        dv, dz = np.sqrt(density) * (L @ rng.normal(size=(2, runs)))
        before, speed = z, v
        z, v = z + h * v - h**2 / 2 + dz, v - h + dv
        t += h
        hit = ~landed & (z < 0.05 * t)
        # Within a step the path is a line: its bend is a millionth.
        gap = before - 0.05 * (t - h)
        share = np.where(hit, gap / np.where(hit, gap - (z - 0.05 * t), 1.0), 0.0)
        when = t - h + share * h
        bounced = -0.8 * (speed + share * (v - speed)) + 0.1 * when
        rest = (1.0 - share) * h
        z = np.where(hit, 0.05 * when + rest * bounced - rest**2 / 2, z)
        v = np.where(hit, bounced - rest, v)
        left = np.where(hit, 0.8 - rest, np.where(landed, left - h, left))
        landed |= hit
        # Back to the end of each run, along its motion.
        over = landed & (left <= 0.0) & (ends[1] == 0.0)
        ends[:, over] = np.stack([v - left, z + left * v])[:, over]
    # Five standard errors of a variance, and what one step of noise adds.
    assert_allclose(np.var(ends[0]), found.final[0, 0], rtol=5.0 * np.sqrt(2.0 / runs) + 1e-2)
    assert_allclose(np.var(ends[1]), found.final[1, 1], rtol=5.0 * np.sqrt(2.0 / runs) + 1e-2)


def impact_of(v, z):
    """Speed at which a ball without drag meets the ground, in mpmath."""
    return mpmath.sqrt(v * v + 2 * z)


@pytest.mark.parametrize("noisy", [False, True])
def test_a_loose_prior_that_has_no_part_in_the_result(noisy):
    """From the apex the speed at the ground, sqrt(v^2 + 2 z), does not depend on v to first order:
    of a speed known to 1e6 to 1e13 times the deviation of the height nothing is left, although the
    time of the fall has all of it. White noise at the time s counts by s/T of the fall T."""
    tight, after, bounce_factor = 1e-9, 0.3, -0.8
    ratio = np.array([1e6, 1e12, 1e13])
    q = 1e-18 if noisy else 0.0
    level = Event(lambda t, y: y["z"], direction=-1, within=5.0)
    mission = Mission(
        [
            Phase(Ball(), 0.5, name="first"),
            Phase(Ball(), level, lambda t, y: {"v": bounce_factor * y["v"], "z": y["z"]}, "fall"),
            Phase(Ball(), after, name="up"),
        ]
    )
    start = {"v": jnp.zeros(3), "z": jnp.ones(3)}
    P0 = np.zeros((2, 2, 3))
    P0[0, 0], P0[1, 1] = (ratio * tight) ** 2, tight**2
    run, found = propagate_covariance(
        mission, start, 0.0, P0, noise=np.diag([q, 0.0]) if noisy else None, batch=True,
        accuracy=FINE,
    )  # fmt: skip
    assert np.all(np.asarray(run.status) <= Status.EVENT)
    with mpmath.workdps(60):
        one, h = mpmath.mpf(1), mpmath.mpf(after)
        slopes = [mpmath.diff(impact_of, (0 * one, one), n) for n in ((1, 0), (0, 1))]
        fall = mpmath.sqrt(2)
        for k in range(3):
            variances = [mpmath.mpf(float(P0[i, i, k])) for i in range(2)]
            impact = sum(s * s * p for s, p in zip(slopes, variances, strict=True)) + q * fall / 3
            b = mpmath.mpf(bounce_factor) ** 2 * impact
            exact = [
                [b + q * h, b * h + q * h**2 / 2],
                [b * h + q * h**2 / 2, b * h**2 + q * h**3 / 3],
            ]
            # Roundings of the loose column: a few units in the last place, squared.
            bound = 1e-7 + (10.0 * 2.2e-16 * ratio[k]) ** 2
            assert_allclose(found.final[..., k], np.array(exact, float), rtol=bound)
            # An error of the speed at the apex delays the impact by itself.
            time = variances[0] + variances[1] / 2 + q * fall / 3
            assert_allclose(found.time[k], float(time), rtol=1e-9)
    for phase in found.phases:
        assert np.min(np.diagonal(np.asarray(phase))) >= 0.0


@pytest.mark.sweep  # compiles two missions more
def test_a_batch_is_each_run_alone():
    starts = {name: x * jnp.array([1.0, 1.2]) for name, x in START.items()}
    noise = np.diag([1e-4, 0.0])
    _, both = propagate_covariance(MISSION, starts, 0.0, P0, noise=noise, batch=True, accuracy=FAST)
    own = {name: x[1] for name, x in starts.items()}
    _, one = propagate_covariance(MISSION, own, 0.0, P0, noise=noise, accuracy=FAST)
    # Runs of a block share their steps: the tolerance.
    assert_allclose(both.final[..., 1], one.final, rtol=1e-5, atol=1e-10)
    assert both.time.shape == (2,)


def test_what_cannot_be_carried():
    loop = ClosedLoop(Ball(), lambda y: y["v"], period=0.1)
    with pytest.raises(InputError, match="closed loop"):
        propagate_covariance(Mission([Phase(loop, 1.0)]), START, 0.0, P0)
    with pytest.raises(InputError, match="noise has 2 entries"):
        propagate_covariance(MISSION, START, 0.0, P0, noise=[None, None])
    with pytest.raises(InputError, match=r"must be \(2, 2\)"):
        propagate_covariance(MISSION, START, 0.0, np.eye(3))
