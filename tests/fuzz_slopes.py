"""Derivatives where the motion leaves nothing to resolve: `python tests/fuzz_slopes.py [NAME ...]`.

For each system of the registry: each array that may be zero set to zero, those of its parameters
alone or together, those of its state, and all, so that it is at rest, or on a straight line, or
without a force; and states of equilibrium to which Newton's method leads, which rounding leaves
inexact. There the derivatives of the final state by every array, in forward and in reverse
mode, are compared with the variational equations

    d' = f_y d + f_p p,    d(0) = dy0

as equations of motion of their own, in so many fixed steps that half of them give the same. It ends
with status 1 where a derivative is wrong and no note says why."""

import itertools
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import restricted
from jax.flatten_util import ravel_pytree
from restricted import EARTH_MOON, RestrictedBody

from jaxspace.core import InputError
from jaxspace.core.quantities import quantities
from jaxspace.rotations import Quaternion
from jaxspace.simulation import simulate

RTOL = 1e-9
# Of a hundred steps, each of which may leave 300 tolerances before the run is repeated.
ALLOWED = 3e-5
# Below this the absolute tolerance, a thousandth of the relative one, is what is promised.
LEAST = 1e-3
# The same steps in another order of summation, of runs that amplify roundings.
MODES = 1e-7
# Truths that half of the steps change by more are none, as those of a fall into a centre.
RESOLVED = 1e-7
STEPS, SAVED = 800, 16
# Starts and iterations of Newton's method, the rate that it leaves, relative to its terms, and how
# far from the sample it may lead, relative to its size.
STARTS, ITERATIONS, LEFT, FAR = 4, 60, 1e-12, 10.0
# Errors that are no defect: system, what is zero there, and by what is differentiated.
NOTES = {
    ("inertial_navigator", ".attitude", ".roll_frequency"): (
        "height and velocity do not depend on it: 10 m/s^2 over 600 s, 2e6 m, cancels to 6e-8 m"
    ),
}


class Place(NamedTuple):
    """A system and a state, as the arrays of both, and what is zero there."""

    zero: str
    leaves: list[Any]


class Slope(NamedTuple):
    """The derivative `by` one array at a place where others are `zero`.

    - `error`: of forward mode, of the block of the final state where it is largest, relative to the
      largest derivative of the block along the run.
    - `modes`: difference of both modes, likewise."""

    zero: str
    by: str
    error: float
    modes: float

    @property
    def wrong(self) -> bool:
        # What is not finite is no less than a number.
        return not (self.error <= ALLOWED and self.modes <= MODES)


