"""Smoothed samples, whose statistics have derivatives by every run.

Quantile c of a share q, and half the width b of the kernel about it, together:

    (1/n) sum_i G((c - x_i)/b) = q        (1/n) sum_i K((c - x_i)/b) = 32/35 r
    r = 4 sqrt(q (1 - q)/n)

    symbol  meaning                                                          unit
    x_i     values of the n runs                                             that of the output
    K       triweight (1 - z^2)^3, zero beyond -1 and 1                      1
    G       distribution of the kernel 35/32 K                               1
    r       half the kernel as a share of the runs: four errors of a rank    1

Where values are sparse the kernel is wide: it contains the same number of runs everywhere, and its
standard deviation b/3 is 1.3 errors of c. Both equations are smooth in all values, and so are c and
b. Only the runs within b of c have a weight in their derivatives, about 8 sqrt(q (1 - q) n) of
them: no other needs to be differentiated (`_few_runs.py`). Source: Silverman, Density Estimation
for Statistics and Data Analysis (1986), 3.3 (kernels); Wand and Jones, Kernel Smoothing (1995),
2.7.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..core import Scalar

# Of the kernel of a share of violations, in mean absolute deviations: 1.3 standard deviations of a
# normal distribution. An outlier moves the former less.
BANDWIDTH = 1.3 * float(np.sqrt(np.pi / 2.0))
# Half the kernel of a quantile, in standard errors of its rank: twenty runs beyond it hold it.
HALF_WIDTH = 4.0
# Units of rounding up to which a width counts as zero dispersion.
NOISE = 4096.0
# Newton's steps for a quantile and its width, from order statistics.
NEWTON_STEPS = 16


def below(z: Float[Array, "..."]) -> Float[Array, "..."]:
    """The distribution G of the triweight kernel."""
    z = jnp.clip(z, -1.0, 1.0)
    z2 = z * z
    return 0.5 + 35.0 / 32.0 * z * (1.0 - z2 * (1.0 - z2 * (0.6 - z2 / 7.0)))


def density(z: Float[Array, "..."]) -> Float[Array, "..."]:
    """The derivative of G."""
    return 35.0 / 32.0 * triweight(z)


def triweight(z: Float[Array, "..."]) -> Float[Array, "..."]:
    """The kernel K, 1 at its middle."""
    return jnp.maximum(1.0 - z * z, 0.0) ** 3


def hinge(z: Float[Array, "..."]) -> Float[Array, "..."]:
    """The integral of G from -1 on: max(z, 0), smoothed."""
    near = jnp.clip(z, -1.0, 1.0)
    z2 = near * near
    curved = 35.0 / 32.0 * z2 * (0.5 - z2 * (0.25 - z2 * (0.1 - z2 / 56.0)))
    return 35.0 / 256.0 + 0.5 * near + curved + jnp.maximum(z - 1.0, 0.0)


def count(x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
    """The number of successful runs; NaN for none, which makes NaN of a statistic."""
    n = jnp.sum(good, dtype=x.dtype)
    return jnp.where(n > 0.0, n, jnp.nan)


def width_of_all(
    x: Float[Array, " runs"], good: Bool[Array, " runs"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The width of a kernel from the scatter of all successful runs, and their number."""
    n = count(x, good)
    mean = jnp.sum(jnp.where(good, x, 0.0)) / n
    off = jnp.abs(jnp.where(good, x - mean, 0.0))
    return jnp.maximum(BANDWIDTH * jnp.sum(off) / (n * jnp.cbrt(n)), _noise(mean)), n


