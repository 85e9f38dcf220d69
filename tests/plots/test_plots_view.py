"""The page that plays a run: what it holds, and that it draws and plays in a browser."""

import contextlib
import http.server
import json
import re
import shutil
import subprocess
import threading
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from jaxspace import Scene, simulate
from jaxspace.attitude import ReactionWheels, Top, TorqueFreeBody
from jaxspace.bodies import BodyState, PrincipalInertia, RigidBody
from jaxspace.core import InputError
from jaxspace.orbits import CircularPath
from jaxspace.plots import show_run, view_page
from jaxspace.plots._view_page import _momentum
from jaxspace.plots._view_shapes import faces_of, top_faces, wheel_faces
from jaxspace.rotations import Quaternion

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
TIMES = np.linspace(0.0, 20.0, 101)
# After a while, with the controls: pause, the middle of the run, the other view.
WATCH = """<script>
const found = {};
const seen = () => {
  const copy = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  [copy.canvas.width, copy.canvas.height] = [canvas.width, canvas.height];
  copy.drawImage(canvas, 0, 0);
  const p = copy.getImageData(0, 0, canvas.width, canvas.height).data;
  const colours = new Set();
  for (let i = 0; i < p.length; i += 4) if (p[i + 3]) colours.add(p.slice(i, i + 3).join());
  return colours.size;
};
let waits = 0;
const watch = () => {
  // A busy machine may draw its first frame late.
  if (state.t === 0 && waits++ < 200) { setTimeout(watch, 100); return; }
  found.played = state.t;
  found.colours = seen();
  $("play").click();
  found.paused = state.t;
  $("time").value = 0.5;
  $("time").dispatchEvent(new Event("input"));
  found.middle = $("clock").textContent;
  if ($("near")) { $("near").value = "body"; $("near").dispatchEvent(new Event("change")); }
  found.near = seen();
  found.note = $("note").textContent;
  setTimeout(() => {
    found.later = state.t;
    found.error = document.body.dataset.error || "";
    document.body.insertAdjacentHTML("beforeend", "<i id=found>" + JSON.stringify(found) + "</i>");
    new Image().src = "SERVER/done";
  }, 300);
};
setTimeout(watch, 500);
</script><img src="SERVER/wait" hidden></body>"""


@contextlib.contextmanager
def waiting_server():
    """The address of a server whose picture `wait` comes only after `done` is asked for.

    A page that shows it is loaded, and its document printed, when its script is at its end."""
    done = threading.Event()

    class Answers(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            if self.path == "/done":
                done.set()
            else:
                done.wait(100)
            self.send_response(204)
            self.end_headers()

        def log_message(self, format, *args):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Answers) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            done.set()
            server.shutdown()
            thread.join()


class Wheels(eqx.Module):
    """Stands for an effect with wheels."""

    axes: Array

    def speeds(self, y):
        return jnp.ones((3, len(TIMES))) * jnp.array([[1.0], [-2.0], [0.5]])


def run(system, states, ts=TIMES, **more):
    """What the page reads of a trajectory."""
    first = SimpleNamespace(mass=None)
    return SimpleNamespace(
        system=system, ts=ts, states=states, status=np.array(0), initial=first, **more
    )


def spacecraft(ts=TIMES, wheels=True):
    """A body with three wheels, on a circle; its quaternion changes its sign halfway."""
    wxyz = Quaternion.about(2, jnp.asarray(0.3 * ts)).wxyz * np.where(ts > 9.0, -1.0, 1.0)
    circle = 7e6 * np.stack([np.cos(ts), np.sin(ts), 0.0 * ts])
    omega = jnp.asarray(0.3 * np.stack([0.0 * ts, 0.0 * ts, 1.0 + 0.0 * ts]))
    states = BodyState(position=circle, attitude=Quaternion(wxyz), omega=omega)
    body = RigidBody(inertia=jnp.array([1.0, 2.0, 2.5]))
    effects = (Wheels(jnp.eye(3)),) if wheels else ()
    return run(SimpleNamespace(body=body, effects=effects), states, ts)


