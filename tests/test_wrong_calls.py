"""Wrong calls get one sentence that names what is wrong, and no error of Python or JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import Integrated
from unchecked import unchecked

from jaxspace import (
    BodyState,
    Scene,
    simulate,
    simulate_batch,
    simulate_mission,
    simulate_mission_batch,
)
from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import Load, RigidBody
from jaxspace.core import AbstractSystem, InputError
from jaxspace.dispersion import Campaign, Normal, disperse
from jaxspace.estimation import fit
from jaxspace.optimization import Criterion, minimise
from jaxspace.orbits import ClassicalElements, PointGravity, TwoBody
from jaxspace.orbits.initial import orbit_from_altitude, orbit_from_radius
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, Event, Mission, Phase, SimulationError
from jaxspace.solvers import FixedSteps, Regularised, Splitting, Stormer, Tsit5
from jaxspace.studies import sensitivity

SPAN = jnp.array([0.0, 1.0])
FAR = jnp.array([0.0, 100.0])
Y = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
MANY = BodyState(jnp.ones((3, 5)), jnp.ones((3, 5)))
KEPLER = Integrated(TwoBody(1.0))
FREE = TorqueFreeBody([3.0, 2.0, 1.0])


class Decay(AbstractSystem):
    """A vector that decays at three rates."""

    rates: object

    def vector_field(self, t, y):
        return -self.rates * y

    def invariants(self, t, y):
        return {}


class Other(AbstractSystem):
    """A derivative of another tree than the state."""

    def vector_field(self, t, y):
        return {"a": y["a"], "b": y["a"]}

    def invariants(self, t, y):
        return {}


class Widening(AbstractSystem):
    """A vector for the derivative of a number."""

    def vector_field(self, t, y):
        return jnp.ones(3) * y

    def invariants(self, t, y):
        return {}


class Evasive:
    """An object that raises where it is asked for an attribute."""

    def __getattr__(self, name):
        raise KeyError(name)

    def __call__(self, t, y, body):
        return Load(force_N=-y.position)


class Puzzling(Evasive):
    """An object that answers to any name."""

    def __getattr__(self, name):
        return Puzzling()


def at_x(t, y):
    return y.position[0]


def jump_to(after):
    return Mission([Phase(KEPLER, 1.0, lambda t, y: after, "burn"), Phase(KEPLER, 1.0, name="b")])


def campaign(build):
    return Campaign(build, {"mu": Normal(1.0, 0.1)}, lambda run, inputs: {"x": run.final.mass})


MISSION = Mission([Phase(KEPLER, 1.0, name="coast")])


def custom(function):
    body = RigidBody(1.0, [1.0, 1.0, 1.0])
    return Scene((Custom(function),), body)


def test_a_tolerance_beside_the_accuracy_says_where_it_goes():
    """In every verb; other unknown arguments get the nearest name, or all of them."""
    verbs = (simulate, simulate_batch, simulate_mission, simulate_mission_batch)
    for verb in verbs:
        with pytest.raises(TypeError, match=r"rtol: give accuracy=Accuracy\(rtol=...\)\.$"):
            verb(KEPLER, Y, SPAN, rtol=1e-9)  # type: ignore[call-overload]
    unknown: dict = {"tol": 1e-9}, {"throws": True}, {"zzz": 1}
    sentences = (
        r"no argument tol: give accuracy=1e-9, or",
        "Did you mean throw\\?$",
        "It has system, y",
    )
    for given, sentence in zip(unknown, sentences, strict=True):
        with pytest.raises(TypeError, match=sentence):
            simulate(KEPLER, Y, SPAN, **given)


def test_a_property_that_is_called_says_that_it_is_one():
    scene = Scene([PointGravity(1.0)])
    assert scene.parts == ("position", "velocity")
    with pytest.raises(TypeError, match="property: write the property without parentheses"):
        scene.parts()  # type: ignore[operator]


def test_raw_moments_of_several_bodies_say_what_to_write():
    for shape in ((3, 3), (3, 64), (64, 3)):
        with pytest.raises(InputError, match=r"bodies give PrincipalInertia\(moments\), \(3, bod"):
            RigidBody(inertia=np.arange(1.0, 1.0 + np.prod(shape)).reshape(shape))


def test_an_array_without_an_axis_of_runs_is_named():
    """Of a system and of a mission, whose runs are cut into blocks."""
    system, states = Decay(jnp.ones(100)), jnp.ones(100)
    sentence = r"rates of shape \(100,\), because their annotations have no batch axis"
    with pytest.raises(InputError, match=sentence):
        simulate_batch(system, states, SPAN)
    with pytest.raises(InputError, match=sentence):
        simulate_mission_batch(Mission([Phase(system, 1.0)]), states)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda: simulate(Decay(jnp.ones(3)), jnp.ones(4), SPAN),
            r"Decay.vector_field fails for y0, which contains an array \(4,\): .*\(3,\), \(4,\)",
        ),
        (
            lambda: simulate(Other(), {"a": jnp.ones(3)}, SPAN),
            r"y0 contains \['a'\] \(3,\), and Other.vector_field returns .*\['b'\] \(3,\)",
        ),
        (
            lambda: simulate(KEPLER, [jnp.ones(3), jnp.ones(3)], SPAN),
            r"fails for y0, which contains \[0\] \(3,\), \[1\] \(3,\)",
        ),
        (lambda: simulate(KEPLER, jnp.ones(6), SPAN), r"which contains an array \(6,\)"),
        (
            lambda: simulate(custom(lambda t, y, body: None), Y, SPAN),
            "Custom.function returns nothing: it must return a Load",
        ),
        (
            lambda: simulate(custom(lambda t, y, body: -y.position), Y, SPAN),
            "it must return a Load",
        ),
        (
            lambda: simulate_mission(
                Mission([Phase(KEPLER, Event(lambda t, y: y.position, within=1.0))]), Y
            ),
            r"Phase.until.condition returns \(3,\): it must return one number",
        ),
        (
            lambda: simulate_mission(Mission([Phase(KEPLER, 1.0)]), [jnp.ones(3)]),
            "fails for y0, which contains",
        ),
        (
            lambda: simulate(KEPLER, Y, SPAN, events=(Event(lambda t, y: y.height),)),
            r"events\[0\].condition fails for the time and the state .*no attribute 'height'",
        ),
        (lambda: simulate(KEPLER, Y, SPAN, events=Event(lambda t, y: t)), "must be a tuple"),
        (lambda: simulate(KEPLER, Y, SPAN, accuracy="high"), "accuracy is 'high'"),
        (lambda: Accuracy(rtol="high"), "Accuracy.rtol is 'high'"),
        (
            lambda: simulate_mission(Mission([Phase(KEPLER, jnp.ones(3))]), Y),
            r"Phase 'phase': until has the shape \(3,\): it must be one time",
        ),
        (
            lambda: simulate_mission(Mission([Phase(KEPLER, 1.0)]), Y, jnp.linspace(0.0, 1.0, 5)),
            r"t0 has the shape \(5,\): it must be a scalar, the start time",
        ),
        (lambda: Phase(KEPLER, "1 day"), "Phase.until is '1 day': it must be a duration in s"),
        (
            lambda: Mission([KEPLER]),
            "Mission.phases contains an object of type Integrated: it must contain phases",
        ),
        (lambda: Scene(PointGravity(1.0)), "Scene.effects is a PointGravity: it must be a list"),
        (lambda: Scene((3.0,)), "Scene.effects contains an object of type float"),
        (
            lambda: simulate(Widening(), jnp.array(1.0), SPAN),
            r"Widening.vector_field returns \(3,\) for y0, which has the shape \(\)",
        ),
        (lambda: simulate(KEPLER, Y, ["0", "1"]), r"ts is \['0', '1'\]: it must be an array of"),
        (lambda: simulate(KEPLER, Y, np.array(["0", "1"])), "ts is array.*it must be an array of"),
        (lambda: simulate(KEPLER, Y, [0.0, 1.0 + 1.0j]), "ts is .*it must be an array of times"),
        (lambda: simulate(KEPLER, Y, SPAN.astype(complex)), "ts is .*it must be an array of times"),
        (lambda: simulate(KEPLER, Y, [[0.0, 1.0], [2.0]]), "ts is .*it must be an array of times"),
        (lambda: simulate(KEPLER, Y, [False, True]), "ts is .*it must be an array of times"),
        (lambda: simulate_mission(MISSION, Y, "noon"), "t0 is 'noon': it must be one time, s"),
        (lambda: simulate(KEPLER, Y, SPAN, accuracy=1), "Accuracy.rtol is 1: it must be below one"),
        (lambda: simulate(KEPLER, Y, SPAN, accuracy=2.0), "Accuracy.rtol is 2: .* below one"),
        (lambda: simulate(KEPLER, Y, SPAN, accuracy=1.0j), "accuracy is 1j: it must be a number"),
        (lambda: Accuracy(atol=1.0j), "Accuracy.atol is 1j: it must be a number"),
        (
            lambda: simulate_mission(jump_to(None), Y),
            "Phase 'burn': then returns nothing: it must return",
        ),
        (
            lambda: simulate_mission(jump_to("x"), Y),
            "then returns an object of type str: it must return",
        ),
        (
            lambda: simulate_mission(Mission([Phase(KEPLER, 1.0, lambda t, y: y.height)]), Y),
            "Phase 'phase': then fails for the time and a state .*no attribute 'height'",
        ),
        (lambda: Phase(KEPLER, 1.0, 3.0), "Phase.then is 3.0: it must be a function"),
        (lambda: Phase(KEPLER, 1.0j), "Phase.until is 1j: it must be a duration in s"),
        (lambda: Phase(KEPLER, np.array(1.0j)), "Phase.until is .*: it must be a duration in s"),
        (lambda: simulate(KEPLER, Y, SPAN, events=None), "events is of type NoneType"),
        (lambda: Custom(Puzzling(), "energy"), "Custom.keeps is 'energy': it must be a set of"),
        (lambda: Custom(Puzzling(), at_x), "Custom.keeps is .*: it must be a set of names"),
        (
            lambda: simulate_mission_batch(MISSION, MANY, "noon"),
            "t0 is 'noon': it must be one time, or",
        ),
        (
            lambda: simulate_mission_batch(MISSION, MANY, 1.0j),
            "t0 is 1j: it must be one time, or one for",
        ),
        (
            lambda: simulate(MISSION, Y, SPAN),
            "^system is of type Mission: use simulate_mission instead.$",
        ),
        (
            lambda: simulate_batch(MISSION, MANY, SPAN),
            "^systems is of type Mission: use simulate_mission_batch instead.$",
        ),
        (
            lambda: simulate_mission(FREE, Y),
            "^mission is of type TorqueFreeBody, a system: use simulate instead.$",
        ),
        (
            lambda: simulate_mission_batch(KEPLER, MANY),
            "^missions is of type Integrated, a system: use simulate_batch instead.$",
        ),
        (lambda: simulate_mission([KEPLER], Y), "mission is of type list: it must be a Mission"),
        (
            lambda: sensitivity(MISSION, Y, events=(Event(at_x),)),
            "events is not available for a mission",
        ),
        (lambda: sensitivity(KEPLER, Y, SPAN, num_saved=3), "num_saved is 3: for a system"),
        (
            lambda: simulate(
                KEPLER, Y, SPAN, events=(Event(at_x, terminal=False, then=lambda t, y: None),)
            ),
            r"events\[0\].then returns nothing: it must return the state",
        ),
        (
            lambda: simulate_mission(MISSION, Y)["costa"],
            r"no phase 'costa': its phases are coast. Did you mean coast\?",
        ),
        (lambda: Stormer(steps=10**12), r"Stormer.steps is 1000000000000: .* up to 1e\+08"),
        (lambda: FixedSteps(Tsit5(), 10**12), "FixedSteps.steps is 1000000000000"),
        (lambda: Splitting(steps=10**12), "Splitting.steps is 1000000000000"),
        (lambda: Regularised(steps=10**12), "Regularised.steps is 1000000000000"),
        (
            lambda: disperse(campaign(lambda inputs: (MISSION, Y)), 4),
            r"Campaign.build ignores its inputs: .*must use mu",
        ),
        (lambda: disperse(campaign(lambda inputs: MISSION), 4), "Campaign.build returns .*Mission"),
        (
            lambda: disperse(campaign(lambda inputs: inputs["my"]), 4),
            r"Campaign.build requests the unknown input 'my': the inputs are mu. Did you mean mu\?",
        ),
    ],
)
def test_wrong_calls_get_a_sentence(call, sentence):
    with unchecked(), pytest.raises(InputError, match=sentence):
        call()


def held(thing):
    """A load that closes over an object."""
    return lambda t, y, body: thing(t, y, body)


@pytest.mark.parametrize("kind", [Evasive, Puzzling])
@pytest.mark.parametrize("closure", [False, True])
def test_objects_that_answer_to_any_name_are_loads_as_others(kind, closure):
    """Nothing is asked of them but to be called: r'' = -r."""
    load = held(kind()) if closure else kind()
    final = simulate(custom(load), Y, SPAN).final.position
    np.testing.assert_allclose(final, [np.cos(1.0), np.sin(1.0), 0.0], atol=1e-8)


def test_mapped_runs_that_fail_raise_their_sentence_alone():
    """Outside of jit, where the run is mapped and no program."""

    def end(mu):
        run = simulate(Integrated(TwoBody(mu)), Y, FAR, accuracy=Accuracy(max_steps=4))
        return run.final.position

    with pytest.raises(
        SimulationError, match="^The maximum number of steps was reached: increase max_steps"
    ):
        jax.vmap(end)(jnp.array([1.0, 1.1]))


@pytest.mark.parametrize("derivative", [jax.grad, jax.jacfwd])
def test_the_derivative_of_a_failed_run_is_refused_in_one_sentence(derivative):
    def end(mu):
        run = simulate(Integrated(TwoBody(mu)), Y, FAR, accuracy=Accuracy(max_steps=4))
        return run.final.position[0]

    with pytest.raises(
        SimulationError, match="^The maximum number of steps was reached: increase max_steps"
    ):
        derivative(end)(1.0)


def ended(mu):
    """A run that no search can finish."""
    accuracy = Accuracy(method=Tsit5(), max_steps=4)
    return simulate(Integrated(TwoBody(mu)), Y, FAR, accuracy=accuracy).final.position


@pytest.mark.parametrize(
    "search",
    [
        lambda: minimise(lambda mu: Criterion(ended(mu)[0]), jnp.array(1.0)),
        lambda: fit(ended, jnp.zeros(3), jnp.array(1.0)),
    ],
    ids=["minimise", "fit"],
)
def test_a_run_that_fails_in_a_search_raises_its_sentence_alone(search):
    """And not the error of JAX, which holds the traceback of the call before it."""
    with pytest.raises(
        SimulationError, match="^The maximum number of steps was reached: increase max_steps"
    ):
        search()


MANY_ARRAYS = jnp.ones((3, 5))


@pytest.mark.parametrize(
    ("call", "array"),
    [
        (lambda: simulate(KEPLER, MANY, SPAN), r"y0.position has the shape \(3, 5\)"),
        (
            lambda: simulate(KEPLER, BodyState(Y.position, Y.velocity, mass=jnp.ones(5)), SPAN),
            r"y0.mass has the shape \(5,\)",
        ),
        (
            lambda: simulate(Integrated(TwoBody(jnp.ones(5))), Y, SPAN),
            r"system.system.mu has the shape \(5,\)",
        ),
        (
            lambda: jax.jit(lambda y: simulate(KEPLER, y, SPAN, throw=False).final)(MANY),
            r"y0.position has the shape \(3, 5\)",
        ),
        (
            lambda: simulate_mission(Mission([Phase(KEPLER, 1.0)]), MANY),
            r"y0.position has the shape \(3, 5\)",
        ),
        (lambda: sensitivity(KEPLER, MANY, SPAN), r"y0.position has the shape \(3, 5\)"),
    ],
)
def test_many_runs_are_sent_to_the_batch(call, array):
    with pytest.raises(InputError, match=array + ".*simulate_mission_batch a batch.*batch=True"):
        call()


def test_axes_that_declare_no_runs_are_one_run():
    # Five vectors of one state, in a system of a user without declared shapes.
    run = simulate(Decay(jnp.ones((3, 1))), MANY_ARRAYS, SPAN)
    np.testing.assert_allclose(run.final, np.exp(-1.0) * MANY_ARRAYS, rtol=1e-8)
    assert run.status.shape == ()


def test_mapped_runs_are_one_run_each():
    final = jax.vmap(lambda y: simulate(KEPLER, y, SPAN).final.position, -1, -1)(
        BodyState(*(jnp.stack([x, 1.1 * x], axis=-1) for x in (Y.position, Y.velocity)))
    )
    assert final.shape == (3, 2)
    # To the tolerance of both, whose steps differ.
    np.testing.assert_allclose(final[:, 0], simulate(KEPLER, Y, SPAN).final.position, rtol=1e-8)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda: BodyState(jnp.ones((2, 3)), jnp.ones((2, 3))),
            r"BodyState.position has the shape \(2, 3\)",
        ),
        (
            lambda: simulate(
                FREE, BodyState(attitude=Quaternion(jnp.zeros(4)), omega=jnp.ones(3)), SPAN
            ),
            r"Quaternion.wxyz is \[0. 0. 0. 0.\]: it must be of non-zero length",
        ),
        (
            lambda: simulate(KEPLER, BodyState(Y.position, Y.velocity, mass=jnp.array(-1.0)), SPAN),
            "BodyState.mass is -1: it must be positive",
        ),
        (
            lambda: RigidBody(1.0, np.diag([1.0, 1.0, 5.0])),
            "InertiaTensor.tensor is .*no principal moment exceeds the sum of the other two",
        ),
        (
            lambda: ClassicalElements(1.0, 2.0, 0.0, 0.0, 0.0, 3.0),
            r"true_anomaly is 3: it must be within 2.0944 rad of the periapsis",
        ),
        (lambda: orbit_from_radius(1.0, 1.0, 1.5, true_anomaly=-2.5), "true_anomaly is -2.5"),
    ],
)
def test_what_no_body_has_is_refused(call, sentence):
    with pytest.raises(InputError, match=sentence):
        call()


def test_an_orbit_through_its_planet_is_doubted():
    with pytest.warns(UserWarning, match="periapsis_altitude is -100000 m: the orbit passes"):
        orbit_from_altitude(-1e5, 6.4e6, 4e14)
