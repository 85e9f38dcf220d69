"""A local minimum under constraints, by gradients: L-BFGS inside the method of multipliers.

    minimise f(x)   subject to   c(x) = 0,   d(x) >= 0
    L(x) = f + lambda . c + (rho/2) |c|^2 + (1/2 rho) sum [max(0, nu - rho d)^2 - nu^2]
    lambda <- lambda + rho c,   nu <- max(0, nu - rho d)          after each descent of L in x

    symbol       meaning
    f, c, d      objective, equalities, inequalities, scaled so that values of order 1 matter
    lambda, nu   multipliers
    rho          weight of the constraints, ten times larger while they do not decrease

Source: Hestenes 1969, Powell 1969, Rockafellar 1973; the descent is `optax.lbfgs`.
Valid for smooth functions. `f` may be infinite outside its domain: the line search turns back.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import lax
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import Scalar
from ._criterion import Criterion, Point
from ._gradient_check import gradient_error


class RoundState(NamedTuple):
    """What one descent hands to the next update of the multipliers."""

    x: Point
    criterion: Criterion
    dual: Criterion
    rho: Float[Array, ""]
    gradient: Float[Array, ""]
    violation: Float[Array, ""]
    steps: Int[Array, ""]
    rounds: Int[Array, ""]
    gradient_error: Float[Array, ""]
    history: Float[Array, "rounds 3"]


class DescentState(NamedTuple):
    """What one step of a descent hands to the next; `state` is that of optax."""

    x: Point
    state: PyTree
    steps: Int[Array, ""]


def solve_multipliers(
    problem: Callable[[Point], Criterion],
    start: Point,
    tolerance: Scalar,
    max_steps: int,
    max_rounds: int,
    check_gradient: bool,
    adam_steps: int,
    adam_rate: Scalar,
) -> RoundState:
    """The last round of descents; arguments as in `minimise`."""
    # The shapes of a criterion without evaluating the start: every call of `problem` is one more
    # copy of it to compile.
    blank = jax.tree.map(
        lambda like: jnp.zeros(like.shape, like.dtype), jax.eval_shape(problem, start)
    )
    dual = Criterion(jnp.ones_like(blank.objective), blank.equal_zero, blank.non_negative)
    rho = 10.0 * jnp.ones_like(blank.objective)

    if adam_steps > 0:
        start = _adam(lambda x: _lagrangian(problem(x), dual, rho), start, adam_steps, adam_rate)

    def unfinished(loop: RoundState) -> Bool[Array, ""]:
        missed = (loop.gradient > tolerance) | (loop.violation > tolerance)
        return missed & (loop.rounds < max_rounds)

    def improve(loop: RoundState) -> RoundState:
        x, _, dual, rho, _, violation, steps, rounds, wrong, history = loop

        def lagrangian(x: Point) -> Float[Array, ""]:
            return _lagrangian(problem(x), dual, rho)

        # A descent to the last digit is wasted while the multipliers are not right.
        enough = jnp.maximum(0.01 * jnp.minimum(violation, 1.0), tolerance)
        value, slopes = jax.value_and_grad(lagrangian)(x)
        if check_gradient:
            check = functools.partial(gradient_error, lagrangian, x, slopes)
            wrong = lax.cond(rounds == 0, check, lambda: wrong)
        x, gradient, taken = _descend(lagrangian, x, value, slopes, enough, max_steps)
        criterion = problem(x)
        left = _violation(criterion, dual, rho)
        # Updated with the weight of this descent, before it grows.
        dual = _updated(criterion, dual, rho)
        rho = jnp.where(left > 0.25 * violation, 10.0 * rho, rho)
        history = history.at[rounds].set(jnp.stack([criterion.objective, left, gradient]))
        taken, done = steps + taken, rounds + 1
        return RoundState(x, criterion, dual, rho, gradient, left, taken, done, wrong, history)

    first = RoundState(
        x=start,
        criterion=blank,
        dual=dual,
        rho=rho,
        gradient=jnp.full_like(rho, jnp.inf),
        violation=jnp.ones_like(rho),
        steps=jnp.asarray(0),
        rounds=jnp.asarray(0),
        gradient_error=jnp.zeros_like(rho),
        history=jnp.full((max_rounds, 3), jnp.nan, rho.dtype),
    )
    return lax.while_loop(unfinished, improve, first)


def _adam(f: Callable[[Point], Array], x: Point, steps: int, rate: Scalar) -> Point:
    """A number of steps of Adam, which leave flat and rough starts that a line search does not."""
    method = optax.adam(rate)

    def step(_: Array, loop: tuple[Point, PyTree]) -> tuple[Point, PyTree]:
        x, state = loop
        slope = jax.grad(f)(x)
        # Outside of the domain the objective is infinite, and has no slope to follow.
        slope = jax.tree.map(lambda g: jnp.where(jnp.isfinite(g), g, 0.0), slope)
        with jax.numpy_dtype_promotion("standard"):
            updates, state = method.update(slope, state, x)
        return optax.apply_updates(x, updates), state

    return lax.fori_loop(0, steps, step, (x, method.init(x)))[0]


def _lagrangian(criterion: Criterion, dual: Criterion, rho: Float[Array, ""]) -> Float[Array, ""]:
    """The augmented Lagrangian L."""
    total, c, d = criterion.objective, criterion.equal_zero, criterion.non_negative
    if c is not None and dual.equal_zero is not None:
        total = total + jnp.sum(dual.equal_zero * c + 0.5 * rho * c * c)
    if d is not None and dual.non_negative is not None:
        active = jnp.maximum(dual.non_negative - rho * d, 0.0)
        total = total + jnp.sum(active * active - dual.non_negative * dual.non_negative) / (
            2.0 * rho
        )
    return total


def _updated(criterion: Criterion, dual: Criterion, rho: Float[Array, ""]) -> Criterion:
    """The multipliers after a descent, in the places of their constraints."""
    c, d = criterion.equal_zero, criterion.non_negative
    return Criterion(
        objective=jnp.ones_like(criterion.objective),
        equal_zero=None if c is None or dual.equal_zero is None else dual.equal_zero + rho * c,
        non_negative=None
        if d is None or dual.non_negative is None
        else jnp.maximum(dual.non_negative - rho * d, 0.0),
    )


def _violation(criterion: Criterion, dual: Criterion, rho: Float[Array, ""]) -> Float[Array, ""]:
    """The largest violation of an equality, of an inequality, or of complementarity."""
    c, d = criterion.equal_zero, criterion.non_negative
    largest = jnp.zeros_like(criterion.objective)
    if c is not None:
        largest = jnp.maximum(largest, jnp.max(jnp.abs(c)))
    if d is not None and dual.non_negative is not None:
        # Either d or its multiplier must be zero, and neither negative.
        largest = jnp.maximum(largest, jnp.max(jnp.abs(jnp.minimum(d, dual.non_negative / rho))))
    return largest


def _largest(tree: Point) -> Float[Array, ""]:
    """The largest magnitude in a tree."""
    return jax.tree.reduce(jnp.maximum, jax.tree.map(lambda leaf: jnp.max(jnp.abs(leaf)), tree))


def _descend(
    f: Callable[[Point], Float[Array, ""]],
    x: Point,
    value: Float[Array, ""],
    gradient: Point,
    enough: Float[Array, ""],
    max_steps: int,
) -> tuple[Point, Float[Array, ""], Int[Array, ""]]:
    """L-BFGS from `x`, where `f` has this value and gradient, until no component of the gradient
    exceeds `enough`.

    **Returns** the point, the largest component of the gradient, and the number of steps."""
    method = optax.lbfgs()

    def unfinished(loop: DescentState) -> Bool[Array, ""]:
        steep = _largest(optax.tree.get(loop.state, "grad")) > enough
        return (loop.steps == 0) | (steep & (loop.steps < max_steps))

    def step(loop: DescentState) -> DescentState:
        x, state, steps = loop
        # The line search leaves value and gradient at its end in the state.
        value = optax.tree.get(state, "value")
        gradient = optax.tree.get(state, "grad")
        # optax mixes integer widths, which a caller's strict promotion would refuse.
        with jax.numpy_dtype_promotion("standard"):
            updates, state = method.update(
                gradient, state, x, value=value, grad=gradient, value_fn=f
            )
        return DescentState(optax.apply_updates(x, updates), state, steps + 1)

    state = optax.tree.set(method.init(x), value=value, grad=gradient)
    last = lax.while_loop(unfinished, step, DescentState(x, state, jnp.asarray(0)))
    return last.x, _largest(optax.tree.get(last.state, "grad")), last.steps
