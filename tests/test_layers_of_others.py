"""A run inside the transformations and the libraries of others."""

import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh, PartitionSpec
from numpy.testing import assert_allclose

from jaxspace import Accuracy, simulate, simulate_batch
from jaxspace.core import AbstractSystem, Scalar
from jaxspace.solvers import Tsit5

FAST = Accuracy(1e-8, method=Tsit5(), max_steps=64)
TS = np.array([0.0, 0.5])


class Spring(AbstractSystem):
    """x'' = -k x."""

    k: Scalar

    def vector_field(self, t, y):
        return {"v": -self.k * y["x"], "x": y["v"]}

    def invariants(self, t, y):
        return {}


def half_second(k, y):
    """The state half a second later."""
    return simulate(Spring(k), y, TS, accuracy=FAST, throw=False).final


START = {"v": jnp.array(0.0), "x": jnp.array(1.0)}


def angle(k, t):
    return jnp.cos(jnp.sqrt(k) * t)


@pytest.mark.parametrize(
    "remat", [True, pytest.param(False, marks=pytest.mark.sweep)], ids=["checkpoint", "scan"]
)
def test_in_a_scan_with_and_without_checkpoints(remat):
    """Ten steps of half a second, and the derivative through all of them."""
    step = jax.checkpoint(half_second) if remat else half_second

    @jax.jit
    @jax.value_and_grad
    def end(k):
        last, _ = jax.lax.scan(lambda y, _: (step(k, y), None), START, length=10)
        return last["x"]

    value, slope = end(jnp.array(2.0))
    assert_allclose(value, angle(2.0, 5.0), atol=1e-7)
    assert_allclose(slope, jax.grad(angle)(2.0, 5.0), atol=1e-6)


def test_in_a_shard_map():
    """Every device runs its own part of a batch; here one device."""
    mesh = Mesh(np.array(jax.devices()[:1]), ("runs",))
    spec = PartitionSpec("runs")

    def part(x):
        y0s = {"v": jnp.zeros_like(x), "x": x}
        return simulate_batch(Spring(jnp.array(2.0)), y0s, TS, accuracy=FAST).final["x"]

    mapped = jax.jit(jax.shard_map(part, mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False))
    x = jnp.linspace(0.5, 1.5, 8)
    assert_allclose(mapped(x), x * angle(2.0, 0.5), atol=1e-7)


OTHER = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
from jax import export
program = export.deserialize(open(sys.argv[1], "rb").read())
print(repr(float(program.call(2.0, 1.0))))
assert "jaxspace" not in sys.modules
"""


def test_saved_and_run_in_another_process(tmp_path):
    """By `jax.export`: the other process needs JAX alone."""
    pytest.importorskip("flatbuffers", reason="in which jax.export writes")

    def end(k, x):
        return half_second(k, {"v": jnp.zeros_like(x), "x": x})["x"]

    number = jax.ShapeDtypeStruct((), float)
    file = tmp_path / "spring.bin"
    file.write_bytes(jax.export.export(jax.jit(end))(number, number).serialize())
    done = subprocess.run(
        [sys.executable, "-c", OTHER, str(file)], cwd=Path("/"), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert_allclose(float(done.stdout), angle(2.0, 0.5), atol=1e-7)


def test_inside_flax():
    """A stiffness learned by a module of flax."""
    nnx = pytest.importorskip("flax.nnx")

    class Layer(nnx.Module):
        def __init__(self):
            self.log_k = nnx.Param(jnp.array(0.0))

        def __call__(self, x):
            y0s = {"v": jnp.zeros_like(x), "x": x}
            spring = Spring(jnp.exp(self.log_k[...]))
            return simulate_batch(spring, y0s, TS, accuracy=FAST).final["x"]

    layer = Layer()
    x = jnp.linspace(0.5, 1.5, 4)

    @nnx.jit
    def slope(layer, x):
        return nnx.value_and_grad(lambda layer: jnp.sum((layer(x) - 0.6 * x) ** 2))(layer)

    for _ in range(20):
        loss, gradient = slope(layer, x)
        layer.log_k[...] = layer.log_k[...] - 0.8 * gradient["log_k"][...]
    assert float(loss) < 1e-6
    assert_allclose(jnp.exp(layer.log_k[...]), (np.arccos(0.6) / 0.5) ** 2, rtol=1e-2)


def test_inside_torch():
    """Through DLPack, with the derivative of a run as that of a function of torch."""
    torch = pytest.importorskip("torch")

    def ends(k, x):
        y0s = {"v": jnp.zeros_like(x), "x": x}
        return simulate_batch(Spring(k), y0s, TS, accuracy=FAST).final["x"]

    forwards = jax.jit(ends)
    backwards = jax.jit(lambda k, x, g: jax.vjp(ends, k, x)[1](g))

    def of_torch(a):
        return jnp.from_dlpack(a.detach().contiguous())

    class Run(torch.autograd.Function):
        @staticmethod
        def forward(context, k, x):
            context.save_for_backward(k, x)
            return torch.from_dlpack(forwards(*map(of_torch, (k, x))))

        @staticmethod
        def backward(context, g):
            given = map(of_torch, (*context.saved_tensors, g))
            return tuple(torch.from_dlpack(a) for a in backwards(*given))

    k = torch.tensor(2.0, dtype=torch.float64, requires_grad=True)
    x = torch.linspace(0.5, 1.5, 4, dtype=torch.float64)
    loss = torch.sum(Run.apply(k, x) ** 2)
    loss.backward()
    expected = jax.grad(lambda k: jnp.sum((jnp.asarray(x.numpy()) * angle(k, 0.5)) ** 2))(2.0)
    assert_allclose(float(k.grad), float(expected), rtol=1e-6)
