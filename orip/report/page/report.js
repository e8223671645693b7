"use strict";

// Tables: a click on a heading sorts by that column, again the other way round.
const collator = new Intl.Collator("en", { numeric: true });

function sortedBy(rows, place, asNumbers, sign) {
  const keyed = rows.map((row) => {
    const text = row.cells[place].textContent;
    return { row, text, value: asNumbers ? Number.parseFloat(text) : Number.NaN };
  });
  keyed.sort((a, b) => {
    const [lostA, lostB] = [Number.isNaN(a.value), Number.isNaN(b.value)];
    if (!asNumbers || (lostA && lostB)) return sign * collator.compare(a.text, b.text);
    return lostA || lostB ? lostA - lostB : sign * (a.value - b.value);  // what has no number comes last
  });
  return keyed.map((entry) => entry.row);
}

for (const heading of document.querySelectorAll("thead th:has(button)")) {
  heading.querySelector("button").addEventListener("click", () => {
    const rising = heading.getAttribute("aria-sort") === "ascending";
    for (const other of heading.parentElement.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", rising ? "descending" : "ascending");
    const body = heading.closest("table").tBodies[0];
    const asNumbers = !heading.classList.contains("words");
    body.append(...sortedBy([...body.rows], heading.cellIndex, asNumbers, rising ? -1 : 1));
  });
}

// Served by `orip screen` the page may be out of date when somebody comes back to it.
addEventListener("pageshow", (event) => { if (event.persisted && location.protocol !== "file:") location.reload(); });

// The block in 3-D. plotly is unpacked when the view comes into sight, or a while after the page has opened.
const view = document.getElementById("view");
const block = JSON.parse(document.getElementById("block-data").textContent);
const MARKS = { tie: ["circle", 2.2], control: ["diamond", 5], check: ["diamond-open", 5], rejected: ["x", 3.5] };
const dark = matchMedia("(prefers-color-scheme: dark)");

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

async function unpackPlotly() {
  const packed = atob(document.getElementById("plotly-packed").textContent);
  const bytes = Uint8Array.from(packed, (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);
}

// The coordinates of polylines in one trace: null separates one from the next.
function polylines(lines, style) {
  const at = (axis) => lines.flatMap((line) => [...line.map((place) => place[axis]), null]);
  return { type: "scatter3d", mode: "lines", x: at(0), y: at(1), z: at(2), hoverinfo: "skip", ...style };
}

function markers(places, names, kind, style, said = []) {
  const at = (axis) => places.map((place) => place[axis]);
  const real = places.map((place, row) => [...place.map((value, axis) => value + block.origin[axis]), said[row] ?? ""]);
  return {
    type: "scatter3d", mode: "markers", x: at(0), y: at(1), z: at(2), text: names, customdata: real, name: kind,
    hovertemplate: `${kind} %{text}<br>X %{customdata[0]:.3f}<br>Y %{customdata[1]:.3f}<br>Z %{customdata[2]:.3f}%{customdata[3]}<extra></extra>`,
    textposition: "top center", textfont: { size: 10, color: colour("soft") }, ...style,
  };
}

function pyramid(centre, corners) {
  const [a, b, c, d] = corners;
  return [[...corners, a], [a, centre, c], [b, centre, d]];
}

function photoTraces() {
  const { names, xyz, corners, motions } = block.photos;
  const line = { color: colour("photo"), width: 2 };
  const upper = corners.map(([, , c, d]) => [d, c]);
  return [
    polylines(xyz.flatMap((centre, row) => pyramid(centre, corners[row])), { name: "photo frames", line }),
    polylines(upper, { name: "upper edge", line: { ...line, width: 6 }, showlegend: false }),
    markers(xyz, names, "photo", { marker: { size: 3.5, color: colour("photo"), symbol: "square" } }, motions),
  ];
}

// Rigs: from the origin of each to its cameras.
function bodyTraces() {
  if (!block.bodies.length) return [];
  const arms = block.bodies.flatMap(({ xyz: [middle, ...cameras] }) => cameras.map((camera) => [middle, camera]));
  const middles = block.bodies.map(({ xyz: [middle] }) => middle);
  return [
    polylines(arms, { name: "rigs", line: { color: colour("ink"), width: 8 } }),
    markers(middles, block.bodies.map(({ name }) => name), "exposure", { marker: { size: 2.5, color: colour("ink") }, showlegend: false }),
  ];
}

function pointTraces() {
  const { names, kinds, xyz } = block.points;
  return Object.entries(MARKS).flatMap(([kind, [symbol, size]]) => {
    const rows = kinds.flatMap((other, row) => (other === kind ? [row] : []));
    if (!rows.length) return [];
    const style = { marker: { size, symbol, color: colour(kind) } };
    return [markers(rows.map((row) => xyz[row]), rows.map((row) => names[row]), `${kind} point`, style)];
  });
}

function rayTrace(chosen) {
  const photos = chosen === "none" ? [] : chosen === "all" ? block.photos.names.keys() : [Number(chosen)];
  const rays = [...photos].flatMap((photo) =>
    block.photos.sees[photo].map((point) => [block.photos.xyz[photo], block.points.xyz[point]]));
  return polylines(rays, { name: "rays", line: { color: colour("third"), width: 1 }, opacity: 0.6, showlegend: rays.length > 0 });
}

// What coordinates are reduced by, as it is written behind the name of an axis.
function reduction(origin) {
  return origin ? ` ${origin < 0 ? "+" : "−"} ${Math.abs(origin)}` : "";
}

function layout() {
  const titled = (axis, place) => ({
    title: { text: `${axis}${reduction(block.origin[place])} (${block.unit})` },
    color: colour("soft"), gridcolor: colour("rule"), zerolinecolor: colour("rule"), showbackground: false,
  });
  return {
    scene: { aspectmode: "data", xaxis: titled("X", 0), yaxis: titled("Y", 1), zaxis: titled("Z", 2),
      camera: block.camera },
    paper_bgcolor: "rgba(0,0,0,0)", font: { color: colour("ink"), size: 11 }, margin: { l: 0, r: 0, t: 0, b: 0 },
    legend: { x: 0, y: 1, bgcolor: "rgba(0,0,0,0)" }, uirevision: "kept",
    modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("soft"), activecolor: colour("ink") },
  };
}

const rays = document.getElementById("rays");
const photoNames = document.getElementById("photo-names");
const pointNames = document.getElementById("point-names");

function draw() {
  const traces = [...photoTraces(), ...bodyTraces(), ...pointTraces(), rayTrace(rays.value)];
  for (const trace of traces) {
    const named = trace.name === "photo" ? photoNames.checked : trace.name.endsWith(" point") && trace.name !== "tie point" && pointNames.checked;
    if (trace.mode === "markers" && named) trace.mode = "markers+text";
  }
  // plotly has a button that uploads what is drawn; nothing of a project leaves its page
  const config = { responsive: true, displaylogo: false, showSendToCloud: false, plotlyServerURL: "" };
  return globalThis.Plotly.react(view, traces, layout(), config);
}

function offerRays() {
  const few = block.photos.sees.reduce((sum, seen) => sum + seen.length, 0) <= 60000;
  const choices = [["none", "none"], ...(few ? [["all", "of all photos"]] : []),
    ...block.photos.names.map((name, row) => [String(row), `of photo ${name}`])];
  rays.append(...choices.map(([value, text]) => new Option(text, value)));
}

async function showBlock() {
  await unpackPlotly();
  view.replaceChildren();
  offerRays();
  photoNames.checked = block.photos.names.length <= 40;
  pointNames.checked = block.points.kinds.filter((kind) => kind !== "tie").length <= 40;
  await draw();
  document.querySelector(".controls").hidden = false;
  for (const control of [rays, photoNames, pointNames]) control.addEventListener("change", draw);
  dark.addEventListener("change", draw);
  view.on("plotly_click", ({ points: [hit] }) => {
    const photo = hit.data.name === "photo" ? block.photos.names.indexOf(hit.text) : -1;
    if (photo < 0) return;
    rays.value = String(photo);
    draw();
  });
  view.dataset.drawn = "yes";
}

const thinned = block.points.names.length < block.points.of;
const upwards = block.upwards ? ` ${block.upwards}` : "";
document.getElementById("view-note").textContent =
  "Pyramids stand on the photos' frames; the thick edge is the upper one. Click on a photo to see its rays." +
  (thinned ? ` ${block.points.names.length} of ${block.points.of} points are drawn, every control and check point among them.` : "") + upwards;
let begun = false;
function showOnce() {
  if (begun) return;
  begun = true;
  watch.disconnect();
  showBlock().catch((error) => { view.textContent = `The view cannot be drawn: ${error.message}`; });
}
const watch = new IntersectionObserver((entries) => {
  if (entries.some((entry) => entry.isIntersecting)) showOnce();
}, { rootMargin: "300px" });
watch.observe(view);
// A page that is printed without having been read to the end has the view, too.
addEventListener("load", () => setTimeout(showOnce, 1500));
addEventListener("beforeprint", showOnce);
