const $ = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const narrow = () => document.documentElement.clientWidth < 600;
const dark = () => matchMedia("(prefers-color-scheme: dark)").matches;
// The library's button to share a plot would send the numbers away.
const config = () => ({
  displaylogo: false,
  showSendToCloud: false,
  responsive: true,
  displayModeBar: narrow() ? false : "hover",
});
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
  return {
    title,
    gridcolor: line,
    zerolinecolor: line,
    linecolor: colour("--soft"),
    automargin: true,
    exponentformat: "power",
    minexponent: 6,
    ...more,
  };
}

function layout(x, y, more = {}) {
  const clear = "rgba(0,0,0,0)";
  return {
    paper_bgcolor: clear,
    plot_bgcolor: clear,
    font: { color: colour("--ink"), size: 12 },
    margin: { l: narrow() ? 50 : 70, r: 12, t: 34, b: 50 },
    ...(x && { xaxis: x, yaxis: y }),
    hovermode: "closest",
    modebar: { bgcolor: clear, color: colour("--soft"), activecolor: colour("--ink") },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: { size: 12 } },
    ...more,
  };
}

const drawings = {
  footprint: drawFootprint,
  rose: drawRose,
  scatter: drawScatter,
  histogram: drawHistogram,
  contributors: drawContributors,
  convergence: drawConvergence,
  matrix: drawMatrix,
  trajectories: drawTrajectories,
  time: drawTime,
};

async function drawAll() {
  const how = `${narrow() ? "narrow" : "wide"} ${dark() ? "dark" : "light"}`;
  for (const [id, draw] of Object.entries(drawings)) if ($(id)) await draw();
  document.body.dataset.drawn = how;
}

async function start() {
  // The plotting library is in the page, compressed: it needs no network and a third of the room.
  const bytes = Uint8Array.from(atob($("library").textContent), (c) => c.charCodeAt(0));
  const text = await new Response(
    new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")),
  ).text();
  const script = document.createElement("script");
  script.textContent = text;
  document.head.appendChild(script);
  for (const [id, draw] of [
    ["across", drawScatter],
    ["up", drawScatter],
    ["histogram-of", drawHistogram],
    ["contributors-of", drawContributors],
    ["convergence-of", drawConvergence],
  ])
    if ($(id)) $(id).addEventListener("change", draw);
  await drawAll();
  // One after the other: of two drawings at once the older one could end last.
  let before = narrow(),
    drawing = Promise.resolve();
  const again = () => {
    drawing = drawing.then(drawAll);
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  addEventListener("resize", () => {
    if (narrow() !== before) {
      before = narrow();
      again();
    }
  });
}
start().catch((error) => {
  document.body.dataset.error = error.message;
  console.error(error);
});
