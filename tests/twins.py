"""The functions of the hard cases once more, in mpmath: other formulas where there are others, and
always with digits to spare. Named as in `jaxspace.verification`."""

import numpy as np
from mpmath import mp, mpf

from jaxspace.core import InputError
from jaxspace.optimization.ascent import NODES, WEIGHTS, Ascent, ConstantMassFlow
from jaxspace.optimization.steering import linear_tangent_steering

DIGITS = 60


def dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), mpf(0))


def cross(a, b):
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def norm(a):
    return mp.sqrt(dot(a, a))


def bisected(f, low, high):
    """A root of f, which is negative at `low` and not at `high`: bisection, then secants that keep
    the bracket."""
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if f(middle) < 0 else (low, middle)
    return mp.findroot(
        f, (low, high), solver="anderson", tol=mpf(10) ** (10 - 2 * mp.dps), maxsteps=300
    )


def halved(f, low, high):
    """The same by halves alone: for a function so steep or so flat that no secant converges."""
    for _ in range(int(mp.prec) + 20):
        middle = (low + high) / 2
        low, high = (middle, high) if f(middle) < 0 else (low, middle)
    return low


# Core and rotations.


def cubic(x):
    """The natural spline through four values at 0, 1, 2.5 and 3."""
    times, values, t = [mpf(0), mpf(1), mpf(5) / 2, mpf(3)], x[:4], x[4]
    h = [b - a for a, b in zip(times, times[1:], strict=False)]
    m = [(b - a) / c for a, b, c in zip(values, values[1:], h, strict=False)]
    a, b, c = 2 * (h[0] + h[1]), h[1], 2 * (h[1] + h[2])
    right = [6 * (m[1] - m[0]), 6 * (m[2] - m[1])]
    whole = a * c - b * b
    bends = [
        mpf(0),
        (right[0] * c - b * right[1]) / whole,
        (a * right[1] - b * right[0]) / whole,
        0,
    ]
    t = min(max(t, times[0]), times[-1])
    k = min(sum(t >= time for time in times[1:]), 2)
    s, bend, after = t - times[k], bends[k], bends[k + 1]
    slope = m[k] - h[k] * (2 * bend + after) / 6
    return [values[k] + s * (slope + s * (bend / 2 + s * (after - bend) / (6 * h[k])))]


def exponential_quotient(x):
    return [mp.expm1(x[0]) / x[0]]


def sine_quotient(x):
    root = mp.sqrt(x[0])
    return [mp.re(mp.sin(root) / root)]


def stumpff(n, z):
    """c_n(z) by its series, whose terms alternate: digits to spare for the greatest of them; far
    from zero by its recurrence."""
    if abs(z) > 1:
        with mp.workdps(mp.dps + 10):
            s = mp.sqrt(z)
            c = [mp.re(mp.cos(s)), mp.re(mp.sin(s) / s)]
            for k in range(n - 1):
                c.append((1 / mp.factorial(k) - c[k]) / z)
            return c[n]
    with mp.workdps(mp.dps + 20 + int(abs(z) ** 0.5)):
        term, total, k = 1 / mp.factorial(n), mpf(0), 0
        while abs(term) > mpf(10) ** (-mp.dps):
            total += term
            k += 1
            term *= -z / ((2 * k + n - 1) * (2 * k + n))
        return total


def stumpff_functions(x):
    return [stumpff(n, x[0]) for n in (2, 3, 4, 5)]


def elliptic_k(x):
    return [mp.ellipk(1 - x[0])]


def elliptic_third(x):
    total, product, p = x
    root = mp.sqrt(total**2 / 4 - product)
    y, z = (total / 2 + root) ** 2, (total / 2 - root) ** 2
    return [mp.re(mp.elliprj(0, y, z, p))]


def length(x):
    return [norm(x)]


def rotation_exp(x):
    angle = norm(x)
    return [mp.cos(angle / 2), *(mp.sin(angle / 2) / angle * c for c in x)]


def rotation_log(q):
    u = norm(q[1:])
    angle = 2 * mp.atan2(u, q[0])
    return [angle / u * c for c in q[1:]]


