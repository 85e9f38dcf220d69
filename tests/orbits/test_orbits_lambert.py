"""Lambert's problem: published transfers, motions in 60 digits run backwards through it, its edges,
derivatives."""

import re

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from both_modes import both_modes
from hypothesis import given, settings
from hypothesis import strategies as st
from test_orbits_kepler import condition, conics, exact_flow, relative
from test_orbits_kepler import forward as slope_of_flow

from jaxspace.core import InputError
from jaxspace.orbits._conic_of_time import _root, conic_of_time, least_time
from jaxspace.orbits._transfer_time import transfer_time
from jaxspace.orbits.elements import eccentricity_vector, periapsis_radius, semi_major_axis
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.lambert import TransferStatus, lambert, least_duration, transfer_status

EPS = np.finfo(float).eps


def _packed(y, revolutions=0, low=True):
    """(r1, r2, duration, mu) -> (v1, v2) as flat arrays."""
    return jnp.concatenate(lambert(y[:3], y[3:6], y[6], y[7], revolutions=revolutions, low=low))


packed = jax.jit(_packed, static_argnums=(1, 2))
slopes_of = both_modes(_packed)
reverse = jax.jit(jax.jacrev(_packed), static_argnums=(1, 2))
flow = jax.jit(kepler_flow)
transfer = jax.jit(lambert, static_argnames=("revolutions", "low"))
time_of = jax.jit(transfer_time, static_argnums=3)
least_of = jax.jit(least_duration, static_argnums=3)
by_normal = jax.jit(lambda r1, r2, t, h: lambert(r1, r2, t, 1.0, normal=h))


def differences(y, *rest, step=1e-4):
    """The Jacobian of `packed` by central differences of fourth order: truncation at 1e-16,
    rounding at 1e-12."""
    columns = []
    for k in range(8):
        e = np.zeros(8)
        e[k] = step
        near, far = (
            np.asarray(packed(y + n * e, *rest)) - np.asarray(packed(y - n * e, *rest))
            for n in (1, 2)
        )
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.array(columns).T


# Published
# -------------------------------------------------------------------------------------------------

EARTH = 398600.4418
MOLNIYA = (
    [22592.145603, -1599.915239, -19783.950506],
    [1922.067697, 4054.157051, -8925.727465],
    36000.0,
)
PUBLISHED = {
    "LAM-VALLADO-7-5": (
        ([15945.34, 0.0, 0.0], [12214.83899, 10249.46731, 0.0], 4560.0),
        {},
        [2.058913, 2.915965, 0.0],
        [-3.451565, 0.910315, 0.0],
        1e-5,
    ),
    "LAM-CURTIS-5-2": (
        ([5000.0, 10000.0, 2100.0], [-14600.0, 2500.0, 7000.0], 3600.0),
        {},
        [-5.9925, 1.9254, 3.2456],
        [-3.3125, -4.1966, -0.38529],
        2e-4,
    ),
    "LAM-DER-II-0P": (
        MOLNIYA,
        {},
        [2.000652697, 0.387688615, -2.66694776],
        [-3.79246619, -1.77707641, 6.856814395],
        1e-6,
    ),
    "LAM-DER-II-1PH": (
        MOLNIYA,
        {"revolutions": 1, "low": False},
        [0.5033577, 0.61869408, -1.57176904],
        [-4.18334626, -1.13262727, 6.13307091],
        1e-6,
    ),
}


@pytest.mark.parametrize("case", PUBLISHED)
def test_published(case):
    (r1, r2, duration), which, v1, v2, rtol = PUBLISHED[case]
    found = transfer(jnp.array(r1), jnp.array(r2), duration, EARTH, **which)
    np.testing.assert_allclose(np.array(found), [v1, v2], rtol=rtol, atol=rtol)


