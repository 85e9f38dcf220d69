"""Single precision stays, whatever Python numbers meet it: every public formula of the systems in
the registry, and of classes that have formulas alone, with a Python number for each number."""

import inspect
from typing import get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from more_systems import MORE
from systems import GYRO, SAMPLES

from jaxspace import Scene
from jaxspace.attitude import SpinningMissile, YoYo
from jaxspace.core import InputError, Scalar, State
from jaxspace.gyros import TwoGimbalGyro
from jaxspace.gyros.bearing import BearingFriction, RotorMotor
from jaxspace.rockets import SpinningRocket

RUBBING = TwoGimbalGyro(
    *(0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015),
    inner_bearing=BearingFriction(0.01, 0.02),
    outer_bearing=BearingFriction(0.02, 0.03),
    motor=RotorMotor(1e-3, 450.0),
)
# Without a state; and a gyro with all of its parts, before those of the registry.
FIRST = [
    (SpinningRocket(6.0, 0.01, 1.2, 0.8, 0.3), None),
    (SpinningMissile(2.0, 0.5, 20.0), None),
    (YoYo(0.264, 0.127, 0.01134, 1.0), None),
    (GYRO.walk(1.0, 2.0), None),
    (RUBBING, RUBBING.state(1.05, 0.1, 2.0, 0.3)),
]


def single(tree):
    return jax.tree.map(
        lambda x: jnp.asarray(x, jnp.float32) if eqx.is_inexact_array(x) else x, tree
    )


def everything():
    """Each class once, with a state where it has one."""
    found = {type(part).__name__: (part, state) for part, state in FIRST}
    for sample in (*SAMPLES, *MORE):
        parts = sample.system.effects if isinstance(sample.system, Scene) else [sample.system]
        for part in parts:
            found.setdefault(type(part).__name__, (part, sample.state))
    return found


EVERYTHING = everything()


def argument(annotation, state):
    """What a formula is given in place of such a parameter; None for what is no number."""
    if annotation == Scalar:
        return 0.3
    if annotation == State or (isinstance(annotation, type) and isinstance(state, annotation)):
        return state
    # Components are an array, and so of the precision of the system.
    for kind in (annotation, *get_args(annotation)):
        size = getattr(kind, "dim_str", "").split(" ")[0]
        if size.isdigit():
            return jnp.full(int(size), 0.1, jnp.float32)
    return None


def calls(part, state):
    """The public formulas whose arguments can be made here, and these."""
    for name in dir(type(part)):
        # A static method and one of the class know no system whose precision they could keep.
        if name.startswith("_") or not inspect.isfunction(inspect.getattr_static(part, name)):
            continue
        parameters = inspect.signature(getattr(part, name)).parameters.values()
        needed = [p.annotation for p in parameters if p.default is inspect.Parameter.empty]
        args = [argument(annotation, state) for annotation in needed]
        if all(x is not None for x in args):
            yield name, args


@pytest.mark.parametrize("name", EVERYTHING)
def test_a_python_number_raises_no_precision(name):
    """By their shapes alone, as the compiler is told them: nothing is compiled."""
    part, state = (single(x) for x in EVERYTHING[name])
    for formula, args in calls(part, state):
        numbers, arrays = eqx.partition(args, lambda x: isinstance(x, float))

        def called(part, arrays, formula=formula, numbers=numbers):
            return getattr(part, formula)(*eqx.combine(numbers, arrays))

        try:
            found = jax.tree.leaves(eqx.filter_eval_shape(called, part, arrays))
        except InputError:
            # The end of a burn, without a mass at which it ends.
            continue
        doubles = [x for x in found if getattr(x, "dtype", None) == jnp.float64]
        # A weak type follows what it meets.
        assert all(x.weak_type for x in doubles), formula


def test_a_moment_that_changes_with_the_time_keeps_single_precision():
    """Its integral is by nodes that are known."""
    missile = single(SpinningMissile(2.0, 0.5, 20.0))
    pair = jnp.array([0.1, 0.2], jnp.float32)

    def moment(t):
        return jnp.stack([jnp.sin(t), jnp.cos(t)])

    rate = eqx.filter_eval_shape(
        lambda m, pair: m.transverse_rate(0.3, pair, moment), missile, pair
    )
    tilt = eqx.filter_eval_shape(
        lambda m, pair: m.complex_tilt(0.3, pair, pair, moment), missile, pair
    )
    assert rate.dtype == tilt.dtype == jnp.float32
