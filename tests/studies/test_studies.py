"""Studies of a run: what its accuracy costs, and which of its effects matter, against closed forms
and independent runs."""

import dataclasses
import math
import sys
from typing import final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_run import run
from systems import J2, MU, RADIUS, SAMPLES, orbit
from test_solvers_exponential import Gyrocompass

from jaxspace import Accuracy, BodyState, Event, Mission, Phase, Scene, simulate
from jaxspace.bodies import Load, RigidBody
from jaxspace.core import AbstractSystem, InputError, Scalar
from jaxspace.integration import eligible_methods, select_method
from jaxspace.io import catalog
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.orbits.outputs import speed_error
from jaxspace.plots import accuracy_cost_figure, effect_budget_figure
from jaxspace.scene import Custom, Scaled
from jaxspace.simulation import SimulationError
from jaxspace.solvers import (
    DOP853,
    RKN1210,
    AdaptiveRegularised,
    ExponentialRosenbrock,
    Regularised,
    Tsit5,
)
from jaxspace.studies import AccuracyCost, EffectBudget, accuracy_cost, effect_budget
from jaxspace.studies._cost_methods import default_methods, methods_by_name, tolerances_of
from jaxspace.studies.budget_table import Influence
from jaxspace.studies.cost_table import Cost, price_table

BY_NAME = {s.name: s for s in SAMPLES}
every = pytest.mark.parametrize("name", BY_NAME)
# The budget measures the change of the final position.
SCENES = [s.name for s in SAMPLES if isinstance(s.system, Scene) and s.state.position is not None]
QUICK = Accuracy(rtol=1e-8, method=Tsit5())
OBLATE = Scene((PointGravity(MU), Oblateness(MU, J2, RADIUS)))


def times(name):
    return jnp.array([0.0, BY_NAME[name].span])


# A closed form, breaks and a Lagrangian; of the others only what is integrated differs.
KINDS = ("two_body", "burning_stage", "double_pendulum")


@pytest.mark.parametrize(
    "name", [n if n in KINDS else pytest.param(n, marks=pytest.mark.sweep) for n in BY_NAME]
)
def test_accuracy_cost_of_every_system(name):
    """A tighter tolerance costs more and errs less; a run is as far off as the table says, by an
    independent integration."""
    s = BY_NAME[name]
    cost = accuracy_cost(
        s.system,
        s.state,
        times(name),
        tolerances=(1e-5, 1e-8),
        methods=[Tsit5()],
        precisions=["float64"],
    )
    loose, tight = cost.rows
    assert (loose.tolerance, tight.tolerance) == (1e-5, 1e-8)
    assert tight.evaluations > loose.evaluations > 0 and tight.steps > loose.steps > 0
    # A thousandth of the tolerance, at order 5; a tenth of that gain is certain. The estimate is
    # that of a run ten times looser than the reference, which is a hundred times tighter than this
    # one.
    assert cost.reference_error < 0.5 * tight.error and tight.error < 1e-2 * loose.error
    assert min(loose.seconds, tight.seconds, loose.compile_seconds) > 0.0 and not tight.failure
    exact = jax.tree.map(lambda x: x[..., -1], run(s.system, s.state, [0.0, s.span], rtol=3e-14))
    result = simulate(s.system, s.state, times(name), accuracy=Accuracy(rtol=1e-5, method=Tsit5()))
    ends = zip(jax.tree.leaves(result.final), jax.tree.leaves(exact), strict=True)
    # Two programs round differently, and the control of the steps makes more of it.
    np.testing.assert_allclose(
        loose.error, max(np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in ends), rtol=0.05
    )
    for quantity, drift in result.drift().items():
        np.testing.assert_allclose(loose.drift[quantity], drift.max(), rtol=0.05, atol=1e-12)


