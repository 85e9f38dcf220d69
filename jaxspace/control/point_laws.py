"""Control laws for a point, and linear ones for any state.

    u = k_p (r - x) - k_d v + k_i int((r - x) dt)            PID, and PD without k_i
    a = 6 (r - x - v t_g - g t_g^2/2) / t_g^2                least effort (ZEM, ZEV)
        - 2 (v_f - v - g t_g) / t_g,       T = m a
    x_{k+1} = A x_k + B (z_k - r),  u_k = C x_k + D (z_k - r)

    symbol         meaning                                          unit
    x, v, r        position, velocity, target                       m, m/s, m
    t_g, v_f       time to go, velocity at the end                  s, m/s
    g, m, T        gravity, mass, thrust                            m/s^2, kg, N
    A, B, C, D     matrices of a linear controller with memory x    any

Source: Astrom and Murray, Feedback Systems, 10; Ebrahimi, Bahrami and Roshanian (2008), Acta
Astronautica 62, 556 (zero effort miss and velocity); Franklin, Powell and Workman, Digital Control
of Dynamic Systems, 4 (linear difference equations).
"""

__all__ = ["PID", "LeastEffortGuidance", "LinearController", "Together"]

from collections.abc import Mapping, Sequence
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import InputError, NumberField, OptionalNumberField, Scalar, Vector, quantity
from ..core.field_types import check_types
from ..core.shapes import with_rank
from ._controller import AbstractController, measurement
from ._integral import Integral, integrated, integrating, unwound


@final
class PID(AbstractController):
    """A command proportional to an error, to its rate and, optionally, to its integral, component
    by component. The integral is frozen while the command is saturated.

    - `reads`, `rate`: names of the measurements, position and velocity by default."""

    proportional: NumberField = quantity("", doc="k_p, command over error")
    derivative: NumberField = quantity("", doc="k_d, command over rate")
    integral: OptionalNumberField = quantity(
        "", optional=True, doc="k_i, command over integral of the error"
    )
    target: Float[Array, "3 *#runs"] = quantity(
        "", default=(0.0, 0.0, 0.0), doc="r, set point, in the unit of the reading"
    )
    reads: str = eqx.field(static=True, default="position")
    rate: str = eqx.field(static=True, default="velocity")

    def start(self, measured: PyTree) -> Integral | None:
        return None if self.integral is None else integrating(measurement(measured, self.reads))

    def act(
        self, t: Scalar, memory: Integral | None, measured: PyTree
    ) -> tuple[Array, Integral | None]:
        x, v = measurement(measured, self.reads), measurement(measured, self.rate)
        error = with_rank(self.target, x.ndim - 1) - x
        command = self.proportional * error - self.derivative * v
        if memory is not None and self.integral is not None:
            memory = integrated(memory, t, error)
            command = command + self.integral * memory.total
        return command, memory

    def settle(self, memory: Integral | None, asked: Array, applied: Array) -> Integral | None:
        return None if memory is None else unwound(memory, asked != applied)


@final
class LeastEffortGuidance(AbstractController):
    """Brings a body to a position with a velocity at a given time, with the thrust that minimises
    the integral of its square in uniform gravity. The command is the thrust in inertial axes, N,
    (3, *runs).

    Reads position, velocity and mass. Valid where the thrust stays within its limit; the time to go
    is bounded below by `least_time`."""

    arrival: NumberField = quantity("s", doc="arrival time")
    gravity: Float[Array, "3 *#runs"] = quantity("m/s^2", doc="g, in inertial axes")
    target: Float[Array, "3 *#runs"] = quantity(
        "m", default=(0.0, 0.0, 0.0), doc="r, target position"
    )
    velocity: Float[Array, "3 *#runs"] = quantity(
        "m/s", default=(0.0, 0.0, 0.0), doc="v_f, velocity at the arrival"
    )
    least_time: NumberField = quantity(
        "s", positive=True, default=1.0, doc="time to go below which the gains are constant"
    )

    def act(self, t: Scalar, memory: None, measured: PyTree) -> tuple[Vector, None]:
        x, v = measurement(measured, "position"), measurement(measured, "velocity")
        rank = x.ndim - 1
        g, r, vf = (with_rank(a, rank) for a in (self.gravity, self.target, self.velocity))
        # The gains grow as 1/t_g^2: at the very end an error of a millimetre would command any
        # thrust.
        left = jnp.maximum(self.arrival - t, self.least_time)
        miss = r - x - left * v - 0.5 * left * left * g
        slip = vf - v - left * g
        acceleration = 6.0 / (left * left) * miss - 2.0 / left * slip
        return measurement(measured, "mass") * acceleration, memory