def data_of(page):
    """What the script of a page is given."""
    return json.loads(re.search(r"const data = (.*);\n", page.read_text()).group(1))


def test_page_holds_the_run(tmp_path):
    page = view_page(spacecraft(), tmp_path / "run.html", title="A <b>run</b>")
    text, data = page.read_text(), data_of(page)
    assert "A &lt;b&gt;run" in text
    assert not re.search(r"https?:|src=|@import", text)  # no network
    # No more than were saved, as many as lines between them need.
    assert 50 < len(data["times"]) == len(data["position"]) == len(data["attitude"]) <= 101
    np.testing.assert_allclose(data["position"][0], [7e6, 0.0, 0.0])
    quaternions = np.array(data["attitude"])
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.99)
    assert list(data["traces"]) == ["axis", "rate", "momentum"]
    assert len(data["wheels"]) == 3 and data["planet"] == 0.0
    # To the three digits that are written.
    angle = -2.0 * np.array(data["times"])
    np.testing.assert_allclose(data["wheels"][1]["angle"], angle, atol=6e-4)


def test_the_momentum_is_that_of_the_wheels_too(tmp_path):
    """A rotor along the axis of a body that spins about it: C n + h."""
    rotor = ReactionWheels.rotor([0.0, 0.0, 2.0], 80.0, 6.0)
    scene = Scene((rotor,), RigidBody(inertia=[220.0, 220.0, 160.0]))
    attitude = Quaternion.identity()
    y = scene.start(BodyState(attitude=attitude, omega=jnp.array([0.0, 0.0, 0.3])))
    states = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), y)
    h = _momentum(scene, np.array([0.0, 1.0]), states)
    np.testing.assert_allclose(h, np.outer([0.0, 0.0, 160.0 * 0.3 + 80.0 * 6.0], [1.0, 1.0]))


def test_what_attracts_is_a_planet(tmp_path):
    shown = spacecraft(wheels=False)
    shown.system.effects = (SimpleNamespace(mu=1.0),)
    planets = [
        data_of(view_page(shown, tmp_path / "run.html", planet_radius=radius))["planet"]
        for radius in (None, 6e6)
    ]
    np.testing.assert_allclose(planets, [7e6 / 3.0, 6e6])


def test_the_sun_is_where_its_path_has_it(tmp_path):
    """A quarter of a circle in the time of the run: from x to y."""
    shown = spacecraft(wheels=False)
    assert data_of(view_page(shown, tmp_path / "dark.html"))["sun"] is None
    rate = 0.5 * np.pi / TIMES[-1]
    shown.system.effects = (SimpleNamespace(sun=CircularPath(1.5e11, rate)),)
    data = data_of(view_page(shown, tmp_path / "run.html"))
    angle = rate * np.array(data["times"])
    expected = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    sun = data["sun"]
    # To the digits that are written.
    np.testing.assert_allclose(sun, expected, atol=6e-6)


def test_long_run_is_thinned_out(tmp_path):
    data = data_of(view_page(spacecraft(np.linspace(0.0, 20.0, 4001), False), tmp_path / "r.html"))
    assert len(data["times"]) <= 1500
    assert data["times"][0] == 0.0 and data["times"][-1] == 20.0


def turns(data):
    """The angle between each two attitudes that follow each other, rad."""
    q = np.array(data["attitude"])
    cosine = np.abs(np.sum(q[1:] * q[:-1], axis=1)) / np.linalg.norm(q[1:], axis=1)
    return 2.0 * np.arccos(np.minimum(cosine / np.linalg.norm(q[:-1], axis=1), 1.0))


