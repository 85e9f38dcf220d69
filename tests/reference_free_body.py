"""The free rotation of a body in as many digits as are asked for, with mpmath: for tests only.

Two roads that share nothing: Taylor series of the equations of motion, and the closed form by
Legendre's functions and Carlson's R_J, composed of pieces that are shorter than a quarter period,
so that no count of periods enters."""

import mpmath
from mpmath import mpf


def product(p, q):
    """Hamilton's product of two quaternions."""
    a, b, c, d = p
    e, f, g, h = q
    return [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]


def taylor(moments, omega, duration, order=40, reach=0.15):
    """Turn and angular velocity after the `duration`, by series of the `order` whose steps are
    `reach` / |omega|: the error of a step is below 1e-30."""
    i1, i2, i3 = (mpf(x) for x in moments)
    a = [(i2 - i3) / i1, (i3 - i1) / i2, (i1 - i2) / i3]
    w, q = [mpf(x) for x in omega], [mpf(1), mpf(0), mpf(0), mpf(0)]
    steps = int(duration * mpmath.norm(w) / mpf(reach)) + 1
    h = mpf(duration) / steps
    for _ in range(steps):
        W, Q = [[x] for x in w], [[x] for x in q]
        for k in range(order):

            def cauchy(x, y, k=k):
                return mpmath.fdot(x, y[k::-1])

            bends = [cauchy(W[(i + 1) % 3], W[(i + 2) % 3]) for i in range(3)]
            pairs = [[cauchy(x, y) for y in W] for x in Q]
            turning = [
                -pairs[1][0] - pairs[2][1] - pairs[3][2],
                pairs[0][0] + pairs[2][2] - pairs[3][1],
                pairs[0][1] + pairs[3][0] - pairs[1][2],
                pairs[0][2] + pairs[1][1] - pairs[2][0],
            ]
            for i in range(3):
                W[i].append(h * a[i] * bends[i] / (k + 1))
            for x, rate in zip(Q, turning, strict=True):
                x.append(h * rate / (2 * (k + 1)))
        w, q = [mpmath.fsum(x) for x in W], [mpmath.fsum(x) for x in Q]
    return q, w


def quarter_period(moments, omega):
    """A quarter of the time in which omega returns in the body; moments in rising or falling
    order."""
    a, p = _rates_and_products(moments, omega)
    del a
    x, y = p[0] + p[1], p[2] + p[1]
    return mpmath.pi / 2 / mpmath.agm(mpmath.sqrt(max(x, y)), mpmath.sqrt(abs(p[0] - p[2])))


def closed(moments, omega, duration, periods=0):
    """Turn and angular velocity after so many whole `periods` and the `duration`; moments in rising
    or falling order."""
    moments, omega = [mpf(x) for x in moments], [mpf(x) for x in omega]
    quarter = quarter_period(moments, omega)
    whole = [mpf(1), mpf(0), mpf(0), mpf(0)]
    if periods:
        turn, _ = closed(moments, omega, 4 * quarter)
        while periods:
            whole = product(whole, turn) if periods % 2 else whole
            turn, periods = product(turn, turn), periods // 2
    pieces = int(abs(duration) / (mpf("0.9") * quarter)) + 1
    for _ in range(pieces):
        turn, omega = _piece(moments, omega, mpf(duration) / pieces)
        whole = product(whole, turn)
    return whole, omega


def _rates_and_products(moments, omega):
    i1, i2, i3 = (mpf(x) for x in moments)
    a = [(i2 - i3) / i1, (i3 - i1) / i2, (i1 - i2) / i3]
    w1, w2, w3 = (mpf(x) for x in omega)
    return a, [-a[1] * a[2] * w1 * w1, a[2] * a[0] * w2 * w2, -a[0] * a[1] * w3 * w3]


def _jacobi(t, x, y, difference):
    """S, c and d (docstring of `_jacobi.py`), by descending Landen transformations of the
    amplitude."""
    top = max(x, y)
    n = mpmath.sqrt(top)
    means, gaps = [mpf(1)], [mpmath.sqrt(min(x, y) / top)]
    b = mpmath.sqrt(abs(difference) / top)
    while abs(gaps[-1]) > mpmath.eps:
        a = means[-1]
        means.append((a + b) / 2)
        gaps.append((a - b) / 2)
        b = mpmath.sqrt(a * b)
    angle = before = 2 ** (len(means) - 1) * means[-1] * n * t
    for a, c in zip(means[:0:-1], gaps[:0:-1], strict=True):
        before = angle
        angle = (angle + mpmath.asin(c / a * mpmath.sin(angle))) / 2
    sn, cn = mpmath.sin(angle), mpmath.cos(angle)
    dn = cn / mpmath.cos(before - angle) if len(means) > 1 else mpf(1)
    return (sn / n, cn, dn) if difference >= 0 else (sn / n, dn, cn)


def _piece(moments, omega, t):
    """Turn and angular velocity within a quarter period: the formulas of `_free_rotation.py`."""
    (i1, i2, i3), (w1, w2, w3) = moments, omega
    (a1, a2, a3), p = _rates_and_products(moments, omega)
    s, c, d = _jacobi(t, p[0] + p[1], p[2] + p[1], p[0] - p[2])
    below = d * d + p[2] * s * s
    later = [
        (w1 * d + a1 * w2 * w3 * s * c) / below,
        (w2 * c * d + a2 * w3 * w1 * s) / below,
        (w3 * c + a3 * w1 * w2 * s * d) / below,
    ]
    L, end = (
        [i * w for i, w in zip(moments, omega, strict=True)],
        [i * w for i, w in zip(moments, later, strict=True)],
    )
    h = mpmath.sqrt(sum(x * x for x in L))
    gain = (i1 - i3) * i1 * w1 * w1 + (i2 - i3) * i2 * w2 * w2
    pole, strength = (i2 - i3) * gain / (i2 * i3 * i3), h / i3 - h / i1
    third = strength * pole * s**3 / 3 * mpmath.elliprj(c * c, d * d, 1, 1 + pole * s * s)
    real = (L[0] ** 2 + L[1] ** 2) * c * d
    real -= i3 * i3 * a3 * w1 * w2 * w3 * s * (1 + pole * s * s)
    psi = h * t / i3 - third + mpmath.atan2(-h * gain / i3 * s * below, real)
    # z = L_2 + i L_1
    chi = psi + mpmath.atan2(end[0] * L[1] - end[1] * L[0], end[0] * L[0] + end[1] * L[1])

    def tilt(v):
        q = [h + v[2], -v[1], v[0], mpf(0)]
        size = mpmath.sqrt(2 * h * (h + v[2]))
        return [x / size for x in q]

    first, (e0, e1, e2, e3) = tilt(L), tilt(end)
    about = [mpmath.cos(chi / 2), mpf(0), mpf(0), mpmath.sin(chi / 2)]
    return product(product(first, about), [e0, -e1, -e2, -e3]), later
