"""A flexible missile whose engine swivels on a sprung hinge: bending, engine and thrust together.

    m (q_i'' + w_i^2 q_i) - S_i d'' = F [(1 - C_2) d + y_h'] phi_i(-l_h)
    J d'' - sum S_i q_i'' + M_d d = C_2 F [(l_h + C_1) d + l_h y_h' + y_h] + M_A (d_A - d) - M_D d'
    I_0 th'' = -F [(l_h + C_1) d + l_h y_h' + y_h] - (I_h + m_e l_h z_e) d''
    J = I_h - C_1 m_e z_e - C_2 (I_h + m_e l_h z_e)
    C_1 = m_e z_e / m,  C_2 = (I_h + m_e l_h z_e) / I_0,  S_i = int phi_i(-l_h - z) z dm

    symbol        meaning                                                      unit
    d, q_i, th    angle of the engine; bending coordinates; pitch              rad, m, rad
    m, L, EI      mass, length, bending stiffness of the uniform beam          kg, m, N m^2
    l_h           distance of the hinge behind the mass centre                 m
    m_e, z_e, I_h engine, the part of the beam behind the hinge: mass, mass
                  centre behind the hinge, moment about it                     kg, m, kg m^2
    F             thrust, along the engine                                     N
    y_h, y_h'     deflection and slope of the beam at the hinge                m, 1
    M_d, M_A, M_D stiffness of the hinge; stiffness and damping of the actuator  N m, N m s

Source: Thomson 9.12-12 to -30 (in -30 "I_hze" is l_h z_e, and m_e z_e g sin(th) is missing).
Bending is counted across the mean axis, about which deformation has neither momentum nor angular
momentum. An engine turned by d displaces the straight beam from it by C_1 - C_2 x, so that engine
and thrust make the angle (1 - C_2) d + y_h' with it. Across the axis of the beam itself the factor
(1 - C_2) would be missing: the difference is the work of the axial thrust in a beam inclined by C_2
d, which is of the size of the softening. Softening of the beam by the axial load is neglected, as
in the book, and so are aerodynamic forces. The modes are those with the engine locked.
"""

from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Complex, Float

from ..core import AbstractSystem, NumberField, Scalar, argument, constructor, quantity
from ..core.listed import no_method
from ..core.printing import printed
from ..core.shapes import with_rank
from ..core.types import as_float, follow_precision
from ._equations import solve
from .beams import beam_integral, beam_roots, beam_shape


@final
@printed()
class MissileState(eqx.Module):
    """Engine, bending and pitch with their rates; also the rates of all."""

    engine: NumberField = quantity("rad", doc="d, angle of the engine")
    bending: Float[Array, "modes *#runs"] = quantity("m", doc="q, of the bending modes")
    pitch: NumberField = quantity("rad", doc="theta")
    engine_rate: NumberField = quantity("rad/s", doc="rate of the engine's angle")
    bending_rate: Float[Array, "modes *#runs"] = quantity("m/s", doc="rate of the bending")
    pitch_rate: NumberField = quantity("rad/s", doc="rate of theta")


