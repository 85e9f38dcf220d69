"""Scenes: absent effects cost nothing, what is missing is said, and what is kept follows from the
effects."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import J2, MU, RADIUS, SAMPLES, motor, orbit, rocket_scene, rocket_state, turned

from jaxspace import Scene, simulate, simulate_batch
from jaxspace.attitude import MovingMasses, TorqueFreeBody
from jaxspace.bodies import BodyState, BurningBody, Load, RigidBody
from jaxspace.core import InputError
from jaxspace.core.vectors import cross, dot
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.rockets import JetDamping
from jaxspace.scene import Custom, Scaled, budget
from jaxspace.scene._explain import compile_vector_field, operation_count
from jaxspace.simulation import Accuracy, Status
from jaxspace.solvers import DOP853
from jaxspace.vehicles import Rail

T = jnp.zeros(())


def instructions(system, y):
    """The instructions of the compiled vector field, without the names that the compiler gives
    them."""
    lines = [
        line for line in compile_vector_field(system, T, y).as_text().splitlines() if " = " in line
    ]
    return sorted(re.sub(r"%[\w.-]+|, metadata=.*", "", line).strip() for line in lines)


def test_gravity_alone_costs_what_two_body_costs():
    scene, bare, y = Scene((PointGravity(MU),)), TwoBody(MU), orbit()
    assert operation_count(scene, T, y) == operation_count(bare, T, y) > 10
    assert instructions(scene, y) == instructions(bare, y)


def test_rotation_alone_costs_what_the_free_body_costs():
    inertia = [3.0, 2.0, 1.0]
    y = BodyState(attitude=turned(), omega=jnp.array([0.1, 0.2, 0.3]))
    scene, bare = Scene((), RigidBody(inertia=inertia), ("attitude",)), TorqueFreeBody(inertia)
    assert operation_count(scene, T, y) == operation_count(bare, T, y) > 10


def coasting():
    """A burnt-out stage that tumbles along an orbit, with its mass in the state."""
    body = BurningBody(1191.0, [1031.0, 1002.0, 521.0], [0.45, 0.46, 0.44], -1.7, 2010.0)
    start = orbit()
    y = BodyState(
        *(start.position, start.velocity, turned(), jnp.array([0.1, 0.2, 0.3])),
        mass=jnp.array(1700.0),
    )
    return Scene((PointGravity(MU),), body, ("attitude", "mass")), y


def test_a_coast_with_a_constant_mass_in_the_state_goes_by_the_closed_form():
    scene, y = coasting()
    assert scene.closed_form() is not None
    ts = jnp.array([0.0, 500.0, 2000.0])

    exact, integrated = (
        simulate(scene, y, ts, accuracy=Accuracy(1e-12, method=method)).final
        for method in ("auto", DOP853())
    )
    assert exact.mass == y.mass
    scales = {"position": RADIUS, "velocity": 7e3, "attitude": 1.0, "omega": 1.0}
    for part, scale in scales.items():
        one, other = (jax.tree.leaves(getattr(x, part))[0] for x in (exact, integrated))
        # Of 400 rad of tumbling and a third of a revolution at 1e-12 a step.
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9 * scale)


@pytest.mark.sweep
def test_its_attitude_has_a_derivative_by_the_mass_as_the_inertia_goes_with_it():
    scene, y = coasting()

    def last(method, mass):
        accuracy = Accuracy(1e-12, method=method)
        y_of = dataclasses.replace(y, mass=mass)
        return simulate(scene, y_of, jnp.array([0.0, 2000.0]), accuracy=accuracy).final

    by_closed_form, by_steps = (
        jax.jacfwd(lambda m, method=method: last(method, m).attitude.wxyz)(y.mass)
        for method in ("auto", DOP853())
    )
    assert float(jnp.max(jnp.abs(by_steps))) > 1e-3
    np.testing.assert_allclose(by_closed_form, by_steps, rtol=1e-7, atol=1e-9)


def test_a_coast_below_the_dry_mass_is_outside_of_the_model():
    """A single run is rejected before it starts; in a batch only the row is marked."""
    scene, y = coasting()
    ts = jnp.array([0.0, 10.0])
    light = dataclasses.replace(y, mass=jnp.array(1000.0))
    with pytest.raises(InputError, match="^y0.mass is below the mass without propellant"):
        simulate(scene, light, ts, throw=False)
    both = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), y, light)
    run = simulate_batch(scene, both, ts)
    np.testing.assert_array_equal(run.status, [Status.COMPLETED, Status.OUTSIDE_MODEL])


def test_a_scene_without_attitude_carries_none():
    scene = Scene((PointGravity(MU), Oblateness(MU, J2, RADIUS)), RigidBody(900.0, [1.0, 1.0, 1.0]))
    assert scene.parts == ("position", "velocity")
    assert len(jax.tree.leaves(scene.vector_field(T, orbit()))) == 2
    with pytest.raises(InputError, match="The state has 'attitude'"):
        scene.vector_field(T, orbit(attitude=turned(), omega=jnp.zeros(3)))


def test_leaving_an_effect_out_gives_its_cost_back():
    """The whole scene without the oblateness has the count of a scene that never had it."""
    full = rocket_scene()
    effects = tuple(e for e in full.effects if not isinstance(e, Oblateness))
    y = rocket_state()
    without = Scene(effects, full.body)
    assert operation_count(without, T, y) < operation_count(full, T, y)
    rows = budget(full, y=y)
    assert [r.effect for r in rows[:-1]] == ["PointGravity", "Oblateness", "Thrust", "JetDamping"]
    assert all(r.operations > 0 for r in rows) and abs(sum(r.share for r in rows) - 1.0) < 1e-12


def test_explain_names_every_effect():
    text = rocket_scene().explain()
    for word in (
        "PointGravity",
        "Oblateness",
        "Thrust",
        "JetDamping",
        "equations of motion",
        "attitude",
        "share",
    ):
        assert word in text


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda: Scene((motor(),), RigidBody(10.0)),
            "Thrust requires a rotating body, and the body has no inertia",
        ),
        (lambda: Scene((), RigidBody(10.0), ("attitude",)), "Scene.carry requires a rotating body"),
        (lambda: Scene((), carry=("spin",)), r"Scene.carry names \['spin'\]"),
        (lambda: Scene((drag(),)), "Custom adds a force, and the body has no mass"),
        (
            lambda: Custom(lambda t, y, b: Load(), keeps={"enrgy"}),
            r"Custom.keeps names \['enrgy'\]",
        ),
        (
            lambda: Scene((motor(), Custom(lambda t, y, b: None)), RigidBody(10.0, [1.0] * 3)),
            "Custom.function returns nothing: it must return a Load",
        ),
        (
            lambda: Scene((MovingMasses(lambda t: t * jnp.ones((3, 1)), [2.0]),)),
            "MovingMasses requires the mass of the body, which has none",
        ),
        (lambda: RigidBody(-5.0), "RigidBody.mass is -5: it must be positive and finite."),
        (lambda: PointGravity(-1.0), "PointGravity.mu is -1"),
    ],
)
def test_what_is_missing_is_said(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_a_missing_part_of_the_state_is_named_with_its_effect():
    with pytest.raises(
        InputError, match="Oblateness requires position|PointGravity requires position"
    ):
        Scene((PointGravity(MU), Oblateness(MU, J2, RADIUS))).vector_field(T, BodyState())
    with pytest.raises(InputError, match="Thrust requires attitude"):
        rocket_scene().vector_field(T, orbit(mass=jnp.array(10.0)))


def drag() -> Custom:
    """A force against the velocity."""
    return Custom(lambda t, y, body: Load(force_N=-0.1 * y.velocity))


def test_a_function_is_an_effect():
    scene = Scene((drag(),), RigidBody(2.0))
    y = BodyState(position=jnp.zeros(3), velocity=jnp.array([3.0, 0.0, 4.0]))
    end = simulate(scene, y, jnp.array([0.0, 10.0]), accuracy=1e-11).final
    # v = v0 exp(-c t / m), in closed form.
    np.testing.assert_allclose(end.velocity, np.exp(-0.5) * np.array([3.0, 0.0, 4.0]), rtol=1e-9)
    assert scene.invariants(T, y) == {}


def test_what_stays_follows_from_the_effects():
    y = orbit()
    oblate = (PointGravity(MU), Oblateness(MU, J2, RADIUS))
    assert set(Scene(oblate[:1]).invariants(T, y)) == {"energy", "angular_momentum"}
    assert set(Scene(oblate).invariants(T, y)) == {"energy", "axial_angular_momentum"}
    free = next(s for s in SAMPLES if s.name == "free_stage")
    kept = set(free.system.invariants(T, free.state))
    assert kept == {
        "energy",
        "angular_momentum",
        "rotational_momentum",
        "rotational_energy",
        "quaternion_norm",
    }
    assert set(rocket_scene().invariants(T, rocket_state())) == {"quaternion_norm"}


def test_jet_damping_needs_what_it_reads():
    assert Scene(
        (JetDamping(lambda t, m: -1.0 + 0.0 * m, 0.0),), rocket_scene().body, ("mass",)
    ).parts == (
        "attitude",
        "omega",
        "mass",
    )


def spring(energy, **more):
    """k r^2/2 per unit mass, k = 4, as an effect with a given energy."""
    return Custom(
        lambda t, y, body: Load(acceleration_N=-4.0 * y.position),
        keeps={"energy"},
        energy=energy,
        **more,
    )


def test_the_energy_of_a_function_is_that_of_its_work():
    """From rest, too, and in batches; a wrong sign, a wrong factor and a part that grows with the
    time are refused."""
    ts = jnp.array([0.0, 0.1])
    y = BodyState(jnp.array([1.0, 2.0, -1.0]), jnp.array([0.3, 0.0, 0.1]))
    rest = BodyState(y.position, jnp.zeros(3))
    right = Scene((spring(lambda t, y, body: 2.0 * dot(y.position, y.position)),))
    for start in (y, rest):
        assert simulate(right, start, ts).drift()["energy"].max() < 1e-9
    wrong = {
        "sign": lambda t, y, body: -2.0 * dot(y.position, y.position),
        "factor": lambda t, y, body: 4.0 * dot(y.position, y.position),
        "time": lambda t, y, body: (2.0 + t) * dot(y.position, y.position),
    }
    for energy in wrong.values():
        for start in (y, rest):
            with pytest.raises(InputError, match="Custom.energy does not belong"):
                simulate(Scene((spring(energy),)), start, ts)
    many = jax.tree.map(lambda x: jnp.stack([x, 2.0 * x], axis=-1), y)
    simulate_batch(right, many, ts)
    with pytest.raises(InputError, match="Custom.energy does not belong"):
        simulate_batch(Scene((spring(wrong["sign"]),)), many, ts)


def test_the_energy_of_a_torque_and_of_a_force_is_per_unit_mass():
    """A weight of 3 m/s^2, and a torque that turns z towards the vertical: energy -M cos/m."""
    body, Z = RigidBody(2.0, [3.0, 2.0, 1.0]), jnp.array([0.0, 0.0, 1.0])

    def load(t, y, body):
        up = y.attitude.rotate_back(Z)
        return Load(force_N=-6.0 * Z, torque_B=0.5 * cross(Z, up))

    def energy(factor):
        def of(t, y, body):
            return 3.0 * y.position[2] - factor * y.attitude.rotate(Z)[2]

        return of

    y = orbit(attitude=turned(), omega=jnp.array([0.1, -0.2, 0.3]))
    for factor, good in ((0.25, True), (0.5, False)):
        effect = Custom(load, keeps={"energy"}, energy=energy(factor))
        scene = Scene((effect,), body)
        if good:
            scene.check_values(T, y)
        else:
            with pytest.raises(InputError, match="Custom.energy does not belong"):
                scene.check_values(T, y)


@pytest.mark.parametrize(("factor", "share"), [(1.0, 0.0), (0.25, 0.75), (0.0, 1.0)])
def test_a_scaled_guide_holds_by_its_factor(factor, share):
    rail = Scaled(Rail([0.0, 0.0, 1.0], 5.0), factor)
    y = BodyState(jnp.zeros(3), jnp.array([0.0, 0.0, 2.0]))
    free = BodyState(y.velocity, jnp.array([3.0, -1.0, 4.0]))
    held = rail.constrained(0.0, y, free).velocity
    np.testing.assert_allclose(held, [3.0 * share, -share, 4.0], rtol=1e-15)


def test_a_scaled_effect_keeps_all_but_its_load():
    planet = Oblateness(MU, J2, RADIUS)
    assert Scaled(planet, 0.5).ground() == planet.ground() == RADIUS
    stage = motor()
    assert Scaled(stage, 0.5).switches() == stage.switches()
    # Nothing is held, and nothing costs.
    y = BodyState(jnp.ones(3), jnp.ones(3))
    assert Scaled(planet, 0.5).constrained(0.0, y, y) is y
