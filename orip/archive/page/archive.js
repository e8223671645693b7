"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const columns = [
  ["project", "Project"], ["bundle", "Bundle"], ["state", "Result"], ["sigma0", "sigma0", 3],
  ["redundancy", "Redundancy", 0], ["photos", "Photos", 0], ["points", "Points", 0],
  ["check_rms_xy", "Check XY", 3], ["check_rms_z", "Check Z", 3], ["check_max", "Check largest", 3],
  ["failures", "Gates failed", 0], ["text", "What the adjustment says"],
];
const first = 500;
const collator = new Intl.Collator("en", { numeric: true });
const found = (id) => document.getElementById(id);
let sorted = "project", direction = 1, all = false;

for (const row of data.rows) row.failures = row.failed.length;
for (const state of [...new Set(data.rows.map((row) => row.state))].sort()) found("state").add(new Option(state, state));
for (const [gate, count] of data.gates) found("gate").add(new Option(`${gate} (${count})`, gate));

function chosen() {
  const text = found("text").value.toLowerCase(), state = found("state").value, gate = found("gate").value;
  return data.rows.filter((row) =>
    (!text || `${row.project} ${row.bundle} ${row.text}`.toLowerCase().includes(text)) && (!state || row.state === state) &&
    (!gate || (gate === "*" ? row.failures > 0 : row.failed.includes(gate))));
}

function before(one, other) {
  const a = one[sorted], b = other[sorted];
  if (a === null || b === null) return (a === null) - (b === null);
  return direction * (typeof a === "number" ? a - b : collator.compare(a, b));
}

function cell(row, [key, , digits]) {
  const made = document.createElement("td"), value = row[key];
  if (key === "project") {
    const link = document.createElement("a");
    link.href = row.link;
    link.textContent = value;
    made.append(link);
  } else if (value !== null) {
    made.textContent = digits === undefined ? value : value.toFixed(digits);
  }
  if ((key === "failures" && value > 0) || (key === "state" && value !== "converged")) made.className = "bad";
  return made;
}

function node(name, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

function histogram(id, rows) {
  const values = rows.map((row) => row[id]).filter((value) => value !== null).sort((a, b) => a - b);
  const drawing = found(id), bins = 30, left = 10, width = 400, bottom = 105, height = 90;
  drawing.replaceChildren(node("line", { x1: left, x2: left + width, y1: bottom, y2: bottom }));
  if (!values.length) {
    drawing.append(node("text", { x: left, y: 60 }, "no values"));
    return;
  }
  const low = values[0], high = values[Math.floor(0.98 * (values.length - 1))], span = high - low || 1;
  const counts = new Array(bins).fill(0);
  let beyond = 0;
  for (const value of values) {
    if (value > low + span) beyond += 1;
    else counts[Math.min(bins - 1, Math.floor(((value - low) / span) * bins))] += 1;
  }
  const most = Math.max(...counts);
  counts.forEach((count, bin) => {
    const tall = (count / most) * height;
    const bar = node("rect", { x: left + (bin * width) / bins, y: bottom - tall, width: width / bins - 1, height: tall });
    bar.append(node("title", {}, `${(low + (bin * span) / bins).toPrecision(3)} and above: ${count}`));
    drawing.append(bar);
  });
  drawing.append(node("text", { x: left, y: 122 }, low.toPrecision(3)));
  const more = beyond ? `; ${beyond} above, to ${values[values.length - 1].toPrecision(3)}` : "";
  drawing.append(node("text", { x: left + width, y: 122, "text-anchor": "end" }, (low + span).toPrecision(3) + more));
}

function show() {
  const rows = chosen().sort(before), shown = all ? rows : rows.slice(0, first);
  found("count").textContent = `${rows.length} of ${data.rows.length} lines`;
  found("rows").replaceChildren(...shown.map((row) => {
    const line = document.createElement("tr");
    line.append(...columns.map((column) => cell(row, column)));
    if (row.failures) line.title = `failed: ${row.failed.join(", ")}`;
    return line;
  }));
  found("more").hidden = shown.length === rows.length;
  found("more").textContent = `Show all ${rows.length}`;
  for (const [key] of columns) {
    const order = direction > 0 ? "ascending" : "descending";
    found(`head-${key}`).setAttribute("aria-sort", key === sorted ? order : "none");
  }
  histogram("sigma0", rows);
  histogram("check_max", rows);
}

for (const [key, label] of columns) {
  const head = document.createElement("th"), button = document.createElement("button");
  head.id = `head-${key}`;
  head.scope = "col";
  button.type = "button";
  button.textContent = label;
  button.addEventListener("click", () => {
    direction = key === sorted ? -direction : 1;
    sorted = key;
    show();
  });
  head.append(button);
  found("heads").append(head);
}
for (const id of ["text", "state", "gate"]) found(id).addEventListener("input", show);
found("filters").addEventListener("submit", (event) => event.preventDefault());
found("more").addEventListener("click", () => { all = true; show(); });
show();
