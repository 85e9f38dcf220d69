"""Small motions about a state: modes, stability, transfer functions, root loci.

    x' = A x + B u,   o = C x            x: small change of the state
    A v = lambda v                       frequency |lambda|, damping ratio -Re(lambda) / |lambda|
    G(s) = C (s I - A)^-1 B              transfer functions
    A - k B C                            the loop u = -k o closed

Source: Thomson 6.5, 6.8, 9.10 (characteristic equations); Kailath (1980), Linear Systems, 2.
Valid for motions so small that the vector field is linear. If the state is not an equilibrium the
matrices are those at the time `t`, and `residual` is the remaining rate.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Complex, Float

from ..core import AbstractSystem, Scalar, State
from ..core.printing import printed
from ..core.structure import HashedModule
from ..core.tracing import is_traced
from ._eigenvalues import eigenvalues, ordered
from ._linearise import Blocks, Input, Output, forced, jacobian, measured

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@final
@printed(eigenvalues="1/s")
class Modes(HashedModule):
    """A system linearised about a state, with its modes in the order of their frequencies.

    - `matrix`: A, (n, n, *runs).
    - `input_matrix`: B, (n, m, *runs).
    - `output_matrix`: C, (p, n, *runs).
    - `residual`: the rate of the state itself, (n, *runs), zero at an equilibrium.
    - `eigenvalues`: lambda, 1/s, (n, *runs); of a pair the one with positive frequency first.
    - `states`, `inputs`, `outputs`: names of the rows and columns.

    Derivatives of the eigenvalues are those of each root. Where roots are equal with distinct
    shapes it is their mean slope; where the shapes coincide as well, as for a free translation, the
    slope is not finite."""

    matrix: Float[Array, "n n *#runs"]
    input_matrix: Float[Array, "n m *#runs"]
    output_matrix: Float[Array, "p n *#runs"]
    residual: Float[Array, "n *#runs"]
    eigenvalues: Complex[Array, "n *#runs"]
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    @property
    def frequencies(self) -> Float[Array, "n *#runs"]:
        """|lambda|, rad/s: the angular frequency of an undamped mode."""
        size = self.eigenvalues.real**2 + self.eigenvalues.imag**2
        zero = size == 0.0
        return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, size)))

    @property
    def damping_ratios(self) -> Float[Array, "n *#runs"]:
        """-Re(lambda) / |lambda|: 1 for decay, -1 for growth, 0 for an undamped oscillation and at
        zero."""
        size = self.frequencies
        zero = size == 0.0
        return jnp.where(zero, 0.0, -self.eigenvalues.real / jnp.where(zero, 1.0, size))

    @property
    def growth(self) -> Float[Array, "*#runs"]:
        """The greatest real part, 1/s: negative for a state that is stable to small
        perturbations."""
        return jnp.max(self.eigenvalues.real, axis=0)

    @property
    def stable(self) -> Bool[Array, "*#runs"]:
        """Whether every small change decays: an undamped oscillation is not stable."""
        # Roundings of the matrix move a root from the imaginary axis.
        rounding = 1e2 * jnp.finfo(self.matrix.dtype).eps
        return self.growth < -rounding * jnp.max(jnp.abs(self.eigenvalues), axis=0)

    @property
    def shapes(self) -> Complex[Array, "n n *#runs"]:
        """The shape of each mode, a column of length one; without derivatives."""
        return _runs_last(ordered(_runs_first(self.matrix))[1])

    def transfer(self, s: Complex[ArrayLike, "..."] | complex) -> Complex[Array, "p m ..."]:
        """The transfer functions G(s) at complex frequencies, 1/s, of any shape: (p, m, ...), then
        the runs."""
        kind = self.eigenvalues.dtype
        runs = self.eigenvalues.ndim - 1
        a, b, c = (
            _runs_first(x.astype(kind))
            for x in (self.matrix, self.input_matrix, self.output_matrix)
        )
        s = jnp.asarray(s).astype(kind)
        s = s.reshape(*s.shape, *(1,) * (runs + 2))
        pencil = s * jnp.eye(a.shape[-1], dtype=kind) - a
        answer = c @ jnp.linalg.solve(
            pencil, jnp.broadcast_to(b, (*pencil.shape[:-1], b.shape[-1]))
        )
        return _runs_last(answer)

    def bode(self, frequency: Float[ArrayLike, "..."]) -> tuple[Array, Array]:
        """Magnitude, dB, and phase, rad, of G(i w) at angular frequencies w, rad/s, each
        (p, m, ...), then the runs; the phase is unwrapped along the last axis of w."""
        w = jnp.asarray(frequency, self.matrix.dtype)
        g = self.transfer(jax.lax.complex(0.0 * w, w))
        phase = jnp.angle(g)
        magnitude = 20.0 * jnp.log10(jnp.abs(g))
        return magnitude, jnp.unwrap(phase, axis=1 + w.ndim) if w.ndim else phase

    def plot_bode(self, frequency: Float[ArrayLike, " frequencies"], title: str = "") -> "Figure":
        """Bode plot of all transfer functions and runs, a matplotlib figure.

        **Arguments**

        - `frequency`: w, rad/s.

        **Raises** `ImportError` where matplotlib is not installed."""
        from ..plots import bode_figure

        result = (np.asarray(x).reshape(*x.shape[:3], -1) for x in self.bode(frequency))
        magnitude, phase = (np.moveaxis(x, 2, -1) for x in result)
        p, m, count, w = magnitude.shape
        labels = [
            f"{o} / {i}" + (f", run {k}" if count > 1 else "")
            for o in self.outputs[:p]
            for i in self.inputs[:m]
            for k in range(count)
        ]
        # An output of several components has no name for each.
        labels = labels if len(labels) == p * m * count else []
        return bode_figure(
            frequency, magnitude.reshape(-1, w), phase.reshape(-1, w), tuple(labels), title=title
        )

    def plot_root_locus(
        self,
        gains: Float[ArrayLike, " gains"],
        output: int = 0,
        input: int = 0,
        title: str = "",
    ) -> "Figure":
        """The root locus of one run, a matplotlib figure; arguments as in `root_locus`.

        **Raises** `ImportError` where matplotlib is not installed."""
        from ..plots import root_locus_figure

        return root_locus_figure(gains, self.root_locus(gains, output, input), title=title)

    def zeros(self, output: int = 0, input: int = 0) -> np.ndarray:
        """The zeros of one transfer function of one run, 1/s; it cannot be traced."""
        from scipy.linalg import matrix_balance

        n = self.matrix.shape[0]
        b, c = self.input_matrix[:, input : input + 1], self.output_matrix[output : output + 1]
        pencil = np.block([[np.asarray(self.matrix), np.asarray(b)], [np.asarray(c), np.zeros(1)]])
        # Stiff parts have entries of their frequency squared: in balanced units they have that of
        # the frequency, and low zeros retain their digits next to them.
        pencil = matrix_balance(pencil, permute=False)[0]
        weight = np.diag([1.0] * n + [0.0])
        # Of (P - s W) x = 0 about a place where P - s W is regular: 1/(s - place) are eigenvalues.
        scale = max(float(np.max(np.abs(pencil[:n, :n]))), 1e-300)
        # In no simple ratio to the matrix, so that the place is unlikely to be a zero.
        place = 0.377 * scale
        inverse = np.linalg.eigvals(np.linalg.solve(pencil - place * weight, weight))
        # The others are at infinity.
        finite = np.abs(inverse) * scale > np.finfo(pencil.dtype).eps ** 0.3
        return np.sort_complex(place + 1.0 / inverse[finite])

    def root_locus(
        self, gains: Float[ArrayLike, " gains"], output: int = 0, input: int = 0
    ) -> Complex[Array, "n gains *#runs"]:
        """The closed-loop eigenvalues with u = -k o, for each gain k."""
        a, b, c = (
            _runs_first(x)
            for x in (
                self.matrix,
                self.input_matrix[:, input : input + 1],
                self.output_matrix[output : output + 1],
            )
        )
        gains = jnp.asarray(gains, a.dtype)
        gains = gains.reshape(*gains.shape, *(1,) * a.ndim)
        return _runs_last(eigenvalues(a - gains * (b @ c)), axes=1)

    def __str__(self) -> str:
        if is_traced(self.eigenvalues):
            return repr(self)
        if self.eigenvalues.ndim > 1:
            return f"modes of {self.eigenvalues.shape[1:]} runs"
        lines = [f"{'eigenvalue (1/s)':>28}  {'frequency (rad/s)':>18}  {'damping ratio':>13}"]
        for value, w, zeta in zip(
            np.asarray(self.eigenvalues), self.frequencies, self.damping_ratios, strict=True
        ):
            root = f"{value.real:+.6e} {value.imag:+.6e}i"
            lines.append(f"{root:>28}  {float(w):18.6e}  {float(zeta):13.4f}")
        return "\n".join(lines)


def modes(
    system: AbstractSystem,
    y: State,
    *,
    inputs: Sequence[Input] = (),
    outputs: Sequence[Output] = (),
    t: Scalar = 0.0,
) -> Modes:
    """The small motions of a system about a state.

    **Arguments**

    - `system`: any system; parameters with a batch axis give a batch.
    - `y`: the state, usually an equilibrium: see `equilibrium`.
    - `inputs`: names of driven parameters of the system, or functions
      (system, u) -> system of one number.
    - `outputs`: names of parts of the state, or functions of the state.
    - `t`: the time, s.

    **Returns** the `Modes`, differentiable in everything; see there for coinciding eigenvalues.

    **Raises** `InputError` for a name that is neither a parameter nor a part of the state."""
    blocks = Blocks.of(system, y, t)
    zero = jnp.zeros((blocks.count, *blocks.runs), blocks.dtype)
    driven, input_names = forced(system, tuple(inputs), blocks.runs)
    drive = jnp.zeros((len(input_names), *blocks.runs), blocks.dtype)

    def field(x: Array, u: Array) -> Array:
        moved = blocks.moved(x)
        return blocks.rate(x, moved, driven(u).vector_field(t, moved))

    a = jacobian(lambda x: field(x, drive), zero)
    b = jacobian(lambda u: field(zero, u), drive) if input_names else a[:, :0]
    c = a[:0]
    output_names = ()
    if outputs:
        c = jacobian(lambda x: measured(tuple(outputs), blocks.moved(x), blocks.runs), zero)
        output_names = tuple(
            given if isinstance(given, str) else getattr(given, "__name__", "output")
            for given in outputs
        )
    roots = _runs_last(eigenvalues(_runs_first(a)), axes=1)
    residual = field(zero, drive)
    return Modes(a, b, c, residual, roots, blocks.labels, input_names, output_names)


def equilibrium(system: AbstractSystem, y: State, t: Scalar = 0.0, steps: int = 20) -> State:
    """The equilibrium near a state, with Newton's method and minimum-norm steps.

    **Arguments**

    - `system`, `t`: whose vector field vanishes at the equilibrium.
    - `y`: start of the search; coordinates without influence are unchanged.
    - `steps`: of Newton's method; the number of correct digits doubles in each.

    **Returns** the state; its derivatives with respect to the parameters are those of the
    equilibrium. For a batch use `jax.vmap`."""

    return _equilibrium(system, y, t, steps)


# Compiled once for every system of one structure: called as it is, the loop is compiled each time.
@eqx.filter_jit
def _equilibrium(system: AbstractSystem, y: State, t: Scalar, steps: int) -> State:
    def newton(system: AbstractSystem, y: State, repeated: int = 1) -> State:
        blocks = Blocks.of(system, y, t)
        zero = jnp.zeros(blocks.count, blocks.dtype)

        def field(x: Array) -> Array:
            moved = blocks.moved(x)
            return blocks.rate(x, moved, system.vector_field(t, moved))

        a = jacobian(field, zero)
        # Without derivatives of the matrix, which are multiplied by zero at the root.
        inverse = jnp.linalg.pinv(jax.lax.stop_gradient(a))
        x = zero
        for _ in range(repeated):
            x = x - inverse @ field(x)
        return blocks.moved(x)

    arrays, static = eqx.partition(system, eqx.is_array)
    fixed = eqx.combine(jax.lax.stop_gradient(arrays), static)
    result = jax.lax.fori_loop(0, steps, lambda _, y: newton(fixed, y), jax.lax.stop_gradient(y))
    # Two more steps, the only ones that are differentiated: about the root the first one gives the
    # derivatives of the implicit function theorem, and the second one those of second order.
    return newton(system, jax.lax.stop_gradient(result), 2)


def _runs_first(x: Array) -> Array:
    return jnp.moveaxis(x, (0, 1), (-2, -1))


def _runs_last(x: ArrayLike, axes: int = 2) -> Array:
    return jnp.moveaxis(x, (-2, -1), (0, 1)) if axes == 2 else jnp.moveaxis(x, -1, 0)
