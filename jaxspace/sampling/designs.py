"""Sampling of the inputs of a campaign: random, Latin hypercube or Sobol points.

A design determines the position of run i in the unit cube from the key of the campaign and the
number i only, so that a run is the same in any chunk, on any machine and after a restart:

- `LatinHypercube`: each of N equal layers of every input contains one of the N runs. The layer of a
  run is its number under a random permutation, evaluated for this number only (Kensler, Correlated
  Multi-Jittered Sampling, Pixar 13-01, 2013).
- `Sobol`: a sequence whose first 2^m points fill the cube evenly, under Owen's scrambling by a hash
  (Burley, J. Comput. Graph. Tech. 9 (2020), 1). Direction numbers: `scipy.stats.qmc`.
"""

import functools
import zlib
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtri
from jaxtyping import Array, Float, Integer

from ..core import InputError
from ..core.barrier import barrier
from ..core.structure import HashedModule
from .distributions import AbstractDistribution

BITS = 32


class AbstractDesign(HashedModule):
    """Sampling of the runs in the unit cube."""

    @abstractmethod
    def uniforms(
        self, key: Array, numbers: Integer[Array, " runs"], dimensions: int
    ) -> Float[Array, "runs dimensions"]:
        """The points of the runs with these numbers, from 0 to 1."""

    def normals(
        self, key: Array, numbers: Integer[Array, " runs"], dimensions: int
    ) -> Float[Array, "runs dimensions"]:
        """The standard normal numbers at these points, which are finite: in single precision a
        point may round to 0 or 1."""
        u = self.uniforms(key, numbers, dimensions)
        least = float(jnp.finfo(u.dtype).epsneg)
        return ndtri(jnp.where(u > 0.0, jnp.minimum(u, 1.0 - least), 0.5 * least))


@final
class LatinHypercube(AbstractDesign):
    """Latin hypercube sampling: every input is divided into as many equally probable layers as
    there are runs, and each layer contains one run.

    - `runs`: number of runs of the campaign. Fewer runs do not form a hypercube, and further runs
      pass through the layers again."""

    runs: int = eqx.field(static=True)

    def __check_init__(self):
        if not 1 <= self.runs < 2**31:
            raise InputError(
                f"LatinHypercube.runs is {self.runs}: it must be from 1 to 2147483647."
            )

    def uniforms(
        self, key: Array, numbers: Integer[Array, " runs"], dimensions: int
    ) -> Float[Array, "runs dimensions"]:
        # Each pass through the layers has another permutation.
        numbers = numbers.astype(jnp.uint32)
        again = numbers // self.runs
        places = numbers % self.runs

        def one(number: Array, again: Array, place: Array) -> Array:
            seeds = jax.random.bits(jax.random.fold_in(key, again), (dimensions,), jnp.uint32)
            layers = jax.vmap(lambda seed: _permuted(place, self.runs, seed))(seeds)
            # Another stream than that of the permutations.
            run_key = jax.random.fold_in(jax.random.fold_in(key, 0x4C4853), number)
            # Half a step inwards: no point is on the border of its layer.
            within = jax.random.uniform(run_key, (dimensions,))
            within = within + 0.5 * float(jnp.finfo(within.dtype).eps)
            layer = layers.astype(within.dtype)
            # Nor does the sum round to it.
            return jnp.minimum(layer + within, jnp.nextafter(layer + 1.0, layer)) / self.runs

        return jax.vmap(one)(numbers, again, places)


@final
class Sobol(AbstractDesign):
    """Scrambled Sobol points: use a power of two for the number of runs. There are 2^31 points, of
    at most 21201 standard normal numbers each.

    Raises `InputError` for more when drawing."""

    def uniforms(
        self, key: Array, numbers: Integer[Array, " runs"], dimensions: int
    ) -> Float[Array, "runs dimensions"]:
        directions = jnp.asarray(_directions(dimensions))
        seeds = jax.random.bits(key, (dimensions,), jnp.uint32)
        numbers = numbers.astype(jnp.uint32)
        gray = numbers ^ (numbers >> 1)
        points = jnp.zeros((*numbers.shape, dimensions), jnp.uint32)
        for bit in range(directions.shape[1]):
            on = (gray >> bit) & 1
            points = points ^ (on[:, None] * directions[:, bit])
        # Half a step inwards: no point is on the border, where a normal number is infinite.
        dtype = jnp.result_type(float)
        share = (_scrambled(points, seeds).astype(dtype) + 0.5) * 2.0**-BITS
        return jnp.minimum(share, 1.0 - float(jnp.finfo(dtype).epsneg))


