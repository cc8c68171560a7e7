"use strict";
const $ = id => document.getElementById(id);
const TYPES = {f4: Float32Array, f8: Float64Array, i4: Int32Array};
/* Arrays arrive as base64, little-endian, as browsers' processors store them. */
const unpacked = (key, value) => {
  if (typeof value?.bdata !== "string") return value;
  const bytes = Uint8Array.from(atob(value.bdata), letter => letter.charCodeAt(0));
  return new TYPES[value.dtype](bytes.buffer);
};
const data = JSON.parse($("data").textContent, unpacked);
const {cells, looks, point, series} = data;
const count = data.look.length, width = cells ? cells.y.length : 1;
const letters = { state: "z", position: "x", velocity: "v" };
/* A parameter or observable in words; a coordinate, such as position[0], by its symbol, x₁. */
const words = name => name.replaceAll("_", " ").replaceAll(".", " ").replace(
  /^(state|position|velocity)\[(\d+)\]$/,
  (_, kind, at) => letters[kind] + String(Number(at) + 1).replace(/\d/g, digit => "₀₁₂₃₄₅₆₇₈₉"[digit]));
const safe = text => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
const number = value => String(Number(value.toPrecision(10)));

/* For each point its first dot; the dots of a point follow each other. */
const first = new Int32Array(count + 1);
for (const p of point) first[p + 1]++;
for (let p = 0; p < count; p++) first[p + 1] += first[p];
const place = p => cells
  ? [[cells.x[Math.floor(p / width)]], [cells.y[p % width]]]
  : [data.x.slice(first[p], first[p + 1]), data.y.slice(first[p], first[p + 1])];

function factsOf(p) {
  const found = [];
  for (const [name, column] of Object.entries(data.facts)) {
    const value = column.codes ? column.names[column.codes[p]] : column[p];
    if (value !== "" && !Number.isNaN(value)) {
      found.push([words(name), typeof value === "number" ? number(value) : value]);
    }
  }
  return found;
}
const hover = p => factsOf(p).map(([name, value]) => safe(`${name}: ${value}`)).join("<br>");

/* --- the diagram ------------------------------------------------------------------------------ */

const DASHES = {stable: "solid", unstable: "dash", inadmissible: "dot"};
const SYMBOLS = {motion: "circle", stable: "circle", unstable: "circle-open", inadmissible: "x-thin-open",
  bifurcation: "diamond", "inadmissible bifurcation": "diamond-open"};
const GLYPHS = {motion: "•", stable: "● ──", unstable: "○ ╌╌", inadmissible: "× ┈┈", bifurcation: "◆", "inadmissible bifurcation": "◇"};
/* Later ones are drawn above the others. */
const ORDER = ["inadmissible", "motion", "unstable", "stable", "inadmissible bifurcation", "bifurcation"];
const SHADES = {motion: Object.keys(data.lines).length ? "soft" : "ink", stable: "ink", unstable: "ink", inadmissible: "soft",
  bifurcation: "accent", "inadmissible bifurcation": "accent"};
const canvasHasGL = Boolean(document.createElement("canvas").getContext("webgl"));
/* Few points are sharper as vector graphics; many need the graphics processor. */
const KIND = canvasHasGL && data.x.length > 3000 ? "scattergl" : "scatter";
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function axis(title) {
  return {title: {text: safe(words(title))}, color: colour("ink"), gridcolor: colour("line"), zerolinecolor: colour("line"),
    linecolor: colour("soft"), showline: true, mirror: true, automargin: true, exponentformat: "power"};
}
function layout(x, y, more) {
  return {paper_bgcolor: colour("paper"), plot_bgcolor: colour("paper"),
    font: {color: colour("ink"), family: "system-ui, DejaVu Sans, sans-serif", size: 13},
    margin: {l: 55, r: 12, t: 12, b: 45}, xaxis: axis(x), yaxis: axis(y), hovermode: "closest",
    hoverlabel: {bgcolor: colour("paper"), bordercolor: colour("soft"), font: {color: colour("ink")}, align: "left"},
    showlegend: false, uirevision: "kept", ...more};
}
const SETTINGS = {responsive: true, displaylogo: false, scrollZoom: true, displayModeBar: true,
  modeBarButtons: [["zoomIn2d", "zoomOut2d", "resetScale2d"], ["zoom2d", "pan2d"], ["toImage"]]};

