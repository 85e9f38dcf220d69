// Draws `data`, which stands above this script: frames of one run, with a body and its traces.
const $ = (id) => document.getElementById(id);
const canvas = $("view"),
  pen = canvas.getContext("2d");
const ends = [data.times[0], data.times[data.times.length - 1]];
const span = ends[1] - ends[0] || 1;
const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
// From the side on which the run begins, which a planet would hide from the other one.
const seenFrom = () =>
  data.planet > 0 ? Math.atan2(data.position[0][1], data.position[0][0]) + 0.7 : -0.9;
const state = {
  t: ends[0],
  playing: !still,
  speed: 1,
  yaw: seenFrom(),
  pitch: 0.42,
  zoom: 1,
  near: !data.position,
  last: null,
  frames: 0,
  traces: {},
  turned: null,
};
// What the saved times do not resolve: nothing is known of the way from one of them to the next.
const coarse = Object.fromEntries(data.coarse.map((name) => [name, true]));
coarse.orbit = coarse.position;
for (const name in data.traces) coarse[name] = coarse.attitude;
const UNRESOLVED = data.coarse.length
  ? `The frames do not resolve the ${data.coarse.join(" and the ")}, ` +
    "shown at these times alone: a shorter run, or more saved times, show the motion."
  : "";
const TOO_FAST = "Something turns faster than the screen shows: choose a slower speed.";
// The unit of the clock and its size, s, by the length of the run; so many digits that it counts
// on.
const [UNIT, SIZE] = span > 172800 ? ["d", 86400] : span > 7200 ? ["h", 3600] : ["s", 1];
const DIGITS = Math.max(0, Math.ceil(2 - Math.log10(span / SIZE / 10)));
// Seconds of a whole run at speed 1.
const SHOWN = 12;
// Where no sun is stated, the light comes from over the reader's left shoulder: right, up, towards.
const LIGHT = [-0.35, 0.45, 0.82];

const colour = (name) =>
  getComputedStyle(document.documentElement)
    .getPropertyValue("--" + name)
    .trim();
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

function turn(q, v) {
  const u = [q[1], q[2], q[3]],
    w = scale(cross(u, v), 2);
  return add(add(v, w, q[0]), cross(u, w));
}

// The frame before the time t, and the share of the way to the next one.
function place(t) {
  let low = 0,
    high = data.times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (data.times[middle] <= t) low = middle;
    else high = middle;
  }
  const gap = data.times[high] - data.times[low];
  return [low, high, gap > 0 ? Math.min(Math.max((t - data.times[low]) / gap, 0), 1) : 0];
}

function between(rows, [low, high, s], held) {
  if (held) return rows[s < 1 ? low : high];
  const mixed = rows[low].map((x, i) => x + s * (rows[high][i] - x));
  if (mixed.length !== 4) return mixed;
  const size = Math.hypot(...mixed) || 1;
  return mixed.map((x) => x / size);
}

// The camera: world to right, up, towards the reader.
function camera() {
  const [sy, cy, sp, cp] = [
    Math.sin(state.yaw),
    Math.cos(state.yaw),
    Math.sin(state.pitch),
    Math.cos(state.pitch),
  ];
  return [
    [-sy, cy, 0],
    [-sp * cy, -sp * sy, cp],
    [cp * cy, cp * sy, sp],
  ];
}

