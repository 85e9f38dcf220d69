"""The best staging where each stage also drops a fixed mass, and the best number of stages.

    m_i = (m_{i+1} + c_i) G_i,   G_i = mu_i (1 - b_i)/(1 - b_i mu_i)      upwards: m_{n+1} = P
    mu_i = (1 - x_i/u_i)/b_i,    x_{n+1} = x,   x_i = x_{i+1} + c_i/q_{i+1}
    q_i = q_{i+1} G_i,           q_{n+1} = P/x
    v_m = sum_i u_i ln mu_i,     lambda = -q_1/m_1

Without fixed masses every x_i is the x of `staging.py`. A fixed mass c_i makes the mass above a
stage cost more than its weight, so that the stages below get less of the velocity. Everything
follows from the one unknown x, with which the velocity falls. A stage whose fixed mass costs more
than the stage saves is left out: of all choices of stages the one with the least initial mass is
taken.

    symbol   meaning                                                         unit
    c_i      fixed mass dropped with stage i: engine, interstage, fairing    payloads
    q_i      velocity's price in m_1 over that of the mass m_i: Lambda/p_i   s/m times mass
    and the symbols of `staging.py`

Source: the conditions of Thomson 8.2-8 for the chain with fixed masses (p_i = dm_1/dm_i; for every
stage p_i dm_i/d(u_i ln mu_i) is the same).
Valid as `staging.py` is.
"""

__all__ = ["StageNumbers", "number_of_stages"]

import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..core import InputError, Scalar
from ..core.checks import check_non_negative, check_positive
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.roots import increasing_root
from ..core.types import as_float

# Ten stages have 1023 choices.
MOST_STAGES = 10


class Chain(NamedTuple):
    """Stages of one choice: ln mu_i, initial mass m_1 over the payload, and lambda."""

    log_ratio: Float[Array, "stages *#runs"]
    initial_mass: Scalar
    multiplier: Scalar


def _chain(x: Scalar, u: Array, b: Array, c: Array, chosen: Bool[Array, " stages"]) -> Chain:
    """The chain of the stages that are `chosen`, from the unknown x."""
    above = jnp.ones_like(x)
    q = 1.0 / x
    rising = x
    logs = []
    for i in reversed(range(u.shape[0])):
        fixed = jnp.where(chosen[i], c[i], 0.0)
        rising = rising + fixed / q
        # Beyond it the mass ratio would be below one: the stage would reduce the velocity.
        used = chosen[i] & (rising < u[i] * (1.0 - b[i]))
        # 1 - b mu = x/u where the stage is used, because the difference loses digits.
        share = jnp.where(used, rising / u[i], 1.0 - b[i])
        mu = (1.0 - share) / b[i]
        growth = jnp.where(used, mu * (1.0 - b[i]) / share, 1.0)
        above = (above + fixed) * growth
        q = q * growth
        logs.append(jnp.where(used, jnp.log(jnp.where(used, mu, 1.0)), 0.0))
    return Chain(jnp.stack(logs[::-1]), above, -q / above)


def _best_chain(
    u: Array, b: Array, c: Array, v: Scalar, chosen: Bool[Array, " stages"]
) -> tuple[Chain, Bool[Array, "*runs"]]:
    """The best division among the stages that are `chosen`, and whether they can give `v`."""
    column = chosen.reshape(-1, *(1,) * v.ndim)
    limit = -jnp.sum(jnp.where(column, u * jnp.log(b), 0.0), axis=0)
    able = v < limit
    # Half of the limit replaces a velocity that the stages cannot give, so that a root exists.
    goal = jnp.where(able, v, 0.5 * limit)
    highest = jnp.max(jnp.where(column, u * (1.0 - b), 0.0), axis=0)

    def missing(x: Scalar) -> Scalar:
        return goal - jnp.sum(u * _chain(x, u, b, c, chosen).log_ratio, axis=0)

    return _chain(increasing_root(missing, 0.0 * v, highest), u, b, c, chosen), able