def check_every_row(cost):
    """Every row is good and within its tolerance, and has a gradient; so far as float32 goes."""
    assert {r.precision for r in cost.rows} == {"float64", "float32"}
    assert any("float32: tolerances below 1.9e-06 are left out" in note for note in cost.notes)
    assert not any("does not run" in note for note in cost.notes)
    for r in cost.rows:
        assert not r.failure and r.gradient_seconds > 0.0
        if r.precision == "float64":
            # Single steps within the tolerance add up; derivatives err some ten times more.
            allowed = 1e-10 if r.tolerance is None else 1e3 * r.tolerance
            assert r.error < allowed and r.gradient_error < 10.0 * allowed
    words = str(cost)
    for word in ("DOP853", "Tsit5", "float32", "gradient error", "to compile"):
        assert word in words


@pytest.mark.sweep
@every
def test_every_method_and_precision_of_every_system(name):
    s = BY_NAME[name]
    tolerances = (1e-5, 1e-7, 1e-9)
    check_every_row(
        accuracy_cost(
            s.system, s.state, times(name), tolerances=tolerances, gradient=True, repeats=1
        )
    )


class Swing(eqx.Module):
    angle: Scalar
    rate: Scalar


@final
class Spring(AbstractSystem):
    """x'' = -x, which declares no closed form."""

    def vector_field(self, t, y):
        return Swing(y.rate, -y.angle)

    def invariants(self, t, y):
        return {"energy": 0.5 * (y.rate * y.rate + y.angle * y.angle)}


@pytest.mark.sweep
def test_every_method_and_precision():
    """By default those that "auto" may take: here DOP853 and Tsit5. The table's errors are those
    against the closed form, which it does not know: x = cos t + 2 sin t."""
    y0 = Swing(jnp.array(1.0), jnp.array(2.0))
    cost = accuracy_cost(
        Spring(), y0, jnp.array([0.0, 3.0]), tolerances=(1e-5, 1e-9), gradient=True, repeats=1
    )
    check_every_row(cost)
    assert set(cost.methods) == {"DOP853", "Tsit5"}
    run = simulate(Spring(), y0, jnp.array([0.0, 3.0]), accuracy=Accuracy(1e-5, method=Tsit5()))
    exact = (np.cos(3.0) + 2.0 * np.sin(3.0), 2.0 * np.cos(3.0) - np.sin(3.0))
    error = max(
        abs(float(a) / b - 1.0) for a, b in zip(jax.tree.leaves(run.final), exact, strict=True)
    )
    loose = next(r for r in cost.rows if (r.method, r.tolerance) == ("Tsit5", 1e-5))
    # Two programs round differently, and the control of the steps makes more of it.
    assert loose.error == pytest.approx(error, rel=0.05)
    assert loose.drift["energy"] == pytest.approx(float(run.drift()["energy"][-1]), rel=0.05)


def test_the_methods_are_those_that_auto_may_take_and_a_file_may_name():
    allowed = {"closed_form", *catalog().methods}
    for s in SAMPLES:
        methods = eligible_methods(s.system, s.state, (1e-4, 1e-12))
        names = {m if isinstance(m, str) else type(m).__name__ for m in methods}
        assert {"DOP853", "Tsit5"} <= names <= allowed
        assert ("closed_form" in names) == (s.system.closed_form() is not None)
        for rtol in (1e-4, 1e-12):
            assert select_method(s.system, s.state, rtol) in methods
    assert RKN1210() in eligible_methods(TwoBody(MU), orbit(), (1e-9,))


@pytest.mark.sweep
def test_the_methods_by_default_are_such_as_may_be_named():
    """Also those of a long eccentric orbit, whose steps are in variables of the method."""
    scene = Scene((PointGravity(MU), Oblateness(MU, RADIUS, J2)))
    y0 = BodyState([7e6, 0.0, 0.0], [0.0, 9e3, 3e3])
    ts = jnp.array([0.0, 10.0 * 86400.0])
    methods = default_methods(scene, y0, ts, (1e-6, 1e-12))
    assert AdaptiveRegularised() in methods
    by_name = methods_by_name(scene, y0, ts, methods, 1e-12)
    assert list(by_name.values()) == list(methods)
    rows = tolerances_of(AdaptiveRegularised(), scene, y0, [1e-6, 1e-12])
    assert rows == [1e-6, 1e-12]


