"""What effects read and add, read off their loads: the words, how little is asked of a state, and
how often a load is traced."""

import dataclasses
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from systems import MU, motor, orbit, turned

from jaxspace import Scene
from jaxspace.attitude import EnergySink, GravityGradient, NutationDamper, ReactionWheels
from jaxspace.bodies import AbstractEffect, BodyState, BurningBody, Load, RigidBody
from jaxspace.core.vectors import norm
from jaxspace.orbits import PointGravity, UniformGravity
from jaxspace.rockets import JetDamping
from jaxspace.scene import Custom
from jaxspace.scene.reading import read_effects
from jaxspace.vehicles import Rail

BODY = RigidBody(2.0, [3.0, 2.0, 1.0])
STAGE = BurningBody(10.0, [3.0, 2.0, 1.0], [0.1, 0.1, 0.1])
PLACE = ("position", "velocity")
TURN = ("attitude", "omega")


@pytest.mark.parametrize(
    ("effect", "body", "needs", "adds", "parts"),
    [
        (UniformGravity([0.0, 0.0, -9.8]), BODY, "", "acceleration", PLACE),
        (PointGravity(MU), RigidBody(), "position", "acceleration", PLACE),
        (GravityGradient(MU), BODY, "position attitude", "torque", PLACE + TURN),
        # An inertia that is constant is none of a mass; one that burns is.
        (EnergySink(0.4), BODY, "omega", "torque", TURN),
        (EnergySink(0.4), STAGE, "omega mass", "torque", (*TURN, "mass")),
        (motor(), STAGE, "attitude mass", "force torque mass_rate", (*PLACE, *TURN, "mass")),
        (JetDamping(lambda t, m: -8.0, -1.0), STAGE, "omega mass", "torque", (*TURN, "mass")),
        (
            NutationDamper(1.0, [0.0, 0.0, 1.0], [0.5, 0.0, 0.0], 3.0, 0.1),
            BODY,
            "omega",
            "torque parts inertia momentum",
            (*TURN, "parts"),
        ),
        # A guide changes the rate of what is there, and asks for no more.
        (Rail([0.0, 0.0, 1.0], 5.0), BODY, "position velocity", "acceleration", PLACE),
    ],
)
def test_what_an_effect_reads_and_adds(effect, body, needs, adds, parts):
    found = read_effects([effect], body)
    assert found.effects[0].needs == set(needs.split())
    assert found.effects[0].adds == set(adds.split())
    assert found.parts == parts


def test_what_may_be_absent_is_not_asked_for_and_used_where_it_is():
    """A force per unit mass that also turns a body, if it can turn."""

    def load(t, y, body):
        push = -0.1 * y.velocity
        if y.attitude is None:
            return Load(acceleration_N=push)
        return Load(acceleration_N=push, torque_B=y.attitude.rotate_back(push))

    alone = Scene([Custom(load)])
    assert alone.parts == PLACE
    assert alone.readings[0].adds == {"acceleration"}
    turning = Scene([Custom(load), EnergySink(0.4)], BODY)
    assert turning.parts == PLACE + TURN
    assert turning.readings[0].needs == {"velocity", "attitude"}
    assert turning.readings[0].adds == {"acceleration", "torque"}


def test_a_guide_that_holds_the_attitude_adds_a_torque():
    scene = Scene([Rail([0.0, 0.0, 1.0], 5.0), EnergySink(0.4)], BODY)
    assert scene.readings[0].adds == {"acceleration", "torque"}


def test_velocity_cannot_hide_from_a_kick():
    """A kick that depends on what it changes would be wrong without a word."""

    def drag(t, y, body):
        return Load(acceleration_N=-0.1 * y.velocity)

    scene = Scene([PointGravity(1.0), Custom(drag)])
    assert scene.split() is None
    assert "Custom reads or adds more" in scene.missing("split")
    push = Custom(lambda t, y, body: Load(acceleration_N=0.1 * y.position))
    assert Scene([PointGravity(1.0), push]).split() is not None


@final
class Weights(eqx.Module):
    """A function with arrays whose axes nothing declares; the last one is that of the runs."""

    weights: Array

    def __call__(self, t, y, body):
        return Load(acceleration_N=jnp.sum(self.weights, axis=0) * y.velocity)


@pytest.mark.parametrize("runs", [(), (1,), (5,)])
def test_parameters_of_runs_are_read_in_a_state_of_runs(runs):
    scene = Scene(
        [PointGravity(jnp.ones(runs)), Custom(Weights(jnp.ones((2, *runs))))], RigidBody(2.0)
    )
    assert scene.parts == PLACE
    assert scene.readings[1].needs == {"velocity"}


@final
class Follower(AbstractEffect):
    """Turns a body by the speed of the wheels of another effect."""

    def load(self, t, y, body):
        return Load(torque_B=jnp.sum(y.part("wheels"), axis=0) * y.omega)


def test_the_part_of_an_effect_that_comes_later():
    wheels = ReactionWheels(jnp.eye(3), [1.0, 1.0, 1.0], [0.0, 0.0, 0.0])
    scene = Scene([Follower(), wheels], BODY)
    assert scene.parts == (*TURN, "parts")
    assert [sorted(r.adds) for r in scene.readings][0] == ["torque"]


def test_a_load_is_traced_once_for_each_make_of_a_scene():
    """However many scenes there are, whatever their numbers, and whatever asks for their parts."""
    traces = []

    def load(t, y, body):
        traces.append(y.present)
        return Load(acceleration_N=-1.0 * y.position / norm(y.position))

    for mu in (1.0, 2.0, 3.0):
        scene = Scene([PointGravity(mu), Custom(load)])
        assert scene.parts == PLACE
        assert scene.split() is not None
    # In both scenes: the kick of the split is one without the attraction, first asked in a state of
    # nothing, which it refuses.
    assert traces == [PLACE, (), PLACE]


def test_numbers_may_be_traced():
    """Scenes are made within `jit`, `grad` and `vmap`: what a load reads depends on no number."""

    def pull(mu):
        scene = Scene([PointGravity(mu), EnergySink(0.1 * mu)], RigidBody(mu, mu * jnp.ones(3)))
        y = orbit(attitude=turned(), omega=jnp.ones(3))
        return norm(scene.vector_field(0.0, y).velocity)

    slopes = jax.jit(jax.vmap(jax.grad(pull)))(jnp.array([1.0, 2.0]))
    r = orbit().position
    np.testing.assert_allclose(slopes, 1.0 / np.sum(np.square(r)), rtol=1e-12)


def test_an_error_of_a_load_is_told_by_the_scene():
    """That of the state which has everything, and not of one that lacks what the load reads."""

    def load(t, y, body):
        return Load(acceleration_N=y.position * y.momentum)

    with pytest.raises(AttributeError, match="momentum"):
        Scene([Custom(load)])


def test_an_effect_is_a_class_with_a_load():
    """No set of words, no potential: what there is not is not written."""

    @final
    class Push(AbstractEffect):
        def load(self, t, y, body):
            return Load(acceleration_N=0.0 * y.position + 1.0)

    y = BodyState(*jnp.array([[1.0, 2.0, 3.0], [0.1, 0.2, 0.3]]))
    scene = Scene([Push()])
    assert np.all(np.asarray(scene.vector_field(0.0, y).velocity) == 1.0)
    assert scene.invariants(0.0, y) == {}
    assert Push().potential(0.0, y, BODY) is None
    assert dataclasses.replace(scene, effects=()).parts == PLACE
