"""The optimal division of a velocity between the stages of a rocket, for the least initial mass.

    ln(m01/P) = sum_i ln[mu_i (1 - b_i) / (1 - b_i mu_i)]                 to be least
    v_m       = sum_i u_i ln mu_i,    mu_i >= 1                           at a given velocity
    mu_i      = (1 + lambda u_i) / (lambda u_i b_i) = (1 - x/u_i) / b_i   with x = -1/lambda > 0
    d ln(m01/P) / dv_m = -lambda

The velocity of these mass ratios falls as x rises from 0, so that x is the root of one monotone
equation. A stage with x >= u_i (1 - b_i) would get mu_i < 1. Its best mass ratio is the bound
mu_i = 1: the rocket is better without it.

    symbol   meaning                                                                     unit
    mu_i     mass ratio of the burn of stage i, initial over final mass of what it moves  1
    u_i      exhaust velocity                                                            m/s
    b_i      structural factor (beta): mass left of stage i over its initial mass        1
    v_m      total velocity, without losses                                              m/s
    m01, P   initial mass of the rocket, payload                                         kg
    lambda   multiplier, negative: lambda u_i < -1 for every stage that is used          s/m

Source: Thomson 8.2; in 8.2-8 the constraint belongs outside the sum.
Valid for stages that burn in sequence, each dropped when it is empty, below v_m = sum_i u_i
ln(1/b_i), the velocity at which no payload is left.
"""

__all__ = ["equal_stages_payload", "optimal_staging_by_gradient", "stationary_mass_ratio"]

from collections.abc import Sequence
from typing import TypeAlias, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..core import Flag, InputError, Scalar, check
from ..core.checks import check_non_negative, check_positive, is_concrete
from ..core.formula import ABOVE_ZERO, BELOW_ONE, NOT_NEGATIVE, POSITIVE, formula
from ..core.jit import jit_quickly, quick_jit
from ..core.printing import printed
from ..core.roots import increasing_root
from ..core.safe import safe_divide
from ..core.shapes import with_rank
from ..core.tracing import is_traced
from ..core.types import as_float
from ..minimisation import Criterion, minimise
from .fixed_masses import all_choices, choose_stages
from .optimisers import lbfgs

Stages: TypeAlias = Float[Array, "stages *#runs"]
StageValues: TypeAlias = Stages | np.ndarray | Sequence[float]


def stationary_mass_ratio(
    multiplier: ArrayLike, exhaust_velocity: ArrayLike, structural_factor: ArrayLike
) -> ArrayLike:
    """Mass ratio at which ln(m01/P) is stationary (Thomson 8.2-9).

    **Arguments**

    - `multiplier`: lambda, 1/(unit of u).
    - `exhaust_velocity`: u, in any unit.
    - `structural_factor`: b.

    **Returns** mu. Below 1 it is invalid: the optimum is then at the bound mu = 1.
    """
    product = multiplier * exhaust_velocity
    return (1.0 + product) / (product * structural_factor)


def velocity_limit(exhaust_velocity: Stages, structural_factor: Stages) -> Scalar:
    """The total velocity, unit of u, at which the payload vanishes: sum_i u_i ln(1/b_i)."""
    return -jnp.sum(exhaust_velocity * jnp.log(structural_factor), axis=0)


@formula(
    total_velocity=NOT_NEGATIVE,
    exhaust_velocity=POSITIVE,
    structural_factor=BELOW_ONE,
    stages=ABOVE_ZERO,
)
def equal_stages_payload(
    total_velocity: Scalar,
    exhaust_velocity: Scalar,
    structural_factor: Scalar,
    stages: Scalar,
) -> Scalar:
    """Payload over initial mass, P/m01, of a rocket of equal stages (Thomson 8.2-P1).

    **Arguments**

    - `total_velocity`: v_m, and `exhaust_velocity`: u, in one unit.
    - `structural_factor`: b, below 1.
    - `stages`: N, one or more; infinite for the limit exp(-v_m/(u (1 - b))).

    **Returns** [(1/mu - b)/(1 - b)]^N with mu = exp(v_m/(N u)); zero where the stages cannot give
    the velocity.
    """
    each = as_float(total_velocity) / (exhaust_velocity * stages)
    # ln of the ratio by its difference from 1, which is accurate for many stages.
    lost = -jnp.expm1(-each) / (1.0 - structural_factor)
    able = lost < 1.0
    finite = jnp.isfinite(as_float(stages))
    log_ratio = jnp.where(finite, stages, 1.0) * jnp.log1p(-jnp.where(able, lost, 0.0))
    endless = -total_velocity / (exhaust_velocity * (1.0 - structural_factor))
    return jnp.where(able, jnp.exp(jnp.where(finite, log_ratio, endless)), 0.0)


