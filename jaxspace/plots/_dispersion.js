const $ = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const narrow = () => document.documentElement.clientWidth < 600;
const dark = () => matchMedia("(prefers-color-scheme: dark)").matches;
// The library's button to share a plot would send the numbers away.
const config = () => ({ displaylogo: false, showSendToCloud: false, responsive: true,
  displayModeBar: narrow() ? false : "hover" });
// A number of the last state as words, and all else without underscores.
const words = (name) => {
  const [first, block, ...components] = name.replaceAll("_", " ").split(".");
  if (first !== "final" || !block) return name.replaceAll("_", " ");
  return [block, ...components.map((c) => "xyz"[c] ?? c), "at the end"].join(" ");
};
// A long name goes on in the next line, after a space or a dot, so that nothing of it is cut.
function lines(text, most) {
  const found = [""];
  for (const part of text.match(/[^ .]+[ .]*|[ .]+/g) || [])
    for (const piece of part.match(new RegExp(`.{1,${most}}`, "g"))) {
      if (found.at(-1) && (found.at(-1) + piece).trimEnd().length > most) found.push("");
      found.push(found.pop() + piece);
    }
  return found.map((line) => line.trimEnd());
}
const wrapped = (text, most) => lines(text, most).join("<br>");
const label = (name) => words(name) + (data.units[name] ? ` [${data.units[name]}]` : "");

function axis(text, more = {}) {
  const line = colour("--line");
  const title = { text: wrapped(text, narrow() ? 32 : 48), font: { size: 13 }, standoff: 10 };
  return { title, gridcolor: line, zerolinecolor: line,
    linecolor: colour("--soft"), automargin: true, exponentformat: "power", minexponent: 6, ...more };
}

function layout(x, y, more = {}) {
  const clear = "rgba(0,0,0,0)";
  return { paper_bgcolor: clear, plot_bgcolor: clear, font: { color: colour("--ink"), size: 12 },
    margin: { l: narrow() ? 50 : 70, r: 12, t: 34, b: 50 }, ...(x && { xaxis: x, yaxis: y }), hovermode: "closest",
    modebar: { bgcolor: clear, color: colour("--soft"), activecolor: colour("--ink") },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: { size: 12 } }, ...more };
}

function ellipse(a, b) {
  const i = data.names.indexOf(a), j = data.names.indexOf(b), e = data.ellipses;
  if (!e || i === j || e.half[i] === null || e.half[j] === null || e.phase[i][j] === null) return null;
  const x = [], y = [];
  for (let n = 0; n <= 120; n++) {
    const t = (n * Math.PI) / 60;
    x.push(e.centre[i] + e.half[i] * Math.cos(t));
    y.push(e.centre[j] + e.half[j] * Math.cos(t - e.phase[i][j]));
  }
  return { x, y, mode: "lines", name: "ellipse of 99 %", line: { color: colour("--c1"), width: 1.6 },
    hoverinfo: "skip" };
}

function mark(name, a, b, at, symbol, tint) {
  if (!at || at[a] === undefined || at[b] === undefined) return [];
  return [{ x: [at[a]], y: [at[b]], mode: "markers", name, hoverinfo: "name+x+y",
    marker: { symbol, size: 12, color: tint, line: { width: 2, color: tint } } }];
}

function drawScatter() {
  const [a, b] = [$("across").value, $("up").value];
  const points = { x: data.points[a], y: data.points[b], customdata: data.numbers, mode: "markers",
    name: "one run", marker: { size: 4.5, opacity: 0.5, color: colour("--c0") },
    hovertemplate: "run %{customdata}<br>%{x}<br>%{y}<extra></extra>" };
  const traces = [points, ...[ellipse(a, b)].filter(Boolean),
    ...mark("mean", a, b, data.mean, "cross-thin", colour("--c1")),
    ...mark("nominal", a, b, data.nominal, "diamond-open", colour("--c2"))];
  const aside = (data.ellipses?.one_sided || []).filter((name) => a !== b && [a, b].includes(name)).map(words);
  $("scatter-words").textContent = aside.length ? `${aside.join(" and ")}: the runs lie to one side of their mean. ` +
    "They are no normal distribution, and the ellipse does not bound them." : "";
  // A metre is a metre in both directions.
  const ground = data.footprint && a === "east" && b === "north" ? { scaleanchor: "x", scaleratio: 1 } : {};
  return Plotly.react("scatter", traces, layout(axis(label(a)), axis(label(b), ground)), config());
}

