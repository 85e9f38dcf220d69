"""Searches that keep their state: resumed after a kill they end as if there had been none."""

import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from test_robust_design import algebraic, linear_quadratic

from jaxspace.core import InputError
from jaxspace.dispersion import Normal
from jaxspace.minimisation import Criterion, StopReason, minimise
from jaxspace.robust import optimise_design, train_design
from jaxspace.robust.statistics import MeanPlus


class Kill(Exception):
    """What ends a search without warning."""


def valley(x):
    """Rosenbrock's, within a disk that holds its minimum off."""
    cost = 100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2
    return Criterion(cost, non_negative=1.5 - jnp.sum(x**2))


def killed_at(number):
    def progress(step, objective, violation, gradient):
        if step == number:
            raise Kill

    return progress


def campaign():
    return algebraic(linear_quadratic, {"w": Normal(0.0, 1.0)})


SEARCHES = {
    "sqp": lambda **given: minimise(valley, jnp.array([-1.2, 1.0]), **given),
    "lbfgs": lambda **given: minimise(
        valley, jnp.array([-1.2, 1.0]), optimiser=optax.lbfgs(), tolerance=1e-5, **given
    ),
    "design": lambda **given: optimise_design(
        campaign(), jnp.asarray(0.5), minimise=MeanPlus("y", 1.0), **given
    ),
    "batches": lambda **given: train_design(
        *(campaign(), jnp.asarray(0.5)),
        minimise=MeanPlus("y", 1.0),
        optimiser=optax.adam(0.02),
        batch=64,
        max_steps=12,
        **given,
    ),
}


def bits(result):
    return [np.asarray(x).tobytes() for x in jax.tree.leaves(result) if eqx.is_array(x)]


@pytest.mark.parametrize("name", SEARCHES)
def test_a_killed_search_ends_as_if_it_had_not_been(name, tmp_path):
    search, store = SEARCHES[name], tmp_path / "search.npz"
    whole = search()
    # Twice, and each time anywhere after the last write.
    for number in (2, 3):
        with pytest.raises(Kill):
            search(store=store, resume=store.exists(), progress=killed_at(number))
        assert os.listdir(tmp_path) == ["search.npz"]
    again = search(store=store, resume=True)
    assert bits(again) == bits(whole)
    # A search that has ended is read.
    steps = []
    ended = search(store=store, resume=True, progress=lambda *row: steps.append(row))
    assert bits(ended) == bits(whole) and not steps


def test_ctrl_c_keeps_the_last_step(tmp_path):
    def interrupt(step, objective, violation, gradient):
        if step == 5:
            raise KeyboardInterrupt

    store = tmp_path / "search.npz"
    stopped = SEARCHES["sqp"](store=store, progress=interrupt)
    assert int(stopped.reason) == StopReason.INTERRUPTED and int(stopped.steps) == 5
    first = []
    SEARCHES["sqp"](store=store, resume=True, progress=lambda *row: first.append(row[0]))
    assert first[0] == 6


def test_a_store_of_another_search_is_refused(tmp_path):
    store = tmp_path / "search.npz"
    SEARCHES["sqp"](store=store)
    with pytest.raises(InputError, match="which exists: resume the search in it, or delete it"):
        SEARCHES["sqp"](store=store)
    for other in (
        lambda: minimise(valley, jnp.array([-1.0, 1.0]), store=store, resume=True),
        lambda: minimise(valley, jnp.array([-1.2, 1.0]), tolerance=1e-3, store=store, resume=True),
        lambda: SEARCHES["lbfgs"](store=store, resume=True),
        lambda: SEARCHES["design"](store=store, resume=True),
    ):
        with pytest.raises(InputError, match="which belongs to another search"):
            other()
    store.write_bytes(store.read_bytes()[:100])
    with pytest.raises(InputError, match="which cannot be read"):
        SEARCHES["sqp"](store=store, resume=True)
    with pytest.raises(InputError, match="resume is true without a store"):
        SEARCHES["sqp"](resume=True)
    with pytest.raises(InputError, match="store is given under jit"):
        jax.jit(lambda x: minimise(valley, x, store=tmp_path / "a.npz").x)(jnp.zeros(2))


def test_the_search_of_the_nominal_run_has_its_own_store(tmp_path):
    def search(nominal, **given):
        return optimise_design(
            *(campaign(), jnp.asarray(0.5)),
            minimise=MeanPlus("y", 1.0),
            nominal=nominal,
            store=tmp_path / "search.npz",
            **given,
        )

    steps = []
    whole = search(True)
    again = search(True, resume=True, progress=lambda *row: steps.append(row))
    assert bits(again) == bits(whole) and not steps
    with pytest.raises(InputError, match="which belongs to another search"):
        search(False, resume=True)
