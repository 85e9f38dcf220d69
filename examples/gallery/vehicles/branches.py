"""Separate descent of rocket parts
Descent of the parts of a rocket

A two-stage sounding rocket: a spring separates the empty first stage, which
descends under a parachute from 2 km; at apogee the payload leaves the second
stage, and its parachute opens at 6 km. All parts are one mission."""

from functools import partial

import equinox as eqx
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import BodyState, Event, Mission, Phase, Scene, simulate_mission
from jaxspace.bodies import Detached, parting, solids
from jaxspace.rockets import SteeredThrust, steering
from jaxspace.vehicles import Parachute, Wind, ground_gravity, local_air

jaxspace.enable_x64()
FIRST, SECOND, PAYLOAD = 40.0, 15.0, 10.0  # kg, without propellant
PROPELLANT = (30.0, 6.0)  # kg
air = local_air.LocalAir(wind=Wind([0.0, 8e3], [4.0, 15.0], [0.0, 0.0]))


def scene(drag_area, *more):
    pull = ground_gravity.GroundGravity(9.81)
    drag = Parachute(drag_area, air=air)
    return Scene([pull, drag, *more], carry=("mass",))


class Below(eqx.Module):
    """A condition with a parameter: all parachutes share a program."""

    height: float

    def __call__(self, t, y):
        return y.position[2] - self.height


def parachute(name, start, opens):
    falling, down = (Event(Below(h), -1, within=3e3) for h in (opens, 0.0))
    fall = Phase(scene(0.02), falling, name="fall")
    hang = Phase(scene(8.0), down, name="parachute")
    return Mission([fall, hang], start=start, name=name)


motor = partial(SteeredThrust.of_propellant, steering.AlongVelocity())
first = motor(9e3, 230.0, PROPELLANT[0])
burnout = first.burn_time
second = motor(4e3, 230.0, PROPELLANT[1], ignition=burnout + 3.0)
rest = SECOND + PAYLOAD + PROPELLANT[1]
apart = parting.spring_speed(400.0, FIRST, rest)
# The state has no attitude: the axis of the rocket is taken upwards.
first_stage = solids.cylinder(FIRST, 0.1, 2.0)
others = solids.cylinder(rest, 0.1, 3.0).moved(jnp.array([0.0, 0.0, 2.5]))
still = jnp.zeros(3)
kicks = [still, jnp.array([0.0, 0.0, apart])]
lower, upper = parting.come_apart(first_stage, others, kicks=kicks)
apogee = Event(lambda t, y: y.velocity[2], -1, within=300.0)
parts = [parachute("stage", Detached(SECOND, still), 2e3)]
parts += [parachute("payload", Detached(PAYLOAD, still), 6e3)]
climb = Phase(scene(0.01, second), apogee, name="climb", branches=parts)
booster = parachute("booster", lower, 2e3)
sustainer = Mission([climb], start=upper, name="sustainer")
ascent = Phase(scene(0.012, first), burnout, branches=[booster, sustainer])
mass = jnp.array(FIRST + PROPELLANT[0] + rest)
y0 = BodyState(jnp.zeros(3), jnp.array([4.0, 0.0, 35.0]), mass=mass)
flight = simulate_mission(Mission([ascent]), y0, accuracy=1e-6, num_saved=60)

figure, axes = plt.subplots(figsize=(5.8, 4.2))
names = ("sustainer", "booster", "sustainer.stage", "sustainer.payload")
lines = {"both stages": flight.without_branches()}
lines |= {name: flight[name].without_branches() for name in names}
for name, line in lines.items():
    path = jnp.concatenate([p.states.position for p in line], axis=1) / 1e3
    axes.plot(path[0], path[2], label=name.rpartition(".")[2])
axes.set(xlabel="east, km", ylabel="height, km")
axes.legend()
plt.show()
