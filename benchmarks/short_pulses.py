"""Short pulses that fall between the stages of long steps can be missed with a successful status.
The table counts the missed pulses of forty smooth ones, by the pulse length relative to the mean
step: an oscillator is simulated over twenty time units with one pulse, at a tolerance of 1e-9, and
compared with the closed form. A pulse counts as missed if more than half of its effect is lost.
With a `max_step` of half a pulse no pulse may be missed.

The pulses are (1 + cos)/2 in shape. SciPy's DOP853 stands for peers that sample, too; each method
at its own mean step."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxspace import BodyState
from jaxspace.core import AbstractSystem
from jaxspace.simulation import Accuracy, simulate
from jaxspace.solvers import DOP853, RKN1210, Tsit5

from ._measure import optional

SPAN, KICK, PULSES, TOLERANCE = 20.0, 1e-3, 40, 1e-9
LENGTHS = (0.5, 0.3, 0.2, 0.1, 0.05)


class Struck(AbstractSystem):
    """r'' = -r + kick (1 + cos(2 pi (t - c) / w)) / w within w/2 of c."""

    centre: Array
    width: Array
    kick: Float[Array, "3 *#runs"]

    def vector_field(self, t, y):
        x = (t - self.centre) / self.width
        pulse = jnp.where(jnp.abs(x) < 0.5, (1.0 + jnp.cos(2.0 * jnp.pi * x)) / self.width, 0.0)
        return BodyState(y.velocity, self.kick * pulse - y.position)

    def invariants(self, t, y):
        return {}


def effect(centre, width):
    """What the pulse adds to the last position."""
    return (
        KICK
        * np.sin(SPAN - centre)
        * (2.0 / width)
        * np.sin(0.5 * width)
        * (1.0 + 1.0 / ((2.0 * np.pi / width) ** 2 - 1.0))
    )


def ours(method):
    """A call: centre, width, kick, longest step -> the last position and the number of steps."""

    @eqx.filter_jit
    def end(centre, width, kick, longest):
        y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 0.5, 0.0]))
        system = Struck(centre, width, kick * jnp.array([0.0, 0.0, 1.0]))
        accuracy = Accuracy(rtol=TOLERANCE, method=method, max_step=longest)
        run = simulate(system, y0, jnp.array([0.0, SPAN]), accuracy=accuracy)
        return run.final.position[2], run.stats["steps"]

    return lambda *given: tuple(map(float, end(*map(jnp.asarray, given))))


def scipys():
    """The same by SciPy."""
    from scipy.integrate import solve_ivp

    def end(centre, width, kick, longest):
        def rate(t, y):
            x = (t - centre) / width
            pulse = kick * (1.0 + np.cos(2.0 * np.pi * x)) / width if abs(x) < 0.5 else 0.0
            return [*y[3:], -y[0], -y[1], pulse - y[2]]

        y0 = [1.0, 0.0, 0.0, 0.0, 0.5, 0.0]
        run = solve_ivp(
            rate, (0.0, SPAN), y0, "DOP853", rtol=TOLERANCE, atol=TOLERANCE, max_step=longest
        )
        return run.y[2, -1], run.t.size - 1

    return end


def missed(end, width, longest) -> int:
    """How many of the pulses of this width are not in the result; their centres are drawn where
    their effect is large."""
    g = np.random.default_rng(4)
    centres = SPAN - 0.5 * np.pi - np.pi * g.integers(0, 5, PULSES) + g.uniform(-1.0, 1.0, PULSES)
    late = [end(c, width, KICK, longest)[0] - effect(c, width) for c in centres]
    return int(np.sum(np.abs(late) > 0.5 * np.abs(effect(centres, width))))


def measure() -> dict:
    """The mean step of every method without a pulse, and how many pulses of which length it misses,
    of PULSES."""
    methods = {
        "ours, RKN 12(10)": ours(RKN1210()),
        "ours, DOP853": ours(DOP853()),
        "ours, Tsit5": ours(Tsit5()),
    }
    if optional("scipy"):
        methods["scipy DOP853"] = scipys()
    seen = {}
    for name, end in methods.items():
        step = SPAN / end(0.0, 1.0, 0.0, np.inf)[1]
        row = {"mean_step": step}
        row |= {f"missed_at_{part}": missed(end, part * step, np.inf) for part in LENGTHS}
        row["missed_at_0.05_with_max_step"] = missed(end, 0.05 * step, 0.025 * step)
        seen[name] = row
    return seen
