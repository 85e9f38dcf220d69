"""Transfer between coaxial ellipses
Transfers between apsides of coaxial ellipses

Two impulses transfer a satellite from the perigee of an ellipse to the apogee
of another one with the same line of apsides (4.12), along half an ellipse
that is tangent to both. Right: the cost of the four transfers between apsides
against the size of the outer ellipse; departure from the perigee, where the
speed is highest, is optimal."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.conic import conic_radius
from jaxspace.orbits.transfers import coaxial_transfer

jaxspace.enable_x64()
e1, a1, e2, a2 = 0.2, 1.5, 0.3, 4.0  # in radii of the Earth
p1, q1 = a1 * (1.0 - e1), a1 * (1.0 + e1)
angle = jnp.linspace(0.0, 2.0 * jnp.pi, 400)


def ellipse(perigee, apogee, angle):
    e = (apogee - perigee) / (apogee + perigee)
    r = conic_radius(perigee * (1.0 + e), e, angle)
    return r * jnp.cos(angle), r * jnp.sin(angle)


figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
left.add_patch(plt.Circle((0, 0), 1.0, color="0.88"))
inner, outer = ellipse(p1, q1, angle), ellipse(2.8, 5.2, angle)
left.plot(*inner, label="first")
left.plot(*outer, label="last")
left.plot(*ellipse(p1, 5.2, angle[:200]), label="transfer")
left.plot([p1, -5.2], [0.0, 0.0], "ko", ms=4)
left.set(xlabel="x / R", ylabel="y / R", aspect="equal")
left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=3)

size = jnp.linspace(2.6, 8.0, 300)
p2, q2 = size * (1.0 - e2), size * (1.0 + e2)
ways = {
    "perigee to apogee": (p1, q1, q2, p2),
    "apogee to perigee": (q1, p1, p2, q2),
    "opposite: perigee to perigee": (p1, q1, p2, q2),
    "opposite: apogee to apogee": (q1, p1, q2, p2),
}
for name, radii in ways.items():
    right.plot(size, coaxial_transfer(*radii, 1.0).total, label=name)
right.plot(a2, coaxial_transfer(p1, q1, 5.2, 2.8, 1.0).total, "ko", ms=4)
right.set(xlabel="outer semi-major axis / R", ylabel="speed / sqrt(mu / R)")
right.legend()
plt.show()
