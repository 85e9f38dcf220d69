// Charts of the runs themselves: their places, their distribution and their ways.

function ellipse(a, b) {
  const i = data.names.indexOf(a),
    j = data.names.indexOf(b),
    e = data.ellipses;
  if (!e || i === j || e.half[i] === null || e.half[j] === null || e.phase[i][j] === null)
    return null;
  const x = [],
    y = [];
  for (let n = 0; n <= 120; n++) {
    const t = (n * Math.PI) / 60;
    x.push(e.centre[i] + e.half[i] * Math.cos(t));
    y.push(e.centre[j] + e.half[j] * Math.cos(t - e.phase[i][j]));
  }
  return {
    x,
    y,
    mode: "lines",
    name: "99 % ellipse",
    line: { color: colour("--c1"), width: 1.6 },
    hoverinfo: "skip",
  };
}

function mark(name, a, b, at, symbol, tint) {
  if (!at || at[a] === undefined || at[b] === undefined) return [];
  return [
    {
      x: [at[a]],
      y: [at[b]],
      mode: "markers",
      name,
      hoverinfo: "name+x+y",
      marker: { symbol, size: 12, color: tint, line: { width: 2, color: tint } },
    },
  ];
}

function drawScatter() {
  const [a, b] = [$("across").value, $("up").value];
  const points = {
    x: data.points[a],
    y: data.points[b],
    customdata: data.numbers,
    mode: "markers",
    name: "one run",
    marker: { size: 4.5, opacity: 0.5, color: colour("--c0") },
    hovertemplate: "run %{customdata}<br>%{x}<br>%{y}<extra></extra>",
  };
  const traces = [
    points,
    ...[ellipse(a, b)].filter(Boolean),
    ...mark("mean", a, b, data.mean, "cross-thin", colour("--c1")),
    ...mark("nominal", a, b, data.nominal, "diamond-open", colour("--c2")),
  ];
  const aside = (data.ellipses?.one_sided || [])
    .filter((name) => a !== b && [a, b].includes(name))
    .map(words);
  $("scatter-words").textContent = aside.length
    ? `${aside.join(" and ")}: the runs lie to one side of their mean. ` +
      "They are no normal distribution, and the ellipse does not bound them."
    : "";
  // A metre is a metre in both directions.
  const ground =
    data.footprint && a === "east" && b === "north" ? { scaleanchor: "x", scaleratio: 1 } : {};
  return Plotly.react("scatter", traces, layout(axis(label(a)), axis(label(b), ground)), config());
}

function drawFootprint() {
  const f = data.footprint,
    unit = data.units.east ? ` [${data.units.east}]` : "",
    d = f.degrees;
  const [x, y] = [data.points.east, data.points.north];
  const place = x.map((e, k) =>
    d && e !== null && y[k] !== null
      ? `<br>${(d[1][0] + d[1][1] * y[k]).toFixed(5)}°, ${(d[0][0] + d[0][1] * e).toFixed(5)}°`
      : "",
  );
  const points = {
    x,
    y,
    mode: "markers",
    name: "landings",
    customdata: data.numbers,
    text: place,
    marker: { size: 4.5, opacity: 0.5, color: colour("--c0") },
    hovertemplate: "run %{customdata}<br>%{x} east, %{y} north%{text}<extra></extra>",
  };
  const rings = f.ellipses.map((e, k) => ({
    ...e,
    mode: "lines",
    hoverinfo: "skip",
    line: { color: colour("--c1"), width: 1.8, dash: ["solid", "dash", "dot"][k] },
  }));
  const one = (name, at, symbol, tint) => ({
    x: [at[0]],
    y: [at[1]],
    mode: "markers",
    name,
    hoverinfo: "name+x+y",
    marker: { symbol, size: 12, color: tint, line: { width: 2, color: tint } },
  });
  const traces = [points, ...rings, one("rail", [0, 0], "triangle-up", colour("--ink"))];
  traces.push(...mark("nominal", "east", "north", data.nominal, "diamond-open", colour("--c2")));
  if (f.radius !== null) {
    const turn = Array.from({ length: 181 }, (_, k) => (k * Math.PI) / 90);
    traces.push({
      x: turn.map((t) => f.radius * Math.sin(t)),
      y: turn.map((t) => f.radius * Math.cos(t)),
      mode: "lines",
      name: `required: within ${Number(f.radius.toPrecision(6))} ${data.units.east || ""}`,
      hoverinfo: "skip",
      line: { color: colour("--bad"), width: 1.4, dash: "longdashdot" },
    });
  }
  // A metre is a metre in both directions.
  const up = axis(`north of the rail${unit}`, { scaleanchor: "x", scaleratio: 1 });
  return Plotly.react("footprint", traces, layout(axis(`east of the rail${unit}`), up), config());
}

function drawRose() {
  const r = data.rose,
    tints = ["--soft", "--c0", "--c2", "--c1"],
    width = 360 / r.shares[0].length;
  const bars = r.shares.map((row, k) => ({
    type: "barpolar",
    r: row,
    theta: row.map((_, n) => n * width),
    width: row.map(() => 0.85 * width),
    name: r.names[k],
    marker: { color: colour(tints[k]) },
    hovertemplate: `${r.names[k]}: %{r:.1f} %<extra></extra>`,
  }));
  const line = colour("--line");
  const polar = {
    bgcolor: "rgba(0,0,0,0)",
    radialaxis: { gridcolor: line, ticksuffix: " %", angle: 22.5, nticks: 4 },
    angularaxis: {
      direction: "clockwise",
      rotation: 90,
      gridcolor: line,
      tickvals: [0, 45, 90, 135, 180, 225, 270, 315],
      ticktext: ["N", "NE", "E", "SE", "S", "SW", "W", "NW"],
    },
  };
  const title = { text: "Wind direction by height", font: { size: 13 }, x: 0.5 };
  return Plotly.react(
    "rose",
    bars,
    layout(undefined, undefined, {
      polar,
      title,
      margin: { l: 40, r: 40, t: 70, b: 30 },
      legend: { orientation: "h", y: -0.12, x: 0.5, xanchor: "center" },
    }),
    config(),
  );
}

