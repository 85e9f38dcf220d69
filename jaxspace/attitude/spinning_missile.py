"""A spinning symmetric body under a transverse moment, by closed forms for small angles: thrust
misalignment, a pulse or any moment, and a body with a tilted principal axis.

    w' - i lam w = M/A                                   w = omega_1 + i omega_2, body axes
    Th' = w e^(i n t),       Th = theta e^(i psi)        inertial axes, small angles
    w  = w0 e^(i lam t) + (M/A) t e^(i lam t) E((nu - lam) t)             for M e^(i nu t)
    Th = Th0 + w0 t E((n + lam) t) + (M/A) t^2 D((n + nu) t, (n + lam) t)
       + b [1 - e^(i n t) + i n t E((n + lam) t)]                         principal axis askew by b
    E(x) = (e^(i x) - 1)/(i x),   D(x, y) = (E(x) - E(y))/(i (x - y))

    symbol      meaning                                                          unit
    A, C, n     moments across and along the axis, rate of spin                  kg m^2, rad/s
    lam         n (C - A)/A                                                      rad/s
    M, nu       transverse moment M_1 + i M_2 in body axes, its frequency        N m, rad/s
    theta, psi  angle between the axis and its first direction; of the node      rad
    Th, b       complex tilt of the axis; small turn from the body's axis to the  rad
                principal one, as a vector (x + i y)

Source: Thomson 7.2-5 to 7.2-9, 7.3-5 to 7.3-9, 7.4-2, 7.4-18, Problems 6, 10 and 13 of 7.4.
Complex numbers are (2, *runs): real and imaginary part. w is exact for a symmetric body; Th is
valid for small angles, to third order. E and D have no singularities: resonance, nu = lam, a body
without spin and one with C = A are regular cases.
"""

__all__ = ["principal_tilt"]

import math
from collections.abc import Callable
from typing import TypeAlias, final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..bodies.inertia import AbstractInertia
from ..bodies.principal_axes import principal_axes
from ..core import AbstractParameters, Matrix, NumberField, Scalar, quantity
from ..core.safe import sinc_squared
from ..core.shapes import with_rank
from ..core.types import precision_of
from ..rotations.tilt import tilt_of_axis

Complex: TypeAlias = Float[Array, "2 *#runs"]
"""Real and imaginary part."""
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
# Terms of the series of D: |x|, |y| < 1, and the sum of the next ones is below rounding.
_TERMS = 19


def principal_tilt(inertia: AbstractInertia) -> Complex:
    """The rotation vector b, rad, (2, *runs), from the body's z axis to the nearest principal axis
    (Thomson 7.4-2).

    Its derivative exists where the moment of that axis differs from both others."""
    moments, axes = principal_axes(inertia)
    # Principal axes come in the order of their moments, and that near z may be any of them.
    nearest = jnp.argmax(jnp.abs(axes[2]), axis=0)
    along = jnp.take_along_axis(axes, nearest[None, None], axis=1)[:, 0]
    moment = jnp.take_along_axis(moments, nearest[None], axis=0)[0]
    # An axis has two unit vectors: the one on the side of z is taken.
    return tilt_of_axis(
        _refined(inertia.matrix(), moment, jnp.where(along[2] < 0.0, -along, along))
    )


def _refined(tensor: Matrix, moment: Scalar, s: Array) -> Array:
    """The principal axis `s` of the `moment`, nearer to z than the others, with all digits of a
    small tilt."""
    # Its components across z by those of the tensor: an eigenvector has absolute errors only.
    # With nearly equal moments it cannot be improved.
    a = tensor[0, 0] - moment
    b = tensor[0, 1]
    c = tensor[1, 1] - moment
    d, e = tensor[0, 2], tensor[1, 2]
    whole = a * c - b * b
    use = jnp.abs(whole) > 1e-8 * moment * moment
    share = jnp.where(use, s[2], 0.0) / jnp.where(use, whole, 1.0)
    x, y = (b * e - c * d) * share, (b * d - a * e) * share
    return jnp.stack([jnp.where(use, x, s[0]), jnp.where(use, y, s[1]), s[2]])