function draw() {
  const ratio = devicePixelRatio || 1,
    w = canvas.clientWidth,
    h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, w, h);
  const axes = camera(),
    now = place(state.t);
  // The largest thing that is seen fills the smaller side.
  const extent = state.near ? data.reach : data.extent;
  const unit = (0.43 * Math.min(w, h) * state.zoom) / extent;
  const project = (p) => [
    w / 2 + unit * dot(axes[0], p),
    h / 2 - unit * dot(axes[1], p),
    dot(axes[2], p),
  ];
  const scene = {
    axes,
    project,
    unit,
    now,
    attitude: data.attitude && between(data.attitude, now, coarse.attitude),
  };
  const sun = data.sun && between(data.sun, now, false);
  scene.light = sun ? axes.map((axis) => dot(axis, sun)) : LIGHT;
  if (data.ground) ground(scene, extent);
  frame(scene, extent);
  // Behind what is drawn, or in front of it.
  if (sun && scene.light[2] < 0) sunAt(scene, sun, extent);
  if (state.near) drawBody(scene, [0, 0, 0], 1);
  else drawOrbit(scene, extent);
  if (sun && scene.light[2] >= 0) sunAt(scene, sun, extent);
  $("clock").textContent =
    `t = ${(state.t / SIZE).toFixed(DIGITS)} ${UNIT}` + (data.phases ? ", " + phase() : "");
  $("readings").textContent = Object.entries(data.readings)
    .map(([name, rows]) => reading(name, rows, now))
    .join(", ");
  $("note").textContent = UNRESOLVED || (tooFast(now) ? TOO_FAST : "");
  state.frames += 1;
  document.body.dataset.frames = state.frames;
}

// Whether the body or a wheel has turned by more than a quarter of a turn since it was last drawn.
function tooFast([low, high, s]) {
  const angles = [data.turned, ...data.wheels.map((wheel) => wheel.angle)];
  const now = angles.map((angle) => angle[low] + s * (angle[high] - angle[low]));
  const before = state.turned;
  state.turned = now;
  return (
    state.playing &&
    before !== null &&
    now.some((angle, i) => Math.abs(angle - before[i]) > Math.PI / 2)
  );
}

function phase() {
  return data.phases.filter(([start]) => start <= state.t).pop()?.[1] ?? "";
}

// A length or a speed in m or km, by the greatest of the run, with five digits of it.
function reading(name, rows, now) {
  const greatest = Math.max(...rows.map(([x]) => Math.abs(x))),
    large = greatest >= 1e4;
  const digits = Math.max(0, 4 - Math.floor(Math.log10(greatest / (large ? 1000 : 1) || 1)));
  const unit = (large ? "km" : "m") + (name === "speed" ? "/s" : "");
  const value = between(rows, now, coarse.position)[0] / (large ? 1000 : 1);
  return `${name} ${value.toFixed(Math.min(digits, 3))} ${unit}`;
}