@pytest.mark.parametrize(
    ("case", "radius", "behind", "arc", "e", "a", "dv"),
    [
        (
            "T4.16-1",
            3.0,
            80.0,
            40.0,
            3.231206918391528,
            -0.8311684425621705,
            27513.54865000841 / 25940.74798221808,
        ),
        ("T4.16-P1", 2.0, 30.0, 45.0, 1.2716892466081722, -6.509785931356442, 0.4860643698211524),
        ("T4.16-P2", 2.0, 30.0, 90.0, 0.393340976214637, 2.831408328441838, 0.22998807666441304),
    ],
)
def test_rendezvous_on_a_circle(case, radius, behind, arc, e, a, dv):
    """Thomson 4.16: from `behind` the target, met after its `arc`; units of the earth's radius and
    gravitational parameter."""
    angle, speed = np.deg2rad(behind + arc), np.sqrt(1.0 / radius)
    r1, r2 = jnp.array([radius, 0.0, 0.0]), radius * jnp.array([np.cos(angle), np.sin(angle), 0.0])
    v1, v2 = by_normal(r1, r2, np.deg2rad(arc) * radius / speed, jnp.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(jnp.linalg.norm(eccentricity_vector(r1, v1, 1.0)), e, rtol=1e-9)
    np.testing.assert_allclose(semi_major_axis(r1, v1, 1.0), a, rtol=1e-9)
    np.testing.assert_allclose(
        jnp.linalg.norm(v1 - speed * jnp.array([0.0, 1.0, 0.0])), dv, rtol=1e-9
    )
    np.testing.assert_allclose(
        jnp.linalg.norm(v2 - speed * jnp.array([-np.sin(angle), np.cos(angle), 0.0])), dv, rtol=1e-9
    )
    if case == "T4.16-1":
        np.testing.assert_allclose(periapsis_radius(r1, v1, 1.0), 1.854508779393426, rtol=1e-9)


@pytest.mark.parametrize(
    ("sense", "e", "a", "dv"),
    [
        (
            1.0,
            0.8199825402983386,
            2.136853191558964,
            [-0.4460400858845732, -0.29882727660936464, 0.7767899303992291],
        ),
        (
            -1.0,
            0.3410448754716118,
            2.1144405313235892,
            [-1.8091947788443794, 0.48819045231808106, -0.048097975294306754],
        ),
    ],
)
def test_short_and_long_way_out_of_plane(sense, e, a, dv):
    """T4.16-P7: from the perigee of a polar ellipse to a satellite over the equator."""
    r1, arc = jnp.array([0.0, 0.0, 1.4]), np.deg2rad(330.0)
    r2 = 2.0 * jnp.array([np.cos(arc), np.sin(arc), 0.0])
    v1, _ = by_normal(r1, r2, arc * 2.0**1.5, sense * jnp.cross(r1, r2))
    np.testing.assert_allclose(v1 - jnp.array([np.sqrt(1.3 / 1.4), 0.0, 0.0]), dv, rtol=1e-9)
    np.testing.assert_allclose(jnp.linalg.norm(eccentricity_vector(r1, v1, 1.0)), e, rtol=1e-9)
    np.testing.assert_allclose(semi_major_axis(r1, v1, 1.0), a, rtol=1e-9)


# Against 60 digits
# -------------------------------------------------------------------------------------------------


def transfers(n, seed):
    """Motions on all kinds of conics, to nearly radial, from 1e-4 to 100 times the time scale of
    the start, forwards; of those on ellipses only less than a revolution: start, velocity,
    duration, and the place and the velocity that 60 digits lead to."""
    r, v, t = conics(n, seed)
    t, beta = np.abs(t), 2.0 / np.linalg.norm(r, axis=0) - np.sum(v * v, axis=0)
    period = 2.0 * np.pi * np.where(beta > 0.0, beta, 1.0) ** -1.5
    t = np.where(beta > 0.0, 0.98 * period * t / (t + period), t)
    ends = [exact_flow(r[:, k], v[:, k], t[k]) for k in range(n)]
    return r, v, t, np.array([x for x, _ in ends]).T, np.array([x for _, x in ends]).T


@pytest.mark.parametrize(
    "seed", [1, pytest.param(2, marks=pytest.mark.sweep), pytest.param(3, marks=pytest.mark.sweep)]
)
def test_the_velocity_that_leads_there(seed):
    """The end of a motion in 60 digits is rounded to doubles, as are the inputs: what that does to
    the velocities, told by the Jacobian, is the least error there can be. Four times that is
    allowed, for the rounding on the way (1.0 seen, median 0.2)."""
    n = 150
    r1, v1, t, r2, v2 = transfers(n, seed)
    h = np.cross(r1, v1, axis=0)
    found = by_normal(*map(jnp.asarray, (r1, r2, t, h)))
    slopes = jax.jit(
        jax.vmap(lambda y, h: jnp.array(jax.jacfwd(lambda y: _one(y, h))(y)), in_axes=(-1, -1))
    )
    slope = np.asarray(slopes(jnp.asarray(np.concatenate([r1, r2, t[None]])), jnp.asarray(h)))
    for k in range(n):
        size = np.r_[np.repeat([np.linalg.norm(r1[:, k]), np.linalg.norm(r2[:, k])], 3), t[k]]
        bound = np.linalg.norm(slope[k] * size) * EPS + EPS * (
            np.linalg.norm(v1[:, k]) + np.linalg.norm(v2[:, k])
        )
        error = np.hypot(
            *(
                np.linalg.norm(np.asarray(a)[:, k] - b[:, k])
                for a, b in zip(found, (v1, v2), strict=True)
            )
        )
        assert error < 4.0 * bound, (k, error / bound)


def _one(y, h):
    return jnp.concatenate(lambert(y[:3], y[3:6], y[6], 1.0, normal=h))


def exact_time(x, lam, kappa):
    """The classical form of the time of flight, in enough digits to lose most of them."""
    with mp.workdps(120):
        x, lam = mp.mpf(x), mp.sign(lam) * mp.sqrt(1 - mp.mpf(kappa))
        energy = 1 - x * x
        y, root = mp.sqrt(1 - lam**2 * energy), mp.sqrt(abs(energy))
        psi = mp.acos(x * y + lam * energy) if energy > 0 else mp.asinh((y - x * lam) * root)
        time = (psi / root - x + lam * y) / energy
        return float(time), float((3 * time * x - 2 + 2 * lam**3 * x / y) / energy)


def geometries(n, seed):
    """x from the slowest ellipse to the fastest hyperbola and about the parabola; lambda, kappa:
    any, half of them close to lambda = 1 or -1."""
    g = np.random.default_rng(seed)
    near = 1.0 + 10.0 ** g.uniform(-12.0, -1.0, n) * g.choice([-1.0, 1.0], n)
    x = np.choose(
        g.integers(0, 3, n),
        [-1.0 + 10.0 ** g.uniform(-8.0, 0.3, n), 1.0 + 10.0 ** g.uniform(-3.0, 6.0, n), near],
    )
    kappa = np.where(
        g.uniform(size=n) < 0.5, 10.0 ** g.uniform(-14.0, 0.0, n), g.uniform(0.0, 1.0, n)
    )
    return x, g.choice([-1.0, 1.0], n) * np.sqrt(1.0 - kappa), kappa


def test_the_time_of_flight_loses_no_digits():
    """Against the classical form in 120 digits: time and slope to a few units of rounding. (For
    negative lambda the slope is a difference where the time has its bend, hence its wider limit.)
    """
    x, lam, kappa = geometries(300, 5)
    exact = np.array([exact_time(*some) for some in zip(x, lam, kappa, strict=True)]).T
    found = time_of(*map(jnp.asarray, (x, lam, kappa)))
    np.testing.assert_allclose(found.value, exact[0], rtol=20 * EPS)
    np.testing.assert_allclose(found.slope, exact[1], rtol=1e-12)


@pytest.mark.parametrize(("revolutions", "low"), [(0, True), (1, True), (30, False)])
def test_the_conic_of_a_time_has_that_time(revolutions, low):
    """There and back, in some rounding units of the time, wherever the conic is: no run stays
    unsolved."""
    x, lam, kappa = map(jnp.asarray, geometries(20000, 7))
    if revolutions:
        least, lowest = jax.jit(least_time, static_argnums=2)(lam, kappa, revolutions)
        share = jnp.abs(x) / (1.0 + jnp.abs(x))
        x = lowest + share * ((1.0 if low else -1.0) - lowest)
        assert np.all(jnp.abs(time_of(lowest, lam, kappa, revolutions).slope) < 1e-7 * least)
    there = time_of(x, lam, kappa, revolutions)
    time = there.value
    back = jax.jit(conic_of_time, static_argnums=(3, 4))(time, lam, kappa, revolutions, low)
    again = time_of(back, lam, kappa, revolutions).value
    away = jnp.abs(there.slope) * (1.0 + jnp.abs(x)) * EPS
    assert np.all(jnp.abs(again - time) <= 20.0 * (EPS * time + away))


def test_a_rounding_of_the_value_at_the_root_costs_no_digits():
    """The value is wrong by 1e-12, so that its sign puts the root out of the interval by as much:
    bisections towards it end where they are as short as the last step, 1e-8."""
    root = jnp.array([0.3, 0.7])
    found = _root(
        lambda x: (x - root - 1e-12, root - x),
        jnp.zeros(2),
        jnp.ones(2),
        root + 5e-13,
        jnp.ones_like,
        order=2,
    )
    np.testing.assert_allclose(found, root, rtol=0.0, atol=1e-12)


# Conserved, and the same seen from elsewhere
# --------------------------------------------------------------------------

coordinate = st.floats(-2.0, 2.0).map(lambda x: round(x, 3))
place = st.tuples(coordinate, coordinate, coordinate).filter(lambda x: 0.1 < np.linalg.norm(x))


@given(place, place, st.floats(0.05, 20.0))
@settings(max_examples=30)
def test_it_arrives_and_can_be_turned_round(r1, r2, duration):
    """The motion arrives, and the way back with the velocities reversed is a transfer, too: both as
    well as rounding the input allows, by the derivatives of the motion and of the transfer, times a
    few operations."""
    r1, r2 = np.array(r1), np.array(r2)
    sine = np.linalg.norm(np.cross(r1, r2)) / (np.linalg.norm(r1) * np.linalg.norm(r2))
    if sine < 1e-2:  # the plane is in doubt by EPS / sine, and so is everything below
        return
    if abs(np.cross(r1, r2)[2]) < 1e-9:  # the plane holds the normal: neither way is meant
        return
    up = jnp.array([0.0, 0.0, 1.0])
    v1, v2 = by_normal(jnp.asarray(r1), jnp.asarray(r2), duration, up)
    end = flow(jnp.asarray(r1), v1, duration, 1.0)
    y = jnp.array([*r1, *v1, duration, 1.0])
    assert relative(end[0], r2) < 30.0 * EPS * (1.0 + condition(slope_of_flow(y), y, r2))
    back = by_normal(jnp.asarray(r2), jnp.asarray(r1), duration, -up)
    y = np.r_[r1, r2, duration, 1.0]
    size = np.r_[np.repeat([np.linalg.norm(r1), np.linalg.norm(r2)], 3), duration, 1.0]
    changes = np.asarray(slopes_of(y)[1]) * size
    bound = 20.0 * EPS * (np.linalg.norm(changes) + np.linalg.norm(v1) + np.linalg.norm(v2))
    np.testing.assert_allclose(back, [-v2, -v1], rtol=0.0, atol=bound)


@pytest.mark.sweep
@pytest.mark.parametrize("revolutions", [1, pytest.param(4, marks=pytest.mark.sweep)])
def test_transfers_with_revolutions_arrive_from_a_least_duration_on(revolutions):
    r1, r2 = jnp.array([1.0, 0.2, 0.1]), jnp.array([-0.3, 1.4, 0.2])
    least = least_of(r1, r2, 1.0, revolutions)
    for low in (True, False):
        for longer in (1.0 + 1e-9, 1.01, 3.0):
            v1, v2 = transfer(r1, r2, longer * least, 1.0, revolutions=revolutions, low=low)
            end = flow(r1, v1, longer * least, 1.0)
            np.testing.assert_allclose(end, [r2, v2], rtol=0.0, atol=1e-11)
            a = semi_major_axis(r1, v1, 1.0)
            assert revolutions < longer * least / (2.0 * np.pi * a**1.5) < revolutions + 1
        assert np.all(
            np.isnan(transfer(r1, r2, 0.999 * least, 1.0, revolutions=revolutions, low=low))
        )
    rise = jax.jit(jax.grad(least_duration, argnums=2), static_argnums=3)(r1, r2, 1.0, revolutions)
    np.testing.assert_allclose(rise, -0.5 * least, rtol=1e-14)  # a duration goes as 1 / sqrt(mu)
    slope = jax.jit(jax.grad(lambda r: least_duration(r, r2, 1.0, revolutions)))
    curve = jax.jit(lambda r: jax.jvp(slope, (r,), (r,))[1])(r1)
    difference = (slope(1.0001 * r1) - slope(0.9999 * r1)) / 2e-4
    np.testing.assert_allclose(curve, difference, rtol=1e-6, atol=1e-6)
    longer = (least_of(r1 + jnp.array([1e-5, 0.0, 0.0]), r2, 1.0, revolutions) - least) / 1e-5
    np.testing.assert_allclose(slope(r1)[0], longer, rtol=1e-4)
    low, high = (
        transfer(r1, r2, 2.0 * least, 1.0, revolutions=revolutions, low=which)[0]
        for which in (True, False)
    )
    assert jnp.dot(low, r1) < jnp.dot(high, r1)


def test_a_short_arc_keeps_the_digits_of_its_chord():
    """Over a short time t the velocities are (r2 - r1) / t -+ g t / 2, with the acceleration g."""
    key = np.random.default_rng(3)
    for size in 10.0 ** key.uniform(-8.0, -6.0, 8):
        r1 = key.normal(size=3)
        r1 = r1 / np.linalg.norm(r1)
        r2 = r1 + size * key.normal(size=3)
        if np.cross(r1, r2)[2] < 0.0:
            # Counterclockwise, so that the arc is the short one.
            r1, r2 = r2, r1
        y = np.array([*r1, *r2, size, 1.0])
        # The difference of the places as they are rounded is exact.
        velocity = (r2 - r1) / size
        fall = -0.5 * r1
        # Some roundings, and the next order of t. Lengths and directions that are subtracted from
        # each other leave 2e-16 / t.
        near = 1e-14 + 10.0 * size**2
        values, slopes, reverse = map(np.asarray, slopes_of(y))
        for sign, v, by in zip((-1, 1), np.split(values, 2), np.split(slopes, 2), strict=True):
            np.testing.assert_allclose(v, velocity + sign * fall * size, rtol=0, atol=near)
            expected = np.hstack([-np.eye(3), np.eye(3)]) / size
            np.testing.assert_allclose(by[:, :6], expected, rtol=0, atol=near / size)
        np.testing.assert_allclose(reverse, slopes, rtol=0, atol=near / size)


# Edges
# -------------------------------------------------------------------------------------------------


def test_half_a_turn_stays_in_the_plane_of_the_normal():
    """A Hohmann transfer, and its derivatives within the plane: those out of it are infinite, and
    left out."""
    y = np.array([1.0, 0.0, 0.0, -1.5, 0.0, 0.0, np.pi * 1.25**1.5, 1.0])

    def within(y):
        up = jnp.array([0.0, 0.0, 1.0])
        return jnp.concatenate(lambert(y[:3], y[3:6], y[6], y[7], normal=up))

    derivatives = both_modes(within)
    found, forward, reverse = derivatives(y)
    np.testing.assert_allclose(
        found, [0.0, np.sqrt(1.2), 0.0, 0.0, -np.sqrt(1.2) / 1.5, 0.0], atol=1e-15
    )
    inside = np.ix_([0, 1, 3, 4], [0, 1, 3, 4, 6, 7])
    slope = np.asarray(forward)
    assert np.all(np.isfinite(slope))
    # In the plane z = 0 the default serves on both sides; exactly opposite it is not asked.
    aside = y + np.array([0, 0, 0, 0, 1e-7, 0, 0, 0])
    np.testing.assert_allclose(slope[inside], differences(aside)[inside], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(reverse, slope, atol=1e-14)
    # Off by a rounding, the places would say another plane.
    off = y + np.array([0, 0, 0, 0, 0, 2e-16, 0, 0])
    np.testing.assert_allclose(derivatives(off)[0], found, atol=1e-15)


X, Y, Z = np.eye(3)
STATUS = jax.jit(transfer_status, static_argnames="revolutions")


@pytest.mark.parametrize(
    ("expected", "start", "end", "duration", "rest"),
    [
        (TransferStatus.SAME_PLACE, X + Y, X + Y, 2.0, {}),
        (TransferStatus.SAME_PLACE, X + Y, X + Y, 40.0, {"revolutions": 1}),
        (TransferStatus.NO_PLANE, X, -1.5 * X, 2.0, {}),
        (TransferStatus.NO_PLANE, X, -1.5 * X + 2e-16 * Z, 2.0, {}),
        (TransferStatus.NO_PLANE, X, -1.5 * X, 2.0, {"normal": X}),
        # Both ways round are as good: the plane holds the normal, but for a rounding.
        (TransferStatus.NO_WAY, Z, Y, 1.5 * np.pi, {}),
        (TransferStatus.NO_WAY, X + 2e-16 * Y, -Z, 2.0, {}),
        (TransferStatus.NO_WAY, X, Y, 2.0, {"normal": X + Y}),
        (TransferStatus.NO_WAY, X, Y, 2.0, {"normal": 0.0 * X}),
        (TransferStatus.INVALID, X, Y, 2.0, {"normal": np.nan * X}),
        (TransferStatus.INVALID, 0.0 * X, Y, 2.0, {}),
        (TransferStatus.INVALID, X, np.nan * Y, 2.0, {}),
        (TransferStatus.INVALID, X, Y, 0.0, {}),
        (TransferStatus.INVALID, X, Y, np.inf, {}),
        (TransferStatus.TOO_SHORT, X, Y, 2.0, {"revolutions": 1}),
    ],
)
def test_what_has_no_single_transfer_is_named(expected, start, end, duration, rest):
    start, end = jnp.asarray(start), jnp.asarray(end)
    if "normal" in rest:
        rest = {**rest, "normal": jnp.asarray(rest["normal"])}
    with pytest.raises(InputError, match=f"lambert: {re.escape(expected.sentence)}"):
        lambert(start, end, duration, 1.0, **rest)
    # Beside a good one in a batch: NaN and a status.
    places = jnp.stack([end, Z + 0.1 * Y], axis=1)
    durations = jnp.array([duration, 40.0])
    rest = {**rest, "normal": jnp.stack([rest["normal"], Y], axis=1)} if "normal" in rest else rest
    starts = jnp.stack([start, X], axis=1)
    v1, v2 = transfer(starts, places, durations, 1.0, **rest)
    assert np.isnan(v1[:, 0]).all() and np.isnan(v2[:, 0]).all()
    assert np.isfinite(v1[:, 1]).all() and np.isfinite(v2[:, 1]).all()
    assert list(STATUS(starts, places, durations, 1.0, **rest)) == [expected, TransferStatus.FOUND]


def test_the_shortest_duration_asks_which_way():
    with pytest.raises(InputError, match="least_duration: The plane of start and end contains"):
        least_duration(jnp.asarray(Z), jnp.asarray(Y), 1.0, 1)
    ends = jnp.stack([Y, X + Z], axis=1)
    starts = jnp.stack([Z, X], axis=1)
    ups = jnp.stack([Z, -Y], axis=1)
    found = jax.jit(lambda n: least_duration(starts, ends, 1.0, 1, normal=n))(ups)
    assert list(np.isfinite(found)) == [False, True]


@pytest.mark.parametrize("duration", [1.0, 4.0])
def test_the_same_direction_is_a_straight_line(duration):
    """A free fall out: straight, and so is the derivative along it; across, it is that of the short
    way."""
    y = np.array([1.0, 0.0, 0.0, 1.5, 0.0, 0.0, duration, 1.0])
    found, slope, reverse = map(np.asarray, slopes_of(y))
    assert np.all(found[[1, 2, 4, 5]] == 0.0)
    end = flow(jnp.asarray(y[:3]), found[:3], y[6], y[7])
    np.testing.assert_allclose(end, [y[3:6], found[3:]], atol=1e-13)
    aside = 1e-6
    short = np.asarray(packed(y + np.array([0, 0, 0, 0, aside, 0, 0, 0])))
    np.testing.assert_allclose(short[[1, 4]] / aside, slope[[1, 4], 4], rtol=1e-5)
    columns = [0, 3, 6, 7]
    np.testing.assert_allclose(slope[:, columns], differences(y)[:, columns], rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(reverse, slope, atol=1e-14)


def _at(x, angle, r1, r2):
    """An input whose transfer is the conic `x`."""
    c = np.sqrt(r1 * r1 + r2 * r2 - 2.0 * r1 * r2 * np.cos(angle))
    s = 0.5 * (r1 + r2 + c)
    time = time_of(*map(jnp.asarray, (x, np.sqrt(r1 * r2) * np.cos(0.5 * angle) / s, c / s))).value
    return np.array(
        [
            r1,
            0.0,
            0.0,
            r2 * np.cos(angle),
            r2 * np.sin(angle),
            0.0,
            float(time) * np.sqrt(0.5 * s**3),
            1.0,
        ]
    )


@pytest.mark.parametrize("x", [-0.9, 0.0, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.1, 30.0])
@pytest.mark.parametrize("angle", [0.3, 2.0, 4.5])
def test_derivatives_by_differences(x, angle):
    """Ellipses on the slow side, of least energy, parabolas to the last bit, hyperbolas; short way
    and long."""
    y = _at(x, angle, 1.0, 1.3)
    step = 1e-4 * min(1.0, y[6])
    _, slope, reverse = slopes_of(y)
    expected = differences(y, step=step)
    assert (
        relative(slope, expected) < 1e-9
    )  # rounding over the step, at 1e-12 / 1e-4 of the velocity
    np.testing.assert_allclose(reverse, slope, rtol=1e-12, atol=1e-12 * np.abs(slope).max())


# The derivative is by one rule at both roots, whose values the tests above hold.
@pytest.mark.parametrize("low", [True, pytest.param(False, marks=pytest.mark.sweep)])
def test_derivatives_with_revolutions(low):
    y = np.array([1.0, 0.2, 0.1, -0.3, 1.4, 0.2, 40.0, 1.0])
    assert relative(reverse(y, 2, low), differences(y, 2, low)) < 1e-9


@pytest.mark.sweep
def test_second_derivatives():
    y = jnp.array([1.0, 0.2, 0.1, -0.3, 1.4, 0.2, 2.0, 1.0])
    slope = jax.grad(lambda y: jnp.sum(_packed(y)))
    change = jax.jit(lambda y, d: jax.jvp(slope, (y,), (d,))[1])
    slope = jax.jit(slope)
    for k in (0, 4, 6):
        d = jnp.zeros(8).at[k].set(1.0)
        difference = (slope(y + 1e-5 * d) - slope(y - 1e-5 * d)) / 2e-5
        np.testing.assert_allclose(change(y, d), difference, rtol=1e-7, atol=1e-8)


# Batches, precision, input
# -------------------------------------------------------------------------------------------------


def test_a_bad_run_harms_no_other():
    r1, r2 = jnp.array([1.0, 0.2, 0.1]), jnp.array([-0.3, 1.4, 0.2])
    durations = jnp.array([2.0, -1.0, 0.0, jnp.nan, 3.0])
    v1, v2 = transfer(r1[:, None], r2, durations, 1.0)
    assert v1.shape == v2.shape == (3, 5)
    assert np.all(np.isnan(v1[:, 1:4])) and np.all(np.isnan(v2[:, 1:4]))
    for k in (0, 4):
        np.testing.assert_allclose(v1[:, k], transfer(r1, r2, durations[k], 1.0)[0], rtol=1e-14)
    one_place = transfer(r1[:, None], jnp.stack([r1, r2], axis=1), 2.0, 1.0)[0]
    assert np.all(np.isnan(one_place[:, 0]))
    np.testing.assert_allclose(one_place[:, 1], v1[:, 0], rtol=1e-14)
    mapped = jax.vmap(lambda t: transfer(r1, r2, t, 1.0)[0])(durations)
    np.testing.assert_allclose(mapped, v1.T, rtol=1e-14)


def test_single_precision():
    """Values of size one, derivatives of size two: some units of rounding (0.9 and 2.1 seen)."""
    y = jnp.array([1.0, 0.2, 0.1, -0.3, 1.4, 0.2, 2.0, 1.0])
    single = packed(y.astype(jnp.float32))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, packed(y), atol=8 * float(jnp.finfo(jnp.float32).eps))
    slope = jax.jit(jax.jacfwd(_packed))(y.astype(jnp.float32))
    np.testing.assert_allclose(slope, slopes_of(y)[1], atol=20 * float(jnp.finfo(jnp.float32).eps))


def test_bad_input_is_told():
    r1, r2 = jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0])
    with pytest.raises(InputError, match=r"revolutions is -1: it must be zero or more"):
        lambert(r1, r2, 1.0, 1.0, revolutions=-1)
    with pytest.raises(InputError, match=r"least_duration: revolutions is 0"):
        least_duration(r1, r2, 1.0, 0)
    with pytest.raises(InputError, match=r"mu is -1"):
        lambert(r1, r2, 1.0, -1.0)