class Subject:
    """A sample of the registry, and the programs of its derivatives."""

    def __init__(self, sample):
        # The registry holds arrays, of the precision that is set before.
        from systems import Integrated

        self.sample = sample
        inputs = (sample.system, sample.state)
        arrays, static = eqx.partition(inputs, eqx.is_inexact_array)
        flat, self.structure = jax.tree_util.tree_flatten_with_path(arrays, is_leaf=is_attitude)
        self.paths = [path for path, _ in flat]
        self.leaves = [x for _, x in flat]
        self.names = [jax.tree_util.keystr(path[1:]) for path in self.paths]
        self.static = static
        ends = jnp.array([0.0, sample.span])

        def final(arrays):
            system, y = eqx.combine(arrays, static)
            return simulate(Integrated(system), y, ends, accuracy=RTOL, throw=False).final

        @jax.jit
        def slopes(arrays, directions, weights):
            _, push = jax.linearize(final, arrays)
            pull = jax.linear_transpose(push, arrays)
            return jax.lax.map(push, directions), pull(weights)[0]

        def rate(t, both, given):
            arrays, along = given

            def field(arrays, y):
                return eqx.combine(arrays, static)[0].vector_field(t, y)

            return jax.jvp(field, (arrays, both[0]), (along, both[1]))

        def truth(arrays, direction, grid):
            return diffrax.diffeqsolve(
                diffrax.ODETerm(rate),
                diffrax.Dopri8(),
                *(0.0, sample.span, None),
                (arrays[1], direction[1]),
                (arrays, direction),
                stepsize_controller=diffrax.StepTo(grid),
                saveat=diffrax.SaveAt(ts=jnp.linspace(0.0, sample.span, SAVED + 1)),
                max_steps=None,
                throw=False,
            ).ys

        self.slopes = slopes
        self.truths = jax.jit(
            lambda arrays, along, grid: jax.lax.map(lambda d: truth(arrays, d, grid), along)
        )

    def system(self, leaves):
        return eqx.combine(self.tree(leaves), self.static)[0]

    def tree(self, leaves):
        """The leaves as those of system and state."""
        return jax.tree.unflatten(self.structure, leaves)

    def places(self) -> Iterator[Place]:
        """Where something is zero that may be."""
        tree = (self.sample.system, self.sample.state)
        able = [k for k, path in enumerate(self.paths) if _may_vanish(tree, path)]
        state = [k for k in able if self.paths[k][0].idx == 1]
        parameters = [k for k in able if k not in state]
        groups = {self.names[k]: [k] for k in able}
        groups |= {"parameters": parameters, "state": state, "all": [*parameters, *state]}
        for zero, numbers in groups.items():
            leaves = [_zero(x) if k in numbers else x for k, x in enumerate(self.leaves)]
            if numbers and _allowed(eqx.combine(self.tree(leaves), self.static)):
                yield Place(zero, leaves)

    def equilibria(self) -> Iterator[Place]:
        """States whose rate is a rounding error."""
        start, shaped = ravel_pytree(self.tree(self.leaves)[1])
        number = sum(path[0].idx == 0 for path in self.paths)

        @jax.jit
        def rate(y):
            arrays = (self.tree(self.leaves)[0], shaped(y))
            system, y = eqx.combine(arrays, self.static)
            return ravel_pytree(system.vector_field(jnp.zeros(()), y))[0]

        slope, random, found = jax.jit(jax.jacfwd(rate)), np.random.default_rng(0), []
        for _ in range(STARTS):
            y = np.array(start) * random.uniform(0.3, 1.5, start.shape)
            for _ in range(ITERATIONS):
                matrix, left = np.asarray(slope(y)), np.asarray(rate(y))
                if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(left))):
                    break
                y = y - np.linalg.lstsq(matrix, left, rcond=1e-10)[0]
            # Also where an equilibrium is a state of whole numbers.
            y = y + np.finfo(float).eps * np.abs(start) * random.choice([-1.0, 1.0], start.shape)
            terms = np.abs(np.asarray(slope(y))) @ np.abs(y)
            at_rest = np.max(np.abs(rate(y))) <= LEFT * np.max(terms)
            new = all(np.max(np.abs(y - other)) > 1e-6 * np.max(np.abs(y)) for other in found)
            # The derivatives of large angles are those of the rounding of their sines.
            near = np.max(np.abs(y)) <= FAR * np.max(np.abs(start))
            if not (at_rest and new and near):
                continue
            found.append(y)
            state = jax.tree.leaves(shaped(jnp.asarray(y)), is_leaf=is_attitude)
            leaves = [*self.leaves[:number], *state]
            if _allowed(eqx.combine(self.tree(leaves), self.static)):
                yield Place(f"equilibrium {len(found)}", leaves)

    def direction(self, k: int, leaves: list):
        """A change of the array number `k` of these, by its size in the sample."""
        change = [jax.tree.map(jnp.zeros_like, x) for x in leaves]
        if is_attitude(leaves[k]):
            # Along the group.
            change[k] = leaves[k].rate(jnp.array([0.6, -1.0, 0.8]))
        else:
            size = float(np.max(np.abs(self.leaves[k]), initial=0.0)) or 1.0
            parts = np.resize([1.0, -0.7, 0.45, 0.8], np.shape(leaves[k]))
            change[k] = jnp.asarray(size * parts)
        return self.tree(change)

    def moves_breaks(self, arrays, direction) -> bool:
        """Whether a change moves the times at which the field jumps, by which the equations of the
        variations jump too."""

        def breaks(arrays):
            found = eqx.combine(arrays, self.static)[0].breaks()
            return jnp.zeros(0) if found is None else jnp.asarray(found, float)

        return bool(np.any(jax.jvp(breaks, (arrays,), (direction,))[1]))

    def grid(self, leaves) -> tuple[np.ndarray, np.ndarray]:
        """Fixed steps through every break, and every second one of them."""
        breaks = self.system(leaves).breaks()
        breaks = np.zeros(0) if breaks is None else np.asarray(breaks)
        within = breaks[(breaks > 0.0) & (breaks < self.sample.span)]
        fine, coarse = (np.linspace(0.0, self.sample.span, n + 1) for n in (STEPS, STEPS // 2))
        return np.unique([*fine, *within]), np.unique([*coarse, *within])


def _may_vanish(tree, path) -> bool:
    """Whether the declaration of the array at a path allows zero; without one anything is."""
    owner = tree
    for step in path[:-1]:
        owner = getattr(owner, step.name) if hasattr(step, "name") else owner[_key(step)]
    declared = quantities(type(owner)).get(getattr(path[-1], "name", None))
    return declared is None or bool(declared.contains(0.0))


def _key(step):
    return step.key if hasattr(step, "key") else step.idx


def is_attitude(x: object) -> bool:
    return isinstance(x, Quaternion)


def _zero(x):
    """Zero, or no rotation."""
    if is_attitude(x):
        return Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0]))
    return jnp.zeros_like(x)


