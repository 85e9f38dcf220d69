// Charts of what the runs say together: contributors, convergence, correlations and time.

function drawContributors() {
  const name = $("contributors-of").value,
    c = data.contributors[name];
  $("contributors-words").textContent = c.words;
  const shares = c.shares.map((s) => 100 * s),
    names = c.inputs.map((n) => lines(words(n), narrow() ? 18 : 40));
  // Each line of a name, and 100 for what lies around the bars.
  const needed = 100 + names.length * (6 + 16 * Math.max(1, ...names.map((n) => n.length)));
  $("contributors").style.height = needed > (narrow() ? 340 : 440) ? `${needed}px` : "";
  const bars = {
    type: "bar",
    orientation: "h",
    x: shares.map((s) => Math.max(s, 0)),
    width: 0.7,
    y: c.inputs.map((_, k) => k),
    text: shares.map((s) => Math.max(s, 0).toFixed(1)),
    textposition: "outside",
    cliponaxis: false,
    customdata: c.inputs,
    marker: { color: colour("--c2") },
    hovertemplate: "%{customdata}: %{text} %<extra></extra>",
  };
  const y = axis("", {
    autorange: "reversed",
    tickvals: c.inputs.map((_, k) => k),
    ticktext: names.map((n) => n.join("<br>")),
  });
  const x = axis("share of the variance, %", { range: [0, 1.18 * Math.max(5, ...shares)] });
  return Plotly.react("contributors", [bars], layout(x, y, { showlegend: false }), config());
}

function drawConvergence() {
  const name = $("convergence-of").value,
    c = data.convergence[name];
  if (!c) return null;
  // The band ends where the limit or its interval is infinite.
  const known = c.runs.map((_, k) => k).filter((k) => c.low[k] !== null && c.high[k] !== null),
    back = known.slice().reverse();
  const band = {
    x: [...known, ...back].map((k) => c.runs[k]),
    y: [...known.map((k) => c.high[k]), ...back.map((k) => c.low[k])],
    fill: "toself",
    mode: "none",
    fillcolor: colour("--c0") + "33",
    name: "95 % confidence interval",
    hoverinfo: "skip",
  };
  const limit = {
    x: c.runs,
    y: c.limit,
    mode: "lines",
    name: "99th percentile",
    line: { color: colour("--c0"), width: 2 },
  };
  const mean = {
    x: c.runs,
    y: c.mean,
    mode: "lines",
    name: "mean",
    line: { color: colour("--c1"), width: 2 },
  };
  $("convergence-words").textContent = c.words;
  return Plotly.react(
    "convergence",
    [band, limit, mean],
    layout(axis("runs", { type: "log", dtick: 1 }), axis(label(name))),
    config(),
  );
}

function drawMatrix() {
  const names = data.matrix.slice(0, narrow() ? 3 : 5),
    n = names.length,
    traces = [],
    axes = {};
  const gap = 0.03,
    size = (1 - gap * (n - 1)) / n,
    few = {
      automargin: true,
      nticks: 4,
      tickfont: { size: 9 },
      tickangle: 0,
      exponentformat: "power",
      minexponent: 5,
      showgrid: false,
      zeroline: false,
      linecolor: colour("--line"),
      mirror: true,
      showline: true,
    };
  names.forEach((b, row) =>
    names.forEach((a, column) => {
      if (column > row) return;
      // The first axis has no number in its name: all of these have one.
      const k = row * n + column + 2,
        h = data.histograms[a],
        place = [column * (size + gap), 1 - row * (size + gap) - size];
      const title = (show, name) => ({
        text: show ? wrapped(label(name), narrow() ? 14 : 18) : "",
        font: { size: 11 },
        standoff: 4,
      });
      // Numbers at the outer edges alone; those of a histogram on the diagonal are counts, and not
      // of the quantity.
      const numbered = { x: row === n - 1, y: column === 0 && row > 0 };
      axes[`xaxis${k}`] = {
        ...few,
        showticklabels: numbered.x,
        domain: [place[0], place[0] + size],
        anchor: `y${k}`,
        title: title(row === n - 1, a),
      };
      axes[`yaxis${k}`] = {
        ...few,
        showticklabels: numbered.y,
        domain: [place[1], place[1] + size],
        anchor: `x${k}`,
        title: title(column === 0, b),
      };
      const common = {
        xaxis: `x${k}`,
        yaxis: `y${k}`,
        hoverinfo: "skip",
        marker: { color: colour("--c0") },
      };
      if (a === b)
        traces.push({
          ...common,
          type: "bar",
          x: h.counts.map((_, i) => h.start + (i + 0.5) * h.width),
          y: h.counts,
          width: h.width,
        });
      else
        traces.push({
          ...common,
          mode: "markers",
          x: data.points[a].slice(0, 400),
          y: data.points[b].slice(0, 400),
          marker: { color: colour("--c0"), size: 3, opacity: 0.5 },
        });
    }),
  );
  const frame = layout(undefined, undefined, {
    showlegend: false,
    ...axes,
    margin: { l: 60, r: 8, t: 8, b: 60 },
  });
  return Plotly.react("matrix", traces, frame, config());
}

function drawTime() {
  const tints = ["--c1", "--c0", "--c2"];
  const traces = Object.entries(data.time).map(([name, s], k) => ({
    type: "bar",
    orientation: "h",
    y: [""],
    x: [s],
    name,
    width: 0.5,
    marker: { color: colour(tints[k]) },
    hovertemplate: `${name}: %{x:.3g} s<extra></extra>`,
  }));
  return Plotly.react(
    "time",
    traces,
    layout(axis("s"), axis("", { showticklabels: false }), {
      barmode: "stack",
      legend: { ...layout().legend, traceorder: "normal" },
    }),
    config(),
  );
}