def matrix(q):
    w, x, y, z = (c / norm(q) for c in q)
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def euler_angles(q):
    c = matrix(q)
    return [mp.atan2(c[1][0], c[0][0]), mp.asin(-c[2][0]), mp.atan2(c[2][1], c[2][2])]


# Orbits.


def kepler(x):
    """Universal variables from the start, with Kepler's equation solved by bisection."""
    r, v, t, mu = x[:3], x[3:6], x[6], x[7]
    r0, sigma = norm(r), dot(r, v) / mp.sqrt(mu)
    alpha = 2 / r0 - dot(v, v) / mu

    def functions(chi):
        z = alpha * chi**2
        c2, c3 = stumpff(2, z), stumpff(3, z)
        return 1 - z * c2, chi * (1 - z * c3), chi**2 * c2, chi**3 * c3

    def late(chi):
        _, g1, g2, g3 = functions(chi)
        return r0 * g1 + sigma * g2 + g3 - mp.sqrt(mu) * t

    bound = mpf(1)
    while late(bound) < 0 or late(-bound) > 0:
        bound *= 2
    g0, g1, g2, g3 = functions(bisected(late, -bound, bound))
    end = r0 * g0 + sigma * g1 + g2
    f, g = 1 - g2 / r0, t - g3 / mp.sqrt(mu)
    df, dg = -mp.sqrt(mu) * g1 / (end * r0), 1 - g2 / end
    return [f * a + g * b for a, b in zip(r, v, strict=True)] + [
        df * a + dg * b for a, b in zip(r, v, strict=True)
    ]


stepped = kepler


def eccentricity(r, v, mu):
    h = cross(v, cross(r, v))
    return [a / mu - b / norm(r) for a, b in zip(h, r, strict=True)]


def elements(x):
    r, v, mu = x[:3], x[3:6], x[6]
    h, e = cross(r, v), eccentricity(r, v, mu)
    n = [-h[1], h[0], mpf(0)]

    def between(a, b):
        """The angle from a to b about h."""
        return mp.atan2(dot(h, cross(a, b)) / norm(h), dot(a, b))

    i = mp.atan2(mp.sqrt(h[0] ** 2 + h[1] ** 2), h[2])
    return [dot(h, h) / mu, norm(e), i, mp.atan2(n[1], n[0]), between(n, e), between(e, r)]


def state(x):
    p, e, i, node, w, f, mu = x
    c, s = mp.cos, mp.sin
    towards = [
        c(node) * c(w) - s(node) * s(w) * c(i),
        s(node) * c(w) + c(node) * s(w) * c(i),
        s(w) * s(i),
    ]
    ahead = [
        -c(node) * s(w) - s(node) * c(w) * c(i),
        -s(node) * s(w) + c(node) * c(w) * c(i),
        c(w) * s(i),
    ]
    r, speed = p / (1 + e * c(f)), mp.sqrt(mu / p)
    return [r * (c(f) * a + s(f) * b) for a, b in zip(towards, ahead, strict=True)] + [
        speed * (-s(f) * a + (e + c(f)) * b) for a, b in zip(towards, ahead, strict=True)
    ]


def radii(x):
    r, v, mu = x[:3], x[3:6], x[6]
    h = cross(r, v)
    return [dot(h, h) / mu / (1 + norm(eccentricity(r, v, mu)))]


def tilt(x):
    h = cross(x[:3], x[3:6])
    return [mp.atan2(mp.sqrt(h[0] ** 2 + h[1] ** 2), h[2])]


def time_of_flight(r1, r2, mu):
    """The time of the short way as a function of z = alpha chi^2, and y(z) (Bate, 5.3)."""
    d1, d2 = norm(r1), norm(r2)
    angle = mp.atan2(norm(cross(r1, r2)), dot(r1, r2))
    a = mp.sin(angle) * mp.sqrt(d1 * d2 / (1 - mp.cos(angle)))

    def y(z):
        return d1 + d2 + a * (z * stumpff(3, z) - 1) / mp.sqrt(stumpff(2, z))

    def time(z):
        if y(z) < 0:
            return mpf(0)
        chi = mp.sqrt(y(z) / stumpff(2, z))
        return (chi**3 * stumpff(3, z) + a * mp.sqrt(y(z))) / mp.sqrt(mu)

    return time, y, a