NUMBERS = 31
"""Bits of the number of a run on Sobol points: the runs of a campaign are fewer than 2^31."""


@functools.cache
def _directions(dimensions: int) -> np.ndarray:
    """The direction numbers of Joe and Kuo, (dimensions, NUMBERS), from SciPy's sequence."""
    from scipy.stats import qmc

    check_sobol_dimensions(dimensions)
    engine = qmc.Sobol(dimensions, scramble=False, bits=BITS)
    result = []
    for k in range(NUMBERS):
        # From zero the point number 2^k leads, in Gray code, to the direction number k. SciPy would
        # take a step for each point that it skips.
        engine.num_generated = 2**k
        result.append(np.round(engine.random(1)[0] * 2.0**BITS).astype(np.uint64))
        engine.reset()
    return np.stack(result, axis=1).astype(np.uint32)


def check_sobol_dimensions(dimensions: int) -> None:
    """Raise `InputError` where Sobol points have fewer dimensions than that."""
    from scipy.stats import qmc

    if dimensions > qmc.Sobol.MAXDIM:
        raise InputError(
            f"Sobol points with {dimensions} dimensions are required, one for each standard normal "
            f"variable behind the inputs: at most {qmc.Sobol.MAXDIM} are available."
        )


def _reversed(x: Array) -> Array:
    """The bits in the opposite order."""
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        low = jnp.uint32(mask)
        x = ((x >> shift) & low) | ((x & low) << shift)
    return (x >> 16) | (x << 16)


def _scrambled(x: Array, seed: Array) -> Array:
    """Owen's nested scrambling: whether a bit flips depends on the bits above it and the seed."""
    x = _reversed(x) + seed
    # Burley's constants: even factors, so that a bit only depends on those below it in this order.
    for factor in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
        x = x ^ (x * jnp.uint32(factor))
    return _reversed(x)


def _permuted(place: Array, count: int, seed: Array) -> Array:
    """The number `place`, below `count`, under a permutation determined by the seed."""
    mask = 1
    while mask < count - 1:
        mask = 2 * mask + 1
    w = jnp.uint32(mask)
    p = seed

    def mixed(i: Array) -> Array:
        # Kensler's steps, each of which can be undone within the bits of w.
        i = (i ^ p) * jnp.uint32(0xE170893D)
        i = i ^ (p >> 16)
        i = i ^ ((i & w) >> 4)
        i = (i ^ (p >> 8)) * jnp.uint32(0x0929EB3F)
        i = i ^ (p >> 23)
        i = i ^ ((i & w) >> 1)
        i = i * (jnp.uint32(1) | (p >> 27)) * jnp.uint32(0x6935FA69)
        for shift, factor in ((11, 0x74DCB303), (2, 0x9E501CC3), (2, 0xC860A3DF)):
            i = (i ^ ((i & w) >> shift)) * jnp.uint32(factor)
        i = i & w
        return i ^ (i >> 5)

    # A number outside the range is permuted again until it is inside.
    i = jax.lax.while_loop(lambda i: i >= count, mixed, mixed(place.astype(jnp.uint32)))
    # The remainder is taken first, so that the sum cannot overflow.
    return (i + p % jnp.uint32(count)) % jnp.uint32(count)


