"""Cost of a derivative relative to the run itself, in reverse mode and, for the full Jacobian, in
forward mode. The runs are 256 low orbits for three revolutions, in one program compiled by the user
for vectors of 512 bits, with the default `max_steps`. Forward mode executes the steps twice, once
to record them and once along the record. Each column of the Jacobian costs as much as 0.6 to 1.0 of
a run, because a tangent requires the same sums of the method as a state, and shares only the roots
and quotients of the vector field. Six columns cost as much as eight or nine runs, and as
twenty-three with Stormer's method. A handwritten derivative rule for the gravity gradient, which is
symmetric, did not reduce the cost of a column. Without derivative control the steps depend only on
the motion. For a single run, forward mode computes the derivative along one direction. The flight
is through the standard atmosphere with tables of drag and thrust, whose kinks are discontinuities
of a tangent: its error is that of the derivative with respect to the initial mass, compared with
the tightest tolerance."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxspace import AbstractSystem, BodyState, load
from jaxspace.orbits import TwoBody
from jaxspace.simulation import Accuracy, simulate, simulate_batch
from jaxspace.solvers import DOP853, Stormer, Tsit5

from ._measure import WIDE, in_turn, worst
from .low_orbits import SCENE, orbits

RUNS, SPAN = 256, 20.0
STORMER = Stormer(12, steps=264)
ADAPTIVE = "DOP853", "auto, RKN 12(10)", "Tsit5"
PAD = Path(__file__).parents[1] / "examples" / "scenes" / "pad_to_orbit.toml"
CLIMB, TIGHT = 100.0, 1e-12


def end(
    system: AbstractSystem,
    y: BodyState,
    method: Any,
    rtol: float = 1e-9,
    control: bool = True,
) -> BodyState:
    """The orbits three revolutions later; `control`: whether their steps look at derivatives."""
    ts = jnp.array([0.0, SPAN], y.position.dtype)
    accuracy = Accuracy(rtol=rtol, method=method, derivative_control=control)
    return simulate_batch(system, y, ts, accuracy=accuracy).final


def matrix(system: AbstractSystem, y: BodyState, method: Any, rtol: float = 1e-9) -> Array:
    """Derivatives of the positions there with respect to the states, (6, 3, runs)."""

    def column(k):
        components = jnp.zeros((6, y.position.shape[-1]), y.position.dtype).at[k].set(1.0)
        tangent = type(y)(components[:3], components[3:])
        return jax.jvp(lambda s: end(system, s, method, rtol), (y,), (tangent,))[1].position

    return jax.vmap(column)(jnp.arange(6))


def gradient(system: AbstractSystem, y: BodyState, method: Any, rtol: float = 1e-9) -> BodyState:
    """Derivatives of the sum of their first components, in reverse mode."""
    return jax.grad(lambda y: jnp.sum(end(system, y, method, rtol).position[0]))(y)


def uncontrolled(system: AbstractSystem, method: Any, y: BodyState) -> BodyState:
    """`gradient` of runs whose steps the motion alone controls."""
    return jax.grad(lambda y: jnp.sum(end(system, y, method, control=False).position[0]))(y)


def alone(y: BodyState, forward: bool, control: bool) -> BodyState:
    """The gradient of a single run, along its own state in forward mode."""
    accuracy = Accuracy(rtol=1e-9, method=DOP853(), derivative_control=control)

    def place(y: BodyState) -> Array:
        return simulate(SCENE, y, jnp.array([0.0, SPAN]), accuracy=accuracy).final.position[0]

    return jax.jvp(place, (y,), (y,))[1] if forward else jax.grad(place)(y)


def of_single_runs(y0: BodyState) -> dict:
    """Speed of the gradients of a single run by DOP853, with and without derivative control."""
    y = jax.tree.map(lambda x: x[:, 0], y0)
    calls = {}
    for mode in ("reverse", "forward"):
        for control in (True, False):
            program = jax.jit(lambda y, f=mode == "forward", c=control: alone(y, f, c))
            what = "" if control else ", without derivative control"
            calls[f"a single run, {mode} mode{what}"] = lambda program=program: program(y)
    return in_turn(calls, 1, repeats=51)


def of_flights() -> dict:
    """Speed of a single flight through tables and of its gradient, with and without derivative
    control, and the error of the gradient."""
    file = load(PAD)
    rocket, y0 = file.mission.phases[0].system, file.y0

    def height(m: Array, rtol: float, control: bool) -> Array:
        y = eqx.tree_at(lambda y: y.mass, y0, m)
        accuracy = Accuracy(rtol=rtol, derivative_control=control)
        ts = jnp.array([0.0, CLIMB])
        return simulate(rocket, y, ts, accuracy=accuracy).final.position[0]

    def gradient(rtol: float, control: bool) -> Callable[[Array], Array]:
        return jax.jit(jax.grad(lambda m: height(m, rtol, control)))

    true = gradient(TIGHT, True)(y0.mass)
    run = jax.jit(lambda m: height(m, 1e-9, True))
    programs = {
        "run": run,
        "reverse mode": gradient(1e-9, True),
        "reverse mode, without derivative control": gradient(1e-9, False),
    }
    calls = {
        f"a flight through tables, {what}": lambda f=f: f(y0.mass) for what, f in programs.items()
    }
    rows = in_turn(calls, 1, repeats=51)
    base = next(iter(rows.values()))["runs_per_second"]
    for (what, row), f in zip(rows.items(), programs.values(), strict=True):
        if f is not run:
            row["worst_error_of_the_gradient"] = float(jnp.abs(f(y0.mass) / true - 1.0))
            row["times_the_run"] = base / rows[what]["runs_per_second"]
    return rows


def measure() -> dict:
    """Speed of the run, of its reverse mode and of its 6 x 6 matrix, by four methods; the same for
    the closed form; what derivative control takes of it, of single runs as well; and the error of
    the reverse modes against the matrices."""
    y0 = jax.tree.map(lambda x: x[:, :RUNS], orbits())
    works = {"run": end, "run and reverse mode": gradient, "run and 6 x 6 matrix": matrix}
    cases = {
        "DOP853": (SCENE, DOP853()),
        "auto, RKN 12(10)": (SCENE, "auto"),
        "Tsit5": (SCENE, Tsit5()),
    }
    cases |= {
        "Stormer of order 12": (SCENE, STORMER),
        "closed form": (TwoBody(1.0), "auto"),
    }
    programs = {
        name: {
            what: jax.jit(lambda y, f=f, case=case: f(case[0], y, case[1]), compiler_options=WIDE)
            for what, f in works.items()
        }
        for name, case in cases.items()
    }
    for name in ADAPTIVE:
        programs[name]["run and reverse mode, without derivative control"] = jax.jit(
            lambda y, case=cases[name]: uncontrolled(*case, y), compiler_options=WIDE
        )
    calls = {
        f"{name}, {what}": lambda f=f: f(y0)
        for name, every in programs.items()
        for what, f in every.items()
    }
    rows = in_turn(calls, RUNS, repeats=11)
    for name, every in programs.items():
        base, *others = (f"{name}, {what}" for what in every)
        columns = every["run and 6 x 6 matrix"](y0)
        by_reverse = every["run and reverse mode"](y0).position
        rows[f"{name}, run and reverse mode"]["worst_error_of_the_gradient"] = worst(
            by_reverse, columns[:3, 0]
        )
        for other in others:
            rows[other]["times_the_run"] = (
                rows[base]["runs_per_second"] / rows[other]["runs_per_second"]
            )
    return rows | of_single_runs(y0) | of_flights()
