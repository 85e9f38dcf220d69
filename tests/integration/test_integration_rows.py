"""Rows that the runs of a batch write and read each at a place of its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.integration import _rows

ROWS, RUNS = 4, 9
G = np.random.default_rng(0)
INDEX, DUE = G.integers(0, ROWS, RUNS), G.random(RUNS) < 0.6
# A run beyond its last row has nothing to write.
INDEX[0], DUE[0] = ROWS, False
OLD = {"x": G.normal(size=(ROWS, 3, RUNS)), "z": G.normal(size=(ROWS, RUNS))}
NEW = {"x": G.normal(size=(3, RUNS)), "z": G.normal(size=(RUNS,))}
PLACES = [i for i in range(RUNS) if DUE[i]]


def expected() -> dict[str, np.ndarray]:
    """The rows, one run at a time."""
    rows = jax.tree.map(np.copy, OLD)
    for i in PLACES:
        rows["x"][INDEX[i], :, i], rows["z"][INDEX[i], i] = NEW["x"][:, i], NEW["z"][i]
    return rows


@pytest.mark.parametrize(("shape", "whole"), [((RUNS,), jnp.int32), ((3, 3), jnp.int64)])
def test_each_run_writes_and_reads_its_own_row(shape, whole):
    """Of runs on one axis and on two, and nothing of a run that is not due."""
    old, new = jax.tree.map(lambda x: jnp.asarray(x).reshape(*x.shape[:-1], *shape), (OLD, NEW))
    index, due = jnp.asarray(INDEX, whole).reshape(shape), jnp.asarray(DUE).reshape(shape)
    rows = jax.jit(_rows.put_rows)(old, index, due, new)
    for name, row in expected().items():
        np.testing.assert_array_equal(rows[name].reshape(row.shape), row)
    read = _rows.get_rows(rows, index, due)
    for name, values in NEW.items():
        np.testing.assert_array_equal(read[name].reshape(values.shape), np.where(DUE, values, 0.0))


def test_other_devices_write_the_same():
    """By a scatter, of rows as the loop of a CPU has them."""
    flat, new = (
        jax.tree.map(lambda x: jnp.asarray(x).reshape(*x.shape[:1], -1, RUNS), OLD),
        jax.tree.map(lambda x: jnp.asarray(x).reshape(-1, RUNS), NEW),
    )
    rows = jax.jit(_rows._put_at_once)(flat, jnp.asarray(INDEX), jnp.asarray(DUE), new)
    for name, row in expected().items():
        np.testing.assert_array_equal(rows[name].reshape(row.shape), row)