function drawFootprint() {
  const f = data.footprint, unit = data.units.east ? ` [${data.units.east}]` : "", d = f.degrees;
  const [x, y] = [data.points.east, data.points.north];
  const place = x.map((e, k) => d && e !== null && y[k] !== null
    ? `<br>${(d[1][0] + d[1][1] * y[k]).toFixed(5)}°, ${(d[0][0] + d[0][1] * e).toFixed(5)}°` : "");
  const points = { x, y, mode: "markers", name: "landings", customdata: data.numbers, text: place,
    marker: { size: 4.5, opacity: 0.5, color: colour("--c0") },
    hovertemplate: "run %{customdata}<br>%{x} east, %{y} north%{text}<extra></extra>" };
  const rings = f.ellipses.map((e, k) => ({ ...e, mode: "lines", hoverinfo: "skip",
    line: { color: colour("--c1"), width: 1.8, dash: ["solid", "dash", "dot"][k] } }));
  const one = (name, at, symbol, tint) => ({ x: [at[0]], y: [at[1]], mode: "markers", name, hoverinfo: "name+x+y",
    marker: { symbol, size: 12, color: tint, line: { width: 2, color: tint } } });
  const traces = [points, ...rings, one("rail", [0, 0], "triangle-up", colour("--ink"))];
  traces.push(...mark("nominal", "east", "north", data.nominal, "diamond-open", colour("--c2")));
  if (f.radius !== null) {
    const turn = Array.from({ length: 181 }, (_, k) => (k * Math.PI) / 90);
    traces.push({ x: turn.map((t) => f.radius * Math.sin(t)), y: turn.map((t) => f.radius * Math.cos(t)), mode: "lines",
      name: `required: within ${f.radius} ${data.units.east || ""}`, hoverinfo: "skip", line: { color: colour("--bad"), width: 1.4, dash: "longdashdot" } });
  }
  // A metre is a metre in both directions.
  const up = axis(`north of the rail${unit}`, { scaleanchor: "x", scaleratio: 1 });
  return Plotly.react("footprint", traces, layout(axis(`east of the rail${unit}`), up), config());
}

function drawRose() {
  const r = data.rose, tints = ["--soft", "--c0", "--c2", "--c1"], width = 360 / r.shares[0].length;
  const bars = r.shares.map((row, k) => ({ type: "barpolar", r: row, theta: row.map((_, n) => n * width), width: row.map(() => 0.85 * width),
    name: r.names[k], marker: { color: colour(tints[k]) }, hovertemplate: `${r.names[k]}: %{r:.1f} %<extra></extra>` }));
  const line = colour("--line");
  const polar = { bgcolor: "rgba(0,0,0,0)", radialaxis: { gridcolor: line, ticksuffix: " %", angle: 22.5, nticks: 4 },
    angularaxis: { direction: "clockwise", rotation: 90, gridcolor: line, tickvals: [0, 45, 90, 135, 180, 225, 270, 315],
      ticktext: ["N", "NE", "E", "SE", "S", "SW", "W", "NW"] } };
  const title = { text: "Wind by height: from where", font: { size: 13 }, x: 0.5 };
  return Plotly.react("rose", bars, layout(undefined, undefined, { polar, title, margin: { l: 40, r: 40, t: 70, b: 30 },
    legend: { orientation: "h", y: -0.12, x: 0.5, xanchor: "center" } }), config());
}

function upright(x, top, name, tint, dash) {
  return { x: [x, x], y: [0, top], mode: "lines", name, line: { color: tint, width: 1.8, dash } };
}

function drawHistogram() {
  const name = $("histogram-of").value, h = data.histograms[name];
  if (!h) { Plotly.purge("histogram"); $("histogram").innerHTML = "<p class=note>No finite value of a good run.</p>"; return null; }
  const top = 1.05 * Math.max(...h.counts), centres = h.counts.map((_, k) => h.start + (k + 0.5) * h.width);
  const bars = { type: "bar", x: centres, y: h.counts, width: h.width * 0.96, name: "runs", showlegend: false,
    marker: { color: colour("--c0"), opacity: 0.75 }, hovertemplate: "%{x}<br>%{y} runs<extra></extra>" };
  // A limit may be infinite, which the words say.
  const limits = [h.low, h.high].filter((x) => x !== null).map((x, k) => ({ ...upright(x, top, "limits of the middle 99 %",
    colour("--soft"), "dash"), legendgroup: "l", showlegend: k === 0 }));
  const lines = [upright(h.mean, top, "mean", colour("--c1"), "solid"), ...limits];
  // What lies far from the runs is marked at the edge: in its place it would squeeze them to a line.
  const ends = [h.start, h.start + h.width * h.counts.length], room = 0.6 * (ends[1] - ends[0]), far = [];
  const stand = (x, name, tint, dash, first = true) => {
    if (x > ends[0] - room && x < ends[1] + room) return lines.push({ ...upright(x, top, name, tint, dash), showlegend: first });
    const right = x > ends[1];
    far.push({ text: right ? `${name} ${x} →` : `← ${name} ${x}`, x: right ? 1 : 0, xref: "paper", xanchor: right ? "right" : "left",
      y: 0.98 - 0.07 * far.length, yref: "paper", showarrow: false, font: { color: tint, size: 12 }, bgcolor: colour("--ground") });
  };
  if (h.nominal !== null) stand(h.nominal, "nominal", colour("--c2"), "dot");
  for (const [k, x] of h.required.entries()) stand(x, "requirement", colour("--bad"), "longdash", k === 0);
  $("histogram-words").textContent = h.words;
  return Plotly.react("histogram", [bars, ...lines], layout(axis(label(name)), axis("runs"), { bargap: 0, annotations: far }), config());
}

