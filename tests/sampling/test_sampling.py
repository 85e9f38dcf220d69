"""Where runs lie: designs, joint distributions, and distributions by their quantiles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from scipy.stats import qmc

import jaxspace.io
from jaxspace.core import InputError
from jaxspace.dispersion import (
    Campaign,
    ConeDirection,
    Correlated,
    Discrete,
    LatinHypercube,
    Lognormal,
    MultivariateNormal,
    Normal,
    Samples,
    Sobol,
    Triangular,
    TruncatedNormal,
    Uniform,
)
from jaxspace.sampling._more_distributions import _place
from jaxspace.sampling.designs import AbstractDesign, _directions

SQUARE = np.log1p(1.0 / 16.0)  # of a lognormal of mean 2 and deviation 1/2
KNOWN = [
    pytest.param(Normal(2.0, 0.5), scipy.stats.norm(2.0, 0.5), id="normal"),
    pytest.param(Uniform(-2.0, 5.0), scipy.stats.uniform(-2.0, 7.0), id="uniform"),
    pytest.param(
        TruncatedNormal(1.0, 0.5, 0.5, 3.0),
        scipy.stats.truncnorm(-1.0, 4.0, 1.0, 0.5),
        id="truncated",
    ),
    pytest.param(Triangular(1.0, 0.0, 3.0), scipy.stats.triang(1 / 3, 0.0, 3.0), id="triangular"),
    pytest.param(Triangular(0.0, 0.0, 3.0), scipy.stats.triang(0.0, 0.0, 3.0), id="one side"),
    pytest.param(
        Lognormal(2.0, 0.5),
        scipy.stats.lognorm(np.sqrt(SQUARE), scale=2.0 * np.exp(-SQUARE / 2.0)),
        id="lognormal",
    ),
]
Z = np.array([-6.0, -3.0, -1.0, 0.0, 0.3, 2.0, 5.0])


def drawn(inputs, design=None):
    """A campaign of which only the inputs are asked."""
    return Campaign(lambda samples: None, inputs, lambda result, samples: {}, design=design)


@pytest.mark.parametrize("distribution, reference", KNOWN)
def test_quantiles_and_tails(distribution, reference):
    """F^-1(Phi(z)) from the nearer end, and the shares outside of an interval."""
    found = jax.vmap(distribution.from_normal)(Z)
    near = scipy.stats.norm.cdf(-np.abs(Z))
    expected = np.where(Z < 0.0, reference.ppf(near), reference.isf(near))
    # Near a limit a value is a small difference of two of size one.
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    for low, high in ((0.1, 2.9), (0.6, 1.2), (-9.0, 1.5), (1.5, 9.0)):
        share = reference.cdf(low) + reference.sf(high)
        assert distribution.outside(low, high) == pytest.approx(share, abs=1e-14)
    for place in (0.0, 0.7):
        slope = jax.grad(distribution.from_normal)(place)
        ahead, behind = (distribution.from_normal(jnp.asarray(place + h)) for h in (1e-5, -1e-5))
        assert float(slope) == pytest.approx(float(ahead - behind) / 2e-5, rel=1e-8)


def test_moments_of_what_is_new():
    for d, reference in ((p.values[0], p.values[1]) for p in KNOWN[3:]):
        assert float(d.mean) == pytest.approx(reference.mean(), rel=1e-14)
        assert float(d.deviation) == pytest.approx(reference.std(), rel=1e-14)
    die = Discrete(jnp.array([1.0, 2.0, 6.0]), jnp.array([1.0, 1.0, 2.0]))
    assert (float(die.mean), float(die.deviation) ** 2) == pytest.approx((3.75, 5.1875))
    assert die.outside(1.5, 9.0) == 0.25


def test_draws_of_lists(key):
    """The shares of 40 000 draws within five standard errors, sqrt(p q / n) <= 0.0025."""
    die = Discrete(jnp.array([6.0, 1.0, 2.0]), jnp.array([2.0, 1.0, 1.0]))
    values = Samples(jnp.array([3.0, 1.0, 2.0, 4.0]))
    keys = jax.random.split(key, 40000)
    for d, shares in ((die, {6.0: 0.5, 1.0: 0.25}), (values, {1.0: 0.25, 4.0: 0.25})):
        draws = np.asarray(jax.vmap(d.sample)(keys))
        placed = np.asarray(jax.vmap(d.from_normal)(jax.vmap(jax.random.normal)(keys)))
        for value, share in shares.items():
            assert abs(np.mean(draws == value) - share) < 5 * 0.0025
            assert abs(np.mean(placed == value) - share) < 5 * 0.0025


def test_a_cone_of_directions():
    """Uniform over the cap: the cosine is uniform from cos a to 1, the azimuth has no preference;
    the covariance is that of 200 000 draws to five standard errors."""
    cone = ConeDirection(jnp.array([1.0, 2.0, -2.0]), 0.5)
    z = np.random.default_rng(0).standard_normal((200000, 2))
    x = np.asarray(jax.vmap(cone.from_normal)(z))
    np.testing.assert_allclose(np.linalg.norm(x, axis=1), 3.0, rtol=1e-14)
    cosine = x @ np.array([1.0, 2.0, -2.0]) / 9.0
    law = scipy.stats.uniform(np.cos(0.5), 1.0 - np.cos(0.5))
    assert scipy.stats.kstest(cosine, law.cdf).pvalue > 1e-4
    e = x - np.asarray(cone.mean)
    # The fourth moments of a vector of length 3 whose side is 1.5 at most.
    np.testing.assert_allclose(e.T @ e / len(e), cone.covariance, atol=5 * 1.5**2 / np.sqrt(2e5))
    np.testing.assert_array_equal(cone.from_normal(jnp.zeros(2)), cone.vector)
    # The whole sphere: its mean is zero, and each component has a third of the square.
    sphere = np.asarray(jax.vmap(ConeDirection(jnp.array([0.0, 0.0, -1.0])).from_normal)(z))
    np.testing.assert_allclose(sphere.T @ sphere / len(z), np.eye(3) / 3.0, atol=5e-3)
    assert np.abs(sphere.mean(axis=0)).max() < 5.0 / np.sqrt(3 * 2e5)


def test_share_of_a_cone_beyond_a_limit():
    """Components of a sphere are uniform (Archimedes), the component along the axis of a cone is
    uniform from cos a to 1, and that across a narrow cone has the distribution of a disc."""
    turned = ConeDirection([1.0, 2.0, -2.0], np.pi)
    for k in range(3):
        assert turned.outside(k, -2.7, 1.2) == pytest.approx(0.05 + 0.3, rel=1e-12)
    axial = ConeDirection([0.0, 0.0, -2.0], 1.2)
    height = 1.0 - np.cos(1.2)
    # A limit that all but one in a million draws meet.
    limit = -2.0 + 2e-6 * height
    assert axial.outside(2, limit, np.inf) == pytest.approx(1e-6, rel=1e-9)
    assert axial.outside(2, -np.inf, -1.0) == pytest.approx(1.0 - 0.5 / height, rel=1e-12)
    for angle in (1e-3, 1e-6):
        x = np.array([-0.9, 0.3, 0.999])
        disc = (np.arccos(x) - x * np.sqrt(1.0 - x * x)) / np.pi
        cone = ConeDirection([0.0, 0.0, 1.0], angle)
        found = [cone.outside(0, -np.inf, float(np.sin(angle * r))) for r in x]
        np.testing.assert_allclose(found, disc, rtol=0.0, atol=angle**2 + 1e-9)
    # Both caps are wide: all directions outside of each are inside the other one.
    wide = ConeDirection([1.0, 0.0, 0.0], 2.5)
    lacking = 1.0 - np.cos(np.pi - 2.5)
    assert wide.outside(0, -np.inf, -0.7) == pytest.approx(1.7 / (2.0 - lacking), rel=1e-12)
    expected = (1.9 - lacking) / (2.0 - lacking)
    assert wide.outside(1, -np.inf, -0.9) == pytest.approx(expected, rel=1e-12)


def test_a_search_spreads_a_list_by_its_normal_number():
    """The moved number has the value of the search, in the middle of the list and at both ends, and
    is in one cell a straight map of the probabilities."""
    rare = Discrete(np.array([3.0, 0.0, 7.0, 1.0]), np.array([1e-7, 0.5, 1e-5, 0.5]))
    z = jnp.linspace(-8.0, 8.0, 4001)
    moved, factor = jax.vmap(rare.spread)(z)
    value, expected = jax.vmap(rare.searched)(z)
    np.testing.assert_array_equal(jax.vmap(rare.from_normal)(moved), value)
    np.testing.assert_allclose(factor, expected, rtol=1e-12)
    slope = scipy.stats.norm.pdf(moved) * jax.vmap(jax.grad(lambda z: rare.spread(z)[0]))(z)
    np.testing.assert_allclose(slope, factor * scipy.stats.norm.pdf(z), rtol=1e-5)


def test_correlated_inputs(key):
    covariance = np.array([[4.0, -0.9], [-0.9, 0.25]])
    joint = MultivariateNormal([1.0, -1.0], covariance)
    campaign = drawn(joint.inputs("b", "a") | {"c": Normal(0.0, 1.0)})
    x = campaign.samples(key, jnp.arange(40000))
    found = np.cov(np.stack([x["b"], x["a"], x["c"]]))
    # Each entry to five times s_i s_j sqrt((1 + r^2)/n).
    np.testing.assert_allclose(found[:2, :2], covariance, atol=5 * 4.0 * np.sqrt(2.0 / 40000))
    assert abs(found[2, 0]) < 5 * 2.0 / 200.0
    # The ranks of a copula are those of its normal numbers, whatever the marginals.
    copula = Correlated.of((Uniform(0.0, 1.0), Lognormal(2.0, 0.5)), [[1.0, 0.8], [0.8, 1.0]])
    y = drawn(copula.inputs("u", "v")).samples(key, jnp.arange(40000))
    expected = 6.0 / np.pi * np.arcsin(0.4)  # Spearman's for a normal correlation of 0.8
    assert scipy.stats.spearmanr(y["u"], y["v"])[0] == pytest.approx(expected, abs=0.02)
    # The same arguments as those of NumPy, and a factor by its own name.
    np.testing.assert_allclose(joint.covariance, covariance, rtol=1e-12)
    factor = np.array([[2.0, 0.0], [-0.45, 0.5]])
    wide = MultivariateNormal.from_factor([1.0, -1.0], factor)
    np.testing.assert_allclose(wide.covariance, factor @ factor.T, rtol=1e-12)
    np.testing.assert_allclose(wide.from_normal(jnp.ones(2)), [3.0, -0.95], rtol=1e-12)
    # A singular covariance is a law between the inputs.
    rigid = MultivariateNormal([0.0, 0.0], [[1.0, 2.0], [2.0, 4.0]])
    draw = rigid.from_normal(jnp.array([0.3, -1.2]))
    assert float(draw[1]) == pytest.approx(2.0 * float(draw[0]), rel=1e-7)


@pytest.mark.parametrize("runs", [1, 2, 7, 1000])
def test_every_layer_of_a_latin_hypercube_holds_one_run(runs, key):
    u = np.asarray(LatinHypercube(runs).uniforms(key, jnp.arange(runs), 3))
    assert u.min() >= 0.0 and u.max() < 1.0
    for column in u.T:
        assert sorted((column * runs).astype(int)) == list(range(runs))
    if runs == 1000:
        # Independent columns: a correlation beyond five standard errors would be a pattern.
        assert np.abs(np.corrcoef(u.T) - np.eye(3)).max() < 5.0 / np.sqrt(runs)


def test_direction_numbers_are_those_of_scipy():
    gray = np.arange(1024) ^ (np.arange(1024) >> 1)
    points = np.zeros((1024, 5), np.uint32)
    for bit, column in enumerate(_directions(5).T):
        points ^= ((gray >> bit) & 1).astype(np.uint32)[:, None] * column
    expected = qmc.Sobol(5, scramble=False, bits=32).random(1024)
    np.testing.assert_array_equal(points / 2.0**32, expected)


def test_scrambled_points_fill_the_cube(key):
    """Each of 1024 layers holds one of 1024 points in every column; the discrepancy is that of
    SciPy's scrambled points, and far below that of random ones."""
    u = np.asarray(Sobol().uniforms(key, jnp.arange(1024), 4))
    for column in u.T:
        assert sorted((column * 1024).astype(int)) == list(range(1024))
    reference = qmc.discrepancy(qmc.Sobol(4, rng=1).random(1024))
    assert qmc.discrepancy(u) < 1.5 * reference
    other = np.asarray(Sobol().uniforms(jax.random.key(9), jnp.arange(1024), 4))
    assert not np.any(u == other)