def velocities(r1, r2, mu, z, y, a):
    f, g, dg = 1 - y / norm(r1), a * mp.sqrt(y / mu), 1 - y / norm(r2)
    return [(b - f * c) / g for c, b in zip(r1, r2, strict=True)] + [
        (dg * b - c) / g for c, b in zip(r1, r2, strict=True)
    ]


def transfer(x):
    r1, r2, t, mu = x[:3], x[3:6], x[6], x[7]
    time, y, a = time_of_flight(r1, r2, mu)
    low = mpf(-1)
    while time(low) > t:
        low *= 2
    z = bisected(lambda z: time(z) - t, low, 4 * mp.pi**2 * (1 - mpf(10) ** -12))
    return velocities(r1, r2, mu, z, y(z), a)


def quickest_turn(time):
    """The z of the least time after one revolution."""
    low, high = 4 * mp.pi**2, 16 * mp.pi**2
    ratio = (mp.sqrt(5) - 1) / 2
    for _ in range(35):
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        low, high = (low, b) if time(a) < time(b) else (a, high)
    # The golden section finds half of the digits, the slope the others.
    h = mpf(10) ** (-mp.dps // 4)

    def slope(z):
        return (time(z + h) - time(z - h)) / (2 * h)

    return mp.findroot(slope, (low, low * (1 + mpf(10) ** -6)), tol=mpf(10) ** (-mp.dps // 2))


def late_transfer(x):
    r1, r2, t, mu = x[:3], x[3:6], x[6], x[7]
    time, y, a = time_of_flight(r1, r2, mu)
    least = quickest_turn(time)
    ends = 4 * mp.pi**2 * (1 + mpf(10) ** -6), 16 * mp.pi**2 * (1 - mpf(10) ** -6)
    both = [bisected(lambda z: time(z) - t, least, end) for end in ends]
    found = [velocities(r1, r2, mu, z, y(z), a) for z in both]
    # The one that leaves lower above the horizon.
    return min(found, key=lambda v: dot(v[:3], r1))


def shortest(x):
    time, _, _ = time_of_flight(x[:3], x[3:6], x[6])
    return [time(quickest_turn(time))]


def bulge(x):
    r, (mu, j2, radius) = x[:3], x[3:]
    d = norm(r)
    scale, s = -3 * mu * j2 * radius**2 / (2 * d**5), 5 * r[2] ** 2 / d**2
    return [scale * r[0] * (1 - s), scale * r[1] * (1 - s), scale * r[2] * (3 - s)]


# Bodies, attitude, gyros.


def free_flight(x):
    """Taylor series of Euler's equations and of the quaternion, in whole numbers of 2^-bits, which
    are faster than those of mpmath."""
    bits = int(mp.prec) + 30
    moments, w, t = x[:3], x[3:6], x[6]
    steps = int(mp.ceil(2 * abs(t) * max(norm(w), mpf(1) / 8))) + 1
    order = int(mp.dps * 1.25) + 10

    def fixed(c):
        return int(mp.floor(mp.ldexp(c, bits)))

    k = [fixed((moments[(i + 1) % 3] - moments[(i + 2) % 3]) / moments[i]) for i in range(3)]
    h, w, q = fixed(t / steps), [fixed(c) for c in w], [1 << bits, 0, 0, 0]
    for _ in range(steps):
        (u, v, z), (a, b, c, d) = ws, qs = [[c] for c in w], [[c] for c in q]
        for n in range(1, order):

            def product(x, y):
                return sum(map(int.__mul__, x, reversed(y))) >> bits

            rates = [k[i] * product(ws[(i + 1) % 3], ws[(i + 2) % 3]) >> bits for i in range(3)]
            turns = [
                -product(b, u) - product(c, v) - product(d, z),
                product(a, u) + product(c, z) - product(d, v),
                product(a, v) + product(d, u) - product(b, z),
                product(a, z) + product(b, v) - product(c, u),
            ]
            for series, value in zip((*ws, *qs), (*(2 * r for r in rates), *turns), strict=True):
                series.append(value // (2 * n))
        w, q = ([_horner(series, h, bits) for series in part] for part in (ws, qs))
    w, q = ([mp.ldexp(mpf(c), -bits) for c in part] for part in (w, q))
    return [c for row in matrix(q) for c in row] + w


def top_motion(x):
    """The same of a top: attitude and rate after a time."""
    q, w = _top_steps(x)[-1]
    return q + w


def top_turns(x):
    """Euler's angles of it, each turn counted by steps that are short against it."""
    steps = _top_steps(x)
    # (psi + phi)/2 and (psi - phi)/2.
    halves = [(mp.atan2(q[3], q[0]), mp.atan2(q[2], q[1])) for q, _ in steps]
    sums = []
    for series in zip(*halves, strict=True):
        total = series[0]
        for before, after in zip(series, series[1:], strict=False):
            turn = after - before
            total += turn - 2 * mp.pi * mp.nint(turn / (2 * mp.pi))
        sums.append((series[0], total))
    (s0, s), (d0, d) = sums
    q = steps[-1][0]
    theta = 2 * mp.atan2(mp.hypot(q[1], q[2]), mp.hypot(q[0], q[3]))

    def within(angle):
        return angle - 2 * mp.pi * mp.nint(angle / (2 * mp.pi))

    return [within(s0 + d0) + s - s0 + d - d0, theta, within(s0 - d0) + s - s0 - d + d0]


def _top_steps(x):
    """Attitudes and rates at the ends of steps."""
    bits = int(mp.prec) + 30
    A, C, Wl, q, w, t = *x[:3], x[3:7], x[7:10], x[10]
    size = norm(q)
    fast = max(norm(w), abs((A - C) / A * w[2]), mp.sqrt(abs(Wl) / A), mpf(1) / 8)
    steps = int(mp.ceil(4 * abs(t) * fast)) + 1
    order = int(mp.dps * 1.25) + 10

    def fixed(c):
        return int(mp.floor(mp.ldexp(c, bits)))

    def back(part):
        return [mp.ldexp(mpf(c), -bits) for c in part]

    spin, pull, h, z = fixed((A - C) / A * w[2]), fixed(Wl / A), fixed(t / steps), fixed(w[2])
    w, q = [fixed(c) for c in w[:2]], [fixed(c / size) for c in q]
    found = [([size * c for c in back(q)], [*back(w), x[9]])]
    for _ in range(steps):
        (u, v), (a, b, c, d) = ws, qs = [[c] for c in w], [[c] for c in q]
        for n in range(1, order):

            def product(x, y):
                return sum(map(int.__mul__, x, reversed(y))) >> bits

            # The vertical in the body.
            across = product(b, d) - product(a, c), product(c, d) + product(a, b)
            rates = [
                (spin * v[-1] >> bits) + (2 * pull * across[1] >> bits),
                -(spin * u[-1] >> bits) - (2 * pull * across[0] >> bits),
            ]
            turns = [
                -product(b, u) - product(c, v) - (d[-1] * z >> bits),
                product(a, u) + (c[-1] * z >> bits) - product(d, v),
                product(a, v) + product(d, u) - (b[-1] * z >> bits),
                (a[-1] * z >> bits) + product(b, v) - product(c, u),
            ]
            for series, value in zip((*ws, *qs), (*(2 * r for r in rates), *turns), strict=True):
                series.append(value // (2 * n))
        w, q = ([_horner(series, h, bits) for series in part] for part in (ws, qs))
        found.append(([size * c for c in back(q)], [*back(w), x[9]]))
    return found


def _horner(series, h, bits):
    total = 0
    for c in reversed(series):
        total = c + (total * h >> bits)
    return total


def polhode_period(x):
    pairs = sorted(zip(x[:3], x[3:], strict=True), key=lambda pair: -pair[0])
    (a, _), (b, _), (c, _) = pairs
    two_t, h2 = (sum(m**n * w**2 for m, w in pairs) for n in (1, 2))
    p, q = (b - c) * (two_t * a - h2), (a - b) * (h2 - two_t * c)
    return [4 * mp.ellipk(min(p, q) / max(p, q)) / mp.sqrt(max(p, q) / (a * b * c))]


def cones(x):
    across = mp.sqrt(x[0] ** 2 + x[1] ** 2)
    return [mp.atan2(x[3] * across, x[4] * x[2]), mp.atan2(across, x[2])]


def swing(N, beta, alpha, gamma):
    """Cosines of the turning points, period and precession."""
    if beta < 0:
        u1, u2, period, psi = swing(-N, -beta, alpha, gamma)
        return -u2, -u1, period, psi
    with mp.workdps(3 * mp.dps):
        coefficients = [beta, -(alpha + N**2), 2 * gamma * N - beta, alpha - gamma**2]
        u2, u1, u3 = sorted(
            mp.re(u) for u in mp.polyroots(coefficients, maxsteps=500, extraprec=1000)
        )
        m, scale = (u1 - u2) / (u3 - u2), 4 / mp.sqrt(beta * (u3 - u2))
        psi = mpf(0)
        for g, pole, sign in ((gamma - N, 1 - u2, 1), (gamma + N, 1 + u2, -1)):
            if g:
                psi += scale / 2 * g / pole * mp.ellippi(sign * (u1 - u2) / pole, m)
        return u1, u2, scale * mp.ellipk(m), psi


def nutation(x):
    A, C, Wl, theta, theta_rate, psi_rate, phi_rate = x
    n = phi_rate + psi_rate * mp.cos(theta)
    N, beta = C * n / A, 2 * Wl / A
    alpha = theta_rate**2 + (psi_rate * mp.sin(theta)) ** 2 + beta * mp.cos(theta)
    gamma = psi_rate * mp.sin(theta) ** 2 + N * mp.cos(theta)
    u1, u2, period, psi = swing(N, beta, alpha, gamma)
    return [mp.acos(u1), mp.acos(u2), period, psi]


def cubic_period(x):
    N, beta, up, gamma = x
    return [swing(N, beta, up + beta, gamma + N)[2]]


def steady_rates(x):
    A, C, Wl, theta, n = x
    p = C * n + mp.sqrt((C * n) ** 2 - 4 * A * Wl * mp.cos(theta))
    return [2 * Wl / p, p / (2 * A * mp.cos(theta))]


def least_spin(x):
    A, C, Wl, theta = x
    return [2 / C * mp.sqrt(A * Wl * mp.cos(theta))]


def pendulum_period(x):
    return [4 * mp.sqrt(x[0] / x[1]) * mp.ellipk(mp.sin(x[2] / 2) ** 2)]


def libration_period(x):
    rate = x[4] * mp.sqrt(3 * (x[1] - x[3]) / x[2])
    return [4 * mp.ellipk(mp.sin(x[0]) ** 2) / rate]


def tide(x):
    r, q, moments, mu = x[:3], x[3:7], x[7:10], x[10]
    c = matrix(q)
    b = [sum(c[i][j] * r[i] for i in range(3)) for j in range(3)]
    torque = cross(b, [m * u for m, u in zip(moments, b, strict=True)])
    return [3 * mu / norm(r) ** 5 * m for m in torque]


def cord(x):
    w0, w, I, R, m = x
    return [R * mp.sqrt((I / (m * R**2) + 1) * (w0 - w) / (w0 + w))]


def unwound(x):
    I, R, m, _, phi, w0 = x
    c = I / (m * R**2) + 1
    return [w0 * (c - phi**2) / (c + phi**2), 4 * I * c * w0**2 * phi / (R * (c + phi**2) ** 2)]


def pseudo_potential_minimum(x):
    """By the slope of V', whose sign times s^4 c^4 falls: in the squared sine of half the angle."""
    A, C, Wl, h, n = x

    def fall(y):
        up, down = h - C * n, h + C * n
        return (down * y) ** 2 - (up * (1 - y)) ** 2 - 16 * A * Wl * (y * (1 - y)) ** 2

    return [2 * mp.asin(mp.sqrt(halved(fall, mpf(0), mpf(1))))]


def assumed(x):
    """Two powers of a cantilever, x^2 and x^3: M = mu L (1/5, 1/6; 1/6, 1/7), K = EI / L^3 (4, 6;
    6, 12), det(K - w^2 M) = 0."""
    length, stiffness, mass = x
    # 1/1260 z^2 - 34/35 z + 12 = 0 in z = w^2 mu L^4 / EI.
    apart = mp.sqrt((mpf(34) / 35) ** 2 - 4 * mpf(12) / 1260)
    roots = [(mpf(34) / 35 - apart) * 630, (mpf(34) / 35 + apart) * 630]
    return [mp.sqrt(z * stiffness / mass) / length**2 for z in roots]


def gimbal_walk(x):
    """Trapezoidal sums over one period; they converge exponentially."""
    theta0, rate, H, J, I1, I2 = x

    def inertia(theta):
        return I2 * mp.sin(theta) ** 2 + I1 * mp.cos(theta) ** 2

    def walk(theta):
        return H * (mp.cos(theta0) - mp.cos(theta)) / mp.sqrt(J * inertia(theta))

    def slope(theta):
        s, c, z = mp.sin(theta), mp.cos(theta), inertia(theta)
        return H / mp.sqrt(J * z) * (s - (mp.cos(theta0) - c) * (I2 - I1) * s * c / z)

    times, turns, nodes = mpf(0), mpf(0), 400
    for k in range(nodes):
        chi = 2 * mp.pi * (k + mpf(1) / 2) / nodes
        theta = theta0 + rate * mp.sin(chi) / slope(theta0)
        for _ in range(9):
            theta -= (walk(theta) - rate * mp.sin(chi)) / slope(theta)
        times += 1 / slope(theta)
        turns += H * (mp.cos(theta0) - mp.cos(theta)) / inertia(theta) / slope(theta)
    return [2 * mp.pi * times / nodes, turns / times]


# Rockets and optimal flight.


def gain(x):
    return [x[0] * mp.log(x[1])]


def burnout_height(x):
    u, ratio, t, g, start = x
    return [start * t + u * t * (1 - mp.log(ratio) / (ratio - 1)) - g * t**2 / 2]


def coast(x):
    speed, height, g, radius = x
    energy = speed**2 / 2 - g * radius**2 / (radius + height)
    return [-g * radius**2 / energy - radius - height]


def spun_angle(x):
    t, n, burn, ring = x
    log = mp.log(1 - burn * t)
    return [-n / burn * (mp.expm1(ring**2 * log) / ring**2 if ring else log)]


def damping(x):
    return [x[0] ** (x[1] ** 2 - 1)]


spin_left = damping


def density(x):
    return [x[1] * mp.exp(-(x[0] - x[2]) / x[3])]


def two_stages(x):
    u, b, v = x[:2], x[2:4], x[4]
    if v >= sum(c * mp.log(1 / s) for c, s in zip(u, b, strict=True)):
        # More than the stages can give.
        return [mp.nan] * 4

    def ratios(z):
        return [max(mpf(1), (1 - z / c) / s) for c, s in zip(u, b, strict=True)]

    def missing(z):
        return v - sum(c * mp.log(m) for c, m in zip(u, ratios(z), strict=True))

    z = bisected(missing, mpf(0), max(c * (1 - s) for c, s in zip(u, b, strict=True)))
    mass = mpf(1)
    for m, s in zip(ratios(z), b, strict=True):
        mass *= m * (1 - s) / (1 - s * m)
    return [*ratios(z), mass, -1 / z]


def quickest(x):
    a, h, v = x
    ratio = a * h / v**2

    def excess(s):
        # The mean height of the law, by its series: sum 2 (2s)^(2k+1) / (2k+1)! / (8 s^2) ...
        return stumpff(3, -4 * s * s) * s - ratio

    s = bisected(excess, -2 * mp.asinh(6 * abs(ratio)) - 1, 2 * mp.asinh(6 * abs(ratio)) + 1)
    return [mp.atan(mp.sinh(s)), v / a * stumpff(1, -s * s)]


def quick_angle(x):
    theta, duration = quickest(x[:3])
    return [mp.atan2((1 - 2 * x[3] / duration) * mp.sin(theta), mp.cos(theta))]


def steepest(x):
    """Angle, time and velocity of the best linear-tangent steering: its two equations by Newton's
    method from the root of the library, with the quadrature of the library."""
    u, tau, tb, v0, y0, height, g = x
    nodes = [mpf(float(c)) for c in NODES]
    weights = [mpf(float(c)) for c in WEIGHTS]
    times = [tb / 2 * (1 + c) for c in nodes]
    gains = [tb / 2 * c * u / (tau - t) for c, t in zip(weights, times, strict=True)]

    def burnout(theta, T):
        """Both velocities and the height."""
        angles = [mp.atan2((1 - t / T) * mp.sin(theta), mp.cos(theta)) for t in times]
        up = [c * mp.sin(a) for c, a in zip(gains, angles, strict=True)]
        across = sum(c * mp.cos(a) for c, a in zip(gains, angles, strict=True))
        rise = sum((tb - t) * c for t, c in zip(times, up, strict=True))
        w = v0 * mp.sin(theta) + sum(up) - g * tb
        y = y0 + v0 * mp.sin(theta) * tb + rise - g * tb**2 / 2
        return v0 * mp.cos(theta) + across, w, y

    def equations(theta, T):
        _, w, y = burnout(theta, T)
        return [w - g * (T - tb), y + w**2 / (2 * g) - height]

    try:
        given = Ascent(
            ConstantMassFlow(*map(float, (u, tau))), *map(float, (tb, v0, y0, height, g))
        )
        best = linear_tangent_steering(given)
    except InputError:
        # A height that this burn cannot reach.
        return [mp.nan] * 3
    start = mpf(float(best.initial_angle)), mpf(float(best.vanishing_time))
    theta, T = mp.findroot(equations, start, tol=mpf(10) ** (-2 * mp.dps + 10))
    return [theta, T, burnout(theta, T)[0]]


# Transfers.


def bielliptic_break_even(x):
    """The radius of the impulse between at which three impulses cost as much as two; infinite where
    they always cost more, that of the larger circle where they never do."""
    ratio = max(x[0], 1 / x[0])

    def speed(r, other):
        """At the apsis `r` of an ellipse whose other one is `other`."""
        return mp.sqrt(2 * other / (r * (r + other)))

    circle = mp.sqrt(1 / ratio)
    two = speed(1, ratio) - 1 + circle - speed(ratio, 1)

    def saved(u):
        # What three impulses save, over b - x, which every difference holds.
        b = ratio / u
        three = speed(1, b) - 1 + speed(b, ratio) - speed(b, 1) + speed(ratio, b) - circle
        return (two - three) * b / (b - ratio)

    tiny = mpf(10) ** -25
    if saved(tiny) <= 0:
        return [mp.inf]
    if saved(1 - tiny) >= 0:
        return [ratio]
    return [ratio / bisected(lambda u: -saved(u), tiny, 1 - tiny)]


def turning_radii(x):
    """Where the radial speed in a fading attraction vanishes, on either side."""
    r, v = x[:3], x[3:]
    length = norm(r)
    moment = dot(cross(r, v), cross(r, v))

    def potential(R):
        return -mp.exp(-R / 10) / R

    energy = dot(v, v) / 2 + potential(length)

    def side(sign):
        """The nearest way in ln r, as far as the library looks."""

        def over(s):
            R = length * mp.exp(sign * s)
            # (R R')^2, which is that of the start there.
            return (2 * R * R * (energy - potential(R)) - moment) / s

        with mp.workdps(2 * mp.dps + 20):
            steps = [mpf(float(s)) for s in np.geomspace(1e-16, 30.0, 220)]
            for before, after in zip([None, *steps], steps, strict=False):
                if over(after) > 0:
                    continue
                if before is None:
                    return mpf(0)
                return halved(lambda s: -over(s), before, after)
        return None

    inner, outer = side(-1), side(1)
    return [
        mpf(0) if inner is None else length * mp.exp(-inner),
        mp.inf if outer is None else length * mp.exp(outer),
    ]


# Runs.


def burnt(x):
    thrust, u, t, mass = x
    return [1000 + u * mp.log(mass / (mass - thrust * t / u))]


def turned_by_gravity(x):
    """The state of a gravity turn a time later."""
    time, n, g, speed, angle = x
    z0 = mp.tan(angle / 2)

    def growth(a, s):
        return mp.expm1(a * s) / a if a else s

    def late(s):
        return growth(n - 1, s) + z0**2 * growth(n + 1, s) - g * (1 + z0**2) / speed * time

    # The bounds of the library.
    weight = max(z0**2, mpf(float(np.finfo(float).tiny)))
    end = min(64 * (1 + abs(late(mpf(0)))) * (1 + 1 / weight), mpf(2) ** 30)
    s = end if late(end) < 0 else -end if late(-end) > 0 else halved(late, -end, end)
    s = s if time else mpf(0)
    z, unit = z0 * mp.exp(s), speed**2 / (g * (1 + z0**2) ** 2)
    across = growth(2 * n - 1, s) + z0**2 * growth(2 * n + 1, s)
    up = growth(2 * n - 2, s) - z0**4 * growth(2 * n + 2, s)
    faster = mp.exp((n - 1) * s) * (1 + z**2) / (1 + z0**2)
    return [2 * unit * z0 * across, unit * up, speed * faster, 2 * mp.atan(z)]


# Mechanics.


def spread(x):
    """The greatest spread of a lander's legs, and the time to it."""
    M, m, l, start, k, g, speed = x
    carried = M + 2 * m

    def moment(theta):
        return l**2 * (M * mp.sin(theta) ** 2 + 4 * m / 3)

    def potential(theta):
        return carried * g * l * mp.cos(theta) + 2 * k * (theta - start) ** 2

    with mp.workdps(2 * mp.dps):
        rate = carried * l * mp.sin(start) * speed / moment(start)
        height = moment(start) * rate**2 / 2 + potential(start)
        end = mp.pi / 2
        if potential(end) > height:
            end = bisected(lambda theta: potential(theta) - height, start, end)

        def integrand(u):
            theta = start + (end - start) * u
            # The end is right to fewer digits than the nodes come near it.
            return mp.sqrt(moment(theta) / (2 * abs(height - potential(theta))))

        # By the rule for ends where the integrand or its continuation is infinite.
        time = (end - start) * mp.quad(integrand, [0, mpf(1) / 2, 1])
    return [end, time]


def arm(x):
    """Poles of a pendulum on a turning arm, and its place of rest."""
    p, zeta, w, reach = x
    half = mp.mpc(zeta * p, w)
    root = mp.sqrt(mp.mpc(-p * p * (1 - zeta**2), 2 * zeta * p * w))
    poles = [-half - root, -half + root]
    light = [mp.mpc(-zeta * (p + w), -p - w), mp.mpc(-zeta * (p - w), p - w)]
    parts = [mp.re(s) for s in poles] + [mp.im(s) for s in poles]
    rest = reach * w**2 / (p * p - w * w) if p != w else mp.inf
    return [*parts, *(mp.re(s) for s in light), *(mp.im(s) for s in light), rest]


# Instruments.


def rate_gyro(x):
    """Response to a frequency, damping ratio, natural frequency, error torque and drift."""
    A, c, H, K, _, spin, _, bias, u_i, u_s, k, a_i, a_s, w = x
    answer = H / mp.mpc(K + H * spin - A * w * w, c * w)
    torque = bias + u_s * a_i - u_i * a_s + k * a_i * a_s
    figures = [c / (2 * mp.sqrt(K * A)), mp.sqrt(K / A), torque, torque / H]
    return [mp.re(answer), mp.im(answer), *figures]