function drawContributors() {
  const name = $("contributors-of").value, c = data.contributors[name];
  $("contributors-words").textContent = c.words;
  const shares = c.shares.map((s) => 100 * s), names = c.inputs.map((n) => lines(words(n), narrow() ? 18 : 40));
  // Each line of a name, and 100 for what lies around the bars.
  const needed = 100 + names.length * (6 + 16 * Math.max(1, ...names.map((n) => n.length)));
  $("contributors").style.height = needed > (narrow() ? 340 : 440) ? `${needed}px` : "";
  const bars = { type: "bar", orientation: "h", x: shares.map((s) => Math.max(s, 0)), width: 0.7,
    y: c.inputs.map((_, k) => k),
    text: shares.map((s) => Math.max(s, 0).toFixed(1)), textposition: "outside", cliponaxis: false,
    customdata: c.inputs, marker: { color: colour("--c2") }, hovertemplate: "%{customdata}: %{text} %<extra></extra>" };
  const y = axis("", { autorange: "reversed", tickvals: c.inputs.map((_, k) => k), ticktext: names.map((n) => n.join("<br>")) });
  const x = axis("share of the variance, %", { range: [0, 1.18 * Math.max(5, ...shares)] });
  return Plotly.react("contributors", [bars], layout(x, y, { showlegend: false }), config());
}

function drawConvergence() {
  const name = $("convergence-of").value, c = data.convergence[name];
  if (!c) return null;
  // The band ends where the limit or its interval is infinite.
  const known = c.runs.map((_, k) => k).filter((k) => c.low[k] !== null && c.high[k] !== null), back = known.slice().reverse();
  const band = { x: [...known, ...back].map((k) => c.runs[k]), y: [...known.map((k) => c.high[k]), ...back.map((k) => c.low[k])],
    fill: "toself", mode: "none", fillcolor: colour("--c0") + "33", name: "its interval of 95 %", hoverinfo: "skip" };
  const limit = { x: c.runs, y: c.limit, mode: "lines", name: "99 % limit", line: { color: colour("--c0"), width: 2 } };
  const mean = { x: c.runs, y: c.mean, mode: "lines", name: "mean", line: { color: colour("--c1"), width: 2 } };
  $("convergence-words").textContent = c.words;
  return Plotly.react("convergence", [band, limit, mean], layout(axis("runs", { type: "log", dtick: 1 }), axis(label(name))), config());
}

function drawMatrix() {
  const names = data.matrix.slice(0, narrow() ? 3 : 5), n = names.length, traces = [], axes = {};
  const gap = 0.03, size = (1 - gap * (n - 1)) / n, few = { automargin: true, nticks: 4, tickfont: { size: 9 }, tickangle: 0, exponentformat: "power", minexponent: 5, showgrid: false, zeroline: false, linecolor: colour("--line"), mirror: true, showline: true };
  names.forEach((b, row) => names.forEach((a, column) => {
    if (column > row) return;
    // The first axis has no number in its name: all of these have one.
    const k = row * n + column + 2, h = data.histograms[a], place = [column * (size + gap), 1 - row * (size + gap) - size];
    const title = (show, name) => ({ text: show ? wrapped(label(name), narrow() ? 14 : 18) : "", font: { size: 11 }, standoff: 4 });
    // Numbers at the outer edges alone; those of a histogram on the diagonal are counts, and not of the quantity.
    const numbered = { x: row === n - 1, y: column === 0 && row > 0 };
    axes[`xaxis${k}`] = { ...few, showticklabels: numbered.x, domain: [place[0], place[0] + size], anchor: `y${k}`, title: title(row === n - 1, a) };
    axes[`yaxis${k}`] = { ...few, showticklabels: numbered.y, domain: [place[1], place[1] + size], anchor: `x${k}`, title: title(column === 0, b) };
    const common = { xaxis: `x${k}`, yaxis: `y${k}`, hoverinfo: "skip", marker: { color: colour("--c0") } };
    if (a === b) traces.push({ ...common, type: "bar", x: h.counts.map((_, i) => h.start + (i + 0.5) * h.width), y: h.counts, width: h.width });
    else traces.push({ ...common, mode: "markers", x: data.points[a].slice(0, 400), y: data.points[b].slice(0, 400), marker: { color: colour("--c0"), size: 3, opacity: 0.5 } });
  }));
  const frame = layout(undefined, undefined, { showlegend: false, ...axes, margin: { l: 60, r: 8, t: 8, b: 60 } });
  return Plotly.react("matrix", traces, frame, config());
}