@pytest.mark.parametrize("design", [None, LatinHypercube(600), Sobol()])
def test_a_run_depends_on_seed_and_number_alone(design, key):
    inputs = {"b": Normal(0.0, 1.0), **ConeDirection(jnp.ones(3), 0.1).inputs("x", "y", "a")}
    campaign = drawn(inputs, design)
    every = campaign.samples(key, jnp.arange(600))
    some = jax.jit(lambda numbers: campaign.samples(key, numbers))(jnp.array([599, 3]))
    for name, x in some.items():
        # Compiled together an operation may round otherwise: the last bit, of numbers of size one.
        np.testing.assert_allclose(x, every[name][jnp.array([599, 3])], rtol=0.0, atol=1e-14)


@pytest.mark.sweep
def test_a_mean_over_even_points_is_nearer(key):
    """The mean of a smooth function of three inputs over 512 runs, beside its closed form
    E[exp(z)] = exp(1/2): both designs beat the standard error of random draws by far."""
    inputs = {name: Normal(0.0, 1.0) for name in "abc"}
    exact = 3.0 * np.exp(0.5)
    error = np.sqrt(3.0 * (np.exp(2.0) - np.exp(1.0)) / 512.0)
    for design in (LatinHypercube(512), Sobol()):
        x = drawn(inputs, design).samples(key, jnp.arange(512))
        assert abs(sum(float(jnp.mean(jnp.exp(v))) for v in x.values()) - exact) < 0.2 * error


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Triangular(4.0, 0.0, 3.0), "Triangular.mode"),
        (lambda: Lognormal(-1.0, 0.1), "Lognormal.mean"),
        (lambda: Discrete(jnp.ones(2), jnp.ones(3)), "the same number as values"),
        (lambda: ConeDirection(jnp.zeros(3), 0.1), "ConeDirection.vector"),
        (lambda: ConeDirection(jnp.ones(3), 4.0), "ConeDirection.half_angle"),
        (lambda: ConeDirection(jnp.ones(3)).inputs("a", "b"), "2 names are given for 3"),
        (lambda: MultivariateNormal([0.0, 0.0], [[1.0, 2.0], [2.0, 1.0]]), "eigen"),
        (lambda: MultivariateNormal([0.0], np.eye(2)), "covariance has the shape"),
        (lambda: MultivariateNormal.from_factor([0.0], np.ones((2, 1))), "factor has the shape"),
        (lambda: Correlated.of((Normal(0.0, 1.0),) * 2, [[1.0, 0.5], [0.4, 1.0]]), "symmetric"),
        (lambda: LatinHypercube(0), "LatinHypercube.runs"),
    ],
)
def test_bad_input_names_its_field(make, words):
    with pytest.raises(InputError, match=words):
        make()