@final
class SpinningMissile(AbstractParameters):
    """A symmetric body that spins about its axis, z, under a transverse moment."""

    transverse_inertia: NumberField = quantity("kg m^2", positive=True, doc="A, across the axis")
    axial_inertia: NumberField = quantity("kg m^2", positive=True, doc="C, along the axis")
    spin_rate: NumberField = quantity("rad/s", doc="n")

    @property
    def nutation_rate(self) -> Scalar:
        """lam, rad/s: the rate of the free transverse rotation in body axes (Thomson 7.2-6)."""
        return self.spin_rate * (self.axial_inertia / self.transverse_inertia - 1.0)

    @property
    def precession_rate(self) -> Scalar:
        """n + lam = n C/A, rad/s: its rate in inertial axes."""
        return self.spin_rate * self.axial_inertia / self.transverse_inertia

    def transverse_rate(
        self,
        t: Scalar,
        start: Complex,
        moment: Complex | Callable[[Scalar], Complex],
        frequency: Scalar = 0.0,
        panels: int = 8,
    ) -> Complex:
        """w after a time (Thomson 7.2-9); exact for every angle.

        **Arguments**

        - `t`: s, (*runs,).
        - `start`: w0, rad/s, (2, *runs).
        - `moment`: M, N m, (2, *runs), of M e^(i nu t); or a function of the time, which is
          integrated by 32 points of Gauss in each panel.
        - `frequency`: nu, rad/s; a moment along one axis is the sum of two with nu and -nu.
        - `panels`: of the quadrature.

        **Returns** w, rad/s, (2, *runs)."""
        rate = self.nutation_rate
        turned = _phase(rate * t)
        free = _product(_of_rank(start, t), turned)
        if callable(moment):

            def response(tau: Scalar) -> Complex:
                return _phase(rate * (t - tau))

            return free + self._integral(moment, response, t, panels)
        forced = t * _product(turned, _mean_phase((frequency - rate) * t))
        return free + _product(_of_rank(moment, t), forced) / self.transverse_inertia

    def complex_tilt(
        self,
        t: Scalar,
        angle: Complex,
        start: Complex,
        moment: Complex | Callable[[Scalar], Complex],
        frequency: Scalar = 0.0,
        tilt: Complex | None = None,
        panels: int = 8,
    ) -> Complex:
        """Th after a time, in inertial axes (Thomson 7.3-9, 7.4-18 and Problem 10).

        **Arguments**

        - `angle`: Th0, rad, (2, *runs), small.
        - `tilt`: b, rad, (2, *runs), of `principal_tilt`; zero where it is left out.
        - the others: as in `transverse_rate`.

        **Returns** Th, rad, (2, *runs)."""
        n, fast = self.spin_rate, self.precession_rate
        mean = t * _mean_phase(fast * t)
        result = _of_rank(angle, t) + _product(_of_rank(start, t), mean)
        if callable(moment):

            def response(tau: Scalar) -> Complex:
                left = t - tau
                return left * _product(_phase(n * tau), _mean_phase(fast * left))

            result = result + self._integral(moment, response, t, panels)
        else:
            forced = t * t * _mean_ramp((n + frequency) * t, fast * t)
            result = result + _product(_of_rank(moment, t), forced) / self.transverse_inertia
        if tilt is not None:
            turned = _phase(n * t)
            # 1 - e^(i n t) + i n t E((n + lam) t)
            wobble = jnp.stack([1.0 - turned[0] - n * mean[1], n * mean[0] - turned[1]])
            result = result + _product(_of_rank(tilt, t), wobble)
        return result

    def circles(self, moment: Complex) -> tuple[Complex, Scalar, Scalar]:
        """The two circles on which the axis moves under a constant moment from rest (Thomson 7.4,
        Problem 6): the centre of the slow one, (2, *runs), its radius and that of the fast one,
        rad. Not finite without spin or for C = A."""
        m = jnp.hypot(moment[0], moment[1])
        # Th = -M/(n lam A) [lam/(n + lam) - e^(i n t) + n/(n + lam) e^(i (n + lam) t)]
        n, rate = self.spin_rate, self.nutation_rate
        scale = 1.0 / (n * self.transverse_inertia)
        slow = m * jnp.abs(scale * n / (rate * self.precession_rate))
        return -scale / self.precession_rate * moment, slow, m * jnp.abs(scale / rate)

    def _integral(
        self,
        moment: Callable[[Scalar], Complex],
        response: Callable[[Scalar], Complex],
        t: Scalar,
        panels: int,
    ) -> Complex:
        """The integral of M/A times the response from 0 to t."""
        t = jnp.asarray(t)
        places = (np.arange(panels)[:, None] + 0.5 + 0.5 * _PLACES).ravel() / panels
        weights = np.tile(0.5 * _WEIGHTS / panels, panels)
        nodes = jnp.asarray(np.stack([places, weights], axis=1), precision_of(self, t))

        def term(node: Array) -> Complex:
            tau = node[0] * t
            return node[1] * t * _product(_of_rank(moment(tau), t), response(tau))

        # One node after the other in a loop of the program, so that M may be any function.
        first = jnp.zeros_like(term(nodes[0]))
        total, _ = jax.lax.scan(lambda total, node: (total + term(node), None), first, nodes)
        return total / self.transverse_inertia