def normal_columns(inputs: Mapping[str, AbstractDistribution]) -> dict[str, list[int]]:
    """The columns of standard normal numbers used by each independent input, by the name of its
    first number."""
    result: dict[str, list[int]] = {}
    sources: dict[str, str] = {}
    width = 0
    # Sorted, because a dict that passes through `jit` comes out so: places must not change.
    for name, d in sorted(inputs.items()):
        # The numbers of a joint distribution share the columns of the first one.
        first = sources.setdefault(d.source, name) if d.source else name
        if first == name:
            result[name] = list(range(width, width + d.dimensions))
            width += d.dimensions
    return result


def map_normals(
    inputs: Mapping[str, AbstractDistribution], z: Float[Array, "runs dimensions"] | np.ndarray
) -> dict[str, Float[Array, " runs"]]:
    """The inputs, each (runs,), from independent standard normal numbers."""
    return {name: jax.vmap(inputs[name].from_normal)(x) for name, x in _taken(inputs, z).items()}


def search_normals(
    inputs: Mapping[str, AbstractDistribution], z: Float[Array, "runs dimensions"] | np.ndarray
) -> tuple[dict[str, Float[Array, " runs"]], Float[Array, " runs"]]:
    """Inputs, each (runs,), in which rare values of a list are frequent, from independent standard
    normal numbers; and the likelihood ratio of each run, (runs,)."""
    found = {name: jax.vmap(inputs[name].searched)(x) for name, x in _taken(inputs, z).items()}
    # Once for the numbers of a joint distribution, which share a draw.
    factors = [found[name][1] for name in normal_columns(inputs)]
    likelihood = jnp.prod(jnp.stack(factors), axis=0)
    return {name: x for name, (x, _) in found.items()}, likelihood


def _taken(
    inputs: Mapping[str, AbstractDistribution], z: Float[Array, "runs dimensions"] | np.ndarray
) -> dict[str, Array]:
    """The standard normal numbers of each input, (runs,) or (runs, dimensions)."""
    columns = normal_columns(inputs)
    by_source = {inputs[first].source or first: places for first, places in columns.items()}
    z = jnp.asarray(z)
    result = {}
    for name, d in inputs.items():
        places = by_source[d.source or name]
        result[name] = z[:, places] if d.source else z[:, places[0]]
    return result


def draw(
    inputs: Mapping[str, AbstractDistribution],
    design: AbstractDesign | None,
    key: Array,
    numbers: Integer[Array, " runs"],
) -> dict[str, Float[Array, " runs"]]:
    """The inputs of the runs with these numbers, each (runs,); random without a `design`."""
    if design is not None:
        dimensions = sum(map(len, normal_columns(inputs).values()))
        return map_normals(inputs, design.normals(key, numbers, dimensions))

    # A draw depends on the key, the number of its run and its own name only, so that it does not
    # depend on the numbers of runs or other inputs.
    def one(number: Array) -> dict[str, Array]:
        run_key = jax.random.fold_in(key, number)
        result = {}
        for names in _of_equal_structure(inputs):
            tags = [zlib.crc32((inputs[name].source or name).encode()) for name in names]
            # One program for all of a kind, which compiles sooner than one for each.
            kind = jax.tree.map(lambda *x: jnp.stack(x), *(inputs[name] for name in names))
            keys = jax.vmap(jax.random.fold_in, (None, 0))(run_key, jnp.array(tags, jnp.uint32))
            drawn = jax.vmap(lambda d, key: d.sample(key))(kind, keys)
            # Behind a barrier, because the compiler would repeat all draws of a kind for each
            # input.
            result |= zip(names, barrier(drawn), strict=True)
        return {name: result[name] for name in inputs}

    # Each distribution makes one draw; `vmap` adds the axis of runs here, for all of them.
    return jax.vmap(one)(numbers)


def _of_equal_structure(inputs: Mapping[str, AbstractDistribution]) -> list[list[str]]:
    """The names of the inputs whose distributions differ in their numbers only."""
    kinds: dict[Any, list[str]] = {}
    for name, d in inputs.items():
        leaves, structure = jax.tree.flatten(d)
        shapes = tuple((jnp.shape(x), jnp.result_type(x)) for x in leaves)
        kinds.setdefault((structure, shapes), []).append(name)
    return list(kinds.values())
