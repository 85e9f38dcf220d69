"""Engines on a runner that simulates nothing: which chunks they compute, and when a rule ends
them."""

import sys
from typing import final

import jax
import numpy as np
import pytest

from jaxspace.core import InputError
from jaxspace.core.processors import cores
from jaxspace.engines import AbstractEngine, AbstractRunner, DaskCluster, MultiHost, ProcessPool
from jaxspace.engines._interface import Done, Extent, timed
from jaxspace.engines._transfer import compute_chunk, payload_of
from jaxspace.engines.chunks import in_memory
from jaxspace.engines.ending import Ending, checkpoints
from jaxspace.engines.named import InProcess
from jaxspace.statistics import StopRule
from jaxspace.stores.results import RunResults

SEED = 3
CHUNK = 100


@final
class Normals(AbstractRunner):
    """Runs whose output x is a normal number, by a generator of their own."""

    def __init__(self, seed):
        self.prepared = np.asarray(seed)
        self.units = {"x": "m"}
        self.modules = (("engines_module.py", "HERE = True"),)

    @classmethod
    def in_worker(cls, prepared, devices):
        assert devices == jax.local_devices()
        assert any("engines_module" in name for name in sys.modules)
        return cls(prepared)

    @property
    def example(self):
        return self.run(0, 1)

    def run(self, first, count):
        seeds = [(int(self.prepared), k) for k in range(first, first + count)]
        return results([np.random.default_rng(seed).standard_normal() for seed in seeds])


@final
class Backwards(AbstractEngine):
    """The last chunk comes first."""

    @property
    def workers(self):
        return 3

    def compute(self, runner, extents):
        for extent in reversed(extents):
            yield timed(runner, extent)


def results(x):
    x = np.asarray(x)
    return RunResults({}, {"x": x}, np.zeros(len(x), int), np.ones(len(x), int), {})


def test_the_rule_is_asked_at_counts_that_grow_by_an_eighth():
    counts = checkpoints(10**4)
    assert counts[:9] == list(range(1, 10)) and counts[-1] < 10**4
    assert all(b - a <= max(a // 8, 1) for a, b in zip(counts, counts[1:], strict=False))
    # So that asking costs about nine times the last question.
    assert sum(counts) < 10 * counts[-1]


@pytest.mark.parametrize("seed", range(5))
def test_the_end_does_not_depend_on_the_order_of_chunks(seed):
    rng = np.random.default_rng(0)
    chunks = [results(rng.standard_normal(100)) for _ in range(60)]
    # Some failed runs are no values; a chunk of them alone is allowed.
    chunks[2].outputs["x"][:] = np.nan
    rule, in_order = StopRule("x", 0.9, 0.1), Ending(StopRule("x", 0.9, 0.1), 60)
    for k, chunk in enumerate(chunks):
        in_order.add(k, chunk)
        if in_order.enough():
            break
    expected = in_order.enough()
    assert expected is not None and 3 < expected < 59
    x = np.concatenate([c.outputs["x"] for c in chunks[:expected]])
    assert rule.met(x)
    shuffled = Ending(rule, 60)
    for k in np.random.default_rng(seed).permutation(60).tolist():
        shuffled.add(k, chunks[k])
    assert shuffled.enough() == expected


def test_chunks_cover_the_runs_once_whatever_their_order():
    told = []
    here = in_memory(Normals(SEED), InProcess(), CHUNK, 1050, lambda *x: told.append(x), None)
    back = in_memory(Normals(SEED), Backwards(), CHUNK, 1050, None, None)
    assert sorted(here) == sorted(back) == list(range(11))
    x = Normals(SEED).run(0, 1050).outputs["x"]
    for chunks in (here, back):
        joined = np.concatenate([chunks[k][0].outputs["x"] for k in sorted(chunks)])
        np.testing.assert_array_equal(joined, x)
    # Reported when the next one is asked for, the last one too.
    assert told == [*((CHUNK * (k + 1), 1050) for k in range(10)), (1050, 1050)]


def test_a_rule_leaves_out_the_chunks_behind_the_end():
    """The end is that of the runs in their order, also where later ones have come before."""
    rule = StopRule("x", 0.9, 0.1)
    here = in_memory(Normals(SEED), InProcess(), CHUNK, 6000, None, rule)
    back = in_memory(Normals(SEED), Backwards(), CHUNK, 6000, None, rule)
    assert sorted(here) == sorted(back) == list(range(len(here))) and 3 < len(here) < 60
    x = np.concatenate([here[k][0].outputs["x"] for k in sorted(here)])
    assert rule.met(x)


def test_a_worker_makes_the_runner_again():
    runner = Normals(SEED)
    done = compute_chunk(payload_of(runner), Extent(2, 200, 50))
    assert isinstance(done, Done) and done.chunk == 2
    np.testing.assert_array_equal(done.results.outputs["x"], runner.run(200, 50).outputs["x"])


def test_one_host_alone_has_all_chunks():
    extents = [Extent(k, 10 * k, 10) for k in range(4)]
    assert MultiHost().share(extents) == extents and MultiHost().leads and MultiHost().host == 0


@pytest.mark.parametrize("engine", [ProcessPool, DaskCluster])
def test_an_engine_has_a_worker_for_each_core_and_at_least_one(engine):
    assert engine().workers == cores() and engine(workers=3).workers == 3
    with pytest.raises(
        InputError, match=rf"{engine.__name__}\.workers is 0: it must be at least 1"
    ):
        engine(workers=0)