function heatmap() {
  const shades = cells.regions.map(([, shade]) => shade), n = shades.length;
  const rows = Array.from(cells.y, (_, j) => Array.from(cells.x, (_, i) => cells.numbers[i * width + j]));
  const scale = shades.flatMap((shade, k) => [[k / n, shade], [(k + 1) / n, shade]]);
  return {type: "heatmap", x: cells.x, y: cells.y, z: rows, zmin: -.5, zmax: n - .5, colorscale: scale, showscale: false,
    text: rows.map(row => row.map(k => safe(cells.regions[k][0]))),
    hovertemplate: data.names.map((name, k) => `${safe(words(name))}: %{${"xy"[k]}}<br>`).join("") + "%{text}<extra></extra>"};
}
function markers(look) {
  const dots = [...point.keys()].filter(d => data.look[point[d]] === look);
  const name = looks[look], texts = new Map();
  const text = p => texts.get(p) ?? (texts.set(p, hover(p)), texts.get(p));
  const crowd = dots.length > 3000 ? 2 : count > 300 ? 1 : 0;
  const size = name.endsWith("bifurcation") ? (count > 3000 ? 6 : 9) : [6, 4, 2.5][crowd];
  return {type: KIND, mode: "markers", name,
    x: dots.map(d => data.x[d]), y: dots.map(d => data.y[d]), customdata: dots.map(d => point[d]),
    text: dots.map(d => text(point[d])), hovertemplate: "%{text}<extra></extra>",
    marker: {symbol: SYMBOLS[name], size, color: colour(SHADES[name]), line: {width: name === "motion" ? 0 : 1.3, color: colour(SHADES[name])}}};
}
function traces() {
  const found = cells ? [heatmap()] : [];
  for (const name of ORDER.filter(name => name in data.lines)) {
    const [x, y] = data.lines[name];
    found.push({type: "scatter", mode: "lines", name, x, y, hoverinfo: "skip",
      line: {color: colour(SHADES[name]), width: 1.4, dash: DASHES[name]}});
  }
  for (const name of ORDER) {
    const look = looks.indexOf(name);
    if (!cells && data.look.includes(look)) found.push(markers(look));
  }
  return found;
}
function draw() {
  const more = {modebar: {orientation: "v"}, margin: {l: 55, r: 40, t: 12, b: 45}};
  return Plotly.react("diagram", traces(), layout(...data.names, more), SETTINGS);
}

/* --- the selected point ----------------------------------------------------------------------- */

let selected = -1, shown = null, chosen = {}, clock = 0, playing = false, last = 0;
const still = matchMedia("(prefers-reduced-motion: reduce)");