SCENE = """
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"
[initial]
position = ["7000 km", "0 km", "0 km"]
velocity = ["0 km/s", "7.5 km/s", "1 km/s"]
[effects.point_gravity]
[times]
end = "10 min"
[dispersion]
sampling = "latin_hypercube"
outputs = [{ output = "periapsis_altitude", at_least = "300 km" }, "final.position.0"]
[dispersion.inputs]
"planet.mu" = { distribution = "samples", file = "mu.csv", column = "mu", unit = "km^3/s^2" }
"initial.position.0" = { deviation = "1 km" }
"initial.position.1" = { distribution = "triangular", low = "-1 km", high = "3 km" }
[[dispersion.correlated]]
inputs = ["initial.position.0", "initial.position.1"]
correlation = [[1, 0.6], [0.6, 1]]
[[dispersion.direction]]
of = "initial.velocity"
within = "2 deg"
"""


def test_a_file_scatters_in_every_way(tmp_path, key):
    (tmp_path / "mu.csv").write_text("name,mu\na,398600\nb,398601.5\n")
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    campaign = jaxspace.load(path).campaign(runs=64)
    assert campaign.design == LatinHypercube(64)
    assert [(name, r.low, r.high) for name, r in campaign.requirements] == [
        ("periapsis_altitude", 300.0, None)
    ]
    x = jax.jit(lambda numbers: campaign.samples(key, numbers))(jnp.arange(64))
    # The unit is converted by a factor that rounds.
    np.testing.assert_allclose(np.unique(x["planet.mu"]), [3.986e14, 3.986015e14], rtol=1e-14)
    assert np.all((x["initial.position.1"] > -1e3) & (x["initial.position.1"] < 3e3))
    # The error of a correlation of 64 runs is some 0.08; a hypercube has less.
    assert np.corrcoef(x["initial.position.0"], x["initial.position.1"])[0, 1] > 0.3
    v = np.stack([x[f"initial.velocity.{k}"] for k in range(3)])
    cosine = np.array([0.0, 7500.0, 1000.0]) @ v / np.hypot(7500.0, 1000.0) ** 2
    assert np.cos(np.deg2rad(2.0)) <= cosine.min() < np.cos(np.deg2rad(1.5))


