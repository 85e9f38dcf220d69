"""`[optimize]` of scene files: what is read, what is found, and the file of the optimum."""

import os
import signal
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tqdm
from jaxtyping import Array

from jaxspace import load
from jaxspace.cli import main
from jaxspace.core import AbstractSystem, InputError
from jaxspace.io import SceneError
from jaxspace.io.reports.optimum import optimum_report, sensitivity_report
from jaxspace.optimization.optimisers import named_optimiser
from jaxspace.simulation import Event, Mission, Phase, Status, simulate_compact

MU, R1, R2, RADIAL = 3.986004418e14, 6.678137e6, 8.0e6, 1e3

# The least energy with which 8000 km are reached: the faster upwards, the nearer the other apsis.
TRANSFER = f"""
# the comment stays
[planet]
mu = {MU}
radius = "6378.137 km"

[body]
mass = 1.0

[effects.point_gravity]

[initial]
position = ["6678.137 km", 0.0, 0.0]
velocity = ["0.1 km/s", "8 km/s", 0.0]

[times]
end = "300 s"

[optimize]
minimise = "specific_energy"

[optimize.free]
"initial.velocity.1" = {{ low = "7.6 km/s", high = "8.5 km/s" }}
"initial.velocity.0" = {{ low = 0.0, high = "1 km/s" }}

[[optimize.constraint]]
output = "apoapsis_radius"
at_least = "8000 km"
"""


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    path = tmp_path_factory.mktemp("optimize") / "transfer.toml"
    path.write_text(TRANSFER)
    steps = []
    return load(path).optimize(progress=lambda *row: steps.append(row)), steps


def across(radial, r1, r2, mu):
    """The horizontal speed at r1, from energy and angular momentum at both places."""
    return jnp.sqrt((2.0 * mu * (1.0 / r1 - 1.0 / r2) - radial**2) / (1.0 - (r1 / r2) ** 2))


def energy(radial, r1, r2, mu):
    return 0.5 * (across(radial, r1, r2, mu) ** 2 + radial**2) - mu / r1


def test_the_optimum_and_its_multipliers(searched):
    """The closed form, with one number at its bound; its derivatives are what the multipliers
    say."""
    best, steps = searched
    assert best.minimum.converged
    rows = best.minimum.history
    np.testing.assert_array_equal([row[1:] for row in steps], rows[~jnp.isnan(rows[:, 0])])
    exact = (RADIAL, R1, R2, MU)
    np.testing.assert_allclose(best.values["initial.velocity.1"], across(*exact), rtol=1e-7)
    np.testing.assert_allclose(best.objective, energy(*exact), rtol=1e-7)
    by_bound, _, by_target, _ = jax.grad(energy, argnums=(0, 1, 2, 3))(*exact)
    np.testing.assert_allclose(best.target_derivatives, [by_target], rtol=1e-5)
    assert list(best.bound_derivatives) == ["initial.velocity.0"]
    np.testing.assert_allclose(best.bound_derivatives["initial.velocity.0"], by_bound, rtol=1e-5)
    report = optimum_report(best)
    assert "at least" in report and "Converged after" in report


def test_a_search_with_other_numbers_compiles_nothing(searched, tmp_path):
    path = tmp_path / "other.toml"
    path.write_text(
        TRANSFER.replace("the comment stays", "another one").replace("8000 km", "8050 km")
    )
    compiled = []

    def note(event, _, **details):
        compiled.extend([details] if event.endswith("backend_compile_duration") else [])

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        best = load(path).optimize()
    finally:
        jax.monitoring.unregister_event_duration_listener(note)
    assert compiled == []
    exact = (RADIAL, R1, 8.05e6, MU)
    np.testing.assert_allclose(best.values["initial.velocity.1"], across(*exact), rtol=1e-7)


