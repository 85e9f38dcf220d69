"""Thomson, chapter 5: the top at any time, its relatives, the Earth, the rolling disk."""

import jax
import jax.numpy as jnp

from jaxspace import simulate
from jaxspace.attitude import RollingDisk, ShaftPendulum, Top
from jaxspace.attitude.precession_of_earth import luni_solar_rate
from jaxspace.attitude.top_relatives import best_crusher_tilt, crusher_force, crusher_spin

from .case import DEG, STEPS, Case, vec

INERTIAS = {"A": 0.002, "C": 0.0008, "Wl": 0.3}
DISK = {"m": 1.0, "R": 0.3, "g": 9.80665}
UPRIGHT = 90.0 * DEG
DAY = 86400.0


def long_top(A, C, Wl, n, theta, t):
    """theta and psi of a top that is let go, after 178 nutations."""
    top = Top(A, C, Wl)
    y = top.state(vec(0.0, theta, 0.0), vec(0.0, 0.0, n))
    psi, nutation, _ = top.closed_form().angles(jnp.asarray(t), y)
    return nutation, psi


def shaft(m, r, a, g):
    """A disk on a stem that is pinned to a turning shaft."""
    axial = m * r**2 / 2.0
    body = axial / 2.0 + m * a**2, axial, m * g * a
    critical = ShaftPendulum(*body).critical_rate
    fast, slow = ShaftPendulum(*body, 1.5 * critical), ShaftPendulum(*body, 0.5 * critical)
    return critical, fast.equilibrium, slow.frequency(0.0)


def crusher(R, l, b, rate, g):
    """A solid wheel of the width b in an ore crusher; tilts above the horizontal."""
    moments = R**2 / 4.0 + b**2 / 12.0 + l**2, R**2 / 2.0
    wheel = R, l, *moments
    gyroscopic = best_crusher_tilt(rate, 0.0, *wheel)
    best = best_crusher_tilt(rate, g, *wheel)
    forces = (crusher_force(theta, rate, g, *wheel) / g for theta in (best, UPRIGHT))
    speed = l * rate * jnp.sin(best)
    return UPRIGHT - gyroscopic, UPRIGHT - best, *forces, crusher_spin(best, rate, R, l), speed


def moon_and_sun(ratio, month, theta, spin, ellipticity):
    """Rates of both, their sum's period, and that of the moon at two inclinations."""
    share = ratio / (1.0 + ratio)

    def moon(theta):
        return -luni_solar_rate(share, month, ellipticity, theta, spin)

    sun = -luni_solar_rate(1.0, 365.25 * DAY, ellipticity, theta, spin)
    total = moon(theta) + sun
    others = (moon((18.0 + 19.0 / 60.0) * DEG), moon((28.0 + 35.0 / 60.0) * DEG))
    return moon(theta), total, 2.0 * jnp.pi / total, moon(theta) / sun, *others


def rolled(m, R, g, theta, rate, spin, times):
    """theta, psi, psi', forward spin and centre at each time, and the energy."""
    disk = RollingDisk.uniform(m, R, g)
    y = disk.state(vec(0.0, theta, 0.0), vec(rate, 0.0, -spin - rate * jnp.cos(theta)))
    states = simulate(disk, y, vec(0.0, *times), accuracy=1e-13).states
    later = jax.tree.map(lambda x: x[..., 1:], states)
    psi, tilt, _ = Top.angles(later)
    centre = later.position[:2]
    return tilt, psi, Top.rates(later)[0], -later.omega[2], centre.T, disk.energy(y)


def standing(m, R, g, coin, ratio):
    """Least spins of a disk and a hoop on their rim, and of a half dollar that also rolls."""
    disk, hoop = RollingDisk.uniform(m, R, g), RollingDisk.hoop(m, R, g)
    dollar = RollingDisk.uniform(m, coin, g)
    least = disk.least_standing_spin
    return (
        *(d.least_standing_spin for d in (disk, hoop, dollar)),
        coin * dollar.least_rolling_spin,
        jnp.sqrt(disk.tilt_stiffness(UPRIGHT, ratio * least, 0.0)),
    )


def flat(m, R, g, theta):
    """Precession of a coin that does not spin, its phi', and the rate at which its face turns."""
    rate, _ = RollingDisk.uniform(m, R, g).steady_precession_rates(theta, 0.0)
    return rate, -rate * jnp.cos(theta), rate * (1.0 - jnp.cos(theta))


def falls(m, R, g, ratio):
    disk = RollingDisk.uniform(m, R, g)
    return (disk.growth_rate(UPRIGHT, 0.0, ratio * disk.least_rolling_spin),)


