"""What `method="auto"` stands for."""

import json
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import J2, MU, RADIUS, Integrated, orbit, rocket_scene, rocket_state

from jaxspace import Scene, simulate, simulate_batch
from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import BodyState, Load, RigidBody
from jaxspace.core import InputError
from jaxspace.integration import select_method
from jaxspace.integration._selection import RULES
from jaxspace.integration.config import resolve
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy
from jaxspace.solvers import DOP853, RKN1210, Tsit5

GRAVITY = (PointGravity(MU), Oblateness(MU, J2, RADIUS))
TIDE = Custom(
    lambda t, y, body: Load(acceleration_N=-1e-9 * jnp.sin(t) * y.position),
)
DRAG = Custom(
    lambda t, y, body: Load(acceleration_N=-1e-9 * y.velocity),
)
INNER = Custom(
    jax.jit(lambda t, y, body: Load(acceleration_N=y.position)),
)


@pytest.mark.parametrize(
    ("system", "state", "rtol", "method"),
    [
        (TwoBody(MU), orbit(), 1e-4, str),
        (TwoBody(MU), orbit(), 1e-9, str),
        (Scene(GRAVITY), orbit(), 1e-4, Tsit5),
        (Scene(GRAVITY), orbit(), 1e-5, RKN1210),
        (Scene(GRAVITY), orbit(), 1e-12, RKN1210),
        (Scene((*GRAVITY, TIDE)), orbit(), 1e-9, RKN1210),
        (Scene((*GRAVITY, TIDE), RigidBody(mass=2.0)), orbit(), 1e-9, RKN1210),
        (Scene((*GRAVITY, DRAG)), orbit(), 1e-9, DOP853),
        # A function that is compiled as a whole does not mislead it.
        (Scene((*GRAVITY, INNER)), orbit(), 1e-9, DOP853),
        (Scene(GRAVITY, RigidBody(mass=2.0), ("mass",)), orbit(mass=jnp.array(2.0)), 1e-9, DOP853),
        (rocket_scene(), rocket_state(), 1e-9, DOP853),
    ],
)
def test_rules(system, state, rtol, method):
    found = select_method(system, state, rtol)
    assert isinstance(found, method)
    lanes = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), state)
    assert isinstance(select_method(system, lanes, rtol), method)


def test_a_tolerance_written_under_jit_is_known_to_the_rules():
    methods = []

    def run(y):
        result = simulate(Integrated(TwoBody(1.0)), y, jnp.array([0.0, 0.1]), accuracy=1e-3)
        methods.append(result.config.method)
        return result.final

    jax.eval_shape(run, BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0])))
    assert methods == [Tsit5()]


def test_a_loose_run_takes_the_method_of_tighter_ones():
    """So that runs at several tolerances are one program."""

    def method(accuracy):
        return type(resolve(Scene(GRAVITY), orbit(), accuracy).method)

    assert method(Accuracy(1e-4)) is Tsit5
    tight = method(Accuracy(1e-9))
    assert tight is method(Accuracy(1e-4, chosen_at=9e-6)) is method(Accuracy(1e-9, chosen_at=1e-4))
    with pytest.raises(InputError, match="Accuracy.chosen_at is -1: it must be positive"):
        Accuracy(chosen_at=-1)


def test_a_closed_form_stands_before_every_method():
    assert select_method(TorqueFreeBody([1.0, 2.0, 3.0]), BodyState(), 1e-9) == "closed_form"


def test_a_result_says_which_method_ran_and_takes_another():
    ts = np.array([0.0, 600.0])
    run = simulate(Scene(GRAVITY), orbit(), ts, accuracy=1e-10)
    assert isinstance(run.config.method, RKN1210)
    other = simulate(Scene(GRAVITY), orbit(), ts, accuracy=Accuracy(rtol=1e-10, method=DOP853()))
    assert isinstance(other.config.method, DOP853)
    np.testing.assert_allclose(run.final.position, other.final.position, atol=1e-9 * 6.6e6)
    batch = simulate_batch(
        Scene(GRAVITY), jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), orbit()), ts
    )
    assert isinstance(batch.config.method, RKN1210)
    assert float(jnp.max(jnp.abs(batch.error().position))) < 1e-2


ROOT = Path(__file__).parents[2]
CHOOSING = (ROOT / "docs" / "howto" / "choosing_an_integrator.md").read_text()
ROWS = re.findall(r"^\| (.*?) \| (.*?) \| (.*?) \|$", CHOOSING.partition("\n## ")[0], re.MULTILINE)
# Its figures with what follows them, so that no other number is taken for one.
FIGURE = re.compile(r"(?<!\()\b[\d,]*\d(?:\.\d+)?(?= (?:evaluations|runs|s\b|\(\d))")
ERROR = re.compile(r"\((\d\.\de-\d+)\)")


def test_the_table_of_the_page_has_the_rules():
    """In their order, each with its method."""
    _, *rows = ROWS
    assert len(rows) == len(RULES)
    for (_, method, _), rule in zip(rows, RULES, strict=True):
        name = rule.method if isinstance(rule.method, str) else type(rule.method).__name__
        assert method == (
            "none: the solution is evaluated" if name == "closed_form" else f"`{name}`"
        )


@pytest.mark.parametrize("row", ROWS[1:], ids=lambda row: row[1].strip("`"))
def test_the_evidence_of_a_rule_is_measured(row):
    """Each figure is in the results that the row or the paragraph before links, rounded."""
    evidence = row[2]
    pages = re.findall(r"benchmarks\.md#([\w-]+)", evidence)
    measured = [
        value
        for page in {*pages, "which-method"}
        for file in ROOT.glob(f"benchmarks/results/*/{page.replace('-', '_')}.json")
        for case in json.loads(file.read_text())["rows"].values()
        for value in case.values()
    ]
    figures = FIGURE.findall(evidence) + ERROR.findall(evidence)
    assert figures
    for text in figures:
        digits = 3 if "," in text else len(re.sub(r"e.*|\.", "", text))
        number = float(text.replace(",", ""))
        assert any(float(f"{x:.{digits - 1}e}") == number for x in measured), text