def test_a_fast_spin_is_shown_as_it_turns(tmp_path):
    """Five hundred turns and a hundred times, which its closed form fills: no frame is more than a
    quarter of a turn after the one before, and all turns are there."""
    body = TorqueFreeBody(PrincipalInertia(jnp.array([10.0, 11.0, 6.0])))
    spin = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.0, 0.0, 50.0 * np.pi]))
    fast = simulate(body, spin, jnp.asarray(TIMES))
    data = data_of(view_page(fast, tmp_path / "run.html"))
    assert data["coarse"] == [] and 2000 <= len(data["times"]) <= 10_000
    assert turns(data).max() < 0.5 * np.pi
    # To the five digits that are written of each attitude.
    np.testing.assert_allclose(turns(data).sum(), 1000.0 * np.pi, rtol=1e-3)
    np.testing.assert_allclose(data["turned"][-1], 1000.0 * np.pi, rtol=1e-6)


def test_what_the_times_do_not_resolve_is_said(tmp_path):
    """Of states whose equations are not known, by their rate."""
    states = spacecraft().states
    fast = BodyState(states.position, attitude=states.attitude, omega=30.0 * states.omega)
    data = data_of(view_page(run(spacecraft().system, fast), tmp_path / "run.html"))
    assert data["coarse"] == ["attitude"]


def test_failed_end_is_left_out(tmp_path):
    failed = spacecraft(wheels=False)
    states = eqx.tree_at(
        lambda y: y.position, failed.states, np.where(TIMES > 15.0, np.nan, failed.states.position)
    )
    data = data_of(view_page(run(failed.system, states), tmp_path / "run.html"))
    assert data["times"][-1] == 15.0


def test_phases_of_a_mission_follow_one_another(tmp_path):
    phases = (spacecraft(TIMES, False), spacecraft(TIMES + 20.0, False))
    mission = SimpleNamespace(phases=phases, names=("burn", "coast"))
    data = data_of(view_page(mission, tmp_path / "run.html"))
    assert data["phases"] == [[0.0, "burn"], [20.0, "coast"]]
    assert data["times"][-1] == 40.0


def test_batches_and_states_that_cannot_be_seen_are_refused(tmp_path):
    batch = spacecraft()
    batch.status = np.zeros(3)
    with pytest.raises(InputError, match="single run"):
        view_page(batch, tmp_path / "run.html")
    with pytest.raises(InputError, match="neither a position nor an attitude"):
        view_page(run(None, SimpleNamespace(angle=TIMES)), tmp_path / "run.html")


