// Draws what is in the scene: the body with its wheels, the orbit, the planet and its night.

// Faces from the far ones to the near ones.
function faces(scene, centre, size) {
  const { axes, project, attitude, now } = scene;
  const q = attitude || [1, 0, 0, 0];
  const found = [];
  for (const face of data.faces) {
    let points = face.points,
      order = 0;
    if (face.wheel !== undefined) {
      const { axis, at, angle } = data.wheels[face.wheel];
      const half = 0.5 * (angle[now[0]] + now[2] * (angle[now[1]] - angle[now[0]]));
      const spin = [Math.cos(half), ...scale(axis, Math.sin(half))];
      points = points.map((p) => add(turn(spin, p), at));
      // A wheel stands outside of the body: before all of it, or behind.
      order = dot(axes[2], turn(q, at)) > 0 ? 1 : -1;
    }
    const world = points.map((p) => add(centre, scale(turn(q, p), size)));
    const normal = cross(add(world[1], world[0], -1), add(world[2], world[0], -1));
    const length = Math.hypot(...normal) || 1;
    const towards = dot(axes[2], normal) / length;
    if (towards <= 0 && !face.both) continue;
    const light = axes.reduce(
      (sum, axis, i) => sum + (scene.light[i] * dot(axis, normal)) / length,
      0,
    );
    const seen = world.map(project);
    found.push({
      seen,
      light,
      order,
      kind: face.kind,
      depth: seen.reduce((s, p) => s + p[2], 0) / seen.length,
    });
  }
  found.sort((a, b) => a.order - b.order || a.depth - b.depth);
  for (const { seen, light, kind } of found) {
    pen.beginPath();
    seen.forEach((p, i) => (i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
    pen.closePath();
    pen.fillStyle = colour(kind);
    pen.fill();
    // Shade and edges by black and white over the colour.
    pen.fillStyle =
      light > 0.4
        ? `rgba(255,255,255,${0.45 * (light - 0.4)})`
        : `rgba(0,0,0,${0.55 * (0.4 - light)})`;
    pen.fill();
    pen.strokeStyle = "rgba(0,0,0,0.25)";
    pen.lineWidth = 0.6;
    pen.stroke();
  }
}

function drawBody(scene, centre, size) {
  const shown = Object.entries(data.traces).filter(([name]) => state.traces[name]);
  for (const [name, rows] of shown) trace(scene, rows, colour(name), false, coarse[name]);
  faces(scene, centre, size);
  for (const [name, rows] of shown) trace(scene, rows, colour(name), true, coarse[name]);
  arrows(scene, centre, size, shown);
}

function drawOrbit(scene, extent) {
  const { project, unit, now } = scene,
    position = between(data.position, now, coarse.position);
  const radius = data.planet * unit,
    centre = project([0, 0, 0]);
  const hidden = (q) => q[2] < 0 && Math.hypot(q[0] - centre[0], q[1] - centre[1]) < radius;
  const at = project(position);
  const body = () => {
    if (hidden(at)) return;
    const size = data.size || (0.16 * extent) / data.reach / state.zoom;
    if (data.attitude) {
      faces(scene, position, size);
      arrows(
        scene,
        position,
        size,
        Object.entries(data.traces).filter(([name]) => state.traces[name]),
      );
    } else {
      pen.fillStyle = colour("axis");
      pen.beginPath();
      pen.arc(at[0], at[1], 5, 0, 7);
      pen.fill();
    }
  };
  if (state.traces.orbit) {
    // The whole path, before what is gone of it.
    if (!coarse.orbit) line(data.position.map(project), colour("line"), 1);
    trace(scene, data.position, colour("orbit"), false, coarse.orbit, hidden);
    if (data.burns) burnt(scene, false, hidden);
  }
  if (at[2] < 0) body();
  if (data.rod) line([centre, at], colour("muted"), 1.5);
  else if (radius > 0) sphere(scene, centre, radius);
  if (state.traces.orbit) {
    trace(scene, data.position, colour("orbit"), true, coarse.orbit);
    if (data.burns) burnt(scene, true);
  }
  if (at[2] >= 0) body();
}

// The way on which propellant leaves, up to now; `front` as for a trace.
function burnt({ project, now }, front, hidden) {
  for (let i = 0; i <= now[0]; i++) {
    if (!data.burns[i]) continue;
    const end = i === now[0] ? between(data.position, now, coarse.position) : data.position[i + 1];
    const pair = [project(data.position[i]), project(end)];
    if (pair[1][2] >= 0 === front && !(hidden && hidden(pair[1]))) line(pair, colour("burn"), 3.5);
  }
}

function sphere(scene, centre, radius) {
  const { light, axes } = scene,
    size = Math.max(radius, 2);
  pen.fillStyle = colour("planet");
  pen.beginPath();
  pen.arc(centre[0], centre[1], size, 0, 7);
  pen.fill();
  if (size > 20) {
    globe(scene, graticule(), colour("graticule"), 0.6, 0);
    if (data.coast) globe(scene, coasts(), colour("coast"), 1.1, data.rate * state.t);
  }
  if (data.sun) night(centre, size, light);
  // The ball is round: brighter towards the light. A sun behind it lights a rim.
  const [x, y] = [centre[0] + 0.8 * size * light[0], centre[1] - 0.8 * size * light[1]];
  const shade = pen.createRadialGradient(
    x,
    y,
    0.1 * size,
    x,
    y,
    (1.2 + 0.8 * Math.max(-light[2], 0)) * size,
  );
  shade.addColorStop(0, "rgba(255,255,255,0.3)");
  shade.addColorStop(1, "rgba(0,0,0,0.3)");
  pen.fillStyle = shade;
  pen.beginPath();
  pen.arc(centre[0], centre[1], size, 0, 7);
  pen.fill();
  const pole = dot(axes[2], [0, 0, 1]);
  // Its axis, so that north is seen.
  const tip = [0, 0, Math.sign(pole || 1) * data.planet];
  line([scene.project(tip), scene.project(scale(tip, 1.12))], colour("muted"), 1.2);
}

const degrees = Math.PI / 180;
const onSphere = (longitude, latitude) => [
  Math.cos(latitude * degrees) * Math.cos(longitude * degrees),
  Math.cos(latitude * degrees) * Math.sin(longitude * degrees),
  Math.sin(latitude * degrees),
];

// Lines of unit vectors, made when they are first drawn.
let graticuleLines = null,
  coastLines = null;

function graticule() {
  if (graticuleLines) return graticuleLines;
  graticuleLines = [];
  const along = (from, to, point) =>
    Array.from({ length: (to - from) / 3 + 1 }, (_, k) => point(from + 3 * k));
  for (let l = 0; l < 360; l += 30) graticuleLines.push(along(-90, 90, (b) => onSphere(l, b)));
  for (let b = -60; b <= 60; b += 30) graticuleLines.push(along(0, 360, (l) => onSphere(l, b)));
  return graticuleLines;
}

function coasts() {
  coastLines ??= data.coast.map((flat) =>
    Array.from({ length: flat.length / 2 }, (_, k) => onSphere(flat[2 * k], flat[2 * k + 1])),
  );
  return coastLines;
}

// The near half of lines on the planet, turned about its axis by an angle.
function globe({ axes, project }, lines, style, width, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  pen.strokeStyle = style;
  pen.lineWidth = width;
  pen.beginPath();
  for (const points of lines) {
    let open = false;
    for (const [x, y, z] of points) {
      const p = [c * x - s * y, s * x + c * y, z];
      if (dot(axes[2], p) < 0) {
        open = false;
        continue;
      }
      const q = project(scale(p, data.planet));
      if (open) pen.lineTo(q[0], q[1]);
      else pen.moveTo(q[0], q[1]);
      open = true;
    }
  }
  pen.stroke();
}

// The side of the planet that the sun does not reach, up to the terminator.
function night(centre, size, light) {
  const across = Math.hypot(light[0], light[1]);
  const [nx, ny] = across > 1e-9 ? [light[0] / across, light[1] / across] : [1, 0];
  pen.beginPath();
  // From limb to limb along the terminator, the near half of a circle seen at an angle ...
  for (let k = 0; k <= 48; k++) {
    const a = (k * Math.PI) / 48,
      u = Math.cos(a),
      v = -light[2] * Math.sin(a);
    const x = -ny * u + nx * v,
      y = nx * u + ny * v;
    if (k) pen.lineTo(centre[0] + size * x, centre[1] - size * y);
    else pen.moveTo(centre[0] + size * x, centre[1] - size * y);
  }
  // ... and back along the dark limb.
  for (let k = 0; k <= 48; k++) {
    const b = (k * Math.PI) / 48,
      u = -Math.cos(b),
      v = -Math.sin(b);
    pen.lineTo(centre[0] + size * (-ny * u + nx * v), centre[1] - size * (nx * u + ny * v));
  }
  pen.fillStyle = colour("night");
  pen.fill();
}