def test_fixed_steps_have_one_row_and_no_tolerance():
    scene = Scene([PointGravity(MU)])
    method = Regularised(steps=48)
    ts = jnp.array([0.0, 5400.0])
    cost = accuracy_cost(
        scene, orbit(), ts, tolerances=(1e-4, 1e-8), methods=[method], precisions=["float64"]
    )
    (row,) = cost.rows
    assert row.method == f"Regularised({method.steps} steps)" and row.tolerance is None
    # Of order 8 with some 48 steps of a revolution: (2 pi / 48)^8 = 9e-8, over 8!.
    assert 0.0 < row.error < 1e-8 and row.steps == method.steps and not row.failure
    found = cost.cheapest(1e-8)
    assert found.method == method
    assert simulate(scene, orbit(), ts, accuracy=found).config.method == method


@pytest.mark.sweep
def test_auto_of_a_mission_is_shown_where_it_takes_what_was_measured():
    """By a closed form and by RKN1210. Above 1e-5 it would take Tsit5 for the second phase."""
    free = Phase(Scene([PointGravity(MU)]), 300.0, name="free")
    mission = Mission([free, Phase(OBLATE, 300.0, name="oblate")])
    cost = accuracy_cost(
        mission,
        orbit(),
        tolerances=(1e-4, 1e-8),
        methods=["auto"],
        precisions=["float64"],
        repeats=1,
    )
    (row,) = cost.rows
    assert (row.method, row.tolerance) == ("auto", 1e-8)
    # As in `check_every_row`.
    assert row.error < 1e-5 and not row.failure
    assert cost.cheapest(1e-5).method == "auto"


def test_a_constant_of_double_precision_runs_in_single_precision():
    """A user's effect holds numbers of float64, here 1 m/s^2 along x: the row of float32 is there,
    and has its digits. x = 1 + t^2/2 is 51 m after 10 s."""
    y0 = BodyState(jnp.array([1.0, 2.0, 3.0]), jnp.zeros(3))
    with jax.numpy_dtype_promotion("standard"):
        cost = accuracy_cost(
            Scene([wind(1.0)]),
            y0,
            jnp.array([0.0, 10.0]),
            tolerances=(1e-5,),
            methods=[Tsit5()],
            precisions=["float32"],
            repeats=1,
        )
    assert cost.notes == ()
    (row,) = cost.rows
    # Some ten steps, each within 1e-5 and rounded to 6e-8.
    assert row.precision == "float32" and row.error < 1e-5 and not row.failure


@pytest.mark.sweep
def test_closed_form_is_a_method_and_the_reference():
    cost = accuracy_cost(
        TwoBody(MU),
        orbit(),
        jnp.array([0.0, 5400.0]),
        tolerances=(1e-9,),
        methods=[DOP853(), "closed_form"],
        gradient=True,
        repeats=1,
    )
    assert cost.reference == "the closed form" and cost.reference_error < 1e-12
    exact = next(r for r in cost.rows if r.method == "closed_form" and r.precision == "float64")
    assert exact.tolerance is None and exact.error < 1e-12
    single = next(r for r in cost.rows if r.method == "closed_form" and r.precision == "float32")
    assert 1e-9 < single.error < 1e-5
    assert cost.cheapest(1e-11).method == "auto"
    tight = next(r for r in cost.rows if r.method == "DOP853" and r.tolerance == 1e-9)
    assert tight.gradient_error < 1e-7


def table(errors, seconds, failure=""):
    """A table by hand, of DOP853 at 1e-4, 1e-5, ..."""
    rows = [
        Cost(
            "DOP853",
            "float64",
            10.0 ** -(4 + k),
            e,
            s,
            1.0,
            100,
            10,
            2048,
            {"energy": 1e-9},
            failure=failure,
        )
        for k, (e, s) in enumerate(zip(errors, seconds, strict=True))
    ]
    return AccuracyCost(tuple(rows), "the closed form", 1e-13, "float64", (), {"DOP853": DOP853()})