/* Elements above the plot move at once; a trace would draw all of them anew. */
function mark() {
  const {xaxis, yaxis} = $("diagram")._fullLayout, [x, y] = selected < 0 ? [[], []] : place(selected);
  const inside = (axis, at) => at >= 0 && at <= axis._length;
  const spots = Array.from(x, (at, k) => [xaxis.d2p(at), yaxis.d2p(y[k])]).filter(([px, py]) => inside(xaxis, px) && inside(yaxis, py));
  $("marks").replaceChildren(...spots.map(([px, py]) => {
    const box = document.createElement("i");
    box.style.left = `${xaxis._offset + px}px`;
    box.style.top = `${yaxis._offset + py}px`;
    return box;
  }));
}
function select(p, moving = !still.matches) {
  selected = p;
  mark();
  $("facts").replaceChildren(...factsOf(p).flatMap(([name, value]) => {
    const term = document.createElement("dt"), detail = document.createElement("dd");
    term.textContent = name;
    detail.textContent = value;
    return [term, detail];
  }));
  const near = data.nearest[p], owner = data.owners[near];
  shown = near < 0 ? null : series[near];
  const where = near < 0 ? "" : factsOf(owner).slice(0, cells ? 2 : 1).map(fact => fact.join(" ")).join(", ");
  $("whose").textContent = near < 0 ? "This file has no time series for this point."
    : owner === p ? "" : `Time series of the nearest point that has one: ${where}.`;
  $("controls").hidden = $("machine").hidden = !shown;
  if (shown) {
    $("machine").hidden = !shown.machine.masses;
    fill("of", shown.shown[0]);
    fill("across", shown.portrait[0]);
    fill("up", shown.portrait[1]);
    clock = 0;
    play(moving);
  }
  for (const choice of document.querySelectorAll(".choices")) choice.hidden = !shown;
  motion();
}
/* A choice is kept while the next point has the same column. */
function fill(id, wanted) {
  const list = $(id), names = Object.keys(shown.columns);
  list.replaceChildren(...names.map(name => new Option(words(name), name)));
  list.value = names.includes(chosen[id]) ? chosen[id] : wanted;
}
function motion() {
  const settings = {...SETTINGS, displayModeBar: false, scrollZoom: false};
  for (const id of ["time", "portrait"]) {
    $(id).parentNode.hidden = !shown;
    if (!shown) Plotly.purge(id);
  }
  if (!shown) return;
  const of = $("of").value, ink = colour("ink");
  const mode = shown.discrete ? "lines+markers" : "lines";
  const own = of === shown.shown[0];
  const over = (own ? shown.shown : [of]).map((name, k) => ({x: shown.times, y: shown.columns[name], name: words(name), mode,
    line: {color: ink, width: shown.discrete ? .6 : 1.4, dash: k ? "dash" : "solid"}, marker: {size: 5, color: ink}}));
  const hits = {mode: "markers", name: "impacts", x: shown.marks.map(k => shown.times[k]),
    y: shown.marks.map(k => shown.columns[of][k]), marker: {size: 6, color: ink, symbol: "diamond"}};
  const legend = {showlegend: over.length > 1 || shown.marks.length > 0, legend: {orientation: "h", y: 1.02, yanchor: "bottom", x: 0}};
  Plotly.react("time", [...over, hits], layout(shown.discrete ? "iterate" : "time", of, {...legend, uirevision: selected}), settings);
  const across = $("across").value, up = $("up").value;
  Plotly.react("portrait", [{x: shown.columns[across], y: shown.columns[up], hoverinfo: "x+y", mode: shown.discrete ? "markers" : "lines",
    line: {color: ink, width: 1.4}, marker: {size: 5, color: ink}}],
  padded(layout(across, up, {uirevision: selected}), shown.columns[across]), settings);
  for (const id of ["time", "portrait"]) {
    $(id).removeAllListeners("plotly_afterplot");
    $(id).on("plotly_afterplot", frame);
  }
  frame();
}
/* Lines end within the frame. */
function padded(plan, x) {
  const known = Array.from(x).filter(value => !Number.isNaN(value)), low = Math.min(...known), high = Math.max(...known);
  const more = .06 * (high - low) || 1;
  plan.xaxis.range = [low - more, high + more];
  return plan;
}

/* --- the animation ---------------------------------------------------------------------------- */