@final
class FlexibleMissile(AbstractSystem):
    """A uniform flexible missile with an engine that swivels. State: `MissileState`, preferably
    created with `state`."""

    mass: NumberField = quantity("kg", positive=True, doc="m, with the engine")
    length: NumberField = quantity("m", positive=True, doc="L")
    bending_stiffness: NumberField = quantity("N m^2", positive=True, doc="EI")
    engine_length: NumberField = quantity("m", positive=True, doc="b, of the part behind the hinge")
    hinge_stiffness: NumberField = quantity("N m", non_negative=True, doc="M_d, of the hinge")
    thrust: NumberField = quantity("N", default=0.0, doc="F, along the engine")
    actuator_stiffness: NumberField = quantity("N m", default=0.0, doc="M_A, of the actuator")
    actuator_damping: NumberField = quantity("N m s", default=0.0, doc="M_D, of the actuator")
    command: NumberField = quantity("rad", default=0.0, doc="d_A, of the actuator")
    damping_ratio: NumberField = quantity("", default=0.0, doc="of every bending mode")
    modes: int = eqx.field(static=True, default=3, metadata={"doc": "number of bending modes"})

    def vector_field(self, t: Scalar, y: MissileState) -> MissileState:
        del t
        self = follow_precision(self, y)
        rate, pitch = self.accelerations(y, self.command)
        return MissileState(y.engine_rate, y.bending_rate, y.pitch_rate, rate[0], rate[1:], pitch)

    def accelerations(
        self, y: MissileState, command: Scalar, force: Scalar = 0.0, place: Scalar = 0.0
    ) -> tuple[Float[Array, "n *#runs"], Scalar]:
        """Accelerations of engine and bending together, (1 + modes, *runs), and of the pitch.

        **Arguments**

        - `y`: the state; `command`: d_A, rad.
        - `force`: a further one across the missile, N, at `place`, m before the mass centre."""
        m, k = self.matrices
        x = jnp.concatenate([y.engine[None], y.bending])
        rank = x.ndim - 1
        m, k = with_rank(m, rank, axes=2), with_rank(k, rank, axes=2)
        moment = self.actuator_stiffness * command - self.actuator_damping * y.engine_rate
        friction = 2.0 * self.damping_ratio * self.mass
        modal = friction * with_rank(self.frequencies, rank) * y.bending_rate
        # The actuator adds its command and damper here: its spring is in the stiffness matrix.
        drive = jnp.concatenate([jnp.broadcast_to(moment, y.engine.shape)[None], -modal])
        pushed = with_rank(self.across(place), rank) * force
        force_of = drive + pushed - jnp.einsum("ij...,j...->i...", k, x)
        # The elimination joins the rows of both, which must have the same axes of runs.
        m = jnp.broadcast_to(m, (*m.shape[:2], *force_of.shape[1:]))
        rate = solve(m, force_of[:, None])[:, 0]
        return rate, self.mean_turn(y, force, place) - self.engine["turn"] * rate[0]

    def mean_turn(self, y: MissileState, force: Scalar = 0.0, place: Scalar = 0.0) -> Scalar:
        """The angular acceleration of the mean axis, rad/s^2, which is independent of that of the
        engine; arguments as in `accelerations`."""
        shapes, slopes, _ = (with_rank(x, y.engine.ndim) for x in self.hinge)
        bent = jnp.sum((self.lever * slopes + shapes) * y.bending, axis=0)
        turning = -self.thrust * ((self.lever + self.engine["shift"]) * y.engine + bent)
        return (turning + place * force) / self.inertia

    def across(self, place: Scalar) -> Float[Array, "n *#runs"]:
        """Displacement across the mean axis of a point on the straight beam, m before the mass
        centre and before the hinge, per angle of the engine, m, and per bending, 1."""
        engine = self.engine
        shapes = self._shapes_at(place, 0)
        lean = engine["shift"] - engine["turn"] * place
        lean = jnp.broadcast_to(lean, jnp.broadcast_shapes(lean.shape, shapes.shape[1:]))
        shapes = jnp.broadcast_to(with_rank(shapes, lean.ndim), (self.modes, *lean.shape))
        return jnp.concatenate([lean[None], shapes])

    def slopes(self, place: Scalar) -> Float[Array, "modes *#runs"]:
        """The slopes of the bending shapes at a place, m before the mass centre, 1/m."""
        return self._shapes_at(place, 1) / self.length

    def _shapes_at(self, place: Scalar, derivative: int) -> Array:
        at = jnp.asarray(0.5 + place / self.length)
        return jnp.stack([beam_shape("free-free", b, at, derivative) for b in self.roots])

    @property
    def tail_wags_dog_frequency(self) -> Scalar:
        """The frequency, rad/s, at which an oscillating engine no longer rotates the rigid missile,
        because its inertia cancels the thrust; a zero of the pitch: F (l_h + C_1) / (I_h + m_e l_h
        z_e)."""
        engine = self.engine
        coupled = engine["turn"] * self.inertia
        return jnp.sqrt(self.thrust * (self.lever + engine["shift"]) / coupled)

    def invariants(self, t: Scalar, y: MissileState) -> dict[str, Array]:
        """Nothing is conserved under thrust."""
        del t, y
        return {}

    @constructor(
        engine=argument("rad", default=0.0, doc="angle of the engine"),
        pitch=argument("rad", default=0.0, doc="of the missile"),
    )
    def state(self, engine: Scalar = 0.0, pitch: Scalar = 0.0) -> MissileState:
        """A straight missile at rest, with the engine and the pitch at these angles, rad."""
        e, p, zero = jnp.broadcast_arrays(*(as_float(x) for x in (engine, pitch, 0.0 * engine)))
        straight = jnp.broadcast_to(zero, (self.modes, *zero.shape))
        return MissileState(e, straight, p, zero, straight, zero)

    @property
    def lever(self) -> Scalar:
        """l_h, m, of the hinge behind the mass centre."""
        return 0.5 * self.length - self.engine_length

    @property
    def inertia(self) -> Scalar:
        """I_0, kg m^2, of the straight missile about its mass centre."""
        return self.mass * self.length**2 / 12.0

    @property
    def engine(self) -> dict[str, Array]:
        """Mass m_e, mass centre z_e, moment I_h about the hinge, and the ratios `shift` C_1, m, and
        `turn` C_2, and the moment J of the engine in a free missile, kg m^2."""
        mass = self.mass * self.engine_length / self.length
        centre = 0.5 * self.engine_length
        moment = mass * self.engine_length**2 / 3.0
        coupled = moment + mass * self.lever * centre
        shift, turn = mass * centre / self.mass, coupled / self.inertia
        free = moment - shift * mass * centre - turn * coupled
        names = ("mass", "centre", "moment", "shift", "turn", "free_moment")
        values = (mass, centre, moment, shift, turn, free)
        return {name: jnp.asarray(x) for name, x in zip(names, values, strict=True)}

    @property
    def frequencies(self) -> Float[Array, "modes *#runs"]:
        """Angular frequencies w_i, rad/s, of bending with the engine locked."""
        stiffness = self.bending_stiffness / (self.mass * self.length**3)
        roots = jnp.asarray(self.roots, jnp.result_type(stiffness))
        return with_rank(roots, jnp.ndim(stiffness)) ** 2 * jnp.sqrt(stiffness)

    @property
    def roots(self) -> list[float]:
        """The roots beta of the free-free beam."""
        # As plain numbers, so that the parameters decide the precision.
        return beam_roots("free-free", self.modes).tolist()

    @property
    @no_method
    def hinge(self) -> tuple[Array, Array, Array]:
        """phi_i and phi_i', 1/m, at the hinge, and S_i, kg m: each (modes, *runs)."""
        # With the same runs, so that none of their axes is taken for that of the modes.
        mass, length, part = jnp.broadcast_arrays(self.mass, self.length, self.engine_length)
        at = part / length
        shapes = jnp.stack([beam_shape("free-free", b, at) for b in self.roots])
        slopes = jnp.stack([beam_shape("free-free", b, at, 1) for b in self.roots])

        def moment(root: float) -> Array:
            # A place z behind the hinge is b - z from the end.
            return beam_integral(lambda z: beam_shape("free-free", root, at - z) * z, 0.0, at)

        moments = jnp.stack([moment(b) for b in self.roots])
        return shapes, slopes / length, moments * mass * length

    @property
    @no_method
    def matrices(self) -> tuple[Float[Array, "n n *#runs"], Float[Array, "n n *#runs"]]:
        """Masses and stiffnesses of engine and bending, without dampers: of M x'' + K x = 0."""
        shapes, slopes, s = self.hinge
        engine, F = self.engine, self.thrust
        n = self.modes
        m: list[list[Any]] = [[0.0] * (n + 1) for _ in range(n + 1)]
        k: list[list[Any]] = [[0.0] * (n + 1) for _ in range(n + 1)]
        turning = engine["turn"] * F
        w = self.frequencies
        m[0][0] = engine["free_moment"]
        stiff = self.hinge_stiffness + self.actuator_stiffness
        k[0][0] = stiff - turning * (self.lever + engine["shift"])
        for i in range(n):
            m[0][i + 1] = m[i + 1][0] = -s[i]
            k[0][i + 1] = -turning * (self.lever * slopes[i] + shapes[i])
            k[i + 1][0] = -F * (1.0 - engine["turn"]) * shapes[i]
            for j in range(n):
                same = 1.0 if i == j else 0.0
                m[i + 1][j + 1] = same * self.mass
                k[i + 1][j + 1] = same * self.mass * w[i] ** 2 - F * shapes[i] * slopes[j]
        return _matrix(m), _matrix(k)

    @property
    def coupled_frequencies_squared(self) -> Complex[Array, "n *#runs"]:
        """w^2, rad^2/s^2, of engine and bending together, ascending, (1 + modes, *runs); negative
        or complex where the thrust makes them unstable."""
        m, k = self.matrices
        rank = max(m.ndim, k.ndim) - 2
        m, k = jnp.broadcast_arrays(with_rank(m, rank, axes=2), with_rank(k, rank, axes=2))
        # The library takes the matrices of all runs on its last axes.
        product = jnp.moveaxis(solve(m, k), (0, 1), (-2, -1))
        return jnp.moveaxis(jnp.sort(jnp.linalg.eigvals(product), axis=-1), -1, 0)


def _matrix(rows: list[list[ArrayLike]]) -> Array:
    flat = jnp.broadcast_arrays(*(jnp.asarray(x) for row in rows for x in row))
    return jnp.stack(flat).reshape(len(rows), len(rows), *flat[0].shape)