def test_cheapest_is_the_quickest_that_is_good_enough():
    cost = table([1e-3, 1e-6, 1e-7, 1e-9], [1.0, 2.0, 1.5, 3.0])
    assert cost.cheapest_row(1e-2).tolerance == 1e-4
    assert cost.cheapest_row(1e-6).tolerance == pytest.approx(
        1e-6
    )  # tighter, and quicker all the same
    found = cost.cheapest(1e-8)
    assert float(found.rtol) == pytest.approx(1e-7) and isinstance(found.method, DOP853)


def test_cheapest_says_what_was_reached():
    with pytest.raises(
        InputError, match=r"error is 1e-12: it must be at least 1e-09, .*DOP853 at 1e-05 in float64"
    ):
        table([1e-3, 1e-9], [1.0, 2.0]).cheapest(1e-12)
    with pytest.raises(InputError, match="error is -1: it must be positive"):
        table([1e-3], [1.0]).cheapest(-1.0)
    with pytest.raises(InputError, match="in which no run of the table succeeded"):
        table([1e-3], [1.0], failure="It fell.").cheapest()
    # No error is known better than that of the reference.
    with pytest.raises(InputError, match="at least 1e-13"):
        table([1e-16], [1.0]).cheapest(1e-14)


def test_the_table_is_plain_and_frozen():
    cost = table([1e-3, math.nan], [1.0, 2e-5], failure="It fell.")
    with pytest.raises(dataclasses.FrozenInstanceError):
        cost.rows = ()  # pyright: ignore
    words = str(cost)
    assert (
        "1.0e-03*" in words
        and "DOP853 at 1e-04, 1e-05 in float64: It fell." in words
        and "20 us" in words
        and "2 KiB" in words
    )
    widths = {len(line) for line in words.splitlines()[:3]}
    assert len(widths) == 1


BAD_COST = [
    ({"tolerances": ()}, "tolerances is empty"),
    ({"tolerances": (-1e-6,)}, "tolerances is -1e-06: it must be positive"),
    ({"tolerances": (1e-17,)}, "tolerances contains 1e-17: it must be at least"),
    ({"methods": ["euler"]}, "methods contains 'euler': it must contain solvers"),
    ({"methods": [diffrax.Euler()]}, "methods contains Euler.*an error estimate"),
    ({"methods": ["closed_form"]}, "which Scene does not have"),
    (
        {"precisions": ["float16"]},
        r"precisions is \('float16',\): it must contain one or both of float64, float32",
    ),
    ({"repeats": 0}, "repeats is 0: it must be positive"),
]


@pytest.mark.parametrize("wrong, words", BAD_COST)
def test_accuracy_cost_refuses(wrong, words):
    with pytest.raises(InputError, match=words):
        accuracy_cost(OBLATE, orbit(), jnp.array([0.0, 60.0]), **wrong)


def test_studies_refuse_what_is_no_run():
    with pytest.raises(InputError, match="ts changes direction"):
        accuracy_cost(OBLATE, orbit(), jnp.array([0.0, 60.0, 30.0]))
    with pytest.raises(InputError, match="y0.position is"):
        effect_budget(
            OBLATE, BodyState(jnp.array([jnp.nan, 0.0, 0.0]), jnp.ones(3)), jnp.array([0.0, 60.0])
        )
    with (
        jax.enable_x64(False),
        pytest.raises(InputError, match=r"the reference requires float64"),
    ):
        accuracy_cost(OBLATE, orbit(), jnp.array([0.0, 60.0]))