function play(on) {
  playing = on && Boolean(shown);
  $("play").textContent = playing ? "Pause" : "Play";
  last = 0;
  if (playing) requestAnimationFrame(step);
}
function step(stamp) {
  if (!playing || !shown) return;
  const seconds = shown.discrete ? shown.times.length / 4 : Math.min(4 + shown.marks.length / 4, 15);
  if (last) clock = (clock + (stamp - last) / 1000 / seconds) % 1;
  last = stamp;
  frame();
  requestAnimationFrame(step);
}
/* The column at the time of the animation; states of a map are not joined. */
function at() {
  const {times, discrete} = shown, end = times.length - 1;
  const t = times[0] + clock * (times[end] - times[0] + (discrete ? 1 : 0));
  let low = 0, high = end;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle; else high = middle;
  }
  if (times[high] <= t) low = high;
  const next = Math.min(low + 1, end), span = times[next] - times[low];
  const part = discrete || span <= 0 ? 0 : (t - times[low]) / span;
  const value = name => shown.columns[name][low] * (1 - part) + (part ? shown.columns[name][next] * part : 0);
  return {t: discrete ? times[low] : t, value};
}
function frame() {
  if (!shown) return;
  const {t, value} = at();
  /* An element above the plot moves at once; a trace would be drawn anew. */
  const moved = (id, x, y) => {
    const {xaxis, yaxis} = $(id)._fullLayout ?? {}, {style} = $(id).parentNode.querySelector(".dot");
    if (!xaxis) return;
    const px = xaxis.d2p(x), py = yaxis.d2p(y);
    style.visibility = px >= 0 && px <= xaxis._length && py >= 0 && py <= yaxis._length ? "visible" : "hidden";
    style.left = `${xaxis._offset + px}px`;
    style.top = `${yaxis._offset + py}px`;
  };
  moved("time", t, value($("of").value));
  moved("portrait", value($("across").value), value($("up").value));
  $("now").value = Math.round(1000 * clock);
  if (shown.machine.masses) sketch(t, value);
}
function reach({masses}) {
  let far = 0;
  for (let k = 0; k < masses.length; k++) {
    const x = shown.columns[masses[k]], before = k ? shown.columns[masses[k - 1]] : null;
    for (let i = 0; i < x.length; i++) far = Math.max(far, .7 * Math.abs(x[i]), Math.abs(before ? x[i] - before[i] : x[i]));
  }
  return far || 1;
}
function sketch(t, value) {
  const canvas = $("machine"), ratio = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  canvas.width = w * ratio;
  canvas.height = h * ratio;
  const pen = canvas.getContext("2d"), {masses, stops, walls} = shown.machine;
  pen.scale(ratio, ratio);
  const room = Math.min(w / (masses.length + 2), 160), begin = (w - room * (masses.length + 1.8)) / 2;
  const half = room * .17, middle = h / 2, scale = .6 * room / reach(shown.machine);
  const rest = k => begin + room * (k + 1), centre = masses.map((name, k) => rest(k) + scale * value(name));
  pen.strokeStyle = pen.fillStyle = colour("ink");
  pen.lineWidth = 1.3;
  const line = (...xy) => {
    pen.beginPath();
    for (let i = 0; i < xy.length; i += 2) pen.lineTo(xy[i], xy[i + 1]);
    pen.stroke();
  };
  const spring = (a, b) => line(a, middle, ...[.2, .3, .4, .5, .6, .7, .8].flatMap((part, k) =>
    [a + part * (b - a), middle + (k % 6 ? (k % 2 ? -1 : 1) * h * .07 : 0)]), b, middle);
  const wall = x => line(x, middle - h * .3, x, middle + h * .3);
  if (walls[0]) { wall(rest(-1)); spring(rest(-1), centre[0] - half); }
  if (walls[1]) { wall(rest(masses.length)); spring(centre.at(-1) + half, rest(masses.length)); }
  centre.forEach((x, k) => {
    if (k) spring(centre[k - 1] + half, x - half);
    pen.strokeRect(x - half, middle - half, 2 * half, 2 * half);
  });
  const fading = .02 * (shown.times.at(-1) - shown.times[0]);
  const struck = shown.marks.some(k => t >= shown.times[k] && t - shown.times[k] < fading);
  for (const {column, mass, side} of stops) {
    const x = rest(mass) + scale * value(column) - side * half;
    pen.strokeStyle = colour(struck ? "accent" : "ink");
    pen.lineWidth = struck ? 5 : 3;
    line(x, middle + half * 1.1, x, middle + h * .42);
    line(x, middle - half * 1.1, x, middle - h * .42);
  }
}

/* --- pointer, keys, themes -------------------------------------------------------------------- */