def test_the_optimiser_of_a_file_searches(tmp_path, monkeypatch):
    asked = '[optimize]\noptimiser = "adam"\nrate = 0.03\nmax_steps = 7\n'
    path = tmp_path / "transfer.toml"
    path.write_text(TRANSFER.replace("[optimize]\n", asked))
    given = {}

    def minimise(problem, start, **options):
        given.update(options)
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxspace.io._search.optimise.minimise", minimise)
    with pytest.raises(KeyboardInterrupt):
        load(path).optimize()
    assert given["optimiser"] is named_optimiser("adam", 0.03, 7)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "search",
    [
        'optimiser = "adam"\nrate = 0.03\nmax_steps = 3000\ntolerance = 1e-5',
        'optimiser = "lbfgs"',
    ],
)
def test_an_optimiser_of_optax_finds_it_too(tmp_path, search):
    """A target, and a free number at its bound."""
    path = tmp_path / "transfer.toml"
    path.write_text(TRANSFER.replace("[optimize]\n", f"[optimize]\n{search}\n"))
    best = load(path).optimize()
    assert best.minimum.converged, best.minimum.sentence()
    # The tolerance is 1e-5 of the sizes, 900 m/s.
    expected = across(RADIAL, R1, R2, MU)
    np.testing.assert_allclose(best.values["initial.velocity.1"], expected, atol=0.1)
    np.testing.assert_allclose(best.values["initial.velocity.0"], RADIAL, atol=0.1)


def test_sensitivities_are_those_of_the_optimum(searched):
    best, _ = searched
    slopes = best.sensitivities()
    _, by_place, _, by_mu = jax.grad(energy, argnums=(0, 1, 2, 3))(RADIAL, R1, R2, MU)
    np.testing.assert_allclose(slopes["planet.mu"], by_mu, rtol=1e-6)
    np.testing.assert_allclose(slopes["initial.position.0"], by_place, rtol=1e-5)
    assert "planet.mu" in sensitivity_report(best)