SOBOL = (
    SCENE.partition("[dispersion]")[0]
    + """
[body]
mass = "100 kg"
[dispersion]
sampling = "sobol"
outputs = ["final.position.0"]
[dispersion.inputs]
"planet.mu" = { distribution = "lognormal", deviation = "0.1 %" }
"planet.radius" = { distribution = "discrete", values = ["6378 km", 6.4e6], weights = [1, 3] }
[[dispersion.correlated]]
inputs = ["initial.position.0", "initial.position.1"]
covariance = [[4e6, -1.2e6], [-1.2e6, 1e6]]
[[dispersion.correlated]]
inputs = ["initial.position.2", "body.mass"]
factor = [[300.0], [-0.02]]
[[dispersion.direction]]
of = "initial.velocity"
"""
)


def test_a_file_scatters_over_sobol_points(tmp_path, key):
    """Lognormal and discrete numbers, a covariance, a factor and the whole sphere. Of 1024 points
    each layer of one input holds one, so that its shares are exact."""
    path = tmp_path / "scene.toml"
    path.write_text(SOBOL)
    campaign = jaxspace.load(path).campaign()
    assert isinstance(campaign.design, Sobol)
    x = {name: np.asarray(v) for name, v in campaign.samples(key, jnp.arange(1024)).items()}
    mu, square = 3.986004418e14, np.log1p(1e-6)
    law = scipy.stats.lognorm(np.sqrt(square), scale=mu * np.exp(-square / 2.0))
    assert sorted((law.cdf(x["planet.mu"]) * 1024).astype(int)) == list(range(1024))
    values, counts = np.unique(x["planet.radius"], return_counts=True)
    assert (values.tolist(), counts.tolist()) == ([6.378e6, 6.4e6], [256, 768])
    # The error of 1024 random runs is some 4 %; that of even points is far less.
    together = np.cov(x["initial.position.0"] - 7e6, x["initial.position.1"])
    np.testing.assert_allclose(together, [[4e6, -1.2e6], [-1.2e6, 1e6]], rtol=0.02)
    # One number behind two inputs is a law between them, to the rounding of 100 kg.
    shared = x["initial.position.2"] / 300.0
    np.testing.assert_allclose(x["body.mass"], 100.0 - 0.02 * shared, rtol=1e-15)
    assert np.std(shared) == pytest.approx(1.0, rel=0.02)
    v = np.stack([x[f"initial.velocity.{k}"] for k in range(3)]) / np.hypot(7500.0, 1000.0)
    np.testing.assert_allclose(np.linalg.norm(v, axis=0), 1.0, rtol=1e-14)
    # Of random directions both would be wrong by 0.02.
    np.testing.assert_allclose(v.mean(axis=1), 0.0, atol=0.01)
    np.testing.assert_allclose(v @ v.T / 1024, np.eye(3) / 3.0, atol=0.01)


