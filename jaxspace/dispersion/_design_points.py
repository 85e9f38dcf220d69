"""Design points: the violations of a requirement nearest to zero in standard normal numbers.

    z_(i+1) = ((s . z_i - g(z_i)) / (s . s)) s,   s = grad g

    symbol  meaning                                                   unit
    z       standard normal numbers behind the inputs                 1
    g       margin of the requirement, negative where it is violated  of the output

The distance of a design point from zero is its reliability index. The iteration follows
derivatives: it does not see inputs that move in steps, and finds one point from each start.
Source: Hasofer, Lind, Rackwitz and Fiessler: Melchers, Structural Reliability, 2nd edition, 3.4;
step lengths by Zhang and Der Kiureghian.
"""

from collections.abc import Callable

import numpy as np

Slope = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""g, (starts,), and its derivatives, (starts, n), at z, (starts, n)."""

STARTS, ITERATIONS = 8, 25
# With so many starts for each of equal points few of them are missed, a share of e^-6.
FOR_EACH = 6
# Nearer points are the same one, about which runs must be drawn once only.
SAME = 0.3
# A limit that curves by a tenth of its distance is still that of its point.
BEYOND = 0.9


def design_points(slope: Slope, n: int, most: int, rng: np.random.Generator) -> np.ndarray:
    """The nearest violations along the derivatives, (points, n), from several starts for each of
    them: the more there are, the more are missed. None where the search does not converge. It
    makes about `most` evaluations at most."""
    counted = _Counted(slope)
    found = np.zeros((0, n))
    starts = 0
    while True:
        # Not at the origin, where magnitudes have no slope; each start has its opposite.
        away = rng.standard_normal((STARTS // 2, n))
        away *= 0.5 / np.linalg.norm(away, axis=1)[:, None]
        found = _with_new(found, _nearest(counted, np.concatenate([away, -away])))
        starts += STARTS
        if starts >= FOR_EACH * len(found) or counted.made >= most:
            return _near(found)


def points_from(slope: Slope, points: np.ndarray, violations: np.ndarray, most: int) -> np.ndarray:
    """The `points`, (points, n), and those to which the derivatives lead from the `violations`,
    (runs, n), that no point explains. It makes about `most` evaluations at most."""
    counted = _Counted(slope)
    rest = violations
    while counted.made < most:
        rest = rest[~explained(points, rest)]
        if len(rest) == 0:
            break
        points = _with_new(points, _nearest(counted, rest[:STARTS]))
        rest = rest[STARTS:]
    return _near(points)


def united(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The points of both sets, (points, n), each of which is there once."""
    return _near(_with_new(a, b))


def explained(points: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The violations z, (runs, n), beyond the plane through a point, perpendicular to its
    direction: the limit itself where the output is linear."""
    return np.any(z @ points.T >= BEYOND * np.sum(points**2, axis=1), axis=1)


class _Counted:
    """A function of several places, and at how many it was evaluated."""

    def __init__(self, slope: Slope):
        self.slope = slope
        self.made = 0

    def __call__(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.made += len(z)
        return self.slope(z)


def _with_new(points: np.ndarray, more: np.ndarray) -> np.ndarray:
    """The points, and those of the others that are not among them."""
    for z in more:
        if np.all(np.linalg.norm(points - z, axis=1) > SAME):
            points = np.concatenate([points, z[None]])
    return points


def _near(points: np.ndarray) -> np.ndarray:
    """The points that matter: what lies farther off is rarer by a factor of a thousand or more."""
    distance = np.linalg.norm(points, axis=1)
    return points[0.5 * distance**2 < 0.5 * distance.min(initial=np.inf) ** 2 + 7.0]


def _nearest(slope: Slope, z: np.ndarray) -> np.ndarray:
    """The nearest violations by the damped iteration from the starts z, (starts, n); without those
    that do not converge."""
    g, s = slope(z)
    scale = np.abs(g)
    done = np.zeros(len(z), bool)
    for _ in range(ITERATIONS):
        square = np.sum(s * s, axis=1)
        usable = np.isfinite(g) & np.isfinite(square) & (square > 0.0)
        moving = usable & ~done
        if not moving.any():
            break
        with np.errstate(all="ignore"):
            step = ((np.sum(s * z, axis=1) - g) / square)[:, None] * s - z
            # A merit that the step lowers, for a penalty above |z| / |s|.
            penalty = 2.0 * (np.linalg.norm(z, axis=1) + 1.0) / np.sqrt(square)
            merit = 0.5 * np.sum(z * z, axis=1) + penalty * np.abs(g)
        moved, open_ = np.zeros(len(z)), moving
        # If no step lowers the merit the shortest is taken, because the slope there may be another.
        for damping in (1.0, 0.5, 0.25, 0.125):
            trial = np.where(open_[:, None], z + damping * step, z)
            g_new, s_new = slope(trial)
            with np.errstate(all="ignore"):
                lower = 0.5 * np.sum(trial * trial, axis=1) + penalty * np.abs(g_new) < merit
            taken = open_ & ((np.isfinite(g_new) & lower) | (damping == 0.125))
            moved = np.where(taken, damping * np.linalg.norm(step, axis=1), moved)
            z = np.where(taken[:, None], trial, z)
            g, s = np.where(taken, g_new, g), np.where(taken[:, None], s_new, s)
            open_ = open_ & ~taken
            if not open_.any():
                break
        done = done | (moving & (moved < 1e-3) & (np.abs(g) < 1e-3 * scale))
    # Close enough as a centre for draws, if it is on the border at all.
    with np.errstate(invalid="ignore"):
        return z[done | (np.isfinite(g) & (np.abs(g) < 0.05 * scale))]