function upright(x, top, name, tint, dash) {
  return { x: [x, x], y: [0, top], mode: "lines", name, line: { color: tint, width: 1.8, dash } };
}

function drawHistogram() {
  const name = $("histogram-of").value,
    h = data.histograms[name];
  if (!h) {
    Plotly.purge("histogram");
    $("histogram").innerHTML = "<p class=note>No finite value of a good run.</p>";
    return null;
  }
  const top = 1.05 * Math.max(...h.counts),
    centres = h.counts.map((_, k) => h.start + (k + 0.5) * h.width);
  const bars = {
    type: "bar",
    x: centres,
    y: h.counts,
    width: h.width * 0.96,
    name: "runs",
    showlegend: false,
    marker: { color: colour("--c0"), opacity: 0.75 },
    hovertemplate: "%{x}<br>%{y} runs<extra></extra>",
  };
  // A limit may be infinite, which the words say.
  const limits = [h.low, h.high]
    .filter((x) => x !== null)
    .map((x, k) => ({
      ...upright(x, top, "0.5th and 99.5th percentiles", colour("--soft"), "dash"),
      legendgroup: "l",
      showlegend: k === 0,
    }));
  const lines = [upright(h.mean, top, "mean", colour("--c1"), "solid"), ...limits];
  // What lies far from the runs is marked at the edge: in its place it would squeeze them to a
  // line.
  const ends = [h.start, h.start + h.width * h.counts.length],
    room = 0.6 * (ends[1] - ends[0]),
    far = [];
  const stand = (x, name, tint, dash, first = true) => {
    if (x > ends[0] - room && x < ends[1] + room)
      return lines.push({ ...upright(x, top, name, tint, dash), showlegend: first });
    const right = x > ends[1];
    far.push({
      text: right ? `${name} ${x} →` : `← ${name} ${x}`,
      x: right ? 1 : 0,
      xref: "paper",
      xanchor: right ? "right" : "left",
      y: 0.98 - 0.07 * far.length,
      yref: "paper",
      showarrow: false,
      font: { color: tint, size: 12 },
      bgcolor: colour("--ground"),
    });
  };
  if (h.nominal !== null) stand(h.nominal, "nominal", colour("--c2"), "dot");
  for (const [k, x] of h.required.entries())
    stand(x, "requirement", colour("--bad"), "longdash", k === 0);
  $("histogram-words").textContent = h.words;
  return Plotly.react(
    "histogram",
    [bars, ...lines],
    layout(axis(label(name)), axis("runs"), { bargap: 0, annotations: far }),
    config(),
  );
}

// One length for all three axes, about the middle of each: by axes of different lengths the camera
// would stand within the box of a flat orbit, and see nothing.
function cube(paths) {
  const ends = [0, 1, 2].map((k) => {
    let [low, high] = [Infinity, -Infinity];
    for (const path of paths)
      for (const x of path[k]) if (x !== null) [low, high] = [Math.min(low, x), Math.max(high, x)];
    return [low, high];
  });
  // A run that stays where it is has a box too.
  const half = 0.52 * Math.max(...ends.map(([low, high]) => high - low)) || 1;
  return ends.map(([low, high]) => [(low + high) / 2 - half, (low + high) / 2 + half]);
}

function drawTrajectories() {
  const t = data.trajectories,
    tint = colour("--c0");
  const ranges = cube(t.nominal ? [t.nominal, ...t.runs] : t.runs);
  const traces = t.runs.map((p, k) => ({
    type: "scatter3d",
    mode: "lines",
    x: p[0],
    y: p[1],
    z: p[2],
    showlegend: k === 0,
    name: "runs",
    opacity: 0.7,
    line: { color: tint, width: 2 },
    hoverinfo: "name",
    text: `run ${t.numbers[k]}`,
  }));
  if (t.nominal)
    traces.push({
      type: "scatter3d",
      mode: "lines",
      x: t.nominal[0],
      y: t.nominal[1],
      z: t.nominal[2],
      // No wider than the runs, which it would hide where they lie close.
      name: "nominal",
      line: { color: colour("--c1"), width: 3.5 },
      hoverinfo: "name",
    });
  // From where the whole box is seen, with its labels below.
  const scene = {
    aspectmode: "cube",
    camera: { eye: { x: 1.6, y: 1.6, z: 1.1 }, center: { x: 0, y: 0, z: -0.15 } },
  };
  ["x", "y", "z"].forEach((k, n) => {
    scene[k + "axis"] = {
      ...axis(`${k} [${t.unit}]`),
      range: ranges[n],
      nticks: 5,
      backgroundcolor: "rgba(0,0,0,0)",
    };
  });
  return Plotly.react(
    "trajectories",
    traces,
    layout(undefined, undefined, { scene, margin: { l: 0, r: 0, t: 10, b: 0 } }),
    config(),
  );
}
