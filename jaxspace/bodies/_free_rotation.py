"""The free rotation of a rigid body in closed form: angular velocity and attitude, for every
inertia and every start.

Principal axes, right-handed, the second with the intermediate moment; omega means omega(0), and
omega(t) its value a duration t later.

    omega_1' = a_1 omega_2 omega_3, ...
    a_1 = (I_2 - I_3)/I_1,     a_2 = (I_3 - I_1)/I_2,    a_3 = (I_1 - I_2)/I_3
    p_1 = -a_2 a_3 omega_1^2,  p_2 = a_3 a_1 omega_2^2,  p_3 = -a_1 a_2 omega_3^2, none negative
    x = p_1 + p_2,  y = p_3 + p_2,  x - y = p_1 - p_3;   S, c, d of t (core)

    By the addition theorem, with D = d^2 + p_3 S^2:

    omega_1(t) = (omega_1 d + a_1 omega_2 omega_3 S c) / D
    omega_2(t) = (omega_2 c d + a_2 omega_3 omega_1 S) / D
    omega_3(t) = (omega_3 c + a_3 omega_1 omega_2 S d) / D

The attitude is composed of the smallest rotation from the third axis to h, a rotation chi about h,
and the smallest rotation back at the later time:

    R(t) = F(0) R_z(chi) F(t)^-1,   F e_z = h/|h|
    chi = psi + arg(z(t) / z(0)),   z = L_2 + i L_1,   L = I omega
    psi = h t/I_3 - third(t; M, rho) + arg Z
    Z = |z(0)|^2 c d - i h G/I_3 S D - I_3^2 a_3 omega_1 omega_2 omega_3 S (1 + M S^2)
    M = (I_2 - I_3) G / (I_2 I_3^2),   rho = h/I_3 - h/I_1,   G = h^2 - 2T I_3

A change of the start turns the body at t by theta, in its axes there. theta' = delta omega + theta
x omega and L' = L x omega give (L . theta)' = L . delta omega = delta T, which is constant:

    L(t) . theta = t L . delta omega

    symbol   meaning                                                        unit
    I_i      principal moments; I_3 greatest or least                       kg m^2
    omega    angular velocity in principal axes                             rad/s
    L, h     angular momentum in principal axes, and its length             kg m^2/s
    T        kinetic energy; G without differences of T and h               J
    psi      precession of the third axis about h                           rad
    R        turn of the body, in its own axes at the start                 1

Source: Thomson 5.10 to 5.12 (elliptic functions), 5.9 (precession about h); van Zon and Schofield
(2007), J. Comput. Phys. 225, 145 (attitude by the third integral); Celledoni, Fasso, Sarstrom and
Zanna (2008), SIAM J. Sci. Comput. 30, 2084. The third axis is the outer one from which h stays
farther: |L_3| <= h/sqrt(2) where the polhode comes nearest to it, so that neither z nor F loses a
digit. The addition theorem needs no phase, hence no inverse function and no case for the
separatrix.
"""

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import PyTree

from ..core import Flag, Scalar, Vector
from ..core.barrier import barrier
from ..core.jacobi import Jacobi, jacobi
from ..core.squares import unit_factor
from ..core.vectors import components, cross, dot, norm
from ..rotations import Quaternion
from ._axis_order import arranged, axis_order, restored
from ._energy_rules import by_energy, of_equal_energy
from ._free_precession import ArrangedBody, Scaled, angle_between, precession, rate_coefficients