def test_scaled_at_one_is_the_effect_and_at_zero_none():
    s = BY_NAME["burning_stage"]
    scene = s.system

    def scaled(factor):
        return Scene([Scaled(e, factor) for e in scene.effects], scene.body, scene.parts)

    t = jnp.array(3.0)
    for a, b in zip(
        jax.tree.leaves(scaled(1.0).loads(t, s.state)),
        jax.tree.leaves(scene.loads(t, s.state)),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)
    assert all(not np.any(x) for x in jax.tree.leaves(scaled(0.0).loads(t, s.state)))
    np.testing.assert_array_equal(scaled(0.5).breaks(), scene.breaks())
    half = Scene([Scaled(PointGravity(MU), 0.5)]).invariants(t, orbit())["energy"]
    np.testing.assert_allclose(
        half, Scene([PointGravity(0.5 * MU)]).invariants(t, orbit())["energy"], rtol=1e-15
    )


# The one with an effect that may be left out.
@pytest.mark.parametrize(
    "name", [n if n == "oblate_orbit" else pytest.param(n, marks=pytest.mark.sweep) for n in SCENES]
)
def test_effect_budget_of_every_scene(name):
    """What leaving out an effect changes, against plain runs of the scene without it."""
    s = BY_NAME[name]
    budget = effect_budget(
        s.system, s.state, times(name), tolerance=1e-3, accuracy=QUICK, repeats=1
    )
    effects = s.system.effects
    assert {r.effect for r in budget.rows} == {type(e).__name__ for e in effects}
    assert [r.influence for r in budget.rows] == sorted(
        (r.influence for r in budget.rows), reverse=True
    )
    assert 0.0 < sum(r.share for r in budget.rows) <= 1.0 + 1e-9
    assert set(budget.kept) | set(budget.dropped) == {r.effect for r in budget.rows}
    if len(effects) > 1:
        weak = Scene(
            [e for e in effects if type(e).__name__ != "Oblateness"], s.system.body, s.system.parts
        )
        moved = (
            run(weak, s.state, [0.0, s.span]).position[:, -1]
            - run(s.system, s.state, [0.0, s.span]).position[:, -1]
        )
        row = budget["Oblateness"]
        np.testing.assert_allclose(row.left_out, np.linalg.norm(moved), rtol=1e-3)
        np.testing.assert_allclose(row.linear, np.linalg.norm(moved), rtol=0.1)
        np.testing.assert_allclose(row.change, moved, rtol=0.1, atol=0.1 * np.linalg.norm(moved))
    assert "Influence: the change of the final position" in str(budget)


def wind(strength):
    """A constant acceleration along x, m/s^2."""

    def load(t, y, body):
        return Load(acceleration_N=strength * jnp.array([1.0, 0.0, 0.0]))

    return Custom(load)


def test_the_smallest_set_in_a_scene_that_is_solved_by_hand():
    """Constant accelerations move a body by a t^2/2: 1, 0.01 and 0.002 m/s^2 over 10 s by 50, 0.5
    and 0.1 m."""
    scene = Scene([wind(1.0), wind(0.01), wind(0.002)])
    y0 = BodyState(jnp.array([1.0, 2.0, 3.0]), jnp.zeros(3))
    ts = jnp.array([0.0, 10.0])
    found = effect_budget(scene, y0, ts, tolerance=0.55, accuracy=QUICK, repeats=1)
    np.testing.assert_allclose([r.influence for r in found.rows], [50.0, 0.5, 0.1], rtol=1e-9)
    assert [r.effect for r in found.rows] == ["Custom", "Custom 2", "Custom 3"]
    assert not any(r.nonlinear for r in found.rows)
    # Together the two weak ones move it by 0.6 m: the weakest goes alone.
    assert found.dropped == ("Custom 3",) and found.kept == ("Custom", "Custom 2")
    assert found.change == pytest.approx(0.1) and found.seconds > 0.0 and found.seconds_kept > 0.0
    assert "within 0.55 m: keep Custom, Custom 2; omit Custom 3" in str(found)
    none = effect_budget(scene, y0, ts, tolerance=0.01, accuracy=QUICK, repeats=1)
    assert none.dropped == () and none.change is None and "every effect is needed" in str(none)
    speed = effect_budget(scene, y0, ts, output="velocity", accuracy=QUICK)
    np.testing.assert_allclose([r.influence for r in speed.rows], [10.0, 0.1, 0.02], rtol=1e-9)
    assert speed.unit == "m/s" and speed.tolerance is None and "within" not in str(speed)