@quick_jit
def choose_stages(
    u: Float[Array, "stages *#runs"],
    b: Float[Array, "stages *#runs"],
    c: Float[Array, "stages *#runs"],
    v: Float[Array, "*runs"],
    choices: Bool[Array, "choices stages"],
) -> tuple[
    Chain, Bool[Array, "stages *#runs"], Bool[Array, "*runs"], Float[Array, "choices *#runs"]
]:
    """The best of all `choices`: its chain, the stages used, and whether any choice gives the
    velocity; and the initial mass of each choice, (choices, *runs), infinite where it does not."""
    every, able = jax.vmap(lambda chosen: _best_chain(u, b, c, v, chosen))(choices)
    masses = jnp.where(able, every.initial_mass, jnp.inf)
    best = jnp.argmin(masses, axis=0)

    def pick(x: Array) -> Array:
        index = best.reshape(1, *(1,) * (x.ndim - 1 - best.ndim), *best.shape)
        return jnp.take_along_axis(x, jnp.broadcast_to(index, (1, *x.shape[1:])), axis=0)[0]

    chain = jax.tree.map(pick, every)
    chosen = jnp.moveaxis(choices[best], -1, 0)
    return chain, chosen & (chain.log_ratio > 0.0), jnp.any(able, axis=0), masses


def all_choices(stages: int) -> np.ndarray:
    """Every choice of one stage or more, (choices, stages).

    Raises `InputError` for more than ten stages."""
    if stages > MOST_STAGES:
        raise InputError(
            f"fixed_mass is given for {stages} stages: at most {MOST_STAGES} are supported, "
            "because all combinations are evaluated."
        )
    every = np.array(list(itertools.product([True, False], repeat=stages)))
    return every[every.any(axis=1)]


@printed()
class StageNumbers(NamedTuple):
    """Rockets of equal stages: the `numbers` of stages 1, 2, ..., the `initial_mass` over the
    payload of each, (numbers, *runs), infinite where so few do not give the velocity, and the
    `best` number."""

    numbers: Int[Array, " numbers"]
    initial_mass: Float[Array, "numbers *#runs"]
    best: Int[Array, "*runs"]


def number_of_stages(
    exhaust_velocity: ArrayLike,
    structural_factor: ArrayLike,
    total_velocity: ArrayLike,
    fixed_mass: ArrayLike = 0.0,
    most: int = 6,
) -> StageNumbers:
    """The initial mass by the number of equal stages, each of which also drops a fixed mass: every
    further stage saves structure and adds fixed mass.

    **Arguments**, each (*runs,)

    - `exhaust_velocity`, `total_velocity`: in one unit; `structural_factor`: below 1.
    - `fixed_mass`: of each stage, over the payload; zero by default, and then more stages are
      always better.
    - `most`: the highest number that is tried.

    **Raises** `InputError` for values out of range.
    """
    given = (exhaust_velocity, structural_factor, total_velocity, fixed_mass)
    u, b, v, c = (as_float(x) for x in given)
    check_positive("exhaust_velocity", u)
    check_positive("structural_factor", b)
    check_positive("total_velocity", v)
    check_non_negative("fixed_mass", c)
    if most < 1:
        raise InputError(f"most is {most}: it must be at least 1.")
    runs = jnp.broadcast_shapes(*(x.shape for x in (u, b, v, c)))
    u, b, c = (jnp.broadcast_to(x, (most, *runs)) for x in (u, b, c))
    numbers = np.arange(1, most + 1)
    # It does not matter which of several equal stages are left out.
    choices = jnp.asarray(numbers[:, None] > np.arange(most)[::-1])
    masses = choose_stages(u, b, c, jnp.broadcast_to(v, runs), choices)[3]
    return StageNumbers(jnp.asarray(numbers), masses, jnp.argmin(masses, axis=0) + 1)