def free_rotation(duration: Scalar, moments: Vector, omega: Vector) -> tuple[Quaternion, Vector]:
    """The rotation of a body without torque after a duration, and its angular velocity then. First
    derivatives are exact everywhere.

    **Arguments**

    - `duration`: s, (*runs,).
    - `moments`: principal moments, in any order, kg m^2, (3, *runs).
    - `omega`: at the start, along the same axes, rad/s, (3, *runs).

    **Returns** the turn in the axes of the body at the start, (4, *runs), and the angular velocity
    after the duration, rad/s, (3, *runs).

    Near the rotation about the intermediate axis, with its repeated flips, the error of the result
    is 1e-12 over a flip for every tilt of the spin down to 1e-150; a smaller tilt counts as zero.
    The rounding of the inputs already changes the result over 1e4 flips by about 1e-10 for a tilt
    of 0.1, and by 1e-8 for one of 1e-100.

    The derivative by the tilt is of the size 1/tilt during a flip, because the tilt moves the flip
    in time, and of order one where the spin rests between two. The derivatives are accurate in both
    cases."""
    runs = jnp.broadcast_shapes(moments.shape[1:], omega.shape[1:], jnp.shape(duration))
    moments, omega = (
        jnp.stack([jnp.broadcast_to(component, runs) for component in v]) for v in (moments, omega)
    )
    # The motion of a faster body is the same in a shorter time.
    factor = unit_factor(*components(omega))
    turn, later = _rotated(jnp.broadcast_to(duration, runs) / factor, moments, factor * omega)
    return turn, later / factor


@jax.custom_jvp
def _rotated(duration: Scalar, moments: Vector, omega: Vector) -> tuple[Quaternion, Vector]:
    """R and omega(t), all arguments with the runs."""
    return _formula(duration, moments, omega, moments_stay=False)


def _rotated_tangent(
    primals: tuple[PyTree, ...], tangents: tuple[PyTree, ...]
) -> tuple[PyTree, ...]:
    """With respect to the initial state and the duration, with the angle about h from the identity
    of the module's docstring; with respect to the moments through the formula itself, which has no
    cancellation."""
    duration, moments, omega = primals
    of_duration, of_moments, of_omega = (
        None if isinstance(x, SymbolicZero) else x for x in tangents
    )
    result = _rotated(duration, moments, omega)
    slopes = []
    if of_duration is not None or of_omega is not None:
        moved = tuple(
            jnp.zeros_like(x) if slope is None else slope
            for x, slope in ((duration, of_duration), (omega, of_omega))
        )
        _, slope = jax.jvp(
            lambda t, w: _formula(t, moments, w, moments_stay=True), (duration, omega), moved
        )
        slopes.append(slope)
    if of_moments is not None:
        _, slope = jax.jvp(
            lambda i: _formula(duration, i, omega, moments_stay=False), (moments,), (of_moments,)
        )
        slopes.append(slope)
    return result, jax.tree.map(lambda *parts: sum(parts), *slopes)


# Symbolic zeros, so that slopes that are not requested cost nothing.
_rotated.defjvp(_rotated_tangent, symbolic_zeros=True)


def _formula(
    duration: Scalar, moments: Vector, omega: Vector, *, moments_stay: bool
) -> tuple[Quaternion, Vector]:
    """R and omega(t), as the module's docstring writes them. With `moments_stay`, the derivatives
    are those for constant moments, to full accuracy."""
    middle, mirrored = axis_order(moments, omega)
    # The exchange of two axes is a reflection, under which an angular velocity changes its sign.
    sign = jnp.where(mirrored, -1.0, 1.0).astype(omega.dtype)
    body = ArrangedBody.of(
        arranged(moments, middle, mirrored), sign * arranged(omega, middle, mirrored)
    )
    # Barriers between the stages: fused into one, the program compiles for much longer.
    body, mirrored, sign = barrier((body, mirrored, sign), everywhere=True)
    phase = barrier(jacobi(duration, body.x, body.y, body.difference), everywhere=True)
    scaled = barrier(Scaled.of(body, phase), everywhere=True)
    within = barrier(_omega_within(body, scaled), everywhere=True)
    # A half period reverses two components: the side of the separatrix decides which.
    odd, circled = phase.half_periods % 2.0 != 0.0, body.difference < 0.0
    later = jnp.where(jnp.stack([odd & circled, odd, odd & ~circled]), -within, within)
    later = of_equal_energy(later, body.moments, body.omega)
    # The whole half turns of z are counted by the precession.
    reached = jnp.where(odd & circled, -later, later)
    small = _slow(body, duration)
    large = _turn(body, phase, scaled, duration, reached, later, small, moments_stay).wxyz
    turn = jnp.where(small, _small_turn(body, later, duration).wxyz, large)
    vector = sign * restored(turn[1:], middle, mirrored)
    return Quaternion(jnp.concatenate([turn[:1], vector])), sign * restored(later, middle, mirrored)