def test_a_stiff_run_has_the_exponential_method_by_default():
    """A gyrocompass, by default: the explicit methods run out of steps, the reference too, and the
    table says so."""
    compass = Gyrocompass(jnp.array(1e3))
    ts = jnp.array([0.0, 0.8 / compass.slow_rate()])
    cost = accuracy_cost(
        compass,
        Gyrocompass.start(1e-3),
        ts,
        tolerances=(1e-9,),
        precisions=["float64"],
        repeats=1,
    )
    assert cost.reference.startswith("ExponentialRosenbrock at") and cost.reference_error < 1e-8
    failure = {row.method: bool(row.failure) for row in cost.rows}
    assert failure == {"DOP853": True, "Tsit5": True, "ExponentialRosenbrock": False}
    assert isinstance(cost.cheapest(error=1e-6).method, ExponentialRosenbrock)


def test_a_mission_counts_an_effect_over_all_of_its_phases():
    """Half the run with gravity alone, half with oblateness as well: its influence is that of the
    second half."""
    first = Scene([PointGravity(MU)])
    mission = Mission([Phase(first, 300.0, name="free"), Phase(OBLATE, 300.0, name="oblate")])
    budget = effect_budget(mission, orbit(), accuracy=QUICK, tolerance=1e6, repeats=1)
    assert budget["PointGravity"].phases == ("free", "oblate") and budget["Oblateness"].phases == (
        "oblate",
    )
    middle = jax.tree.map(lambda x: x[..., -1], run(first, orbit(), [0.0, 300.0]))
    ends = [run(system, middle, [300.0, 600.0]).position[:, -1] for system in (OBLATE, first)]
    np.testing.assert_allclose(
        budget["Oblateness"].left_out, np.linalg.norm(ends[1] - ends[0]), rtol=1e-3
    )
    assert "Oblateness" in budget.dropped


@pytest.mark.sweep
def test_a_budget_in_regularised_variables():
    """The attraction is weaker or stronger within them; without it there are none, which its row
    says. Twice as many fixed steps show the error of the integration."""
    how = Accuracy(rtol=1e-8, method=Regularised(steps=12, estimate=False))
    budget = effect_budget(OBLATE, orbit(), jnp.array([0.0, 5400.0]), accuracy=how)
    ends = [
        run(Scene([PointGravity(MU), *more]), orbit(), [0.0, 5400.0]).position[:, -1]
        for more in ((), OBLATE.effects[1:])
    ]
    np.testing.assert_allclose(
        budget["Oblateness"].left_out, np.linalg.norm(ends[1] - ends[0]), rtol=1e-6
    )
    assert "finite" in budget["PointGravity"].failure and budget["PointGravity"].linear > 1e5
    assert budget.noise == pytest.approx(np.linalg.norm(budget.nominal - ends[1]), rel=0.1)
    assert f"Finer integration moves it by {budget.noise:.1g}." in str(budget)


@pytest.mark.sweep
def test_a_run_that_fails_without_an_effect_says_so():
    """Nothing falls without the wind, and the phase waits in vain for its event."""
    down = Event(lambda t, y: y.position[0] - 5.0, direction=1, within=20.0)
    mission = Mission([Phase(Scene([wind(1.0), wind(1e-6)]), down, name="fall")])
    y0 = BodyState(jnp.zeros(3), jnp.array([0.0, 1.0, 0.0]))
    budget = effect_budget(mission, y0, tolerance=1.0, accuracy=QUICK, repeats=1)
    row = budget["Custom"]
    assert row.left_out is None and "did not occur within its time limit" in row.failure
    # x = t^2/2 = 5 stays; y = t moves by sqrt(10)/2 for each unit of relative strength.
    assert row.influence == pytest.approx(math.sqrt(10.0) / 2.0, rel=1e-5)
    assert budget.dropped == ("Custom 2",) and "without Custom the run fails" in str(budget)


