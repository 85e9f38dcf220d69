"""Other libraries beside this one: the same inputs, each as accurate as it goes."""

from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import (
    _measure,
    eccentric_orbit,
    free_body,
    kepler,
    low_orbits,
    of_others,
    top,
    torqued_body,
)
from benchmarks import lambert as lambert_pairs
from benchmarks.eccentric_orbit import START
from jaxspace import Accuracy, BodyState, simulate_batch
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.lambert import lambert
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853, RKN1210, AdaptiveRegularised

from . import page
from ._row import JUDGED, Row, compared

ABOUT = """## Comparison with other libraries

The other libraries are run on the same inputs, from their wheels: the first orbits and bodies of
the benchmarks, which list the speeds. Each uses its tightest tolerance. The allowed difference is
the growth of rounding errors along the motion and does not include a tolerance. The gravity field
of degree and order 5 is that of astrojax, used as an effect, because this library does not include
one.
"""
FEW = 16
GROWN = {
    "orbit": JUDGED
    + "1e-11 of the distance: rounding errors grow with the square of about fifteen revolutions",
    "body": JUDGED + "1e-11: rounding errors over about a hundred rotations",
    "top": JUDGED
    + "1e-9: rounding errors over a hundred nutations, some of which pass the vertical",
    "eccentric": JUDGED
    + "1e-9 of the semi-major axis: rounding errors over a hundred periapsis passages",
    "flow": JUDGED + "1e-12 of the distance",
    "transfer": JUDGED + "1e-12 of the speed",
    "condition": "a hundred rounding errors of the initial state, the limit of the fuzz tests, "
    "amplified by the derivatives of two-body motion",
}
# The bound of the fuzz tests, whatever the difference is.
FUZZ_BOUND = 100.0 * np.finfo(float).eps
BY_CONDITION = ("position, relative to its length", "condition")


def tight(system, y0, span: float, method) -> BodyState:
    """The ends of runs at a tolerance of 1e-13."""
    accuracy = Accuracy(1e-13, method=method, max_steps=2**16)
    return simulate_batch(system, y0, jnp.array([0.0, span]), accuracy=accuracy, throw=True).final


def first(tree, count: int = FEW):
    """The first runs of a batch."""
    return jax.tree.map(lambda x: x[..., :count], tree)


def relative(
    ours, theirs, peer: str, what: str, quantity: str, why: str, allowed: float | np.ndarray
) -> Row:
    """The row of vectors (components, runs): the component and run that differ most, each vector in
    units of its length."""
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    size = np.linalg.norm(theirs, axis=0)
    return compared(
        ours / size,
        theirs / size,
        allowed,
        what=what,
        source=f"{peer} {version(peer)}",
        quantity=quantity,
        why=GROWN[why],
    )


def orbits() -> list[Row]:
    """A day of low orbits under oblateness."""
    y0 = first(low_orbits.orbits())
    states = np.concatenate([y0.position, y0.velocity])
    ours = tight(low_orbits.SCENE, y0, low_orbits.DAY, RKN1210()).position
    words = ("Low orbits with J2 over a day", "position, relative to its length", "orbit", 1e-11)
    theirs = _measure.heyoka_ends(low_orbits.equations, states, low_orbits.DAY, 1e-18)()[:3]
    found = [relative(ours, theirs, "heyoka", *words)]
    theirs = low_orbits.by_scipy(states, "DOP853", 1e-13)()
    found.append(relative(first(ours, low_orbits.ALONE), theirs, "scipy", *words))
    if (astrojax := _measure.optional("astrojax")) is not None:
        theirs = low_orbits.by_astrojax(astrojax, y0, 1e-13)()
        found.append(relative(ours, theirs, "astrojax", *words))
    return found


def rotations() -> list[Row]:
    """A free body, a heavy top and a body in the gravity gradient, beside heyoka."""
    found = []
    for module, system, what, why, allowed in (
        (free_body, free_body.BODY, "Free body over a hundred precessions", "body", 1e-11),
        (top, top.TOP, "Heavy tops over a hundred nutations", "top", 1e-9),
    ):
        start = first(module.starts())
        y0 = BodyState(omega=jnp.asarray(start[:3]), attitude=Quaternion(jnp.asarray(start[3:])))
        span = free_body.SPAN
        if module is top:
            span = 100.0 * float(jnp.mean(top.TOP.nutation(y0).period))
        theirs = _measure.heyoka_ends(module.equations, start, span, 1e-18)()
        ends = tight(system, y0, span, DOP853())
        ours = {"integrated": ends}
        if (closed := system.closed_form()) is not None:
            ours["closed form"] = closed.flow(jnp.full(FEW, span), y0)
        for how, end in ours.items():
            found.append(
                relative(
                    end.attitude.wxyz,
                    theirs[3:],
                    "heyoka",
                    f"{what}, {how}",
                    "quaternion",
                    why,
                    allowed,
                )
            )
    start, span = torqued_body.starts(torqued_body.RATE), free_body.SPAN / torqued_body.RATE
    start = first(start)
    parts = (jnp.asarray(start[a:b]) for a, b in ((0, 3), (3, 6), (6, 9), (9, 13)))
    r, v, omega, q = parts
    end = tight(torqued_body.SCENE, BodyState(r, v, Quaternion(q), omega), span, DOP853())
    theirs = _measure.heyoka_ends(torqued_body.equations, start, span, 1e-18)()
    what = "Body tumbling in the gravity gradient"
    words = (what, "quaternion", "body", 1e-11)
    return [*found, relative(end.attitude.wxyz, theirs[9:], "heyoka", *words)]


