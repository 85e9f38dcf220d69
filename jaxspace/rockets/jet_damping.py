"""Jet damping: the effect on the rotation of propellant that flows from the grain to the nozzle.

    M = m' (r_e x (omega x r_e) averaged over the exit) - (dJ/dm) m' omega

    averaged over an exit ring of radius rho at the distance l behind the centre of mass:
    M_xy = m' (l^2 + rho^2 / 2) omega_xy - m' (dJ_x,y/dm) omega_xy
    M_z = m' rho^2 omega_z - m' (dJ_z/dm) omega_z

    averaged over a cluster of nozzles at the places r_i, which share the flow equally:
    M = m' (mean of |r_i|^2 omega - r_i (r_i . omega)) - m' (dJ/dm) omega

    symbol   meaning                                                unit
    m'       rate of the mass, negative when mass leaves            kg/s
    l        distance of the nozzle's exit from the centre of mass  m
    rho      radius of the ring of exits (0: one central nozzle)    m
    dJ/dm    how the inertia falls with the mass                    m^2

Closed forms for radii of gyration k, k_z that stay (xi = m / m_0, constant m'), the second for any
k:
    omega = omega_0 xi^(l^2/k^2 - 1)                                        no spin (7.8-4)
    omega = omega_0 k_0^2/(xi k^2) exp(-integral of (l/k)^2 d(xi)/xi from xi to 1)    k(xi), l(xi)
    omega_z = n xi^(rho^2/k_z^2 - 1)                                        (7.9)
    |omega_xy| = |omega_xy(0)| xi^((l^2 + rho^2/2 - k^2)/k^2)               (Ex. 7.9-1, corrected)

Source: Thomson 7.8, 7.9 (errata 11 to 13), 7.10 problem 5 (a greater k has less damping where l
stays, and more where l/k does). The exhaust leaves along the nozzle axis, without swirl.
"""

__all__ = ["jet_damping_ratio", "spin_ratio"]

from collections.abc import Callable
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, Vector, quantity, reference
from ..core.checks import check_positive
from ..core.formula import NOT_NEGATIVE, formula
from ..core.safe import phi1, times_slope
from ..core.shapes import with_rank
from ..core.types import as_float
from ..core.vectors import axis, dot

# The error of a quadrature by Gauss falls exponentially with the nodes.
NODES = 32


@formula(mass_ratio=NOT_NEGATIVE)
def jet_damping_ratio(
    mass_ratio: Scalar,
    lever_over_gyration: Scalar | Callable[[Scalar], Scalar],
    *,
    gyration: Callable[[Scalar], Scalar] | None = None,
) -> Scalar:
    """omega / omega_0 without spin (Thomson 7.8-4; with a radius of gyration that changes, 7.10
    problem 5).

    **Arguments**

    - `mass_ratio`: xi = m / m_0.
    - `lever_over_gyration`: l / k, or a smooth function of xi, from (places, *runs) to the same
      shape.
    - `gyration`: k / k_0 as a function of xi, where k changes; `None` where it stays.

    At the mass ratio zero, the end of the range, the derivatives are one-sided: by the mass ratio
    infinite for k < l < sqrt(2) k, by l / k zero; zero where the ratio is infinite. With a function
    the mass ratio has to be positive: the ratio at zero is NaN.

    **Raises** `InputError` where a function is given, for a mass ratio that is not positive.
    """
    xi = as_float(mass_ratio)
    ratio = (
        1.0
        if gyration is None
        else (gyration(xi[None])[0] / gyration(jnp.ones_like(xi)[None])[0]) ** 2
    )
    if not isinstance(lever_over_gyration, Callable):
        return _power(xi, as_float(lever_over_gyration) ** 2 - 1.0) / ratio
    check_positive("mass_ratio", mass_ratio)
    # (l/k)^2 d(xi)/xi over the logarithm of xi, in which it is smooth.
    x, weights = np.polynomial.legendre.leggauss(NODES)
    x, weights = (jnp.asarray(a, xi.dtype).reshape(-1, *(1,) * xi.ndim) for a in (x, weights))
    half = -0.5 * jnp.log(xi)
    squares = lever_over_gyration(jnp.exp(-half * (1.0 + x))) ** 2
    return jnp.exp(-half * jnp.sum(weights * squares, axis=0)) / (xi * ratio)


@formula(mass_ratio=NOT_NEGATIVE, ring_over_gyration=NOT_NEGATIVE)
def spin_ratio(mass_ratio: Scalar, ring_over_gyration: Scalar) -> Scalar:
    """omega_z / n (Thomson 7.9); at the mass ratio zero
    as `jet_damping_ratio`.

    **Arguments**

    - `mass_ratio`: m / m_0, (*runs,).
    - `ring_over_gyration`: rho / k_z, (*runs,)."""
    return _power(as_float(mass_ratio), as_float(ring_over_gyration) ** 2 - 1.0)