def _of_rank(pair: Complex, t: Scalar) -> Complex:
    """The number with the axes of the times."""
    return with_rank(jnp.asarray(pair), jnp.ndim(t))


def _product(a: Complex, b: Complex) -> Complex:
    # As pairs of real numbers, which every derivative and every batch takes.
    return jnp.stack([a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]])


def _phase(x: Scalar) -> Complex:
    """e^(i x)."""
    return jnp.stack([jnp.cos(x), jnp.sin(x)])


def _mean_phase(x: Scalar) -> Complex:
    """E(x), the mean of e^(i x s) for s from 0 to 1."""
    x = jnp.asarray(x)
    half = sinc_squared(0.25 * x * x)
    return jnp.stack([sinc_squared(x * x), 0.5 * x * half * half])


def _mean_ramp(x: Scalar, y: Scalar) -> Complex:
    """D(x, y), the divided difference of E: [e^(i y) E(x - y) - E(y)]/(i x)."""
    x, y = jnp.broadcast_arrays(jnp.asarray(x), jnp.asarray(y))
    # D is symmetric: the greater argument divides, so that the quotient is accurate.
    swap = jnp.abs(y) > jnp.abs(x)
    great, small = jnp.where(swap, y, x), jnp.where(swap, x, y)
    # Below it the difference of the closed form cancels, and the series has few terms.
    near = jnp.abs(great) < 1.0
    apart = _product(_phase(small), _mean_phase(great - small)) - _mean_phase(small)
    far = jnp.stack([apart[1], -apart[0]]) / jnp.where(near, 1.0, great)
    a, b = jnp.where(near, great, 0.0), jnp.where(near, small, 0.0)
    # The sum of i^k h_k/(k + 2)!, of the homogeneous polynomials h_k = a h_(k-1) + b^k.
    h = jnp.ones_like(a)
    power = jnp.ones_like(a)
    total = [0.5 * jnp.ones_like(a), 0.0 * a]
    for k in range(1, _TERMS):
        power = power * b
        h = a * h + power
        sign = 1.0 if k % 4 < 2 else -1.0
        total[k % 2] = total[k % 2] + sign / math.factorial(k + 2) * h
    return jnp.where(near, jnp.stack(total), far)
