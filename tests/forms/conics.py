"""States on conics, from which the searches begin. Units with mu = 1."""

import math


def on_conic(e: float, f: float, tilt: float = 0.0) -> tuple[float, ...]:
    """Position and velocity at the anomaly f of a conic whose periapsis is 1, turned by `tilt`
    about the line of apsides."""
    # By Python's numbers, so that the inputs are the same on every device.
    r = (1.0 + e) / (1.0 + e * math.cos(f))
    s = 1.0 / math.sqrt(1.0 + e)
    c, n = math.cos(tilt), math.sin(tilt)
    y, v = r * math.sin(f), s * (e + math.cos(f))
    return (r * math.cos(f), y * c, y * n, -s * math.sin(f), v * c, v * n)


CIRCLE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