CASES = [
    Case(
        "T5.13-long",
        "Top that is let go, after 178 nutations, in one evaluation",
        (Top.closed_form,),
        {**INERTIAS, "n": 150.0, "theta": 0.6981317007977318, "t": 20.0},
        long_top,
        {"theta (rad)": 0.7064303911108745, "psi (rad)": 51.64527364769969},
    ),
    Case(
        "T5.14-P12",
        "Disk on a stem that is pinned to a rotating shaft",
        (ShaftPendulum,),
        {"m": 1.0, "r": 0.2, "a": 0.3, "g": 9.80665},
        shaft,
        {
            "critical rate (rad/s)": 6.064234288020211,
            "theta at 1.5 of it (rad)": 1.1102423351135742,
            "frequency at half of it (rad/s)": 4.697335681000454,
        },
    ),
    Case(
        "T5.14-P16",
        "Ore crusher: best tilt and force",
        (best_crusher_tilt, crusher_force, crusher_spin),
        {"R": 0.4572, "l": 0.9144, "b": 0.3048, "rate": 10.471975511965978, "g": 9.81456},
        crusher,
        {
            "tilt, gyroscopic force (rad)": 0.6708163357729628,
            "tilt, with the weight (rad)": 0.6441016161786896,
            "F/W there": 7.690790794687655,
            "F/W, horizontal": 3.554245445416501,
            "phi' (rad/s)": -23.03582657310371,
            "speed of the centre (m/s)": 7.657008023614016,
        },
    ),
    Case(
        "T5.15-P2",
        "Precession of the Earth by the moon and the sun",
        (luni_solar_rate,),
        {
            **{"ratio": 0.012345679012345678, "month": 2360448.0, "theta": 0.4092797095926703},
            **{"spin": 7.292115429419613e-05, "ellipticity": 0.0032},
        },
        moon_and_sun,
        {
            "by the moon (rad/s)": 5.218036260653693e-12,
            "by both (rad/s)": 7.61191355719845e-12,
            "period (s)": 825440969601.8802,
            "moon over sun": 2.1797425741850813,
            "moon at 18 deg 19' (rad/s)": 5.399627411860636e-12,
            "moon at 28 deg 35' (rad/s)": 4.994587903626386e-12,
        },
    ),
    Case(
        "T5.16-exact",
        "Disk that rolls, tilted by 10 deg, after 0.5, 1 and 2 s",
        (RollingDisk,),
        {
            **DISK,
            **{"theta": 80.0 * DEG, "rate": 0.5, "spin": 12.0, "times": (0.5, 1.0, 2.0)},
        },
        rolled,
        {
            "theta (rad)": [1.4113336345916232, 1.3994831223292035, 1.4065345399269389],
            "psi (rad)": [0.15748907991963554, 0.2965049861457172, 0.6000751839300594],
            "psi' (rad/s)": [0.13164740372066627, 0.4210419363017902, 0.24862188576339933],
            "s (rad/s)": [11.99687443482331, 11.99902627770126, 11.997474698660307],
            "centre (m)": [
                [1.792843392608197, 0.13674495003883674],
                [3.543882011776983, 0.5450156642840093],
                [6.760257542394729, 2.1297640092234507],
            ],
            "E (J)": 12.620027178071132,
        },
        rtol=1e-8,
        why=STEPS,
    ),
    Case(
        "T5.16-fall",
        "Disk that rolls upright with half of the least spin",
        (RollingDisk.growth_rate, RollingDisk.least_rolling_spin),
        {**DISK, "ratio": 0.5},
        falls,
        {"growth rate (1/s)": 4.4286905513932675},
    ),
    Case(
        "T5.16-spin",
        "Disk, hoop and half dollar that spin on their rim",
        (RollingDisk.least_standing_spin, RollingDisk.tilt_stiffness),
        {**DISK, "coin": 0.0153, "ratio": 1.5},
        standing,
        {
            "disk (rad/s)": 5.11381136400891,
            "hoop (rad/s)": 4.668249731489904,
            "half dollar (rad/s)": 22.644337329051947,
            "half dollar, rolling (m/s)": 0.22363791047136888,
            "frequency at 1.5 of it (rad/s)": 5.717414917017422,
        },
    ),
    Case(
        "T5.16-euler",
        "Coin nearly flat, without spin",
        (RollingDisk.steady_precession_rates,),
        {**DISK, "theta": 0.1},
        flat,
        {
            "psi' (rad/s)": 36.19026297275667,
            "phi' (rad/s)": -36.0094624004,
            "rate of the face (rad/s)": 0.18080057235667624,
        },
    ),
    Case(
        "T5.16-43",
        "Coin nearly flat, with spin",
        (RollingDisk.tilt_acceleration,),
        {**DISK, "theta": 0.1, "rate": 32.54409623879575, "spin": 2.0},
        lambda m, R, g, theta, rate, spin: (
            RollingDisk.uniform(m, R, g).tilt_acceleration(theta, rate, -spin),
        ),
        {"theta'' (rad/s^2)": 2.818582108975517},
    ),
]