def test_attitude_is_compared_by_its_angle():
    """A constant torque about a principal axis turns a body by M t^2 / 2 A."""

    def torque(t, y, body):
        return Load(torque_B=jnp.array([0.0, 0.0, 1e-5]))

    scene = Scene([Custom(torque)], RigidBody(inertia=[1.0, 1.0, 2.0]))
    free = BY_NAME["torque_free_principal"].state
    y0 = BodyState(attitude=free.attitude, omega=jnp.array([0.0, 0.0, 0.3]))
    budget = effect_budget(scene, y0, jnp.array([0.0, 20.0]), accuracy=QUICK)
    assert (budget.output, budget.unit) == ("attitude", "rad")
    assert budget.rows[0].influence == pytest.approx(1e-5 * 400.0 / 4.0, rel=1e-5)


BAD_BUDGET = [
    ({"output": "omega"}, "output is 'omega': it must be one of position, velocity, or a function"),
    (
        {"output": speed_error},
        "output speed_error reads nominal: it must read only parts of the final",
    ),
    ({"tolerance": -1.0}, "tolerance is -1: it must be positive"),
    ({"repeats": 0}, "repeats is 0"),
]


@pytest.mark.parametrize("wrong, words", BAD_BUDGET)
def test_effect_budget_refuses(wrong, words):
    with pytest.raises(InputError, match=words):
        effect_budget(OBLATE, orbit(), jnp.array([0.0, 60.0]), **wrong)


def test_effect_budget_refuses_a_system_without_effects():
    with pytest.raises(
        InputError,
        match="scene is a TwoBody without effects: it must be a Scene, or a Mission of scenes",
    ):
        effect_budget(TwoBody(MU), orbit(), jnp.array([0.0, 60.0]))


def test_effect_budget_of_a_run_that_fails():
    plunge = BodyState(jnp.array([6.6e6, 0.0, 0.0]), jnp.zeros(3))
    with pytest.raises(SimulationError):
        effect_budget(OBLATE, plunge, jnp.array([0.0, 5400.0]), accuracy=QUICK)


def test_pictures_of_studies():
    cost = table([1e-3, 1e-6], [1e-3, 2e-3])
    figure = cost.plot()
    assert [a.get_xlabel() for a in figure.axes] == [
        "time of a run [ms]",
        "evaluations of the vector field",
    ]
    np.testing.assert_allclose(figure.axes[0].lines[0].get_xdata(), [1.0, 2.0])
    gradient = dataclasses.replace(
        cost, rows=tuple(r._replace(gradient_error=1e-3, gradient_seconds=1.0) for r in cost.rows)
    )
    assert len(accuracy_cost_figure(gradient, title="It").axes) == 3
    rows = [
        Influence("Custom", ("scene",), 50.0, 50.0, 50.0, False, (50.0, 0.0, 0.0), 0.6),
        Influence("Custom 2", ("scene",), 0.5, 0.5, 0.5, False, (0.5, 0.0, 0.0), 0.4),
    ]
    budget = EffectBudget("position", "m", np.zeros(3), 1e-9, tuple(rows), 1.0)
    left, right = effect_budget_figure(budget).axes
    assert [t.get_text() for t in left.get_yticklabels()] == ["Custom 2", "Custom"]
    assert "[m]" in left.get_xlabel() and "[%]" in right.get_xlabel()
    assert budget.plot() is not None


def test_a_picture_without_matplotlib_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"pip install \"jaxspace\[app\]\""):
        table([1e-3], [1e-3]).plot()


