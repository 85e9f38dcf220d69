"""The vector field and the invariants of every system of the registry, and of those beside it."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from more_systems import MORE
from systems import SAMPLES

from jaxspace import Scene
from jaxspace.mechanics import AbstractLagrangian

from .form import Form
from .public import PACKAGES


def rates(built, t, x):
    """The vector field at the time t, and the invariants: each block by its own size."""
    system, state = built(x)
    time = jnp.asarray(t, x.dtype)
    found = system.vector_field(time, state), system.invariants(time, state)
    return tuple(jnp.ravel(leaf) for leaf in jax.tree.leaves(found))


def aligned(block):
    """Of each block of a state its greatest component alone: spins, circles, axes along axes."""
    x = np.asarray(block)
    return jnp.asarray(np.where(np.abs(x) == np.max(np.abs(x)), x, 0.0))


def is_moved(leaf) -> bool:
    """Whether a number of a system is moved: not the places of a table, which have to ascend."""
    if not eqx.is_inexact_array(leaf):
        return False
    return leaf.ndim == 0 or leaf.size < 4 or not bool(jnp.all(jnp.diff(leaf, axis=0) > 0.0))


def form(sample) -> Form:
    """Of all numbers of a system and its state."""

    def flat(state):
        moved = jax.tree.map(is_moved, sample.system), eqx.is_inexact_array
        numbers, rest = eqx.partition((sample.system, state), moved)
        return *ravel_pytree(numbers), rest

    numbers, unravel, rest = flat(sample.state)
    special, _, _ = flat(jax.tree.map(aligned, sample.state))
    function = partial(rates, lambda x: eqx.combine(unravel(x), rest), 0.3 * sample.span)
    starts = [tuple(map(float, np.asarray(x))) for x in (numbers, special)]
    return Form(function, _computes(sample.system), starts, label=sample.name)


def _computes(system) -> tuple[str, ...]:
    """The public methods behind a system: its own, or those of its effects."""
    parts = system.effects if isinstance(system, Scene) else (system,)
    methods = ("vector_field", "invariants", "lagrangian", "load", "potential", "constrained")
    names = []
    for part in parts:
        kind = type(part)
        package = kind.__module__.split(".")[1]
        if package not in PACKAGES:
            continue
        if isinstance(part, AbstractLagrangian):
            names += [f"mechanics.AbstractLagrangian.{method}" for method in methods[:2]]
        # What a class takes from another one is named there.
        own = [method for method in methods if method in vars(kind)]
        if "energy" not in getattr(part, "keeps", {"energy"}):
            # The potential of a force that does work is `None`.
            own = [method for method in own if method != "potential"]
        if "load" in own and "constrained" in own:
            # A guide loads nothing: it takes from the rate.
            own = ["constrained"]
        names += [f"{package}.{kind.__name__}.{method}" for method in own]
    return tuple(names)


def forms() -> tuple[Form, ...]:
    """Of all."""
    return tuple(form(sample) for sample in (*SAMPLES, *MORE))