@final
@printed()
class Staging(eqx.Module):
    """The optimal staging: (stages, *runs) for stage quantities, else (*runs,).

    - `mass_ratio`: mu_i, of the burn of each stage.
    - `initial_mass`: m01/P, initial mass over payload.
    - `payload_ratio`: P/m01, its inverse.
    - `multiplier`: lambda, negative, 1/(unit of u): one more unit of velocity multiplies m01 by
      exp(-lambda).
    - `used`: False for a stage that the optimum omits; its mass ratio is then exactly 1.
    - `feasible`: False where a traced demand exceeds the capability of the stages. The other fields
      are then the limits at vanishing payload: mass ratios 1/b_i, `payload_ratio` 0, `initial_mass`
      and -`multiplier` infinite, derivatives zero."""

    mass_ratio: Stages
    initial_mass: Scalar
    payload_ratio: Scalar
    multiplier: Scalar
    used: Bool[Array, "stages *#runs"]
    feasible: Flag


def optimal_staging(
    exhaust_velocity: StageValues,
    structural_factor: StageValues,
    total_velocity: ArrayLike,
    fixed_mass: StageValues | None = None,
) -> Staging:
    """The mass ratios that give a payload a velocity with the least initial mass (Thomson 8.2-9,
    8.2-10).

    **Arguments**

    - `exhaust_velocity`, in any unit, and `structural_factor`: (stages, *runs), or (stages,) for
      all runs.
    - `total_velocity`: without losses, in the unit of the exhaust velocity, (*runs,).
    - `fixed_mass`: dropped with each stage in addition to its structure, over the payload, with
      runs as the velocity or for all runs; a stage that costs more than it saves is left out. At
      most ten stages.

    **Returns** a `Staging`, differentiable in all of them.

    **Raises** `InputError` for values out of range, and for a concrete velocity at or above the
    limit of these stages.
    """
    u, b, v = _checked(exhaust_velocity, structural_factor, total_velocity)
    if fixed_mass is None:
        return _solve(u, b, v)
    c = as_float(fixed_mass)
    check_non_negative("fixed_mass", c)
    if c.ndim == 0 or c.shape[0] not in (1, u.shape[0]):
        raise InputError(
            f"fixed_mass has the shape {c.shape}: it must have one value for each of "
            f"{u.shape[0]} stages on its first axis."
        )
    return _with_fixed_masses(u, b, v, c)


def _with_fixed_masses(u: Stages, b: Stages, v: Scalar, c: Stages) -> Staging:
    """The best of all choices of stages (`fixed_masses.py`)."""
    rank = max(u.ndim - 1, c.ndim - 1)
    u, b, c = (with_rank(x, rank) for x in (u, b, c))
    shape = jnp.broadcast_shapes(u.shape, b.shape, c.shape, (1, *v.shape))
    u, b, c = (jnp.broadcast_to(x, shape) for x in (u, b, c))
    choices = jnp.asarray(all_choices(shape[0]))
    chain, used, feasible, _ = choose_stages(u, b, c, jnp.broadcast_to(v, shape[1:]), choices)
    return Staging(
        mass_ratio=jnp.where(feasible, jnp.exp(chain.log_ratio), 1.0 / b),
        initial_mass=jnp.where(feasible, chain.initial_mass, jnp.inf),
        payload_ratio=jnp.where(feasible, 1.0 / chain.initial_mass, 0.0),
        multiplier=jnp.where(feasible, chain.multiplier, -jnp.inf),
        used=used | ~feasible,
        feasible=feasible,
    )


@quick_jit
def _solve(u: Stages, b: Stages, v: Scalar) -> Staging:
    limit = velocity_limit(u, b)
    feasible = v < limit
    # A velocity that has a root where there is none, so that no derivative becomes NaN.
    v = jnp.where(feasible, v, 0.5 * limit)
    x = increasing_root(
        lambda x: v - jnp.sum(u * _log_mass_ratio(x, u, b), axis=0),
        0.0 * v,
        jnp.max(u * (1.0 - b), axis=0),
    )
    s = _log_mass_ratio(x, u, b)
    used = s > 0.0
    # Where the root is close to u, u - x has few digits: one more step in the mass ratios
    # themselves gives the velocity to rounding.
    share = jnp.where(used, 1.0 / jnp.where(used, u - x, 1.0), 0.0)
    s = s + share * safe_divide(v - jnp.sum(u * s, axis=0), jnp.sum(u * share, axis=0))
    # 1 - b mu = x/u where the stage is used, because the difference loses digits near the limit.
    log_mass = jnp.sum(jnp.where(used, s + jnp.log1p(-b) - jnp.log(x / u), 0.0), axis=0)
    return Staging(
        mass_ratio=jnp.where(feasible, jnp.exp(s), 1.0 / b),
        initial_mass=jnp.where(feasible, jnp.exp(log_mass), jnp.inf),
        payload_ratio=jnp.where(feasible, jnp.exp(-log_mass), 0.0),
        multiplier=jnp.where(feasible, -1.0 / x, -jnp.inf),
        used=used | ~feasible,
        feasible=feasible,
    )


def optimal_staging_by_gradient(
    exhaust_velocity: StageValues, structural_factor: StageValues, total_velocity: ArrayLike
) -> Staging:
    """The optimum of `optimal_staging` by descent on ln(m01/P), without the stationarity condition.

    **Arguments** as in `optimal_staging`, for one run.

    **Returns** a `Staging`, which is not differentiable; `feasible` also reports whether the
    descent converged.

    **Raises** `InputError` as `optimal_staging` does, and for more than one run.
    """
    u, b, v = _checked(exhaust_velocity, structural_factor, total_velocity)
    if v.ndim > 0:
        raise InputError(
            f"total_velocity has the shape {v.shape}: "
            "the descent does not accept a batch, use jax.vmap."
        )
    return _descend(u, b, v) if is_traced((u, b, v)) else _descend_quickly(u, b, v)