def test_a_long_run_is_judged_by_a_reference_with_more_steps():
    """Of a tight run over many turns the steps run out, of the reference first of all."""
    turning = Spinning(jnp.asarray(2.0 * np.pi))
    y0 = {"x": jnp.asarray(1.0), "v": jnp.asarray(0.0)}
    methods, end = (DOP853(),), 1100.3
    ts, accuracy = jnp.array([0.0, end]), Accuracy(1e-6, method=DOP853())
    cost = accuracy_cost(
        *(turning, y0, ts), methods=methods, tolerances=(1e-6, 1e-11), precisions=("float64",)
    )
    loose, tight = cost.rows
    assert np.isfinite(loose.error) and np.isnan(tight.error)
    assert cost.reference_error < 1e-2 * loose.error
    exact = np.array([np.cos(2.0 * np.pi * end), -np.sin(2.0 * np.pi * end)])
    found = simulate(turning, y0, ts, accuracy=accuracy)
    error = np.array([found.final["x"], found.final["v"]]) / exact - 1.0
    # The sizes of both blocks are their own lengths: the reference is as good as the closed form.
    np.testing.assert_allclose(loose.error, np.linalg.norm(error), rtol=1e-3)


def test_a_table_without_a_reference_says_so():
    """Of a hum that loose steps do not see, tight ones resolve each wave: no run of 64 times as
    many steps ends, and the loose row stands without an error."""
    y0, ts = {"x": jnp.asarray(1.0), "v": jnp.asarray(0.0)}, jnp.array([0.0, 1.0])
    cost = accuracy_cost(
        *(Spinning(jnp.asarray(0.5), jnp.asarray(1e-7)), y0, ts),
        methods=(DOP853(),),
        tolerances=(1e-3, 1e-11),
        precisions=("float64",),
        gradient=True,
        max_steps=32,
    )
    loose, tight = cost.rows
    assert (loose.failure, cost.reference) == (
        "",
        "",
    ) and "maximum number of steps was reached" in tight.failure
    assert loose.seconds > 0.0 and math.isnan(loose.error) and loose.gradient_error is None
    assert cost.notes[0].startswith("The errors are unknown, because no reference run succeeds")
    assert "DOP853 at 1e-11: The maximum number of steps was reached" in cost.notes[0]
    assert "nan" not in str(cost) and cost.notes[0] in str(cost)
    with pytest.raises(InputError, match="none was measured. The errors are unknown"):
        cost.cheapest(1e-3)


@final
class Spinning(AbstractSystem):
    """x' = w v, v' = -w x + h sin(1e6 t)"""

    w: Scalar
    hum: Scalar = 0.0

    def vector_field(self, t, y):
        return {
            "x": self.w * y["v"],
            "v": -self.w * y["x"] + self.hum * jnp.sin(1e6 * t),
        }

    def invariants(self, t, y):
        return {}


def test_the_price_list_of_a_table():
    """Of times that grow by a power of the error, but for a run that is no use and one that is
    slower than a more accurate one."""

    def row(tolerance, error, seconds, failure=""):
        return Cost(
            "DOP853", "float64", tolerance, error, seconds, 0.0, 1, 1, None, {}, None, None, failure
        )

    rows = (
        row(1e-3, 2e-2, 1.0),
        row(1e-5, 5e-4, 1.5),
        row(1e-6, 3e-5, 9.0),
        row(1e-7, 2e-6, 2.0),
        row(1e-9, 2e-8, 0.1, "The maximum number of steps was reached."),
        row(1e-10, 2e-9, 3.0),
    )
    cost = AccuracyCost(rows, "the closed form", 1e-15, "float64", (), {"DOP853": DOP853()})
    prices = cost.prices()
    assert [p.error for p in prices] == [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8]
    assert [p.seconds for p in prices] == [1.0, 1.5, 1.5, 2.0, 2.0, 3.0, 3.0, 3.0]
    tenths = [1.5, 1.0, 2.0 / 1.5, 1.0, 1.5, 1.0, 1.0, np.nan]
    np.testing.assert_allclose([p.tenth for p in prices], tenths)
    assert "2.0" not in prices[0].setting and "1.5 times the time" in price_table(prices)
    assert cost.prices("float32") == () and price_table(()) != ""
    steps = accuracy_cost_figure(cost).axes[0].lines
    drawn = next(line for line in steps if line.get_label() == "cheapest")
    np.testing.assert_allclose(drawn.get_xdata(), [1e3 * p.seconds for p in prices])
