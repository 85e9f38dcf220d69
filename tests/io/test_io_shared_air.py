"""One table [air] for all effects of a file, and the units of results."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.io import SceneError, load

ATMOSPHERE = 'density = "1.225 kg/m^3", reference_height = "0 m", scale_height = "9.2 km"'
SCENE = """
accuracy = 1e-5

[body]
mass = "20 kg"

%s
[effects.ground_gravity]
gravity = "9.81 m/s^2"

[effects.air_drag]
area = "0.0127 m^2"
coefficient = { mach = [0.0, 1.0], values = [0.4, 0.6] }
%s

[effects.parachute]
drag_area = "0.01 m^2"
opening = "50 s"
%s

[initial]
position = ["0 m", "0 m", "5 m"]
velocity = ["2 m/s", "0 m/s", "28 m/s"]

[times]
end = "60 s"

[dispersion]
outputs = ["speed"]

[dispersion.inputs]
"%s" = { deviation = "10 m" }
"""
AIR = f'elevation = "1400 m"\natmosphere = {{ {ATMOSPHERE} }}\n'
INLINE = f'air = {{ elevation = "1400 m", atmosphere = {{ {ATMOSPHERE} }} }}'
"""The same for one effect."""


def scene(shared, drag, area, path="air.elevation"):
    return load("air.toml", text=SCENE % (shared, drag, area, path))


def same(a, b):
    a, b = jax.tree.leaves(a.system), jax.tree.leaves(b.system)
    return len(a) == len(b) and all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_effects_share_the_air_of_the_file():
    shared = scene(f"[air]\n{AIR}", "", "")
    copies = scene("", INLINE, INLINE, "effects.air_drag.air.elevation")
    assert same(shared, copies) and shared.warnings == copies.warnings == ()
    # One input moves it for both.
    mission, _ = shared.build({"air.elevation": jnp.array([100.0, 200.0])})
    effects = mission.phases[0].moving.effects
    heights = [e.air.elevation for e in effects if hasattr(e, "air")]
    assert len(heights) == 2
    for height in heights:
        np.testing.assert_array_equal(height, [100.0, 200.0])


def test_an_effect_may_have_another_air_with_a_warning():
    other = scene(f"[air]\n{AIR}", "", 'air = { elevation = "0 m" }')
    (warning,) = other.warnings
    assert warning.startswith("effects.parachute and effects.air_drag are in different air")
    # One that is forgotten is calm standard air.
    forgotten = scene("", INLINE, "", "effects.air_drag.air.elevation")
    assert len(forgotten.warnings) == 1 and not same(forgotten, other)
    with pytest.raises(SceneError, match="air.elevation is .*: it must be a number"):
        scene('[air]\nelevation = "1 kg"', "", "")


@pytest.mark.parametrize(
    "lengths, output, unit",
    [
        # The radius of a tube does not decide on the altitude of an orbit.
        ('radius = "6378137000 mm"', '"periapsis_altitude"', "m"),
        ('radius = "6378.137 km"', '"periapsis_altitude"', "km"),
        ('radius = "6378137000 mm"', '{ output = "periapsis_altitude", at_least = "9 km" }', "km"),
        ('radius = "6378.137 km"', '{ output = "periapsis_altitude", at_least = "9 mi" }', "km"),
        ('radius = "6378.137 km"', '{ output = "periapsis_altitude", unit = "ft" }', "ft"),
    ],
)
def test_units_of_outputs(lengths, output, unit):
    text = f"""
accuracy = 1e-6
[planet]
mu = 3.986e14
{lengths}
[effects.point_gravity]
[initial]
position = [7e6, 0.0, 0.0]
velocity = [0.0, 8e3, 0.0]
[times]
end = 60.0
[dispersion]
outputs = [{output}]
[dispersion.inputs]
"planet.mu" = {{ deviation = "1 %" }}
"""
    (spec,) = load("orbit.toml", text=text).outputs
    assert spec.unit == unit