def test_the_file_of_the_optimum(searched, tmp_path):
    """It keeps comments and units, and its own optimum is where it starts."""
    best, _ = searched
    path = tmp_path / "best.toml"
    path.write_text(best.text())
    assert "# the comment stays" in best.text() and " km/s" in best.text()
    again = load(path)
    start = again.y0.velocity
    np.testing.assert_allclose(start[1], best.values["initial.velocity.1"], rtol=1e-11)
    objective, _ = best.confirmed(again.nominal_mission(), again)
    np.testing.assert_allclose(objective, best.objective, rtol=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('minimise = "specific_energy"', "", "must have exactly one of minimise and maximise"),
        ('"initial.velocity.1" =', '"initial.velocty.1" =', "Did you mean initial.velocity.1?"),
        ('high = "8.5 km/s"', 'high = "7 km/s"', "low must be below high"),
        ('low = "7.6 km/s"', 'low = "8.2 km/s"', "which is the start of the search"),
        ('at_least = "8000 km"', 'at_least = "8000 kg"', "optimize.constraint.0.at_least"),
        ("[optimize]\n", '[optimize]\noptimiser = "adan"\n', "Did you mean adam?"),
        ("[optimize]\n", "[optimize]\nrate = -1.0\n", "optimize.rate is -1.0: it must be a pos"),
        ("[optimize]\n", '[optimize]\noptimiser = "lbfgs"\nrate = 0.1\n', "optimize.rate is 0.1"),
        ('at_least = "8000 km"', "", "one of equal, at_least, at_most"),
        ('output = "apoapsis_radius"', 'output = "apoapsis"', "Did you mean apoapsis_"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, old, new, sentence):
    path = tmp_path / "wrong.toml"
    assert old in TRANSFER
    path.write_text(TRANSFER.replace(old, new))
    with pytest.raises(SceneError, match=sentence.replace("?", r"\?")):
        load(path)


@pytest.mark.sweep
def test_a_launch_to_orbit(tmp_path):
    """From a start that misses the orbit by hundreds of km; a run of the file of the optimum, of
    adaptive steps, confirms it. The makers of the rocket state 300 kg to a low orbit."""
    file = load(Path(__file__).parents[2] / "examples" / "scenes" / "launch.toml")
    best = file.optimize()
    assert best.minimum.converged
    assert 250.0 < best.objective - 250.0 < 300.0
    altitude, radial, axis = best.constraints
    np.testing.assert_allclose([altitude, radial], [300e3, 0.0], atol=1e-2)
    np.testing.assert_allclose(axis, 6678137.0, atol=1e-2)
    path = tmp_path / "best.toml"
    path.write_text(best.text())
    optimum = load(path)
    run = optimum.nominal_mission()
    assert Status(int(run.status)).good
    mass, *reached = best.confirmed(run, optimum)
    np.testing.assert_allclose(mass, best.objective, rtol=1e-10)
    # What the steps of the search estimate of their error, 3.5e-8 of place and velocity; the axis
    # takes twice of both. The run at the tolerance of the file, 1e-8, is within 0.3 m.
    assert best.error < 5e-8
    speed = np.sqrt(MU / 6678137.0)
    sizes = np.array([6678137.0, speed, 4.0 * 6678137.0])
    misses = np.abs(np.array(reached) - [300e3, 0.0, 6678137.0])
    assert np.all(misses < best.error * sizes), misses / sizes
    assert misses[0] < 0.5 and misses[2] < 1.0


class Fall(AbstractSystem):
    """Fall under g, with a push that begins at a time of its own."""

    push: Array
    begins: Array

    def vector_field(self, t, y):
        return jnp.stack([y[1], jnp.where(t >= self.begins, self.push, 0.0) - 9.8])

    def invariants(self, t, y):
        return {}

    def breaks(self):
        return self.begins[None]


def test_compact_flight():
    """A fall from h to the ground, an elastic bounce, and half a second with a push that begins
    after 0.2 s: height, time, and their derivatives, which pass through the event."""

    def flight(h):
        ground = Event(lambda t, y: y[0], direction=-1, within=10.0)
        begins = jnp.sqrt(2.0 * h / 9.8) + 0.2
        fall = Fall(jnp.asarray(3.0), begins)
        bounce = lambda t, y: y * jnp.array([1.0, -1.0])  # noqa: E731
        mission = Mission([Phase(fall, ground, bounce), Phase(fall, 0.5, name="rise")])
        searched = simulate_compact(mission, jnp.stack([h, 0.0 * h]), steps=20)
        return jnp.stack([searched.final[0], searched.end]), searched

    def exact(h):
        fall, speed = jnp.sqrt(2.0 * h / 9.8), jnp.sqrt(2.0 * h * 9.8)
        height = 0.5 * speed - 4.9 * 0.25 + 1.5 * 0.3**2
        return jnp.stack([height, fall + 0.5])

    h = jnp.asarray(7.0)
    slope, searched = jax.jit(jax.jacfwd(flight, has_aux=True))(h)
    values = jnp.stack([searched.final[0], searched.end])
    np.testing.assert_allclose(values, exact(h), rtol=1e-12)
    np.testing.assert_allclose(slope, jax.jacfwd(exact)(h), rtol=1e-10)
    back = jax.jit(jax.jacrev(lambda h: flight(h)[0]))(h)
    np.testing.assert_allclose(back, slope, rtol=1e-12)
    assert bool(searched.phases[0].happened) and searched.error < 1e-12
    np.testing.assert_allclose(searched.phases[0].before[0], 0.0, atol=1e-12)
    with pytest.raises(InputError, match="steps = 0"):
        simulate_compact(Mission([Phase(Fall(h, h), 1.0)]), jnp.zeros(2), steps=0)


def test_a_target_out_of_reach_is_said(tmp_path):
    """The greatest apoapsis within the bounds lies at both upper ones; the slopes are empty."""
    path = tmp_path / "far.toml"
    path.write_text(TRANSFER.replace('"8000 km"', '"80000 km"'))
    best = load(path).optimize()
    up, along = RADIAL, 8500.0
    rate = R1 * along
    semi = 1.0 / (2.0 / R1 - (up**2 + along**2) / MU)
    greatest = semi * (1.0 + np.sqrt(1.0 - rate**2 / (MU * semi)))
    np.testing.assert_allclose(best.constraints, [greatest], rtol=1e-7)
    said = f"apoapsis radius is {greatest / 1e3:.6g} km where at least 80000 km is required"
    assert best.infeasible and said in best.sentence()
    assert np.all(np.isnan(best.target_derivatives)) and best.bound_derivatives == {}
    report = optimum_report(best)
    assert said in report and "slope:" not in report
    with pytest.raises(
        InputError,
        match="Sensitivities are available for a converged optimum only. The constraints",
    ):
        best.sensitivities()


# From 6678 km upwards to the farthest place, which is missed beyond the speed of escape.
CLIMB = (
    TRANSFER[: TRANSFER.index("[times]")].replace("8 km/s", "10 km/s")
    + """
[[phase]]
name = "climb"
effects = ["point_gravity"]
until = "apoapsis"
within = "172800 s"

[optimize]
minimise = "altitude"
# What 40 steps in two days compute is too rough for gradients of 1e-6.
tolerance = 1e-5

[optimize.free]
"initial.velocity.1" = { low = "7.8 km/s", high = "13 km/s" }
"""
)


@pytest.fixture
def bars(monkeypatch):
    """The bars of a command, as on a terminal."""
    made = []

    class Bar(tqdm.tqdm):
        def __init__(self, **options):
            super().__init__(**{**options, "disable": False, "mininterval": 0.0})
            made.append(self)

    monkeypatch.setattr(tqdm, "tqdm", Bar)
    return made


def test_a_start_that_misses_its_event_is_told(settings_stay, tmp_path, capsys):
    """Beyond the speed of escape: no optimum, and the phase with the sentence of its status."""
    path = tmp_path / "climb.toml"
    path.write_text(CLIMB.replace('"10 km/s"', '"12 km/s"'))
    assert main(["optimize", str(path), "--out", str(tmp_path)]) == 1
    printed = capsys.readouterr().out
    assert "climb failed. The event of the phase did not occur" in printed


def test_a_search_that_its_run_refutes_goes_on(settings_stay, tmp_path, capsys, bars):
    """40 steps in two days miss the first apoapsis of the orbit: the least height, with the least
    speed, is found with more of them. The table has the phase, and its figure is drawn."""
    path = tmp_path / "climb.toml"
    path.write_text(CLIMB)
    assert main(["optimize", str(path), "--out", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert "does not confirm this: it has altitude 15844" in err and "continues with 80" in err
    # The number of its steps, and what is left to do.
    assert bars[0].n >= 2 and "step" in err and "violation 0.0e+00, gradient" in err
    assert load(tmp_path / "climb_optimum.toml").y0.velocity[1] == 7800.0
    semi = 1.0 / (2.0 / R1 - (7800.0**2 + 100.0**2) / MU)
    slowness = (R1 * 7800.0) ** 2 / (MU * semi)
    highest = semi * (1.0 + np.sqrt(1.0 - slowness)) - 6378137.0
    (row,) = [line.split() for line in out.splitlines() if line.startswith("climb ")]
    np.testing.assert_allclose(float(row[2]), highest / 1e3, rtol=1e-5)
    assert "Converged after" in out and (tmp_path / "climb_optimum_climb.png").exists()


AT_BOUND = {"initial.velocity.1": 7800.0}


def test_an_event_that_only_a_run_meets_is_no_optimum(tmp_path):
    """At the least speed: 40 steps miss the event."""
    path = tmp_path / "climb.toml"
    path.write_text(CLIMB)
    begun = load(path).optimize(start=AT_BOUND, steps=40)
    assert not begun.converged
    assert "climb misses its event with 40 steps but reaches it at the" in begun.sentence()


# That a run confirms an optimum, the test of the command above shows as well.
@pytest.mark.parametrize(
    ("steps", "good"), [(80, False), pytest.param(640, True, marks=pytest.mark.sweep)]
)
def test_what_a_run_refutes_is_no_optimum(tmp_path, steps, good):
    """At the least speed: the height by 80 steps is not that of a run of their file, and that by
    640 is."""
    path = tmp_path / "climb.toml"
    path.write_text(CLIMB)
    best = load(path).optimize(start=AT_BOUND, steps=steps)
    assert best.minimum.converged and best.steps == steps
    path.write_text(best.text())
    file = load(path)
    run = file.nominal_mission()
    judged = best.checked(run, best.confirmed(run, file))
    assert judged.converged == good
    assert ("The 80 steps per phase are too coarse" in judged.sentence()) != good


def test_the_altitude_of_an_event_is_free(tmp_path):
    """The lowest end of a climb to a free height lies at its lower bound; what it moves is one. The
    bound has more digits than the file of the optimum, which must not round it to beyond."""
    path = tmp_path / "reach.toml"
    ends = CLIMB.replace('"apoapsis"', '{ at_altitude = { altitude = "500 km" } }')
    low = "400.00000000001234 km"
    free = f'"phase.0.until.at_altitude.altitude" = {{ low = "{low}", high = "600 km" }}\n'
    path.write_text(ends[: ends.index('"initial.velocity.1"')].replace("172800 s", "2 h") + free)
    best = load(path).optimize()
    key = "phase.0.until.at_altitude.altitude"
    np.testing.assert_allclose([best.values[key], best.objective], 400e3, rtol=1e-9)
    np.testing.assert_allclose(best.bound_derivatives[key], 1.0, rtol=1e-9)
    path.write_text(best.text())
    np.testing.assert_allclose(
        load(path).values["phase"][0]["until"]["at_altitude"]["altitude"], 4e5
    )


@pytest.mark.sweep
def test_an_interrupted_command_is_taken_up(settings_stay, tmp_path, monkeypatch, capsys):
    """SIGINT after the second step: what was reached is kept as a file, from which the next call
    goes on to the optimum."""
    path = tmp_path / "transfer.toml"
    path.write_text(TRANSFER)

    class Bar(tqdm.tqdm):
        def update(self, n=1):
            super().update(n)
            if self.n == 2:
                os.kill(os.getpid(), signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr(tqdm, "tqdm", lambda **options: Bar(**{**options, "disable": False}))
        assert main(["optimize", str(path), "--out", str(tmp_path)]) == 1
    assert "Interrupted after" in capsys.readouterr().out
    begun = tmp_path / "transfer_optimum.toml"
    assert load(begun).y0.velocity[1] != 8000.0
    assert main(["optimize", str(begun), "--out", str(tmp_path)]) == 0
    best = load(tmp_path / "transfer_optimum_optimum.toml")
    np.testing.assert_allclose(best.y0.velocity[1], across(RADIAL, R1, R2, MU), rtol=1e-7)


@pytest.mark.sweep
def test_the_command(settings_stay, tmp_path, capsys):
    """`jaxspace optimize`: the table, the sensitivities, the file of the optimum and the figure of
    the search."""
    path = tmp_path / "transfer.toml"
    path.write_text(TRANSFER)
    assert main(["optimize", str(path), "--out", str(tmp_path), "--sensitivities"]) == 0
    printed = capsys.readouterr().out
    for words in ("initial.velocity.1", "apoapsis radius", "at least", "planet.mu", "Converged"):
        assert words in printed
    best = load(tmp_path / "transfer_optimum.toml")
    expected = across(RADIAL, R1, R2, MU)
    np.testing.assert_allclose(best.y0.velocity[1], expected, rtol=1e-7)
    assert (tmp_path / "transfer_search.png").exists()
    # That of the one phase of a scene.
    assert len(list(tmp_path.glob("transfer_optimum_*.png"))) == 1