def _allowed(part) -> bool:
    """Whether a tree and all of its parts would be constructed, and a run start from them."""
    checks = [vars(kind).get("__check_init__") for kind in type(part).__mro__]
    if isinstance(part, eqx.Module):
        try:
            for check in (*checks, getattr(type(part), "check_start", None)):
                if check is not None:
                    check(part)
        except InputError:
            return False
    inside = part if isinstance(part, tuple | list) else getattr(part, "__dict__", {}).values()
    return isinstance(part, jax.Array) or all(map(_allowed, inside))


def derivatives_at(subject: Subject, place: Place) -> list[Slope]:
    """The derivatives at one place by every array that they are known by."""
    arrays = subject.tree(place.leaves)
    every = [subject.direction(k, place.leaves) for k in range(len(place.leaves))]
    along = jax.tree.map(lambda *x: jnp.stack(x), *every)
    (motion, fine), (other, coarse) = (
        map(jax.tree.leaves, subject.truths(arrays, along, jnp.asarray(grid)))
        for grid in subject.grid(place.leaves)
    )
    # A motion that ends in a centre has no derivative after it.
    if not all(np.allclose(a, b, RESOLVED, RESOLVED) for a, b in zip(motion, other, strict=True)):
        return []
    ends, halves = ([_rows(x[:, -1]) for x in truth] for truth in (fine, coarse))
    sizes = [np.linalg.norm(_rows(x, 2), axis=-1).max(axis=1) for x in fine]
    # Every block of the final state counts alike, by its largest derivative.
    usual = [max(np.max(size[np.isfinite(size)], initial=0.0), LEAST) for size in sizes]
    blocks, structure = jax.tree.flatten(arrays[1])
    weights = [jnp.full(y.shape, 1.0 / size) for y, size in zip(blocks, usual, strict=True)]
    forward, gradient = subject.slopes(arrays, along, jax.tree.unflatten(structure, weights))
    forward = [_rows(x) for x in jax.tree.leaves(forward)]
    both = zip(jax.tree.leaves(gradient), jax.tree.leaves(along), strict=True)
    reverse = sum(np.sum(_rows(d) * np.ravel(g), axis=1) for g, d in both)
    found = []
    for k, name in enumerate(subject.names):
        rows = list(zip(forward, ends, halves, sizes, strict=True))
        errors, doubts = (
            [np.max(np.abs(a[k] - b[k])) / max(size[k], LEAST) for a, b, size in pairs]
            for pairs in (
                [(x, truth, size) for x, truth, _, size in rows],
                [(half, truth, size) for _, truth, half, size in rows],
            )
        )
        if not np.max(doubts) <= RESOLVED or subject.moves_breaks(arrays, every[k]):
            continue
        terms = [x[k] / size for x, size in zip(forward, usual, strict=True)]
        total, size = sum(map(np.sum, terms)), sum(np.sum(np.abs(x)) for x in terms)
        found.append(
            Slope(place.zero, name, np.max(errors), abs(reverse[k] - total) / max(size, LEAST))
        )
    return found


def _rows(x, axes: int = 1) -> np.ndarray:
    """An array with all but its leading axes as one."""
    return np.asarray(x).reshape(*x.shape[:axes], -1)


def look(sample) -> list[Slope]:
    """All derivatives of a system at all places."""
    subject = Subject(sample)
    places = itertools.chain(subject.places(), subject.equilibria())
    return [found for place in places for found in derivatives_at(subject, place)]


def main() -> int:
    from systems import SAMPLES, Sample

    moon = RestrictedBody(jnp.asarray(EARTH_MOON))
    start = restricted.Place(jnp.array([0.6, 0.7]), jnp.array([0.01, 0.02]))
    defect = False
    for sample in (Sample("restricted_body", moon, start, 15.0), *SAMPLES):
        if sys.argv[1:] and sample.name not in sys.argv[1:]:
            continue
        found = look(sample)
        wrong = [x for x in found if x.wrong and (sample.name, x.zero, x.by) not in NOTES]
        worst, modes = (max((row[k] for row in found), default=0.0) for k in (2, 3))
        print(
            f"{sample.name}: {len(found)} derivatives, error up to {worst:.0e}, "
            f"modes {modes:.0e} apart, {len(wrong)} wrong",
            flush=True,
        )
        for x in wrong:
            print(f"  zero {x.zero}, by {x.by}: error {x.error:.1e}, modes {x.modes:.1e}")
        defect = defect or bool(wrong)
    return int(defect)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main())
