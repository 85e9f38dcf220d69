"""The quantities of the attracting body, declared once for the effects and systems that have
them."""

from typing import Any

from ..core import quantity


def gravitational_parameter() -> Any:
    """The field `mu`."""
    return quantity(
        "m^3/s^2",
        positive=True,
        shared="planet.mu",
        doc="gravitational parameter of the attracting body",
    )


def equatorial_radius(harmonics: str) -> Any:
    """The field `radius`, to which the `harmonics`, by their name, refer."""
    return quantity(
        "m",
        positive=True,
        shared="planet.radius",
        doc=f"equatorial radius of the attracting body, to which {harmonics}",
    )