MEASURED = '{ distribution = "samples", file = "mu.csv", column = "mu", unit = "km^3/s^2" }'


@pytest.mark.parametrize(
    "old, new, words",
    [
        ('of = "initial.velocity"', 'of = "initial.velocty"', "Did you mean initial.velocity?"),
        ('"2 deg"', '"2 m"', "a unit of angle"),
        ("[0.6, 1]]", "[0.5, 1]]", "not symmetric"),
        ('inputs = ["initial.position.0"', 'inputs = ["initial.posit.0"', "initial.position.0?"),
        ('column = "mu"', 'column = "nu"', "contains no numbers in nu"),
        ('file = "mu.csv"', 'file = "no.csv"', "No such file"),
        ('"latin_hypercube"', '"latin"', "Did you mean latin_hypercube?"),
        ('"300 km"', '"300 s"', "dispersion.outputs.0.at_least"),
        (
            MEASURED,
            '{ distribution = "discrete", values = [1.0, 2.0] }',
            "mu.weights is missing: it must be a list of one or more entries, each a number of "
            "zero or more without unit",
        ),
        (
            MEASURED,
            '{ distribution = "discrete", values = [1.0, 2.0], weights = [1, -3] }',
            "mu.weights.1 is -3: it must be a number of zero or more",
        ),
        (
            MEASURED,
            '{ distribution = "discrete", weights = [1, 3] }',
            "mu.values is missing: it must be a list of one or more entries, each a number in m^3",
        ),
        ("correlation", "corelation", "Did you mean correlation?"),
    ],
)
def test_a_wrong_entry_is_named(old, new, words, tmp_path):
    (tmp_path / "mu.csv").write_text("name,mu\na,398600\nb,398601.5\n")
    path = tmp_path / "scene.toml"
    assert old in SCENE
    path.write_text(SCENE.replace(old, new, 1))
    with pytest.raises(jaxspace.io.SceneError) as raised:
        jaxspace.load(path)
    assert words in str(raised.value)


