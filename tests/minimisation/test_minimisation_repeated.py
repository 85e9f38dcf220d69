"""Repeated searches share their programs, also with a new optimiser of the same settings."""

import functools

import jax
import jax.numpy as jnp
import optax
import pytest

from jaxspace.minimisation import Criterion, minimise
from jaxspace.minimisation._same_function import content, same_values
from jaxspace.minimisation.optimiser import kept_optimiser

PROGRAMS = []


def listen(event: str, duration_secs: float, **kwargs: str | int) -> None:
    del duration_secs, kwargs
    if event == "/jax/core/compile/backend_compile_duration":
        PROGRAMS.append(event)


jax.monitoring.register_event_duration_secs_listener(listen)

MAKERS = {
    "lbfgs": optax.lbfgs,
    "adam": lambda: optax.adam(0.05),
    "chain": lambda: optax.chain(
        optax.clip_by_global_norm(1.0), optax.adam(optax.cosine_decay_schedule(0.05, 100))
    ),
}


def valley(x):
    return Criterion(jnp.sum((x - 1.0) ** 2) + jnp.sum(x**4), x[0] - x[1])


@pytest.mark.parametrize(("name", "bounds"), [("lbfgs", False), ("adam", True), ("chain", False)])
def test_a_fresh_optimiser_compiles_nothing_the_second_time(name, bounds):
    def search(k):
        found = minimise(
            valley,
            jnp.array([0.1, 0.2, 0.3]) + 0.01 * k,
            optimiser=MAKERS[name](),
            bounds=(-1.0 - k, 2.0 + k) if bounds else None,
            max_steps=20,
        )
        return found.x

    search(0)
    before = len(PROGRAMS)
    for k in (1, 2):
        search(k)
    assert len(PROGRAMS) == before


def test_optimisers_of_other_settings_are_others():
    assert kept_optimiser(optax.adam(0.1)) is kept_optimiser(optax.adam(0.1))
    others = [
        optax.adam(0.1),
        optax.adam(0.2),
        optax.adam(0.1, b1=0.8),
        optax.adam(optax.cosine_decay_schedule(0.1, 10)),
        optax.adam(optax.cosine_decay_schedule(0.1, 20)),
        optax.sgd(0.1),
        optax.lbfgs(),
        optax.lbfgs(memory_size=5),
    ]
    kept = [kept_optimiser(x) for x in others]
    assert len({id(x) for x in kept}) == len(others)
    # Both are used with their own settings.
    for rate in (0.1, 0.2):
        found = minimise(
            lambda x: Criterion(x * x), jnp.asarray(1.0), optimiser=optax.sgd(rate), max_steps=1
        )
        # One step of the scaled slope, which is 1 at the start.
        assert float(found.x) == pytest.approx(1.0 - rate, rel=1e-6)


def test_functions_of_the_same_content():
    def adder(a):
        def add(x, b=2.0):
            return x + a + b if x else add(x + 1.0)

        return add

    assert content(adder(1.0)) == content(adder(1.0))
    assert hash(content(adder(1.0))) == hash(content(adder(1.0)))
    for other in (1, True, -1.0, "1.0", None, (1.0,)):
        assert content(adder(1.0)) != content(adder(other))
    assert content(adder(0.0)) != content(adder(-0.0))
    assert content(adder(float("nan"))) == content(adder(float("nan")))
    assert content(functools.partial(max, 1)) == content(functools.partial(max, 1))
    assert content(functools.partial(max, 1)) != content(functools.partial(min, 1))
    # Arrays are compared by identity, lists and dictionaries by what they contain at the time.
    x = jnp.ones(2)
    assert content(adder(x)) == content(adder(x)) != content(adder(jnp.ones(2)))
    for make in (lambda: [1.0], lambda: {"a": 1.0}):
        held = make()
        before = content(adder(held))
        assert before == content(adder(make()))
        held.clear()
        assert before != content(adder(held))
    # As after the first call of a schedule of optax.
    assert same_values(content(adder(100)), content(adder(100.0)))
    assert not same_values(content(adder(100)), content(adder(101.0)))