def _descend(u: Stages, b: Stages, v: Scalar) -> Staging:
    # Each stage has the share q_i^2 / sum_j q_j^2 of the velocity: every q satisfies the
    # constraint, and the bound mu_i = 1 is the ordinary point q_i = 0. Where each stage alone
    # exceeds the difference from the limit, none can vanish, and the shares are those of the
    # difference, which preserves the digits of 1 - b_i mu_i.
    most = -u * jnp.log(b)
    limit = jnp.sum(most)
    left = limit - v
    near = left < jnp.min(most)
    whole, sign = jnp.where(near, left, v), jnp.where(near, -1.0, 1.0)
    # (1 - b mu)/(1 - b) is -expm1(-short)/(1 - b), or 1 - b expm1(s)/(1 - b): each from its small
    # difference, which is accurate near the limit and for slow rockets.
    factor = -jnp.where(near, 1.0, b) / (1.0 - b)

    def log_stage_masses(q: Stages) -> tuple[Stages, Stages, Stages]:
        """ln mu_i, -ln(b_i mu_i), and the logarithms whose sum is ln(m01/P)."""
        part = whole * (q * q / jnp.sum(q * q)) / u
        other = most / u - part
        s, short = jnp.where(near, other, part), jnp.where(near, part, other)
        # b mu >= 1 leaves no payload: an infinite mass there turns the line search back.
        some = short > 0.0
        rest = factor * jnp.expm1(jnp.where(some, sign * part, 0.5 * sign))
        close, apart = (jnp.where(near == side, rest, 0.5) for side in (True, False))
        log_rest = jnp.where(near, jnp.log(close), jnp.log1p(apart))
        return s, short, jnp.where(some, s - log_rest, jnp.inf)

    # Equal b_i mu_i for all stages: feasible if anything is.
    start = jnp.sqrt(jnp.where(near, u / jnp.sum(u), most / limit))
    minimum = minimise(
        lambda q: Criterion(jnp.sum(log_stage_masses(q)[2])),
        start,
        optimiser=lbfgs(),
        tolerance=1e-12,
        check_gradient=False,
    )
    s, short, log_masses = log_stage_masses(minimum.x)
    # A descent reaches the bound to its tolerance only.
    used = u * s > 1e-9 * v
    # The multiplier from the stage with the largest share, where it is best conditioned.
    leader = jnp.argmax(u * s)
    log_mass = jnp.sum(log_masses)
    return Staging(
        mass_ratio=jnp.exp(s),
        initial_mass=jnp.exp(log_mass),
        payload_ratio=jnp.exp(-log_mass),
        multiplier=1.0 / (u * jnp.expm1(-short))[leader],
        used=used,
        feasible=minimum.converged & (v < limit),
    )


# Compiled for one rocket, which takes a hundred microseconds either way.
_descend_quickly = jit_quickly(_descend)


def _log_mass_ratio(x: Scalar, u: Stages, b: Stages) -> Stages:
    """ln mu_i (Thomson 8.2-9) from x = -1/lambda, or 0 where the bound mu_i = 1 holds."""
    used = x < u * (1.0 - b)
    return jnp.where(used, jnp.log1p(-jnp.where(used, x / u, 0.0)) - jnp.log(b), 0.0)


def _checked(
    exhaust_velocity: StageValues, structural_factor: StageValues, total_velocity: ArrayLike
) -> tuple[Stages, Stages, Scalar]:
    """The three inputs as checked arrays that broadcast."""
    u = as_float(exhaust_velocity)
    b = as_float(structural_factor)
    v = as_float(total_velocity)
    for name, stages in (("exhaust_velocity", u), ("structural_factor", b)):
        if stages.ndim == 0:
            raise InputError(
                f"{name} is a scalar: it must have one value per stage on its first axis."
            )
    check_positive("exhaust_velocity", u)
    check_positive("structural_factor", b)
    check_positive("total_velocity", v)
    if is_concrete(b):
        check(np.asarray(b) < 1.0, "structural_factor", b, "below 1")
    rank = max(u.ndim - 1, b.ndim - 1, v.ndim)
    u = with_rank(u, rank)
    b = with_rank(b, rank)
    if all(is_concrete(x) for x in (u, b, v)):
        # By NumPy, which compiles nothing.
        limit = -np.sum(np.asarray(u) * np.log(np.asarray(b)), axis=0)
        # The first rocket of a batch that exceeds the limit, because the error names one number.
        ok, limits = np.broadcast_arrays(np.asarray(v) < limit, limit)
        check(
            ok,
            "total_velocity",
            v,
            "below the limit of these stages, sum of u ln(1/beta), "
            f"{limits.flat[np.argmin(ok)]:.10g} m/s",
        )
    return u, b, v