@pytest.mark.parametrize("dtype, angle", [(np.float64, 1e-8), (np.float32, 8.7e-5)])
def test_narrow_cones(dtype, angle):
    """Within a small angle a the directions are uniform over a disk of radius a: a component across
    the axis has the variance a^2/4, and cos t - 1 is 0 to -a^2/2. 8.7e-5 rad is 0.005 degrees."""
    for axis in np.eye(3):
        cone = ConeDirection(jnp.asarray(axis, dtype), jnp.asarray(angle, dtype))
        expected = angle**2 / 4.0 * (np.eye(3) - np.outer(axis, axis))
        expected += angle**4 / 12.0 * np.outer(axis, axis)
        np.testing.assert_allclose(cone.covariance, expected, rtol=1e-5)
        z = np.random.default_rng(0).standard_normal((4000, 2)).astype(dtype)
        x = np.asarray(jax.vmap(cone.from_normal)(z)).astype(float)
        across = x - np.outer(x @ axis, axis)
        # The square of the radius is uniform: its place among all is 1 - exp(-|z|^2/2).
        place = -np.expm1(-0.5 * np.sum(z.astype(float) ** 2, axis=1))
        np.testing.assert_allclose(
            np.sum(across**2, axis=1), angle**2 * place, rtol=1e-4, atol=1e-6 * angle**2
        )


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_narrow_ranges_keep_their_spread(dtype):
    """A normal distribution that is cut to a range far smaller than its deviation is uniform; a
    lognormal one with a small share d scatters by d times its mean."""
    z = jnp.asarray([-2.0, -0.7, 0.0, 0.4, 1.9], dtype)
    share = scipy.stats.norm.cdf(np.asarray(z, float))
    eps = float(np.finfo(dtype).eps)
    for low, high in ((-1.0, 1.0), (0.0, 1.0), (-1.0, 0.0)):
        cut = TruncatedNormal(dtype(0.0), dtype(1e9), dtype(low), dtype(high))
        found = jax.vmap(cut.from_normal)(z)
        np.testing.assert_allclose(found, low + (high - low) * share, atol=20.0 * eps)
        assert float(cut.variance) == pytest.approx((high - low) ** 2 / 12.0, rel=1e-5)
    # The logarithm of the mean, 34, would round by 34 eps, which here is the spread.
    narrow = Lognormal(dtype(4e14), dtype(4e14 * 30.0 * eps))
    found = np.asarray(jax.vmap(narrow.from_normal)(z)).astype(float) / float(narrow.mean) - 1.0
    np.testing.assert_allclose(found, 30.0 * eps * np.asarray(z, float), atol=2.0 * eps)


def test_rare_shares_keep_their_digits():
    """The shares that a limit refuses, in closed form: of a uniform distribution the width of what
    is cut, of a triangular one x (2 - x) and of a narrow cut normal one the ratio of the widths."""
    assert Uniform(0.0, 1.0).outside(1e-20, 2.0) == pytest.approx(1e-20, rel=1e-12)
    assert Triangular(0.0, 0.0, 1.0).outside(1e-14, 2.0) == pytest.approx(2e-14, rel=1e-12)
    assert Triangular(1.0, 0.0, 1.0).outside(-1.0, 1.0 - 2.0**-40) == pytest.approx(
        2.0**-39, rel=1e-9
    )
    cut = TruncatedNormal(0.0, 1e9, -1.0, 1.0)
    assert cut.outside(-1.0, 0.5) == pytest.approx(0.25, rel=1e-9)
    assert Uniform(-1.0, 0.0).from_normal(jnp.asarray(7.0)) == pytest.approx(
        -scipy.stats.norm.sf(7.0), rel=1e-12
    )