def eccentric() -> list[Row]:
    """A hundred revolutions at an eccentricity of 0.95."""
    ours = eccentric_orbit.ours(AdaptiveRegularised(), 1e-13)
    what = "Orbit of e = 0.95 over a hundred revolutions"
    exact = eccentric_orbit.by_heyoka(1e-19, np.longdouble)
    allowed = 1e-9 / np.linalg.norm(START[:3])
    words = ("position, relative to its length", "eccentric", float(allowed))
    j2 = eccentric_orbit.J2
    pairs = [
        (0.0, eccentric_orbit.by_rebound(0.0), "rebound", what),
        (j2, exact(j2), "heyoka", f"{what}, with J2"),
    ]
    return [relative(ours(x), theirs, peer, name, *words) for x, theirs, peer, name in pairs]


def closed_forms() -> list[Row]:
    """Kepler's and Lambert's problems of the benchmarks, beside pykep."""
    found = []
    r, v, t = first(kepler.states(), 256)
    if peer := _measure.pykep("propagate_lagrangian", r, v, t):
        ours = kepler_flow(r, v, t, 1.0)[0]
        words = (
            "Ellipses and hyperbolas, closed form",
            "position, relative to its length",
            "flow",
            1e-12,
        )
        found.append(relative(ours, peer[1], "pykep", *words))
    start, end, duration = first(lambert_pairs.pairs(), 256)
    if peer := _measure.pykep("lambert_problem", start, end, duration):
        ours = lambert(start, end, duration, 1.0)[0]
        words = ("Lambert's problem", "velocity, relative to its length", "transfer", 1e-12)
        found.append(relative(ours, peer[1], "pykep", *words))
    return found


def days_of_brahe() -> list[Row]:
    """Ellipses a day later, beside brahe."""
    r, v = of_others.orbits(FEW)
    theirs = of_others.by_brahe(_measure.optional("brahe"), np.concatenate([r, v]))()
    ours = kepler_flow(r, v, of_others.DAY, of_others.MU)[0]
    what = "Ellipses a day later, closed form"
    allowed = FUZZ_BOUND * condition(r, v, of_others.DAY)
    return [relative(ours, theirs[:3], "brahe", what, *BY_CONDITION, allowed)]


def fields_of_brahe() -> list[Row]:
    """A low revolution in two fields, beside brahe's method of order 12."""
    brahe, y0 = _measure.optional("brahe"), of_others.low(FEW)
    assert y0.position is not None and y0.velocity is not None
    allowed = FUZZ_BOUND * condition(y0.position, y0.velocity, of_others.REVOLUTION)
    fields = [("J2", of_others.oblate, "Low revolution under J2")]
    if _measure.optional("astrojax") is not None:
        what = "Low revolution in the field JGM-3 of degree and order 5"
        fields.append(("5 x 5", of_others.of_degree_five, what))
    found = []
    for field, scene, what in fields:
        ours = of_others.revolutions(scene(), y0, 1e-13)
        theirs = of_others.revolutions_of_brahe(brahe, y0, field, 1e-13)()
        found.append(relative(ours, theirs, "brahe", what, *BY_CONDITION, allowed))
    return found


def condition(r, v, span: float) -> np.ndarray:
    """How many times larger a relative change of the position or of the velocity at the start is at
    the end of two-body motion, at most, (runs,)."""
    columns = [
        jax.jvp(lambda r, v: kepler_flow(r, v, span, of_others.MU)[0], (r, v), aside)[1]
        for k in range(3)
        for unit in (jnp.zeros_like(r).at[k].set(1.0),)
        for aside in (
            (unit * jnp.linalg.norm(r, axis=0), 0.0 * v),
            (0.0 * r, unit * jnp.linalg.norm(v, axis=0)),
        )
    ]
    end = kepler_flow(r, v, span, of_others.MU)[0]
    return np.linalg.norm(np.stack(columns), axis=(0, 1)) / np.linalg.norm(end, axis=0)


PARTS: dict[Callable[[], list[Row]], tuple[str, ...]] = {
    orbits: ("heyoka", "scipy"),
    rotations: ("heyoka",),
    eccentric: ("heyoka", "rebound"),
    closed_forms: ("pykep",),
    days_of_brahe: ("brahe",),
    fields_of_brahe: ("brahe",),
}


def installed(name: str) -> bool:
    """Whether a peer is there."""
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


def rows() -> list[Row]:
    """The rows of the peers that are installed, and those of the record for the others."""
    found = [row for part, needed in PARTS.items() if all(map(installed, needed)) for row in part()]
    there = {(row.what, row.source.partition(" ")[0]) for row in found}
    old = page.stored("peers")
    return found + [x for x in old if (x.what, x.source.partition(" ")[0]) not in there]