// One length for all three axes, about the middle of each: by axes of different lengths the camera would stand within
// the box of a flat orbit, and see nothing.
function cube(paths) {
  const ends = [0, 1, 2].map((k) => {
    let [low, high] = [Infinity, -Infinity];
    for (const path of paths) for (const x of path[k]) if (x !== null) [low, high] = [Math.min(low, x), Math.max(high, x)];
    return [low, high];
  });
  // A run that stays where it is has a box too.
  const half = 0.52 * Math.max(...ends.map(([low, high]) => high - low)) || 1;
  return ends.map(([low, high]) => [(low + high) / 2 - half, (low + high) / 2 + half]);
}

function drawTrajectories() {
  const t = data.trajectories, tint = colour("--c0");
  const ranges = cube(t.nominal ? [t.nominal, ...t.runs] : t.runs);
  const traces = t.runs.map((p, k) => ({ type: "scatter3d", mode: "lines", x: p[0], y: p[1], z: p[2], showlegend: k === 0, name: "runs",
    opacity: 0.7, line: { color: tint, width: 2 }, hoverinfo: "name", text: `run ${t.numbers[k]}` }));
  if (t.nominal) traces.push({ type: "scatter3d", mode: "lines", x: t.nominal[0], y: t.nominal[1], z: t.nominal[2],
    // No wider than the runs, which it would hide where they lie close.
    name: "nominal", line: { color: colour("--c1"), width: 3.5 }, hoverinfo: "name" });
  // From where the whole box is seen, with its labels below.
  const scene = { aspectmode: "cube", camera: { eye: { x: 1.6, y: 1.6, z: 1.1 }, center: { x: 0, y: 0, z: -0.15 } } };
  ["x", "y", "z"].forEach((k, n) => {
    scene[k + "axis"] = { ...axis(`${k} [${t.unit}]`), range: ranges[n], nticks: 5, backgroundcolor: "rgba(0,0,0,0)" };
  });
  return Plotly.react("trajectories", traces, layout(undefined, undefined, { scene, margin: { l: 0, r: 0, t: 10, b: 0 } }), config());
}

function drawTime() {
  const tints = ["--c1", "--c0", "--c2"];
  const traces = Object.entries(data.time).map(([name, s], k) => ({ type: "bar", orientation: "h", y: [""], x: [s], name, width: 0.5,
    marker: { color: colour(tints[k]) }, hovertemplate: `${name}: %{x:.3g} s<extra></extra>` }));
  return Plotly.react("time", traces, layout(axis("s"), axis("", { showticklabels: false }), { barmode: "stack", legend: { ...layout().legend, traceorder: "normal" } }), config());
}

const drawings = { footprint: drawFootprint, rose: drawRose, scatter: drawScatter, histogram: drawHistogram, contributors: drawContributors,
  convergence: drawConvergence, matrix: drawMatrix, trajectories: drawTrajectories, time: drawTime };

async function drawAll() {
  const how = `${narrow() ? "narrow" : "wide"} ${dark() ? "dark" : "light"}`;
  for (const [id, draw] of Object.entries(drawings)) if ($(id)) await draw();
  document.body.dataset.drawn = how;
}

async function start() {
  // The plotting library is in the page, compressed: it needs no network and a third of the room.
  const bytes = Uint8Array.from(atob($("library").textContent), (c) => c.charCodeAt(0));
  const text = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  const script = document.createElement("script");
  script.textContent = text;
  document.head.appendChild(script);
  for (const [id, draw] of [["across", drawScatter], ["up", drawScatter], ["histogram-of", drawHistogram],
    ["contributors-of", drawContributors], ["convergence-of", drawConvergence]]) if ($(id)) $(id).addEventListener("change", draw);
  await drawAll();
  // One after the other: of two drawings at once the older one could end last.
  let before = narrow(), drawing = Promise.resolve();
  const again = () => { drawing = drawing.then(drawAll); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  addEventListener("resize", () => { if (narrow() !== before) { before = narrow(); again(); } });
}
start().catch((error) => { document.body.dataset.error = error.message; console.error(error); });
