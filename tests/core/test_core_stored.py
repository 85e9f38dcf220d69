"""Programs that are stored by the structure of their arguments, and loaded without a trace."""

import errno
import os
import subprocess
import sys
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace.core import InputError, _structure_key, program_folder, stored
from jaxspace.core._structure_key import NoKey, key_of
from jaxspace.core.jit import compiled, quick_jit
from jaxspace.core.program_folder import ProgramFolder, clear, stored_files
from jaxspace.io.by_numpy import by_numpy

# One entry for each time that a function below is traced.
TRACES = []


class Scale(eqx.Module):
    by: jax.Array
    kind: str = eqx.field(static=True, default="plain")


class OtherScale(Scale):
    pass


def scaled(scale, x, more=None):
    TRACES.append(None)
    return {"y": scale.by * x, "scale": scale, "more": more}


def lifted(scale, x, more=None):
    TRACES.append(None)
    return {"y": scale.by * x, "scale": scale, "more": more}


def adding(number):
    """A function that captures a number, on which its program depends."""

    def add(x):
        TRACES.append(None)
        return x + number

    return add


def with_callback(x):
    TRACES.append(None)
    return jax.pure_callback(lambda x: np.asarray(x) + 1.0, x, x)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder for the programs of this file, whose functions count as those of the package."""
    monkeypatch.setattr(_structure_key, "LIBRARIES", (*_structure_key.LIBRARIES, __name__))
    stored._environment.cache_clear()
    folder = ProgramFolder(tmp_path / "stored", 10**9)
    stored.store_in(folder)
    yield folder
    stored.store_in(None)
    stored._environment.cache_clear()


def traces(function, *args, options=None, **kwargs):
    """The result of a function that this process has not called yet, and how often it is traced."""
    TRACES.clear()
    result = quick_jit(function, **(options or {}))(*args, **kwargs)
    return result, len(TRACES)


def test_other_numbers_load_the_program(folder):
    first, count = traces(scaled, Scale(jnp.array(2.0), "own"), jnp.arange(3.0), more=("a", 1))
    assert count == 1
    again, count = traces(scaled, Scale(jnp.array(5.0), "own"), -jnp.arange(3.0), more=("a", 1))
    assert count == 0
    np.testing.assert_array_equal(again["y"], [0.0, -5.0, -10.0])
    assert again["scale"].kind == "own" and float(again["scale"].by) == 5.0
    assert again["more"] == ("a", 1)
    assert jax.tree.structure(again) == jax.tree.structure(first)
    (file,) = stored_files(folder.root)
    assert file.function == "scaled" and file.machine == folder.folder.name


X = np.arange(3.0)
CHANGED = {
    "function": lambda: traces(lifted, Scale(jnp.array(2.0)), jnp.array(X)),
    "class": lambda: traces(scaled, OtherScale(jnp.array(2.0)), jnp.array(X)),
    "static field": lambda: traces(scaled, Scale(jnp.array(2.0), "b"), jnp.array(X)),
    "static leaf": lambda: traces(scaled, Scale(jnp.array(2.0)), jnp.array(X), 1),
    "type of a static leaf": lambda: traces(scaled, Scale(jnp.array(2.0)), jnp.array(X), True),
    "sign of a static zero": lambda: traces(scaled, Scale(jnp.array(2.0)), jnp.array(X), -0.0),
    "list": lambda: traces(scaled, Scale(jnp.array(2.0)), jnp.array(X), [1, 2]),
    "tuple": lambda: traces(scaled, Scale(jnp.array(2.0)), jnp.array(X), (1, 2)),
    "name": lambda: traces(scaled, Scale(jnp.array(2.0)), jnp.array(X), {"a": None}),
    "keyword": lambda: traces(scaled, Scale(jnp.array(2.0)), x=jnp.array(X)),
    "shape": lambda: traces(scaled, Scale(jnp.array(2.0)), jnp.array(X[:2])),
    "axes": lambda: traces(scaled, Scale(jnp.array(2.0)), jnp.array(X[None])),
    "precision": lambda: traces(scaled, Scale(jnp.float32(2.0)), jnp.float32(X)),
    "weak type": lambda: traces(scaled, Scale(jnp.array(np.float64(2.0))), jnp.array(X)),
    "number for an array": lambda: traces(scaled, Scale(2.0), jnp.array(X)),
    "options": lambda: traces(
        scaled,
        Scale(jnp.array(2.0)),
        jnp.array(X),
        options={"compiler_options": {"xla_backend_optimization_level": 0}},
    ),
    "captured number": lambda: traces(adding(2.0), jnp.array(X)),
    "captured array": lambda: traces(adding(np.arange(3.0)), jnp.array(X)),
    "other captured array": lambda: traces(adding(np.arange(1.0, 4.0)), jnp.array(X)),
}


def test_every_other_structure_is_another_program(folder):
    _, count = traces(scaled, Scale(jnp.array(2.0)), jnp.array(X))
    assert count == 1
    _, count = traces(adding(1.0), jnp.array(X))
    assert count == 1
    for name, call in CHANGED.items():
        expected, count = call()
        assert count == 1, name
        loaded, count = call()
        assert count == 0, name
        for a, b in zip(jax.tree.leaves(expected), jax.tree.leaves(loaded), strict=True):
            assert np.array_equal(a, b) and getattr(a, "dtype", 0) == getattr(b, "dtype", 0), name
    assert len(stored_files(folder.root)) == len(CHANGED) + 2


def test_settings_and_the_environment_are_parts_of_the_key(folder, monkeypatch):
    def count():
        return traces(scaled, Scale(np.float64(2.0)), X)[1]

    assert (count(), count()) == (1, 0)
    with jax.enable_x64(False):
        assert (count(), count()) == (1, 0)
    with jax.default_matmul_precision("float32"):
        assert (count(), count()) == (1, 0)
    assert count() == 0
    version = stored.importlib.metadata.version
    changes = (
        *(
            (stored.importlib.metadata, "version", _newer(name, version))
            for name in ("jax", "numpy")
        ),
        (stored, "_sources", lambda: "edited"),
        (stored.sys, "version", "4.0"),
    )
    for place, name, value in changes:
        with monkeypatch.context() as context:
            context.setattr(place, name, value)
            stored._environment.cache_clear()
            assert (count(), count()) == (1, 0), (place, name)
    with monkeypatch.context() as context:
        context.setenv("XLA_FLAGS", "--xla_cpu_enable_fast_math=false")
        stored._environment.cache_clear()
        assert (count(), count()) == (1, 0)
    stored._environment.cache_clear()
    assert count() == 0


def _newer(changed, version):
    return lambda name: "99.0" if name == changed else version(name)


def test_each_processor_has_a_folder(monkeypatch):
    here = program_folder.machine_type()
    name, features = program_folder._processor()
    monkeypatch.setattr(program_folder, "_processor", lambda: (name, features + " more"))
    more = program_folder.machine_type()
    monkeypatch.setattr(program_folder, "_processor", lambda: (name + " II", features))
    assert len({here, more, program_folder.machine_type()}) == 3


class OfUser:
    def method(self):
        pass


UNKNOWN = {
    "a lambda of the user": lambda: lambda x: x,
    "a closure of the user": lambda: adding(1.0),
    "a function of the user": lambda: scaled,
    "an object of the user": OfUser,
    "a module of the user": lambda: Scale(1.0),
    "a class of the user": lambda: OfUser,
    "a method of the user": lambda: OfUser().method,
    "a lock": lambda: __import__("threading").Lock(),
    "a file": lambda: sys.stderr,
    "an iterator": lambda: iter([1]),
    "a class within a function": lambda: type("Local", (), {"__module__": "jaxspace.core"}),
    "a compiled function": lambda: jax.jit(lambda x: x),
    "an array of objects": lambda: np.array([OfUser()]),
    "a random key": lambda: jax.random.key(0),
    "a list that contains itself": lambda: (x := [], x.append(x))[0],
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_what_names_and_values_do_not_identify_has_no_key(name):
    with pytest.raises(NoKey):
        key_of(UNKNOWN[name]())


def test_keys_tell_values_apart():
    values = [0, 0.0, -0.0, False, None, "", b"", (), [], {}, frozenset(), "0", 1, True, 1.0, 1j]
    values += [(1, 2), (12,), ("1", "2"), ("12",), ((1,), 2), (1, (2,)), [1, 2], {1: 2}, {2: 1}]
    values += [float("nan"), float("inf"), slice(1), slice(1, 2), np.float64(1.0), np.float32(1.0)]
    values += [np.zeros(2), np.zeros((2, 1)), np.zeros(2, int), jnp.zeros(2), jnp.float64, np.sin]
    values += [np.dtype(float), ..., jnp.sin, jnp.cos, {"a": 1, "b": 2}, {"b": 2, "a": 1}]
    values += [jax.tree.structure((1, 2)), jax.tree.structure([1, 2]), int | str, int | None]
    keys = [key_of(x) for x in values]
    assert len(set(keys)) == len(keys)
    assert keys == [key_of(x) for x in values]


def test_functions_of_the_user_are_traced_and_not_stored(tmp_path):
    folder = ProgramFolder(tmp_path, 10**9)
    stored.store_in(folder)
    try:
        for _ in range(2):
            result, count = traces(scaled, Scale(jnp.array(2.0)), jnp.array(X))
            assert count == 1 and float(result["y"][2]) == 4.0
            TRACES.clear()
            assert float(compiled(lambda x: scaled(Scale(3.0), x)["y"])(jnp.array(1.0))) == 3.0
            assert len(TRACES) == 1
    finally:
        stored.store_in(None)
    assert not stored_files(tmp_path)
    assert any("scaled" in name and __name__ in reason for name, reason in stored.refused())


@pytest.fixture
def folder_of_user(tmp_path):
    """A folder for the programs of this file, whose functions are those of a user."""
    folder = ProgramFolder(tmp_path / "stored", 10**9)
    stored.store_in(folder)
    yield folder
    stored.store_in(None)


def test_functions_with_a_name_are_stored(folder_of_user):
    def count(name, function):
        TRACES.clear()
        result = compiled(jaxspace.stored_as(name)(function))(jnp.array(1.0))
        return float(result), len(TRACES)

    def doubled(x):
        TRACES.append(None)
        return 2.0 * x

    # Each call of `adding` creates another function, as another process does.
    assert [count("a", adding(1.0)) for _ in range(2)] == [(2.0, 1), (2.0, 0)]
    assert [count("a", adding(3.0)) for _ in range(2)] == [(4.0, 1), (4.0, 0)]
    assert count("b", adding(1.0)) == (2.0, 1)
    assert count("a", doubled) == (2.0, 1)
    assert len(stored_files(folder_of_user.root)) == 4
    TRACES.clear()
    compiled(adding(1.0))(jnp.array(1.0))
    assert len(TRACES) == 1 and len(stored_files(folder_of_user.root)) == 4


def test_a_name_is_a_text():
    with pytest.raises(InputError, match="name is '': it must be a text that is not empty"):
        jaxspace.stored_as("")


@pytest.mark.parametrize("thing", [jnp.sin, OfUser, OfUser().method, 1.0])
def test_only_functions_have_names(thing):
    with pytest.raises(InputError, match="it must be a function"):
        jaxspace.stored_as("name")(thing)


def test_transformations_and_callbacks_do_not_touch_the_folder(folder):
    call = quick_jit(adding(1.0))
    assert float(jax.jit(call)(1.0)) == 2.0
    assert float(jax.grad(call)(1.0)) == 1.0
    assert float(jax.vmap(call)(jnp.ones(2))[0]) == 2.0
    # Concrete numbers within a function that is traced, too.
    assert float(jax.jit(lambda x: x + call(jnp.array(1.0)))(1.0)) == 3.0
    with by_numpy():
        call(jnp.array(1.0))
    with jax.disable_jit():
        call(jnp.array(1.0))
    assert not stored_files(folder.root)
    assert float(traces(with_callback, jnp.array(1.0))[0]) == 2.0
    assert float(traces(with_callback, jnp.array(2.0))[0]) == 3.0
    assert not stored_files(folder.root)


def summed(x):
    TRACES.append(None)
    return jax.lax.fori_loop(0, 3, lambda k, total: total + x, 0.0 * x)


def test_loops_are_stored_where_numpy_computes_the_rest(folder):
    with by_numpy():
        for expected in (1, 0):
            TRACES.clear()
            assert float(quick_jit(summed, has_loop=True)(jnp.array(2.0))) == 6.0
            assert len(TRACES) == expected
    assert traces(summed, jnp.array(1.0))[1] == 0


def test_a_program_is_prepared_once(folder):
    times = []
    for expected in (1, 0):
        TRACES.clear()
        prepared = quick_jit(summed)
        for _ in range(2):
            prepared.prepare((jnp.array(2.0),), lambda: times.append(len(TRACES)))
        assert float(prepared(jnp.array(2.0))) == 6.0
        assert times[-2:] == [expected, expected] and len(TRACES) == expected
    stored.store_in(None)
    TRACES.clear()
    prepared = quick_jit(summed)
    prepared.prepare((jnp.array(2.0),), lambda: times.append(len(TRACES)))
    assert float(prepared(jnp.array(2.0))) == 6.0
    assert times[-1] == 1 and len(TRACES) == 1


def call(x=2.0):
    result, count = traces(scaled, Scale(jnp.array(x)), jnp.array(X))
    assert float(result["y"][2]) == 2.0 * x
    return count


def damaged(file):
    file.write_bytes(file.read_bytes()[:-1])


def newer(file):
    file.write_bytes(file.read_bytes().replace(b"program 1", b"program 2", 1))


def foreign(file):
    """Another program under this name, of which the content is complete."""
    content = b"not a program"
    head = program_folder._HEAD + program_folder._digest(content)
    file.write_bytes(head + content)


@pytest.mark.parametrize("spoil", [damaged, newer, foreign])
def test_a_damaged_program_is_compiled_again(folder, spoil):
    assert call() == 1
    (file,) = stored_files(folder.root)
    spoil(file.path)
    with pytest.warns(UserWarning, match="is compiled again") as found:
        assert call() == 1
    assert "\n" not in str(found[0].message)
    assert call() == 0


def test_programs_that_others_may_write_are_not_loaded(folder, monkeypatch):
    assert call() == 1
    (file,) = stored_files(folder.root)
    assert folder.folder.stat().st_mode & 0o777 == 0o700
    assert file.path.stat().st_mode & 0o777 == 0o600
    for path, mode in ((file.path, 0o622), (folder.folder, 0o770)):
        before = path.stat().st_mode
        path.chmod(mode)
        folder.writes = True
        with pytest.warns(UserWarning, match="may be written by other users"):
            assert call() == 1
        assert call() == 1
        path.chmod(before)
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    folder.writes = True
    with pytest.warns(UserWarning, match="may be written by other users"):
        assert call() == 1
    monkeypatch.undo()


def test_links_are_not_followed(folder, tmp_path):
    assert call() == 1
    (file,) = stored_files(folder.root)
    file.path.rename(tmp_path / "elsewhere")
    file.path.symlink_to(tmp_path / "elsewhere")
    with pytest.warns(UserWarning, match="are not stored"):
        assert call() == 1


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES, errno.EROFS])
def test_what_cannot_be_written_is_not_stored(folder, monkeypatch, number):
    def fails(*args, **kwargs):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "replace", fails)
    with pytest.warns(UserWarning, match="are not stored") as found:
        assert call() == 1
    assert len(found) == 1
    assert list(folder.folder.iterdir()) == []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert call() == 1


def test_a_folder_that_is_deleted_in_use_is_made_again(folder):
    assert call() == 1
    clear(folder.root)
    folder.folder.rmdir()
    assert call() == 1
    assert call() == 0


def test_the_limit_removes_the_programs_that_are_not_used(folder):
    assert call() == 1
    (first,) = stored_files(folder.root)
    os.utime(first.path, (1e9, 1e9))
    traces(adding(1.0), jnp.array(X))
    (second,) = (file for file in stored_files(folder.root) if file.path != first.path)
    os.utime(second.path, (1.1e9, 1.1e9))
    # Its use makes the older one the last that is removed.
    assert call() == 0
    folder.limit = int(1.2 * (first.size + second.size))
    traces(adding(2.0), jnp.array(X))
    names = {file.path for file in stored_files(folder.root)}
    assert first.path in names and second.path not in names
    assert clear(folder.root) == 2
    folder.limit = first.size // 2
    assert call() == 1
    assert not stored_files(folder.root)


def test_a_limit_of_zero_stores_nothing(tmp_path):
    stored.store_in(ProgramFolder(tmp_path, 0))
    assert call() == 1
    stored.store_in(None)
    assert not list(tmp_path.iterdir())


# A run and a function of LAPACK, which a new process has not set up.
PROCESS = """
import sys
import jax
import jax.numpy as jnp
import numpy as np
import jaxspace
from jaxspace import BodyState, simulate
from jaxspace.core.jit import quick_jit
from jaxspace.orbits import TwoBody

