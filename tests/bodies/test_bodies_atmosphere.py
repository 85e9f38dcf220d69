"""The U.S. Standard Atmosphere, 1976, against its printed table, and its derivatives."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.integrate import quad

from jaxspace.bodies import PadAtmosphere, StandardAtmosphere
from jaxspace.bodies.atmosphere import GAS_CONSTANT, GRAVITY, MOLAR_MASS
from jaxspace.bodies.standard_atmosphere import (
    LAYERS,
    PRESSURE,
    RADIUS,
    geometric_height,
    geopotential_height,
    standard_atmosphere,
)
from jaxspace.core import InputError
from jaxspace.vehicles import LaunchSite

# Table I: geometric height, km; T, K; p, Pa; rho, kg/m^3; c, m/s.
LOW = np.array(
    [
        [-1, 294.651, 1.1393e5, 1.3470, 344.111],
        [0, 288.150, 1.01325e5, 1.2250, 340.294],
        [1, 281.651, 8.98762e4, 1.1117, 336.435],
        [5, 255.676, 5.40482e4, 7.3643e-1, 320.545],
        [10, 223.252, 2.64999e4, 4.1351e-1, 299.532],
        [15, 216.650, 1.21118e4, 1.9476e-1, 295.069],
        [20, 216.650, 5.52930e3, 8.8910e-2, 295.069],
        [30, 226.509, 1.19703e3, 1.8410e-2, 301.709],
        [40, 250.350, 2.87143e2, 3.9957e-3, 317.189],
        [50, 270.650, 7.97788e1, 1.0269e-3, 329.799],
        [60, 247.021, 2.1958e1, 3.0968e-4, 315.073],
        [70, 219.585, 5.2209, 8.2829e-5, 297.061],
        [80, 198.639, 1.0524, 1.8458e-5, 282.538],
    ]
)
# T, K; p, Pa; rho, kg/m^3.
HIGH = np.array(
    [
        [86, 186.87, 3.7338e-1, 6.958e-6],
        [90, 186.87, 1.8359e-1, 3.416e-6],
        [95, 188.42, 7.5966e-2, 1.393e-6],
        [100, 195.08, 3.2011e-2, 5.604e-7],
        [110, 240.00, 7.1042e-3, 9.708e-8],
        [120, 360.00, 2.5382e-3, 2.222e-8],
        [130, 469.27, 1.2505e-3, 8.152e-9],
        [150, 634.39, 4.5422e-4, 2.076e-9],
        [200, 854.56, 8.4736e-5, 2.541e-10],
        [250, 941.33, 2.4767e-5, 6.073e-11],
        [300, 976.01, 8.7704e-6, 1.916e-11],
        [400, 995.83, 1.4518e-6, 2.803e-12],
        [500, 999.24, 3.0236e-7, 5.215e-13],
        [600, 999.85, 8.2130e-8, 1.137e-13],
        [700, 999.97, 3.1908e-8, 3.070e-14],
        [800, 999.99, 1.7036e-8, 1.136e-14],
        [900, 1000.0, 1.0873e-8, 5.759e-15],
        [1000, 1000.0, 7.5138e-9, 3.561e-15],
    ]
)


def padded(function):
    """The function of any number of heights, by one program for all of them."""
    program = jax.jit(function)

    def of(z):
        z = jnp.asarray(z)
        found = program(jnp.resize(z, 256))
        return jax.tree.map(lambda x: x[..., : z.size].reshape(*x.shape[:-1], *z.shape), found)

    return of


air = padded(standard_atmosphere)
slopes = padded(jax.vmap(lambda z: jnp.stack(jax.jacfwd(standard_atmosphere)(z)), 0, 1))


def test_the_printed_table_up_to_the_mesopause():
    """Six digits are printed of the temperature, five of pressure and density."""
    found = np.stack(air(jnp.array(LOW[:, 0] * 1e3)))
    np.testing.assert_allclose(found[0], LOW[:, 1], rtol=4e-6)
    np.testing.assert_allclose(found[1], LOW[:, 2], rtol=8e-5)
    np.testing.assert_allclose(found[2], LOW[:, 3], rtol=4e-5)
    np.testing.assert_allclose(found[3], LOW[:, 4], rtol=4e-6)


def test_the_printed_table_to_a_thousand_kilometres():
    """Five digits of the pressure are printed and four of the density, whose last one is half a
    unit of up to 5e-4."""
    found = np.stack(air(jnp.array(HIGH[:, 0] * 1e3)))
    np.testing.assert_allclose(found[0], HIGH[:, 1], rtol=6e-5)
    np.testing.assert_allclose(found[1], HIGH[:, 2], rtol=2e-4)
    np.testing.assert_allclose(found[2], HIGH[:, 3], rtol=4e-4)


def test_a_gas_in_balance():
    """Both between the nodes: p' = -rho g (below 86 km to rounding, above as good as the spline,
    where molar mass and density are independent), and p = rho R T / M."""
    low = np.linspace(-2e3, 85.9e3, 61) + 7.0
    high = np.linspace(87e3, 990e3, 201)
    for z, rtol in ((low, 1e-9), (high, 2.5e-2)):
        gravity = 9.80665 * (6356766.0 / (6356766.0 + z)) ** 2
        change = slopes(jnp.array(z))[1]
        np.testing.assert_allclose(change, -air(jnp.array(z)).density * gravity, rtol=rtol)


def test_every_joint_is_continuous_and_has_a_slope():
    """Over a millimetre at the base of each layer, at 86, 91, 110, 120 and 1000 km."""
    bases = geometric_height(jnp.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3]))
    joints = jnp.concatenate([bases, jnp.array([80e3, 86e3, 91e3, 110e3, 120e3, 1e6])])
    below, at, above = (np.stack(air(joints + d)) for d in (-1e-3, 0.0, 1e-3))
    # The kinetic temperature is printed in both halves: the rounding of Table 8.
    np.testing.assert_allclose(above, below, rtol=5e-6)
    np.testing.assert_allclose(at, below, rtol=5e-6)
    found = slopes(joints)
    assert np.all(np.isfinite(found)) and np.all(found[1:3] < 0.0)
    reverse = jax.jit(jax.vmap(jax.grad(lambda z: standard_atmosphere(z).density)))(joints)
    np.testing.assert_allclose(reverse, found[2], rtol=1e-12)
    # Far out the density goes on falling, far in everything stays finite.
    out = np.stack(air(jnp.array([-6.4e6, -1e5, 1e6, 1.2e6, 3e6, 4e8])))
    assert np.all(np.isfinite(out)) and np.all(np.diff(out[2, 1:]) < 0.0)
    np.testing.assert_array_equal(out[:, 0], out[:, 1])


def test_the_layers_agree_with_high_precision():
    """Pressures layer by layer, with forty digits. A rounding of the height, up to 80 km, is 16
    times as much of the density, whose scale is 5 km: 4e-15."""
    z = np.linspace(-400.0, 79e3, 120)
    found = air(jnp.array(z))
    with mpmath.workdps(40):
        per_kelvin = mpmath.mpf(GRAVITY) * mpmath.mpf(MOLAR_MASS) / mpmath.mpf(GAS_CONSTANT)
        for k, height in enumerate(z):
            level = mpmath.mpf(RADIUS) * height / (RADIUS + height)
            pressure = mpmath.mpf(PRESSURE)
            tops = [base for base, *_ in LAYERS[1:]] + [mpmath.inf]
            for (base, lapse, at_base), top in zip(LAYERS, tops, strict=True):
                climb = min(level, top) - base
                temperature = at_base + mpmath.mpf(lapse) * climb
                if lapse:
                    pressure *= (at_base / temperature) ** (per_kelvin / lapse)
                else:
                    pressure *= mpmath.exp(-per_kelvin * climb / at_base)
                if level < top:
                    break
            density = pressure * MOLAR_MASS / (GAS_CONSTANT * temperature)
            assert float(found.density[k]) == pytest.approx(float(density), rel=1e-14)
            assert float(found.temperature[k]) == pytest.approx(float(temperature), rel=1e-15)


def test_slopes_agree_with_differences():
    # Not at a height of a table, where a difference is the mean of two slopes.
    z, h = jnp.array([3e3, 15e3, 60e3, 84.5e3, 97e3, 105e3, 123e3, 314e3, 870e3]), 1.0
    two, one, minus, back = (np.stack(air(z + k * h)) for k in (2, 1, -1, -2))
    expected = (8.0 * (one - minus) - two + back) / (12.0 * h)
    # Rounding of 1e-15 over a slope of at least 1e-6 a metre; the temperature is constant at 15 km.
    np.testing.assert_allclose(slopes(z), expected, rtol=1e-7, atol=1e-12)


def test_a_derivative_holds_the_upper_air_once():
    """The air is a function of one number: reverse mode multiplies by its slope."""
    slope = jax.grad(lambda height: jnp.sum(standard_atmosphere(height).density))
    program = str(jax.make_jaxpr(slope)(jnp.array([1e3, 2e3])))
    # Without a derivative one branch as well, for which the program is not larger.
    assert program.count("cond[") == 1


def test_heights_are_those_of_the_standard():
    """86 km is 84.852 km of geopotential; there and back to rounding."""
    assert float(geopotential_height(86e3)) == pytest.approx(84852.0, abs=0.5)
    z = jnp.linspace(-5e3, 1e6, 11)
    np.testing.assert_allclose(geometric_height(geopotential_height(z)), z, rtol=1e-14)


def test_precision_factor_and_input():
    z = jnp.linspace(0.0, 9e5, 30, dtype=jnp.float32)
    single = air(z)
    assert {x.dtype for x in single} == {jnp.dtype("float32")}
    # The logarithm of the density is up to 34, with a unit in the last place of 4e-6.
    np.testing.assert_allclose(single.density, air(z.astype(float)).density, rtol=3e-5)
    half = StandardAtmosphere(0.5)
    assert float(half.density_at(2e5)) == pytest.approx(0.5 * float(air(2e5).density), rel=1e-12)
    assert float(half.scaled(3.0).density_factor) == 1.5
    with pytest.raises(InputError, match="StandardAtmosphere.density_factor is -1"):
        StandardAtmosphere(-1.0)


# ---------------------------------------------------------------- over a launch pad


def test_air_over_a_pad_is_in_equilibrium():
    """T linear from the pad to 11 km; p by a quadrature of g_0 M_0 / (R T), below the pad and above
    the tropopause, too; without values of its own it is the standard."""
    z = jnp.array([-200.0, 1400.0, 3000.0, 9e3, 11e3, 12e3, 4e4, 9e4])
    plain, standard = PadAtmosphere(1400.0).air_at(z), air(z)
    for found, expected in zip(plain, standard, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13)
    pad = float(geopotential_height(1400.0))
    levels = np.asarray(geopotential_height(z))
    per_kelvin = 9.80665 * 28.9644 / 8314.32
    # Warm, cold, and as cold as the tropopause, where the layer is isothermal.
    for kelvin in (313.0, 245.0, 216.65, 216.6500001):
        one = PadAtmosphere(1400.0, kelvin, 84e3)
        found = one.air_at(z)
        slope = (216.65 - kelvin) / (11e3 - pad)

        def at(level, kelvin=kelvin, slope=slope):
            return kelvin + slope * (level - pad)

        def fall(level, at=at):
            return quad(lambda h: per_kelvin / at(h), pad, level, epsabs=0.0, epsrel=1e-12)[0]

        low = levels < 11e3
        np.testing.assert_allclose(found.temperature[low], at(levels[low]), rtol=1e-14)
        np.testing.assert_allclose(found.temperature[~low], standard.temperature[~low], rtol=1e-14)
        expected = [84e3 * np.exp(-fall(level)) for level in levels[low]]
        np.testing.assert_allclose(found.pressure[low], expected, rtol=1e-11)
        # Above by the ratio at the tropopause, 22632.06 Pa of the standard.
        ratio = 84e3 * np.exp(-fall(11e3)) / 22632.06397
        np.testing.assert_allclose(found.pressure[~low] / standard.pressure[~low], ratio, rtol=1e-9)
        density = found.pressure * 28.9644 / (8314.32 * found.temperature)
        np.testing.assert_allclose(found.density[:-1], density[:-1], rtol=1e-12)


def test_derivatives_and_precision_of_the_air_over_a_pad():
    """In both modes, also where the layer is isothermal, and for a batch of pads."""
    heights = jnp.array([1400.0, 5e3, 2e4])

    def total(elevation, kelvin, pressure):
        one = PadAtmosphere(elevation, kelvin, pressure).air_at(heights)
        return jnp.log(one.density), one.sound_speed

    for kelvin in (216.65, 300.0):
        check_grads(total, (1400.0, kelvin, 86e3), 1, atol=1e-6, rtol=1e-6)
    many = PadAtmosphere(0.0, jnp.array([280.0, 300.0])).scaled(2.0).air_at(jnp.array([0.0, 1e3]))
    for k, (kelvin, z) in enumerate(((280.0, 0.0), (300.0, 1e3))):
        alone = PadAtmosphere(0.0, kelvin).air_at(jnp.asarray(z))
        np.testing.assert_allclose(many.density[k], 2.0 * alone.density, rtol=1e-14)
    fields = (jnp.asarray(x, jnp.float32) for x in (1400.0, 300.0, 86e3))
    single = PadAtmosphere(*fields).air_at(heights.astype(jnp.float32))
    assert {x.dtype for x in single} == {jnp.dtype("float32")}
    whole = PadAtmosphere(1400.0, 300.0, 86e3).air_at(heights)
    np.testing.assert_allclose(single.density, whole.density, rtol=1e-5)


def test_a_launch_site_takes_the_air_of_its_pad():
    site = LaunchSite(5.0, 1.4, elevation=1400.0, temperature=308.0, pressure=86e3)
    state, _ = site.air.at(jnp.zeros(3))
    assert (float(state.temperature), float(state.pressure)) == (308.0, pytest.approx(86e3))
    warm, _ = LaunchSite(5.0, 1.4, temperature=308.0).air.at(jnp.zeros(3))
    assert float(warm.pressure) == pytest.approx(101325.0, rel=1e-13)
    for wrong in (
        lambda: LaunchSite(5.0, 1.4, temperature=35.0),
        lambda: PadAtmosphere(0.0, 35.0),
        lambda: PadAtmosphere(0.0, 300.0, -1.0),
        lambda: PadAtmosphere(2e4, 300.0),
    ):
        with pytest.raises(InputError, match="it must be"):
            wrong()
    with pytest.raises(InputError, match="LaunchSite.pressure and LaunchSite.atmosphere are both"):
        LaunchSite(5.0, 1.4, atmosphere=StandardAtmosphere(), pressure=1e5)