function line(points, style, width = 1.2, dash = []) {
  pen.strokeStyle = style;
  pen.lineWidth = width;
  pen.setLineDash(dash);
  pen.beginPath();
  points.forEach((p, i) => (i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
  pen.stroke();
  pen.setLineDash([]);
}

function frame({ project }, extent) {
  const size = 1.08 * extent;
  ["X", "Y", "Z"].forEach((name, i) => {
    const tip = [0, 0, 0];
    tip[i] = size;
    const [a, b] = [project([0, 0, 0]), project(tip)];
    line([a, b], colour("line"), 1);
    pen.fillStyle = colour("muted");
    pen.font = "12px system-ui, sans-serif";
    pen.fillText(name, b[0] + 3, b[1] - 3);
  });
}

// The direction of the sun, at the edge of what is seen.
function sunAt({ project }, sun, extent) {
  const at = project(scale(sun, extent));
  line([project(scale(sun, state.near ? 0 : data.planet)), at], colour("sun"), 1, [2, 4]);
  pen.fillStyle = colour("sun");
  pen.beginPath();
  pen.arc(at[0], at[1], 7, 0, 7);
  pen.fill();
  pen.font = "12px system-ui, sans-serif";
  pen.fillText("sun", at[0] + 11, at[1] + 4);
}

// A trace up to now; `front` picks the half that lies towards the reader; of what is not resolved
// the points alone.
function trace({ project, now }, rows, style, front, held, hidden, size = 1) {
  pen.strokeStyle = style;
  pen.lineWidth = 1.5;
  const last = now[0] + 1;
  let open = false,
    before = null;
  pen.fillStyle = style;
  pen.beginPath();
  for (let i = 0; i <= last; i++) {
    const p = scale(i === last ? between(rows, now, held) : rows[i], size),
      q = project(p);
    const seen = q[2] >= 0 === front && !(hidden && hidden(q));
    if (held) {
      if (seen) pen.fillRect(q[0] - 1, q[1] - 1, 2, 2);
      continue;
    }
    // From the point before, so that both halves meet.
    if (seen && !open) pen.moveTo(...(before || q).slice(0, 2));
    if (seen) pen.lineTo(q[0], q[1]);
    [open, before] = [seen, q];
  }
  pen.stroke();
}

function arrow({ project }, from, tip, style, name, width = 2.5) {
  const [a, b] = [project(from), project(add(from, tip))];
  line([a, b], style, width);
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
  const [x, y] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length],
    head = Math.min(4 * width, 0.4 * length);
  pen.fillStyle = style;
  pen.beginPath();
  pen.moveTo(b[0] + x * head * 0.4, b[1] + y * head * 0.4);
  for (const side of [1, -1])
    pen.lineTo(b[0] - head * (x - 0.45 * side * y), b[1] - head * (y + 0.45 * side * x));
  pen.fill();
  pen.font = "13px system-ui, sans-serif";
  pen.fillText(name, b[0] + 8, b[1] + 4);
}

// The axes of the body that no trace follows, and the vectors of the body, from its centre.
function arrows(scene, centre, size, shown) {
  if (state.traces.axis)
    [
      [1, 0, 0],
      [0, 1, 0],
    ].forEach((axis, k) =>
      arrow(
        scene,
        centre,
        scale(turn(scene.attitude, axis), 1.25 * size),
        colour("muted"),
        "xy"[k],
        1.5,
      ),
    );
  for (const [name, rows] of shown)
    arrow(
      scene,
      centre,
      scale(between(rows, scene.now, coarse[name]), size),
      colour(name),
      data.names[name],
    );
}

// The ground on which a top stands, as a disk about the origin.
function ground({ project }, extent) {
  pen.beginPath();
  for (let k = 0; k <= 72; k++) {
    const a = (k * Math.PI) / 36,
      q = project([0.75 * extent * Math.cos(a), 0.75 * extent * Math.sin(a), 0]);
    if (k) pen.lineTo(q[0], q[1]);
    else pen.moveTo(q[0], q[1]);
  }
  pen.fillStyle = colour("ground");
  pen.fill();
}

function step(clock) {
  if (state.playing) {
    const gone = state.last === null ? 0 : Math.min(clock - state.last, 100) / 1000;
    state.t += (gone * state.speed * span) / SHOWN;
    // From the end it begins again.
    if (state.t > ends[1]) [state.t, state.turned] = [ends[0], null];
    $("time").value = (state.t - ends[0]) / span;
    draw();
  }
  state.last = clock;
  requestAnimationFrame(step);
}

function play(on) {
  state.playing = on;
  $("play").textContent = on ? "Pause" : "Play";
}

$("play").onclick = () => play(!state.playing);
$("time").oninput = (event) => {
  play(false);
  state.t = ends[0] + span * Number(event.target.value);
  draw();
};
$("speed").onchange = (event) => (state.speed = Number(event.target.value));
if ($("near"))
  $("near").onchange = (event) => {
    state.near = event.target.value === "body";
    state.zoom = 1;
    draw();
  };
document.querySelectorAll("#controls input[type=checkbox]").forEach((box) => {
  state.traces[box.value] = box.checked;
  box.onchange = () => {
    state.traces[box.value] = box.checked;
    draw();
  };
});
document.onkeydown = (event) => {
  if (event.key === " " && event.target === document.body) {
    event.preventDefault();
    play(!state.playing);
  }
};
canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
canvas.onpointermove = (event) => {
  if (!event.buttons) return;
  state.yaw -= 0.008 * event.movementX;
  state.pitch = Math.min(Math.max(state.pitch + 0.008 * event.movementY, -1.57), 1.57);
  draw();
};
canvas.addEventListener(
  "wheel",
  (event) => {
    event.preventDefault();
    state.zoom = Math.min(Math.max(state.zoom * Math.exp(-0.0015 * event.deltaY), 0.2), 50);
    draw();
  },
  { passive: false },
);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
addEventListener("resize", draw);
addEventListener("error", (event) => (document.body.dataset.error = event.message));
play(state.playing);
draw();
requestAnimationFrame(step);
