"""The optimiser of `minimise`: sequential quadratic programming, or an optimiser of optax.

optax is imported where one of its optimisers is used, and not with the package.
"""

from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jax.tree_util import GetAttrKey, tree_leaves_with_path
from jaxtyping import Array, Bool, Float, PyTree

from ..core import InputError, Scalar
from ..core.jit import KEPT
from ._same_function import content, same_values

if TYPE_CHECKING:
    import optax

    Optimiser: TypeAlias = optax.GradientTransformation | str
else:
    # Without the import; `check_optimiser` defines the allowed values.
    Optimiser: TypeAlias = object

SQP = "sqp"
# Fields of an optimiser's state that depend on the function itself: differences of its gradients,
# and the value at the end of a line search.
OF_THE_FUNCTION = {"diff_params_memory", "value"}


class Stepper(NamedTuple):
    """An optimiser of optax, as a search uses it.

    - `optimiser`: that of `kept_optimiser`; `unravel`: converts a flat array to a pytree like the
      unknowns, which is passed to optax, so that it can treat its parts differently.
    - `restarts`: whether its state contains values or curvature of one function, which are invalid
      for the next Lagrangian; moments and step counts continue.
    - `plateau`: whether it compares with a least value, which also belongs to one Lagrangian.
    - `averages`: whether its optimum is at other parameters than those of the gradients."""

    optimiser: Any
    unravel: Any
    restarts: bool
    plateau: bool
    averages: bool

    def begin(self, q: Float[Array, " n"]) -> PyTree:
        """The state of the optimiser at `q`."""
        # optax mixes integer widths, which a caller's strict promotion would reject.
        with jax.numpy_dtype_promotion("standard"):
            return jax.tree.map(_strong, self.optimiser.init(self.unravel(q)))

    def restarted(self, state: PyTree, q: Float[Array, " n"], restart: Bool[Array, ""]) -> PyTree:
        """The state for another function, where `restart`."""
        if self.restarts:
            return jax.tree.map(lambda a, b: jnp.where(restart, a, b), self.begin(q), state)
        if not self.plateau:
            return state

        def forgotten(path: jax.tree_util.KeyPath, x: Array) -> Array:
            named = path and getattr(path[-1], "name", "") == "best_value"
            return jnp.where(restart, jnp.inf, x).astype(x.dtype) if named else x

        return jax.tree_util.tree_map_with_path(forgotten, state)

    def step(
        self,
        q: Float[Array, " n"],
        g: Float[Array, " n"],
        value: Array,
        function: Callable[[Array], Scalar],
        state: PyTree,
    ) -> tuple[Float[Array, " n"], PyTree]:
        """The update of `q` and the next state; `function` is one of flat numbers."""
        import optax

        # Here and not before, because it makes another function at each call.
        optimiser = optax.with_extra_args_support(self.optimiser)
        grad, params = self.unravel(g), self.unravel(q)
        with jax.numpy_dtype_promotion("standard"):
            updates, after = optimiser.update(
                grad,
                state,
                params,
                value=value,
                grad=grad,
                value_fn=lambda tree: function(ravel_pytree(tree)[0]),
            )
        # A loop needs the types of the start.
        after = jax.tree.map(lambda a, b: jnp.asarray(a).astype(b.dtype), after, state)
        return ravel_pytree(updates)[0].astype(q.dtype), after

    def averaged(self, state: PyTree, q: Float[Array, " n"]) -> Float[Array, " n"]:
        """The parameters at which a schedule-free optimiser is to be evaluated."""
        import optax

        with jax.numpy_dtype_promotion("standard"):
            params = optax.contrib.schedule_free_eval_params(_averages(state)[0], self.unravel(q))
        return ravel_pytree(params)[0].astype(q.dtype)


def as_stepper(
    optimiser: Any, q: Float[Array, " n"], unravel: Callable[[Array], PyTree]
) -> Stepper:
    """The `optimiser` of `minimise` for numbers like `q`."""
    made = Stepper(kept_optimiser(optimiser), unravel, False, False, False)
    state = jax.eval_shape(made.begin, q)
    held = {
        key.name
        for path, _ in tree_leaves_with_path(state)
        for key in path
        if isinstance(key, GetAttrKey)
    }
    return made._replace(
        restarts=bool(held & OF_THE_FUNCTION),
        plateau="best_value" in held,
        averages=bool(_averages(state)),
    )


# By their content, the last used at the end.
_OPTIMISERS: dict[Hashable, Any] = {}


def kept_optimiser(optimiser: Any) -> Any:
    """The first optimiser of optax with the same settings as this one (`_same_function.py`).

    Each call of `optax.adam` makes new functions, for which JAX would compile new programs."""
    key = content(optimiser)
    found = _OPTIMISERS.pop(key, optimiser)
    # A dictionary in it, such as that of `optax.multi_transform`, may have changed.
    if not same_values(content(found), key):
        found = optimiser
    _OPTIMISERS[key] = found
    if len(_OPTIMISERS) > KEPT:
        del _OPTIMISERS[next(iter(_OPTIMISERS))]
    return found


def check_optimiser(optimiser: object, exact_hessian: bool) -> None:
    """Raise `InputError` for an invalid optimiser, or one that does not use second derivatives."""
    if isinstance(optimiser, str):
        if optimiser != SQP:
            raise InputError(
                f"optimiser is {optimiser!r}: it must be {SQP!r} or an optimiser of optax, such as "
                f"optax.adam(1e-2)."
            )
    elif not (callable(getattr(optimiser, "init", None)) and hasattr(optimiser, "update")):
        raise InputError(
            f"optimiser is a {type(optimiser).__name__}: it must be {SQP!r} or an optimiser of "
            f"optax, such as optax.adam(1e-2)."
        )
    elif exact_hessian:
        raise InputError("exact_hessian is given with an optax optimiser, which does not use one.")


def _averages(state: PyTree) -> list[PyTree]:
    """The states of schedule-free optimisers within that of another one."""
    import optax

    kind = optax.contrib.ScheduleFreeState
    leaves = jax.tree.leaves(state, is_leaf=lambda x: isinstance(x, kind))
    return [x for x in leaves if isinstance(x, kind)]


def _strong(x: PyTree) -> Array:
    """An array whose type does not follow its neighbours', as a loop needs it."""
    x = jnp.asarray(x)
    return x.astype(x.dtype)
