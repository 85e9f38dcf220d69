"""Whether a vector field follows the layout of the library, so that mapped runs can be a batch."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import AbstractSystem
from ..core.layout import component_axes_of
from ..core.structure import once_per_structure


@once_per_structure
def follows_layout(system: AbstractSystem, y0: PyTree) -> bool:
    """Whether the vector field treats a trailing axis as independent runs.

    Decided by values: the field of three random states together must equal that of each of them. A
    system that sums over all axes of its state, for example, fails and is mapped by JAX instead."""
    # Positive numbers of order one, for which the roots and logarithms of a field are defined.
    random = np.random.default_rng(0)

    def numbers(shape: tuple[int, ...], x: jax.ShapeDtypeStruct) -> Array:
        return jnp.asarray(random.uniform(0.6, 1.4, shape), x.dtype)

    def is_shape(x: object) -> bool:
        return isinstance(x, jax.ShapeDtypeStruct)

    runs = 3
    with jax.ensure_compile_time_eval():
        single = jax.tree.map(lambda x: numbers(x.shape, x) if is_shape(x) else x, system)
        states = jax.tree.map(lambda x: numbers((*x.shape, runs), x), y0)

        def shared(x: PyTree, axes: int) -> PyTree:
            return x[..., None] if axes >= 0 and eqx.is_array(x) and x.ndim > 0 else x

        batched = jax.tree.map(shared, single, component_axes_of(single))
        t = jnp.asarray(0.3, jax.tree.leaves(states)[0].dtype)
        try:
            together = batched.vector_field(t, states)
            each = [
                single.vector_field(t, jax.tree.map(lambda x, k=k: x[..., k], states))
                for k in range(runs)
            ]
        except Exception:  # noqa: BLE001 - whatever a user's field raises, it is not a batch
            return False
        alone = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *each)
        pairs = zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True)
        return all(
            a.shape == b.shape and np.allclose(a, b, rtol=1e-4, atol=1e-6, equal_nan=True)
            for a, b in pairs
        )