@jax.custom_jvp
def _power(base: Scalar, exponent: Scalar) -> Scalar:
    """base^exponent for a base that is not negative."""
    return base**exponent


@_power.defjvp
def _power_tangent(primals, tangents):
    base, exponent = primals
    end = base == 0.0
    inside = jnp.where(end, 1.0, base)
    rises = (exponent > 0.0) & (exponent < 1.0)
    one_sided = jnp.where(rises, jnp.inf, jnp.where(exponent == 1.0, 1.0, 0.0))
    by_base = jnp.where(end, one_sided, exponent * inside ** (exponent - 1.0))
    by_exponent = jnp.where(end, 0.0, inside**exponent * jnp.log(inside))
    value = _power(base, exponent)
    return value, times_slope(by_base, tangents[0]) + by_exponent * tangents[1]


@formula(ring_over_gyration=NOT_NEGATIVE)
def spin_angle(
    time: Scalar, spin: Scalar, burn_fraction_rate: Scalar, ring_over_gyration: Scalar
) -> Scalar:
    """Angle of spin, rad, after `time`, s: the integral of omega_z from the rate `spin` = n, rad/s,
    with m'/m_0 = `burn_fraction_rate`, 1/s (positive when mass leaves). Holds for a central nozzle,
    where it is a logarithm, without burning, where it is n t, and when all mass is gone; its
    derivatives there are those of `spin_ratio`: one-sided.

    **Arguments**

    - `time`: s.
    - `spin`: n, rad/s.
    - `burn_fraction_rate`: m'/m_0, 1/s.
    - `ring_over_gyration`: rho / k_z."""
    q = as_float(ring_over_gyration) ** 2
    burnt = burn_fraction_rate * as_float(time)
    # The end of the range, at which the logarithm is infinite.
    empty = burnt == 1.0
    log_xi = jnp.log1p(-jnp.where(empty, 0.5, burnt))
    # -log_xi / burn_fraction_rate = time / phi1(log_xi), which has no hole where nothing burns.
    logarithmic = spin * time * phi1(q * log_xi) / phi1(log_xi)
    # n (1 - xi^q)/(q m'/m_0) reaches the end, where little of the difference cancels.
    late = (empty & (q > 0.0)) | ((burnt > 0.5) & (q * log_xi < -1.0))
    shares = jnp.where(late, q * burnt, 1.0)
    left = _power(jnp.where(late, 1.0 - burnt, 1.0), jnp.where(late, q, 1.0))
    powers = spin * time * (1.0 - left) / shares
    # Through a central nozzle the angle grows without bound: an infinity without slopes.
    bound = jnp.copysign(jnp.inf, jax.lax.stop_gradient(as_float(spin)))
    return jnp.where(late, powers, jnp.where(empty, bound, logarithmic))


@final
class JetDamping(AbstractEffect):
    """Jet damping of a body whose motor loses mass at the rate `mass_rate(t, mass)`, kg/s
    (negative)."""

    mass_rate: Callable[[Scalar, Scalar], Scalar] = reference(
        "mass_rate", doc="rate of the mass, kg/s, as a function of time and mass"
    )
    exit_station: NumberField = quantity(
        "m", doc="z of the nozzle's exit in the body's construction axes"
    )
    exit_radius: NumberField = quantity(
        "m", non_negative=True, default=0.0, doc="of the ring of exits; 0 for one central nozzle"
    )

    nozzles: Float[Array, "2 nozzles *#runs"] | None = quantity(
        "m",
        optional=True,
        doc="x and y of the nozzles of a cluster, instead of a ring; they share the flow equally",
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        assert y.mass is not None and y.omega is not None
        # A body of constant mass has its centre at the origin and gives a plain 0.0.
        centre: Any = body.centre_of_mass(y.mass)
        lever = self.exit_station - (centre if isinstance(centre, float) else centre[2])
        rate = self.mass_rate(t, y.mass)
        kept = body.inertia_per_mass(y.mass) * y.omega
        if self.nozzles is not None:
            return Load(torque_B=rate * (self._carried_by(lever, centre, y.omega) - kept))
        ring = self.exit_radius * self.exit_radius
        across, along = lever * lever + 0.5 * ring, ring + 0.0 * lever
        carried = across + (along - across) * axis(2, across)
        return Load(torque_B=rate * (carried * y.omega - kept))

    def _carried_by(self, lever: Scalar, centre: PyTree, omega: Vector) -> Vector:
        """The mean of r x (omega x r) over the nozzles."""
        assert self.nozzles is not None
        x, y = (with_rank(n, omega.ndim - 1) for n in self.nozzles)
        aside = (0.0, 0.0) if isinstance(centre, float) else (centre[0], centre[1])
        places = jnp.broadcast_arrays(x - aside[0], y - aside[1], lever)
        r = jnp.stack(places)
        w = omega[:, None]
        return jnp.mean(dot(r, r) * w - r * dot(r, w), axis=1)
