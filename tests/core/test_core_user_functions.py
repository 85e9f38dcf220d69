"""Functions of users that ask a traced number for its value, or return something else."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from unchecked import unchecked

from jaxspace import BodyState, Event, Scene, simulate
from jaxspace.bodies import Load
from jaxspace.core import InputError
from jaxspace.estimation import fit
from jaxspace.minimisation import Criterion, minimise
from jaxspace.orbits import PointGravity
from jaxspace.orbits.interception import interception, porkchop
from jaxspace.rockets import SteeredThrust
from jaxspace.rockets.steering import UserSteering
from jaxspace.scene import Custom

Y = BodyState([1, 0, 0], [0, 1, 0])
START = jnp.array([1.0, 2.0])

NUMPY = r"passes a traced array to NumPy or another library.*: use jax.numpy"
BRANCH = r"branches in Python on the value of a traced number.*: use jnp.where"
PYTHON = r"converts a traced number to a number of Python.*: use jax.numpy"


def run(load):
    return simulate(Scene([PointGravity(1.0), Custom(load)]), Y, [0, 1])


def steered(direction):
    thrust = SteeredThrust(UserSteering(direction), 1.0, 1e3, 5.0)
    return simulate(Scene([thrust]), BodyState([1, 0, 0], [0, 1, 0], mass=10.0), [0, 1])


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda: run(lambda t, y, body: Load(force_N=np.sin(y.position))),
            f"^Custom.function {NUMPY}",
        ),
        (
            lambda: run(lambda t, y, body: Load(force_N=y.position if t > 1 else -y.position)),
            f"^Custom.function {BRANCH}",
        ),
        (
            lambda: run(lambda t, y, body: Load(force_N=math.sin(t) * y.position)),
            f"^Custom.function {PYTHON}",
        ),
        (
            lambda: run(lambda t, y, body: Load(force_N=float(t) * y.position)),
            f"^Custom.function {PYTHON}",
        ),
        (
            lambda: steered(lambda t, y: np.asarray(y.velocity)),
            f"^SteeredThrust.load {NUMPY}",
        ),
        (
            lambda: simulate(
                Scene([PointGravity(1.0)]),
                Y,
                [0, 1],
                events=(Event(lambda t, y: t if y.position[0] > 0.0 else -t),),
            ),
            rf"^events\[0\].condition fails .*: it {BRANCH}",
        ),
        (lambda: minimise(lambda x: Criterion(np.sin(x[0])), START), f"^problem {NUMPY}"),
        (
            lambda: minimise(lambda x: Criterion(x[0] if x[0] > 0 else -x[0]), START),
            f"^problem {BRANCH}",
        ),
        (lambda: minimise(lambda x: Criterion(float(x[0])), START), f"^problem {PYTHON}"),
        (
            lambda: minimise(lambda x: jnp.sum(x**2), START),
            r"^problem returns an array of shape \(\): it must return a Criterion, such as",
        ),
        (lambda: fit(lambda p: np.sin(p), jnp.ones(2), START), f"^model {NUMPY}"),
        (
            lambda: Custom(lambda t, y: y),
            r"^Custom.function has the arguments \(t, y\): it must accept \(t, y, body\), .* Load",
        ),
        (
            lambda: run(lambda t, y, body: -y.position),
            r"^Custom.function returns an array of the shape \(3,\): it must return a Load, such",
        ),
        (
            lambda: interception(jnp.ones(6), Y, 0.0, 1.0, 1.0),
            r"^chaser is an array of the shape \(6,\) .*: it must be a position and a velocity",
        ),
        (
            lambda: porkchop(Y, jnp.ones((2, 3)), [0.0, 1.0], [2.0, 3.0], 1.0),
            r"^target is an array of the shape \(2, 3\) .*: it must be a position and a velocity",
        ),
    ],
)
def test_the_message_says_what_to_write(call, sentence):
    with unchecked(), pytest.raises(InputError, match=sentence):
        call()


def test_the_line_of_the_user_is_named(tmp_path):
    path = tmp_path / "script.py"
    text = "def push(t, y, body):\n    return Load(force_N=np.cos(y.position))\n"
    path.write_text(text)
    scope = {"np": np, "Load": Load}
    exec(compile(text, str(path), "exec"), scope)
    with pytest.raises(InputError, match=r"line 2: return Load\(force_N=np.cos\(y.position\)\)"):
        run(scope["push"])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Criterion(1.0, equal=jnp.ones(2)), "no argument 'equal'. Did you mean equal_zero"),
        (lambda: PointGravity(gm=1.0), "PointGravity has no argument 'gm'. It has mu.$|mean mu"),
        (lambda: BodyState(positon=[1, 2, 3]), "Did you mean position?"),
    ],
)
def test_an_unknown_argument_of_a_class_gets_the_nearest_one(make, sentence):
    with pytest.raises(TypeError, match=sentence):
        make()