def _omega_within(body: ArrangedBody, scaled: Scaled) -> Vector:
    """omega(t) within a quarter period, by the addition theorem."""
    (a1, a2, a3) = rate_coefficients(body.moments)
    (w1, w2, w3) = body.omega
    c, d, one, s, below = scaled
    # In this order no product leaves the range: w3 s and w1 one are each of order one.
    first = w1 * one * d + a1 * w2 * (w3 * s) * c
    second = w2 * (c * d) + a2 * (w3 * s) * (w1 * one)
    return jnp.stack([first, second, w3 * one * c + a3 * w2 * (w1 * s) * d]) / below


def _turn(
    body: ArrangedBody,
    phase: Jacobi,
    scaled: Scaled,
    duration: Scalar,
    reached: Vector,
    later: Vector,
    unused: Flag,
    moments_stay: bool,
) -> Quaternion:
    """R. Where the result is `unused`, that of a body that turns about an arbitrary axis."""
    i = body.moments
    # For a slow body the direction of h is undefined: an arbitrary one keeps the unused branch
    # finite.
    stand_in = jnp.asarray([0.6, 0.0, 0.8], i.dtype).reshape(3, *(1,) * (i.ndim - 1))
    start, end, reached = (jnp.where(unused, stand_in, i * w) for w in (body.omega, later, reached))
    h = norm(start)
    chi = precession(body, phase, scaled, duration, h) + angle_between(start, reached)
    chi = barrier(chi, everywhere=True)
    if moments_stay:
        chi = by_energy(jax.lax.stop_gradient(chi), duration, body.omega, later, start, end)
    half = 0.5 * chi
    c, s = jnp.cos(half), jnp.sin(half)
    zero = jnp.zeros_like(h)
    tilt = Quaternion(jnp.stack([h + start[2], -start[1], start[0], zero]))
    back = Quaternion(
        jnp.stack(
            [(h + end[2]) * c, end[1] * c + end[0] * s, end[1] * s - end[0] * c, (h + end[2]) * s]
        )
    )
    return Quaternion(tilt.then(back).wxyz / (2.0 * h * jnp.sqrt((h + start[2]) * (h + end[2]))))


def _slow(body: ArrangedBody, duration: Scalar) -> Flag:
    """Whether the body turns through less than about 0.003 rad, 0.1 rad in single precision, where
    derivatives of the direction of h lose their digits."""
    i, w = body.moments, body.omega
    # Up to an angle at which the lost digits, eps / angle, equal the relative error of the
    # derivatives of the series, about angle^4 / 144.
    least = max(1e-5, (144.0 * float(jnp.finfo(w.dtype).eps)) ** 0.4)
    return dot(i * w, w) / jnp.min(i, axis=0) * duration * duration < least


def _small_turn(body: ArrangedBody, later: Vector, duration: Scalar) -> Quaternion:
    """R of a small turn: Magnus' series of order four, the integrals by the Hermite polynomial of
    omega."""

    def rate(w: Vector) -> Vector:
        a1, a2, a3 = rate_coefficients(body.moments)
        return jnp.stack([a1 * w[1] * w[2], a2 * w[2] * w[0], a3 * w[0] * w[1]])

    w = body.omega
    bend = (rate(w) - rate(later) + cross(w, later)) / 12.0
    return Quaternion.from_rotation_vector(duration * (0.5 * (w + later) + duration * bend))
