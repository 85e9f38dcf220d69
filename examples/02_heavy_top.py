"""A heavy top: Euler angles as input, precession and nutation as output, and an axis that passes
close to the vertical."""

import jax.numpy as jnp

import jaxspace
from jaxspace import simulate
from jaxspace.attitude import Top
from jaxspace.attitude.outputs import continuous_precession

jaxspace.enable_x64()

# Transverse and axial moment of inertia about the tip, kg m^2, and weight times height of the
# centre of mass, N m.
top = Top(transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08)
tilt, spin = jnp.radians(30.0), 60.0
print(
    f"the least spin that stands upright: {top.least_spin(0.0):.1f} rad/s; this top has {spin:.0f}"
)

# Released at rest. The closed form of the nutation gives the turning point, the period and the
# precession per period; the integration agrees.
y0 = top.state(angles=[0.0, tilt, 0.0], rates=[0.0, 0.0, spin])
nutation = top.nutation(y0)
highest, lowest = nutation.turning_points
run = simulate(top, y0, jnp.linspace(0.0, nutation.period, 201), accuracy=1e-11)
theta, psi = top.angles(run.states)[1], continuous_precession(run.states)
print("\nlet go at rest          closed form    integrated")
print(f"upper circle, deg     {jnp.degrees(highest):13.8f} {jnp.degrees(theta.min()):13.8f}")
print(f"lower circle, deg     {jnp.degrees(lowest):13.8f} {jnp.degrees(theta.max()):13.8f}")
print(
    f"precession, deg       {jnp.degrees(nutation.precession):13.8f}"
    f" {jnp.degrees(psi[-1] - psi[0]):13.8f}"
)
print(
    f"after a period of {nutation.period:.6f} s the tilt is back to"
    f" {jnp.abs(theta[-1] - tilt):.0e} rad"
)
assert abs(psi[-1] - psi[0] - nutation.precession) < 1e-8 and abs(theta.max() - lowest) < 1e-8
print(
    "largest relative drift:",
    {name: f"{jnp.max(values):.0e}" for name, values in run.drift().items()},
)

# The initial rate of steady precession gives a motion without nutation.
ts = jnp.linspace(0.0, 10.0, 201)
slow, fast = top.steady_precession_rates(tilt, spin)
print(
    f"\nsteady precession: {slow:.4f} rad/s slowly, {fast:.4f} rad/s fast; small nutations at",
    end=" ",
)
print(f"{top.nutation_frequency(tilt, slow, spin):.3f} rad/s")
for rate in (slow, fast):
    steady = simulate(
        top,
        top.state([0.0, tilt, 0.0], [rate, 0.0, spin - rate * jnp.cos(tilt)]),
        ts,
        accuracy=1e-11,
    )
    wobble = jnp.max(jnp.abs(top.angles(steady.states)[1] - tilt))
    print(f"at {rate:8.4f} rad/s the tilt stays within {wobble:.0e} rad")
    assert wobble < 1e-7

# With h_Z = C n to within one part in a million, the axis rises almost to the vertical, where
# the rates of the Euler angles diverge. The quaternion is integrated instead, and the angles
# are computed from it.
C_n, A = 6.0e-4 * 35.0, 1.0e-3
precession = C_n * (1.0 - 1e-6 - jnp.cos(tilt)) / (A * jnp.sin(tilt) ** 2)
y0 = top.state([0.0, tilt, 0.0], [precession, 0.0, 35.0 - precession * jnp.cos(tilt)])
nutation = top.nutation(y0)
run = simulate(top, y0, jnp.linspace(0.0, nutation.period, 20001), accuracy=1e-11)
fastest = jnp.max(jnp.abs(top.rates(run.states)[0]))
nearest = nutation.turning_points[0]
print(
    f"\nnear-vertical pass: {jnp.degrees(nearest):.6f} deg from the vertical,"
    f" where psi' = {fastest:.0f} rad/s;"
)
print(
    f"the energy drifts by {jnp.max(run.drift()['energy']):.0e}, the smallest angle is off by",
    end=" ",
)
print(f"{jnp.abs(jnp.min(top.angles(run.states)[1]) - nearest):.0e} rad")
assert nearest < 1e-4 and jnp.max(run.drift()["energy"]) < 1e-9