class Border(AbstractDesign):
    """A design whose places lie on the border of the unit cube."""

    def uniforms(self, key, numbers, dimensions):
        u = (numbers % 2).astype(jnp.result_type(float))
        return jnp.broadcast_to(u[:, None], (*numbers.shape, dimensions))


@pytest.mark.parametrize("x64", [True, False])
def test_no_draw_is_infinite_or_impossible(x64, key):
    """Every distribution at the borders of the unit cube, in both precisions; of a list no value of
    weight zero. The last of 2^24 layers ends at 1 in single precision."""
    with jax.enable_x64(x64):
        dtype = jnp.result_type(float)
        lists = jnp.asarray([7.0, 1.0, 8.0, 3.0, 9.0], dtype), jnp.asarray([0.0, 1, 0, 2, 0], dtype)
        inputs = {
            "normal": Normal(0.0, 1.0),
            "uniform": Uniform(-0.3, 0.1),
            "cut": TruncatedNormal(0.0, 1.0, -9.0, 9.0),
            "triangular": Triangular(0.1, 0.0, 0.7),
            "lognormal": Lognormal(1.0, 0.1),
            "list": Discrete(*lists),
            "samples": Samples(lists[0]),
            **ConeDirection(jnp.ones(3, dtype), 0.1).inputs("x", "y", "z"),
        }
        x = drawn(inputs, Border()).samples(key, jnp.arange(2))
        last = 2**24
        numbers = jnp.arange(4096)
        u = LatinHypercube(last).uniforms(key, numbers, 4)
        assert 0.0 < float(u.min()) and float(u.max()) < 1.0
        for seed in range(3):
            u = LatinHypercube(1).uniforms(jax.random.key(seed), jnp.arange(20000), 20)
            assert 0.0 < float(u.min()) and float(u.max()) < 1.0
        far = jnp.asarray([-40.0, -9.0, 9.0, 40.0], dtype)
        some = jax.vmap(inputs["list"].from_normal)(far)
        shares = jnp.asarray([0.0, 1.0 - float(jnp.finfo(dtype).epsneg), 1.0], dtype)
        places = _place(lists[1], shares, 1.0 - shares)
    for name, v in x.items():
        assert v.dtype == dtype and np.all(np.isfinite(v)), name
    assert np.all((x["uniform"] >= np.asarray(-0.3, dtype)) & (x["uniform"] <= dtype.type(0.1)))
    np.testing.assert_array_equal(some, [1.0, 1.0, 3.0, 3.0])
    np.testing.assert_array_equal(places, [1, 3, 3])


def test_a_small_weight_at_either_end_of_a_list():
    """In single precision 1 + 1e-9 is 1: the value has its share of the numbers at its end."""
    with jax.enable_x64(False):
        for weights, sign in (([1.0, 1e-9], 1.0), ([1e-9, 1.0], -1.0)):
            d = Discrete(jnp.asarray([0.0, 1.0]), jnp.asarray(weights))
            border = scipy.stats.norm.isf(1e-9)
            z = sign * jnp.asarray([border - 0.01, border + 0.01])
            found = np.asarray(jax.vmap(d.from_normal)(z))
            np.testing.assert_array_equal(found, [0.0, 1.0] if sign > 0.0 else [1.0, 0.0])


def test_sobol_points_beyond_2_24_are_new(key):
    """Every 2^m points from a multiple of 2^m on fill the layers of each column, and differ from
    the first ones."""
    first = 2**24
    early, late = (np.asarray(Sobol().uniforms(key, n + jnp.arange(256), 3)) for n in (0, first))
    assert not np.any(early == late)
    for column in late.T:
        assert sorted((column * 256).astype(int)) == list(range(256))
    u = Sobol().uniforms(key, jnp.asarray([5, 5 + 2**24, 5 + 2**30]), 3)
    assert len(np.unique(np.asarray(u)[:, 0])) == 3


def test_too_many_dimensions_for_sobol_points(key):
    with pytest.raises(InputError, match="Sobol points with 21202 dimensions are required"):
        Sobol().uniforms(key, jnp.arange(2), 21202)