/* The next point of the same curve, or of another one where it is nearest along the axis. */
function neighbour(p, key) {
  const way = {ArrowLeft: -1, ArrowRight: 1, ArrowUp: 1, ArrowDown: -1}[key];
  if (cells) {
    const i = Math.floor(p / width), j = p % width, sideways = key === "ArrowLeft" || key === "ArrowRight";
    const move = (k, n) => key === "Home" ? 0 : key === "End" ? n - 1 : Math.min(Math.max(k + way, 0), n - 1);
    return key.startsWith("Arrow") && !sideways ? i * width + move(j, width) : move(i, cells.x.length) * width + j;
  }
  const track = data.track, begin = track.indexOf(track[p]), end = track.lastIndexOf(track[p]);
  if (key === "Home") return begin;
  if (key === "End") return end;
  if (key === "ArrowLeft" || key === "ArrowRight") return Math.min(Math.max(p + way, begin), end);
  const other = way > 0 ? end + 1 : begin - 1;
  if (other < 0 || other >= count) return p;
  const low = track.indexOf(track[other]), high = track.lastIndexOf(track[other]), x = q => data.x[first[q]];
  let best = low;
  for (let q = low; q <= high; q++) if (Math.abs(x(q) - x(p)) < Math.abs(x(best) - x(p))) best = q;
  return best;
}
function zoom(factor) {
  const {xaxis, yaxis} = $("diagram")._fullLayout, centre = selected < 0 ? [null, null] : place(selected).map(x => x[0]);
  const range = (axis, middle) => {
    const [a, b] = axis.range, m = middle ?? (a + b) / 2;
    return [m + (a - m) * factor, m + (b - m) * factor];
  };
  Plotly.relayout("diagram", factor
    ? {"xaxis.range": range(xaxis, centre[0]), "yaxis.range": range(yaxis, centre[1])}
    : {"xaxis.autorange": true, "yaxis.autorange": true});
}
document.addEventListener("keydown", event => {
  if (event.target.closest("select, input, button") || event.ctrlKey || event.metaKey || event.altKey) return;
  const {key} = event, factor = {"+": .5, "=": .5, "-": 2, "0": 0}[key];
  if (key.startsWith("Arrow") || key === "Home" || key === "End") select(selected < 0 ? 0 : neighbour(selected, key));
  else if (factor !== undefined) zoom(factor);
  else if (key === " " && shown) play(!playing);
  else return;
  event.preventDefault();
});
$("play").addEventListener("click", () => play(!playing));
$("now").addEventListener("input", event => {
  play(false);
  clock = event.target.value / 1000;
  frame();
});
for (const id of ["of", "across", "up"]) {
  $(id).addEventListener("change", event => { chosen[id] = event.target.value; motion(); });
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => draw().then(motion));

$("notes").textContent = data.notes.join(" ");
$("diagram").setAttribute("aria-label", `Diagram of ${words(data.names[1])} against ${words(data.names[0])}, ${count} points`);
function entry(name, shade, glyph) {
  const found = document.createElement("li"), patch = document.createElement(glyph ? "b" : "i");
  patch.textContent = glyph;
  patch.style[glyph ? "color" : "background"] = shade;
  patch.setAttribute("aria-hidden", "true");
  const label = document.createElement("label"), box = document.createElement("input");
  label.append(patch, name);
  found.append(label);
  if (glyph) {
    Object.assign(box, {type: "checkbox", checked: true});
    label.prepend(box);
    box.addEventListener("change", () => {
      const places = $("diagram").data.flatMap((trace, k) => trace.name === name ? [k] : []);
      Plotly.restyle("diagram", {visible: box.checked}, places);
    });
  }
  return found;
}
$("legend").replaceChildren(...cells ? cells.regions.map(([name, shade]) => entry(name, shade, ""))
  : looks.filter((_, look) => data.look.includes(look)).map(name => entry(name, `var(--${SHADES[name]})`, GLYPHS[name])));
draw().then(() => {
  for (const event of ["plotly_afterplot", "plotly_relayouting"]) $("diagram").on(event, mark);
  $("diagram").on("plotly_click", ({points: [hit]}) => {
    const picked = cells ? hit.pointIndex[1] * width + hit.pointIndex[0] * 1 : hit.customdata;
    if (picked !== undefined) select(picked);
  });
  if (count) select(data.owners[0] ?? 0, false);
  document.body.dataset.ready = "yes";
});