def test_show_opens_the_browser(monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    page = show_run(spacecraft())
    assert opened == [page.as_uri()] and page.exists()


@pytest.mark.parametrize(
    "faces",
    [
        faces_of(np.array([1.0, 2.0, 2.5]), np.eye(3)),
        faces_of(np.array([2.0, 2.0, 1.0]), np.eye(3)),
        faces_of(np.array([4.0, 2.0, 2.0]), np.eye(3)[:, ::-1]),
        top_faces(),
    ],
    ids=["box", "cylinder", "disk", "top"],
)
def test_faces_look_outwards(faces):
    """The volume inside, by the divergence theorem: of faces turned inwards it is negative."""
    volume = 0.0
    for face in faces:
        a, *rest = np.array(face["points"], float)
        volume += sum(a @ np.cross(b, c) for b, c in zip(rest, rest[1:], strict=False)) / 6.0
    assert volume > 0.01


def test_wheel_stands_across_its_axis():
    axis = np.array([1.0, 1.0, 0.0])
    points = np.concatenate([face["points"] for face in wheel_faces(0, axis)])
    assert np.max(np.abs(points @ axis)) < 0.05 < np.max(np.abs(points))


def test_the_earth_has_its_coasts_and_no_other_planet(tmp_path):
    """Greenwich and the southern tip of Africa, in degrees, are near a point of the lines."""
    shown = spacecraft(wheels=False)
    pages = []
    for mu, radius in ((3.986e14, 6.378e6), (4.9e12, 6.378e6), (3.986e14, 1.7e6)):
        shown.system.effects = (SimpleNamespace(mu=mu),)
        pages.append(data_of(view_page(shown, tmp_path / "run.html", planet_radius=radius)))
    assert [page["coast"] is None for page in pages] == [False, True, True]
    points = np.concatenate([np.reshape(line, (-1, 2)) for line in pages[0]["coast"]])
    for place in ([1.0, 51.0], [20.0, -34.8]):
        assert np.min(np.linalg.norm(points - place, axis=1)) < 3.0
    assert np.all(np.abs(points) <= [180.0, 90.0])
    # A turn in a sidereal day.
    np.testing.assert_allclose(pages[0]["rate"] * 86164.1, 2.0 * np.pi, rtol=1e-6)


def test_altitude_speed_and_burn_stand_on_the_page(tmp_path):
    shown = spacecraft(wheels=False)
    circle = shown.states.position
    speed = 7e6 * np.pi / 10.0
    velocity = speed * jnp.stack([-circle[1], circle[0], circle[2]]) / 7e6
    # Burns to the half of the run, and then drops its empty stage.
    mass = np.where(TIMES < 10.0, 100.0 - 2.0 * TIMES, 40.0)
    states = BodyState(circle, velocity, mass=jnp.asarray(mass))
    data = data_of(view_page(run(shown.system, states), tmp_path / "run.html", planet_radius=6e6))
    np.testing.assert_allclose(data["readings"]["altitude"], 1e6, rtol=1e-5)
    np.testing.assert_allclose(data["readings"]["speed"], speed, rtol=1e-5)
    times, lit = np.array(data["times"]), np.array(data["burns"], bool)
    # Up to the frame at 9.8 s; the next one is that of the stage without its propellant.
    assert lit[times < 9.7].all() and not lit[times > 9.7].any()
    # Where no one says where the ground is, the distance.
    bare = data_of(view_page(spacecraft(wheels=False), tmp_path / "run.html"))
    assert list(bare["readings"]) == ["distance"] and bare["burns"] is None


@pytest.mark.skipif(BROWSER is None, reason="no Chromium")
# A body alone is a part of what the spacecraft draws.
@pytest.mark.parametrize(
    "what", ["spacecraft", pytest.param("tumbling", marks=pytest.mark.sweep), "top"]
)
def test_page_draws_and_plays(what, tmp_path):
    if what == "spacecraft":
        shown = spacecraft()
        shown.system.effects += (SimpleNamespace(mu=3.986e14, sun=CircularPath(1.5e11, 0.1)),)
    elif what == "top":
        # In steady precession, tilted by half a radian.
        axis = Quaternion.about(2, jnp.asarray(TIMES)).then(Quaternion.about(0, 0.5))
        spin = jnp.asarray(np.stack([0.0 * TIMES, 0.0 * TIMES, 20.0 + 0.0 * TIMES]))
        shown = run(Top(0.002, 0.0008, 0.3), BodyState(attitude=axis, omega=spin))
    else:
        attitude = Quaternion.about(0, jnp.asarray(TIMES))
        omega = jnp.asarray(np.stack([1.0 + 0.0 * TIMES, 0.0 * TIMES, 0.0 * TIMES]))
        body = TorqueFreeBody(PrincipalInertia(jnp.array([1.0, 2.0, 2.5])))
        shown = run(body, BodyState(attitude=attitude, omega=omega))
    radius = 6.378e6 if what == "spacecraft" else None
    page = view_page(shown, tmp_path / "run.html", planet_radius=radius)
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
    command += [f"--user-data-dir={tmp_path / 'user'}", "--dump-dom"]
    with waiting_server() as server:
        watch = WATCH.replace("SERVER", server)
        page.write_text(page.read_text().replace("</body>", watch))
        done = subprocess.run(
            [*command, page.as_uri()], capture_output=True, text=True, timeout=120
        )
    assert "CONSOLE" not in done.stderr, done.stderr
    found = json.loads(re.search(r"<i id=\"found\">(.*)</i>", done.stdout).group(1))
    assert found["error"] == ""
    assert 0.0 < found["played"] < 20.0
    # Faces in many shades, lines, letters.
    assert found["colours"] > 20 and found["near"] > 20
    assert found["middle"].startswith("t = 10.00 s")
    assert found["later"] == 10.0  # it stands
    # The top turns by 4 rad between two times.
    assert found["note"].startswith("The frames do not resolve") == (what == "top")