@final
class LinearController(AbstractController):
    """A linear controller with a memory, given by matrices.

    The measurement is one vector z: the concatenated readings, or all numbers of the state.

    Raises `InputError` for matrices with incompatible sizes."""

    d: Float[Array, "commands inputs"] = quantity("", doc="D, command over measurement")
    a: Float[Array, "states states"] | None = quantity(
        "", optional=True, doc="A, memory over memory; no memory by default"
    )
    b: Float[Array, "states inputs"] | None = quantity(
        "", optional=True, doc="B, memory over measurement"
    )
    c: Float[Array, "commands states"] | None = quantity(
        "", optional=True, doc="C, command over memory"
    )
    reference: Float[Array, " inputs"] | None = quantity(
        "", optional=True, doc="r, subtracted from the measurement; zero by default"
    )

    def __check_init__(self):
        check_types(self)
        absent = [x is None for x in (self.a, self.b, self.c)]
        if any(absent) and not all(absent):
            raise InputError("LinearController requires all of a, b and c, or none of them.")
        tables = [self.a, self.b, self.c, self.d]
        if any(getattr(x, "ndim", None) != 2 for x in tables if x is not None):
            return  # a placeholder of a tree transformation
        commands, inputs = self.d.shape
        if self.a is not None and self.b is not None and self.c is not None:
            n = self.a.shape[0]
            wanted = ((n, n), (n, inputs), (commands, n))
            given = (self.a.shape, self.b.shape, self.c.shape)
            if wanted != given:
                raise InputError(
                    f"LinearController has a, b, c of the shapes {given}: with d of the shape "
                    f"{self.d.shape} they must be {wanted}."
                )

    def start(self, measured: PyTree) -> Array | None:
        if self.a is None:
            return None
        z = _vector(measured)
        return jnp.zeros((self.a.shape[0], *z.shape[1:]), z.dtype)

    def act(self, t: Scalar, memory: Array | None, measured: PyTree) -> tuple[Array, Array | None]:
        del t
        z = _vector(measured)
        if self.reference is not None:
            z = z - with_rank(self.reference, z.ndim - 1)
        command = _times(self.d, z)
        if memory is None:
            return command, None
        assert self.a is not None and self.b is not None and self.c is not None
        return command + _times(self.c, memory), _times(self.a, memory) + _times(self.b, z)


def _vector(measured: PyTree) -> Array:
    """Concatenated readings, or the numbers of a state, (inputs, *runs)."""
    # In the order of the dictionary, which is that of the sensors, because trees sort their keys.
    parts: Sequence[Any] = (
        [measured[name] for name in measured] if isinstance(measured, Mapping) else [measured]
    )
    leaves = [leaf for part in parts for leaf in jax.tree.leaves(part)]
    rank = min(leaf.ndim for leaf in leaves)
    most = max(leaf.ndim for leaf in leaves)
    # A number such as a mass has no axis of components.
    return jnp.concatenate([x[None] if x.ndim == rank < most else x for x in leaves])


def _times(matrix: Array, vector: Array) -> Array:
    return jnp.einsum("ij,j...->i...", matrix, vector)


@final
class Together(AbstractController):
    """Several controllers of one system.

    - `controllers`: one for each actuator of the system, in their order. The command is the tuple
      of their commands."""

    controllers: tuple[AbstractController, ...] = eqx.field(converter=tuple)

    def start(self, measured: PyTree) -> PyTree:
        return tuple(c.start(measured) for c in self.controllers)

    def act(self, t: Scalar, memory: PyTree, measured: PyTree) -> tuple[PyTree, PyTree]:
        pairs = [c.act(t, m, measured) for c, m in zip(self.controllers, memory, strict=True)]
        return tuple(u for u, _ in pairs), tuple(m for _, m in pairs)

    def settle(self, memory: PyTree, asked: PyTree, applied: PyTree) -> PyTree:
        every = zip(self.controllers, memory, asked, applied, strict=True)
        return tuple(c.settle(*rest) for c, *rest in every)