def smoothed_quantile(
    x: Float[Array, " runs"], good: Bool[Array, " runs"], share: float
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """The quantile of the smoothed sample, half the width of the kernel, and the number of
    successful runs."""
    n = count(x, good)
    held = HALF_WIDTH * jnp.sqrt(share * (1.0 - share) / n)
    fixed = lax.stop_gradient(x)
    # Failed runs go to the end.
    ordered = jnp.sort(jnp.where(good, fixed, jnp.inf))

    def order_statistic(share: Scalar) -> Array:
        place = jnp.ceil(share * jnp.where(n > 0.0, n, 1.0)).astype(int) - 1
        last = jnp.where(n > 0.0, n, 1.0).astype(int) - 1
        return jnp.where(jnp.any(good), ordered[jnp.clip(place, 0, last)], jnp.nan)

    start = order_statistic(share)
    wide = 0.5 * (order_statistic(share + held) - order_statistic(share - held))
    kernel = _Kernel(good, n, share, held, _noise(start))
    begun = (start, jnp.maximum(wide, kernel.least))

    def improved(_: Array, at: tuple[Array, Array]) -> tuple[Array, Array]:
        return kernel.improved(at[0], at[1], fixed)

    c, b = lax.fori_loop(0, NEWTON_STEPS, improved, begun)
    # One more step has the derivatives of the root.
    return (*kernel.solved(c, b, x), n)


class _Kernel(NamedTuple):
    """The two equations of a quantile c and the half-width b of its kernel.

    - `good`, `n`: the successful runs, and how many there are; `share`, `held`: q and r.
    - `least`: the least half-width."""

    good: Bool[Array, " runs"]
    n: Float[Array, ""]
    share: float
    held: Float[Array, ""]
    least: Float[Array, ""]

    def errors(self, c: Array, b: Array, x: Array) -> tuple[Array, Array, Array]:
        """The errors of both equations, and the places z of the runs in the kernel."""
        z = jnp.where(self.good, c - jnp.where(self.good, x, c), 2.0 * b) / b
        now = jnp.sum(jnp.where(self.good, below(z), 0.0)) / self.n
        full = jnp.sum(triweight(z)) / self.n
        return now - self.share, full - 32.0 / 35.0 * self.held, z

    def slopes(self, z: Array) -> tuple[Array, Array, Array, Array]:
        """Their derivatives with respect to c/b and to log b, two of each."""
        bump = jnp.maximum(1.0 - z * z, 0.0)
        moments = (bump**3, z * bump**3, z * bump**2, z * z * bump**2)
        first, second, third, fourth = (jnp.sum(m) / self.n for m in moments)
        # Where no run is near: as with a hundredth of one in the kernel.
        least = 0.01 / self.n
        of_c = jnp.maximum(35.0 / 32.0 * first, least)
        return of_c, -35.0 / 32.0 * second, -6.0 * third, jnp.maximum(6.0 * fourth, least)

    def improved(self, c: Array, b: Array, x: Array) -> tuple[Array, Array]:
        """Newton's step for each unknown separately, in which its equation is monotonic."""
        off, _, z = self.errors(c, b, x)
        c = c - b * jnp.clip(off / self.slopes(z)[0], -1.0, 1.0)
        _, off, z = self.errors(c, b, x)
        factor = jnp.exp(-jnp.clip(off / self.slopes(z)[3], -1.0, 1.0))
        return c, jnp.maximum(b * factor, self.least)

    def solved(self, c: Array, b: Array, x: Array) -> tuple[Array, Array]:
        """Newton's step for both together."""
        first, second, z = self.errors(c, b, x)
        cc, cb, bc, bb = lax.stop_gradient(self.slopes(z))
        # Without dispersion the width is that of the rounding, and constant.
        fixed = b <= self.least
        cb, bc, second = (jnp.where(fixed, 0.0, x) for x in (cb, bc, second))
        whole = cc * bb - cb * bc
        c_step, b_step = bb * first - cb * second, cc * second - bc * first
        return c - b * c_step / whole, b - b * b_step / whole


def _noise(near: Float[Array, ""]) -> Float[Array, ""]:
    """The least width of values `near`: that of their rounding."""
    limits = jnp.finfo(near.dtype)
    return lax.stop_gradient(NOISE * limits.eps * jnp.abs(near) + limits.tiny)
