"""Vehicles with several sets of fins and several changes of the radius, in Python and in files."""

import dataclasses
import shutil
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_vehicles import FINS, NOSE, TAIL

import jaxspace
from jaxspace.bodies import BodyState, ExponentialAtmosphere, RigidBody
from jaxspace.core import InputError
from jaxspace.io import SceneError, listing
from jaxspace.rockets import Motor
from jaxspace.rotations import from_euler_angles
from jaxspace.vehicles import (
    Aerodynamics,
    FinSet,
    RadiusChange,
    TabulatedAerodynamics,
    Vehicle,
    Wind,
)
from jaxspace.vehicles.aerodynamic_table import AerodynamicTable
from jaxspace.vehicles.coefficient import MachTable
from jaxspace.vehicles.local_air import LocalAir

AIR = LocalAir(
    ExponentialAtmosphere(1.2, 0.0, 7000.0), wind=Wind([0.0, 1e4], [3.0, 8.0], [-2.0, 1.0])
)
BODY = RigidBody(16.0, [8.0, 8.0, 0.04])
Y = BodyState(
    jnp.array([10.0, -20.0, 800.0]),
    jnp.array([20.0, -15.0, 180.0]),
    from_euler_angles(jnp.array([0.4, 0.2, -0.9])),
    jnp.array([0.3, -0.2, 0.7]),
)
CANARDS = FinSet(3, 0.05, 0.06, 0.03, 0.02, 0.0635, 0.7, cant=0.02)
SHOULDER = RadiusChange(0.05, 0.0635, 0.1, 0.4)
EXAMPLES = Path(jaxspace.__file__).parents[1] / "examples"


def stacked(load):
    return np.concatenate([load.force_N, load.torque_B])


@pytest.mark.parametrize("kind", [Aerodynamics, TabulatedAerodynamics])
def test_the_forces_of_several_parts_are_those_of_each(kind):
    """The force of each part alone, and of the coefficient along the axis alone, added up; a
    canted set rolls the rocket and a straight one damps it."""
    columns = {"mach": np.array([0.0, 1.0]), "axial": np.array([0.4, 0.6])}
    table = AerodynamicTable.of_columns(columns, area=0.0127, length=0.127, station=0.0)

    def load(**parts):
        if kind is Aerodynamics:
            effect = Aerodynamics(0.0127, MachTable([0.0, 1.0], [0.4, 0.6]), air=AIR, **parts)
        else:
            effect = TabulatedAerodynamics(table, air=AIR, **parts)
        return stacked(effect.load(0.0, Y, BODY))

    bare = load()
    whole = load(nose=NOSE, fins=(FINS, CANARDS), tail=[SHOULDER, TAIL])
    each = [{"nose": NOSE}, {"fins": FINS}, {"fins": CANARDS}, {"tail": SHOULDER}, {"tail": TAIL}]
    expected = bare + sum(load(**one) - bare for one in each)
    np.testing.assert_allclose(whole, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    alone = load(nose=NOSE, fins=(FINS,), tail=())
    np.testing.assert_array_equal(alone, load(nose=NOSE, fins=FINS))


def test_a_model_rocket_moves_every_part_to_its_axes():
    """By the distance of its dry centre of mass, 1.815 kg at -1.056 m beside 14.426 kg at 0."""
    motor = Motor(np.array([0.0, 1.0]), np.array([100.0, 100.0]), 1.0)
    rocket = Vehicle.model_rocket(
        motor,
        radius=0.0635,
        mass=14.426,
        inertia=(6.321, 6.321, 0.034),
        centre=0.0,
        case_mass=1.815,
        case_station=-1.056,
        propellant_station=-0.976,
        grain=(0.033, 0.015, 0.62),
        exit_station=-1.373,
        exit_radius=0.033,
        drag=0.4,
        nose=NOSE,
        fins=[FINS, CANARDS],
        tail=(SHOULDER,),
    )
    origin = 1.815 * -1.056 / (14.426 + 1.815)
    found = [*(x.leading_edge for x in rocket.fins), rocket.tail[0].fore_end]
    np.testing.assert_allclose(found, np.array([-1.168, 0.7, 0.4]) - origin, rtol=1e-14)
    # Of two runs, as in a dispersion of a part.
    spans = dataclasses.replace(CANARDS, span=jnp.array([0.05, 0.06]))
    forces = dataclasses.replace(rocket, fins=(FINS, spans)).as_body(AIR)[1]
    slopes = jax.jit(lambda v: v.moments_of_slope(jnp.asarray(0.3))[0])(forces)
    parts = [part.slope(0.3) for part in (NOSE, FINS, SHOULDER)]
    each = [dataclasses.replace(CANARDS, span=s).slope(0.3) for s in (0.05, 0.06)]
    np.testing.assert_allclose(slopes, sum(parts) + np.array(each), rtol=1e-13)


def test_parts_of_another_kind_are_refused():
    for parts in ({"fins": (FINS, TAIL)}, {"fins": "three"}, {"tail": [FINS]}):
        (name,) = parts
        with pytest.raises(InputError, match=rf"Aerodynamics\.{name} is .*: it must be a "):
            Aerodynamics(0.0127, 0.4, **parts)


def test_a_file_has_lists_of_fins_and_tails_and_the_air_of_the_pad(tmp_path):
    """A table for one, a list of tables for several; their numbers may be dispersed. Temperature
    and pressure at the pad are those of the site."""
    (tmp_path / "scenes").mkdir()
    (tmp_path / "model_rockets").mkdir()
    name = "model_rockets/cesaroni_m1670.eng"
    shutil.copy(EXAMPLES / name, tmp_path / name)
    path = tmp_path / "scenes" / "landing.toml"
    text = (EXAMPLES / "scenes" / "landing.toml").read_text()
    fins = text[text.index("[vehicle.fins]") : text.index("[vehicle.tail]")]
    canted = fins.replace("leading_edge", "cant = 0.01\nleading_edge")
    two = text.replace("[vehicle.tail]", canted + "[[vehicle.tail]]")
    two = two.replace("[vehicle.fins]", "[[vehicle.fins]]")
    two = two.replace("[site]", '[site]\ntemperature = "35 degC"\npressure = "865 hPa"')
    two += '"vehicle.fins.1.span" = { deviation = "1 mm" }\n'
    path.write_text(two)
    file = jaxspace.load(path)
    assert "vehicle.fins.1.span" in file.inputs
    scene = file.mission.phases[1].system
    (forces,) = (e for e in scene.effects if isinstance(e, Aerodynamics))
    assert [x.cant for x in forces.fins] == [None, 0.01] and len(forces.tail) == 1
    state, _ = forces.air.at(jnp.zeros(3))
    np.testing.assert_allclose(state[:2], [308.15, 86500.0], rtol=1e-13)
    path.write_text(two.replace("cant = 0.01", "cant = 9"))
    with pytest.raises(SceneError, match=r"vehicle\.fins\.1\.cant is 9"):
        jaxspace.load(path)
    path.write_text(text.replace(fins, "").replace("[vehicle]", "[vehicle]\nfins = []"))
    with pytest.raises(SceneError, match=r"vehicle\.fins is \[\]: it must be a list"):
        jaxspace.load(path)
    assert "fins (one or a list): the fins, of one set or of several" in listing(word="flights")
