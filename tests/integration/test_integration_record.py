"""The record of a run: what was put in is found again, however often states were dropped, and a run
is refused whose record has no room."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import BodyState
from jaxspace.core import InputError
from jaxspace.integration import _record
from jaxspace.integration._record import Record, Recording, RecordLayout
from jaxspace.orbits import TwoBody
from jaxspace.simulation import Accuracy, simulate
from jaxspace.solvers import DOP853

CLOCK = jnp.zeros(())
OWN = jnp.zeros((2, 3))


def state_after(n, like):
    """A state that tells the number of its step, exactly in single precision too."""
    return jax.tree.map(
        lambda x: (n + 1.0) * 64.0 + jnp.arange(x.size, dtype=x.dtype).reshape(x.shape), like
    )


def step_of(n, like):
    return -(n + 1.0) - 0.25 * jnp.arange(like.size, dtype=like.dtype).reshape(like.shape)


@pytest.mark.parametrize("step", [CLOCK, OWN], ids=["common steps", "own steps"])
@pytest.mark.parametrize("limit", [1, 2, 7, 64, 100, 257])
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_steps_and_states_are_found_again(monkeypatch, step, limit, dtype, fresh_programs):
    """With room for four states beside all steps: they are dropped as often as possible."""
    monkeypatch.setattr(_record, "RECORD_BYTES", 0)
    like = BodyState(jnp.zeros((3, 3), dtype), jnp.zeros((3, 3), dtype))
    layout = RecordLayout.of(like, step, limit)

    @jax.jit
    def added(recording, n, taken):
        return recording.add(n, step_of(n, step), state_after(n, like), taken)

    recording, n = Recording.empty(layout), 0
    rejected = np.random.default_rng(limit).random(4 * limit) < 0.3
    for reject in rejected:
        recording = added(recording, jnp.asarray(n), jnp.asarray(not reject))
        n += not reject
        if n == limit:
            break
    assert n == limit
    record = Record(layout, recording.numbers, recording.stride, jnp.asarray(n))
    stride, count = int(recording.stride), int(recording.count)
    assert stride <= layout.longest and count == limit // stride
    # Not fewer states than promised: the stride was not doubled too early.
    assert stride == 1 or count >= _record.FEWEST_STATES // 2
    for k in range(limit):
        np.testing.assert_array_equal(record.step(jnp.asarray(k)), step_of(k, step))
    for k in range(count):
        found, expected = record.state(jnp.asarray(k)), state_after((k + 1) * stride - 1, like)
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            assert a.dtype == dtype
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("shared", [False, True])
def test_a_short_record_holds_more_steps_where_the_runs_share_them(
    monkeypatch, shared, fresh_programs
):
    """Five of each run, or all of them with one number each, that of the run ahead."""
    monkeypatch.setattr(_record, "RECORD_BYTES", 0)
    monkeypatch.setattr(_record, "RECORDED_STEPS", 15)
    monkeypatch.setattr(_record, "FEWEST_ROWS", 1)
    like = BodyState(jnp.zeros((3, 3)), jnp.zeros((3, 3)))
    layout = RecordLayout.of(like, jnp.zeros(3), 100, short=True)
    assert layout.rows == 5
    recording, steps = Recording.empty(layout, jnp.asarray(shared)), 100 if shared else layout.rows
    add = jax.jit(lambda r, n, step, y: r.add(n, step, y, jnp.array(True)))
    for n in range(steps):
        recording = add(recording, n, step_of(n, jnp.zeros(3)), state_after(n, like))
    record = Record(
        layout, recording.numbers, recording.stride, jnp.asarray(steps), shared=recording.shared
    )
    for n in range(steps):
        expected = step_of(n, jnp.zeros(3))
        expected = np.full(3, np.max(expected)) if shared else expected
        np.testing.assert_array_equal(record.step(jnp.asarray(n)), expected)
    stride = int(recording.stride)
    for k in range(int(recording.count)):
        found, expected = record.state(jnp.asarray(k)), state_after((k + 1) * stride - 1, like)
        np.testing.assert_array_equal(found.position, expected.position)


def test_a_short_run_keeps_every_state():
    like = BodyState(jnp.zeros((3, 64)), jnp.zeros((3, 64)))
    layout = RecordLayout.of(like, CLOCK, 16384)
    # All steps and the states of some sixty of them share less than 200 kB.
    assert layout.dtype.itemsize * layout.size <= _record.RECORD_BYTES
    recording = Recording.empty(layout)
    add = jax.jit(lambda r, n: r.add(n, n * 1.0, state_after(n, like), jnp.array(True)))
    for n in range(60):
        recording = add(recording, jnp.asarray(n))
    assert int(recording.stride) == 1 and int(recording.count) == 60


def end(mu, max_steps, dense=False):
    """Where a short flight ends."""
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
    accuracy = Accuracy(method=DOP853(), max_steps=max_steps)
    return simulate(TwoBody(mu), y0, jnp.array([0.0, 1.0]), accuracy=accuracy, dense=dense).final


def test_a_record_without_room_is_refused_before_it_is_compiled(monkeypatch, fresh_programs):
    sentence = "Accuracy.max_steps is {}: .* would require {} GB of memory; .* at most {}"
    # Half of the memory for the ends of the steps, of 8 bytes each, or for seven numbers of each.
    monkeypatch.setattr(_record, "memory", lambda: 16e9)
    with pytest.raises(InputError, match=sentence.format(10**12, 8000, 10**9)):
        jax.jacfwd(end)(1.0, 10**12)
    with pytest.raises(InputError, match=sentence.format(10**12, 8000, 10**9)):
        jax.jacrev(end)(1.0, 10**12)
    with pytest.raises(InputError, match=sentence.format(2 * 10**9, 112, 142857142)):
        end(1.0, 2 * 10**9, dense=True)
    # What is asked for is the memory of this machine.
    monkeypatch.undo()
    assert 2**28 < _record.memory() < 2**60
    with pytest.raises(InputError, match="would require 8000000 GB"):
        jax.eval_shape(jax.grad(lambda mu: end(mu, 10**15).position[1]), 1.0)
    # The value keeps no record.
    run = jax.eval_shape(lambda mu: end(mu, 10**15), 1.0)
    assert run.position.shape == (3,)


def test_more_steps_than_can_be_counted_are_refused():
    with pytest.raises(
        InputError, match="max_steps is 1e.30: it must be at most 9223372036854775807"
    ):
        end(1.0, 10**30)
    with jax.enable_x64(False):
        with pytest.raises(InputError, match="at most 2147483647, .* without jaxspace.enable_x64"):
            end(1.0, 10**12)