jaxspace.enable_x64()
jaxspace.keep_programs(sys.argv[1])
traces = []
jax.monitoring.register_event_duration_secs_listener(
    lambda name, *more, **details: traces.append(name) if "backend_compile" in name else None
)
y0 = BodyState(jnp.array([float(sys.argv[2]), 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
run = simulate(TwoBody(1.0), y0, jnp.array([0.0, 1.0, 3.0]))
solve = quick_jit(jnp.linalg.solve)
x = solve(2.0 * jnp.eye(3), jnp.ones((3, 1)))
print(np.asarray(run.states.position).tobytes().hex(), len(traces), float(x[0, 0]))
"""


def started(folder, number, limit):
    environment = os.environ | {"JAXSPACE_PROGRAMS_LIMIT": str(limit)}
    environment["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "1"
    command = [sys.executable, "-c", PROCESS, str(folder), str(number)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def results(*processes):
    outputs = [process.communicate()[0].split() for process in processes]
    assert all(process.returncode == 0 for process in processes)
    assert all(float(x) == 0.5 for *_, x in outputs)
    return [bits for bits, *_ in outputs], [int(count) for _, count, _ in outputs]


def test_processes_share_programs_and_their_bits(tmp_path):
    # All at once: one that does not store its programs, and two with other numbers that do.
    (plain, bits, other), counts = results(
        started(tmp_path / "plain", 1.2, 0),
        started(tmp_path / "own", 1.2, 10**9),
        started(tmp_path / "own", 1.1, 10**9),
    )
    assert bits == plain != other
    (loaded,), (count,) = results(started(tmp_path / "own", 1.2, 10**9))
    assert loaded == plain
    assert count < min(counts)
    assert not (tmp_path / "plain" / "stored").exists()


# Searches and missions whose functions the user has named: the first process stores all programs
# of the verbs, and the second one misses none.
VERBS = """
import sys
import jax
import jax.numpy as jnp
import numpy as np
import jaxspace
from jaxspace import BodyState, Event, Mission, Phase, simulate_batch, simulate_mission
from jaxspace.core import program_folder, stored
from jaxspace.optimization import Criterion, minimise
from jaxspace.orbits import TwoBody

jaxspace.enable_x64()
jaxspace.keep_programs(sys.argv[1])
shift = float(sys.argv[2])
read, misses = program_folder.ProgramFolder.read, []

def noted(self, name):
    content = read(self, name)
    misses.extend([name] if content is None else [])
    return content

program_folder.ProgramFolder.read = noted

@jaxspace.stored_as("distance from a point")
def distance(x):
    return Criterion((x["a"] - 1.0) ** 2 + (x["b"] + 2.0) ** 2, None, x["a"] + x["b"])

@jaxspace.stored_as("height")
def height(t, y):
    return y.position[1]

found = minimise(distance, {"a": jnp.array(shift), "b": jnp.array(0.5)})
y0 = BodyState(jnp.array([1.0 + 0.1 * shift, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.1]))
mission = Mission([Phase(TwoBody(1.0), 1.0, name="a"), Phase(TwoBody(1.0), Event(height, -1, 9.0))])
flown = simulate_mission(mission, y0)
many = jax.tree.map(lambda x: jnp.stack([x, 1.1 * x], axis=-1), y0)
batch = simulate_batch(TwoBody(1.0), many, jnp.array([0.0, 1.0]))
bits = [found.x["a"], found.x["b"], flown.final.position, batch.final.position]
print(b"".join(np.asarray(x).tobytes() for x in bits).hex(), len(misses), len(stored.refused()))
"""


def test_verbs_load_all_of_their_programs(tmp_path):
    def run(folder, shift, limit=10**9):
        environment = os.environ | {"JAXSPACE_PROGRAMS_LIMIT": str(limit)}
        environment["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "1"
        command = [sys.executable, "-c", VERBS, str(tmp_path / folder), str(shift)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        bits, *counts = done.stdout.split()
        return bits, *map(int, counts)

    _, misses, refused = run("stored", 0.2)
    assert misses > 3 and refused == 0
    bits, misses, _ = run("stored", 0.4)
    assert misses == 0
    assert run("plain", 0.4, 0)[0] == bits
