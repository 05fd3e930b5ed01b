// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
// Tracked objects of the operators' page: directions and ranges, or positions, over time, each with one standard deviation.
"use strict";

const SVG = "http://www.w3.org/2000/svg";
/** Size of a plot, and its margins: left, right, top, bottom. */
const PLOT = { width: 420, height: 110, left: 64, right: 8, top: 8, bottom: 18 };
const DEGREES = 180 / Math.PI;
/** Plotted quantities: title, unit, factor, names of the value and of its standard deviation. */
const QUANTITIES = [
  ["azimuth", "°", DEGREES, "azimuth_rad", "sigma_azimuth_rad"],
  ["elevation", "°", DEGREES, "elevation_rad", "sigma_elevation_rad"],
  ["range", "m", 1, "range_m", "sigma_range_m"],
];
/** Those of objects without directions. */
const POSITIONS = ["x", "y", "z"].map((axis) => [axis, "m", 1, `${axis}_m`, `sigma_${axis}_m`]);

function draws(tag, attributes, text) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

/** Angles without steps of a full circle. */
function unwrapped(values) {
  let turns = 0;
  return values.map((value, i) => {
    if (i > 0) turns -= Math.round((value - values[i - 1]) / (2 * Math.PI));
    return value + turns * 2 * Math.PI;
  });
}

/** A plot of values with a band of one standard deviation; points without a source in the image are hollow. */
function plot(states, [title, unit, factor, name, sigmaName]) {
  const known = states.filter((state) => state[name] !== null);
  if (known.length === 0) return null;
  const raw = name === "azimuth_rad" ? unwrapped(known.map((s) => s[name])) : known.map((s) => s[name]);
  const rows = known.map((s, i) => ({ t: Number(BigInt(s.stamp_ns) / 1000n) / 1e6, value: raw[i] * factor,
    sigma: (s[sigmaName] ?? 0) * factor, measured: s.status === "confirmed" }));
  const [t0, t1] = [Number(BigInt(states[0].stamp_ns) / 1000n) / 1e6, Number(BigInt(states.at(-1).stamp_ns) / 1000n) / 1e6];
  let low = Math.min(...rows.map((r) => r.value - r.sigma));
  let high = Math.max(...rows.map((r) => r.value + r.sigma));
  const margin = (high - low) * 0.05 || Math.abs(high) * 1e-6 || 1e-6;
  [low, high] = [low - margin, high + margin];
  const x = (t) => PLOT.left + ((t - t0) / (t1 - t0 || 1)) * (PLOT.width - PLOT.left - PLOT.right);
  const y = (v) => PLOT.top + ((high - v) / (high - low)) * (PLOT.height - PLOT.top - PLOT.bottom);
  const digits = Math.min(Math.max(Math.ceil(1 - Math.log10(high - low)), 0), 8);
  const svg = draws("svg", { viewBox: `0 0 ${PLOT.width} ${PLOT.height}`, role: "img", "data-quantity": title,
    "aria-label": `${title} from ${rows[0].value.toFixed(digits)} to ${rows.at(-1).value.toFixed(digits)} ${unit}` });
  const bottom = PLOT.height - PLOT.bottom;
  svg.append(draws("path", { class: "axis", d: `M${PLOT.left} ${PLOT.top}V${bottom}H${PLOT.width - PLOT.right}` }));
  const upper = rows.map((r) => `${x(r.t).toFixed(1)} ${y(r.value + r.sigma).toFixed(1)}`);
  const lower = rows.map((r) => `${x(r.t).toFixed(1)} ${y(r.value - r.sigma).toFixed(1)}`).reverse();
  svg.append(draws("path", { class: "band", d: `M${[...upper, ...lower].join("L")}Z` }));
  svg.append(draws("path", { class: "value", d: `M${rows.map((r) => `${x(r.t).toFixed(1)} ${y(r.value).toFixed(1)}`).join("L")}` }));
  for (const r of rows) {
    svg.append(draws("circle", { class: r.measured ? "point" : "coasting", cx: x(r.t).toFixed(1), cy: y(r.value).toFixed(1), r: 2 }));
  }
  const end = { x: PLOT.left - 4, "text-anchor": "end" };
  svg.append(draws("text", { ...end, y: PLOT.top + 8 }, high.toFixed(digits)), draws("text", { ...end, y: bottom }, low.toFixed(digits)));
  svg.append(draws("text", { x: PLOT.left + 6, y: PLOT.top + 10 }, `${title}, ${unit}`));
  svg.append(draws("text", { x: PLOT.width - PLOT.right, y: PLOT.height - 4, "text-anchor": "end" }, `${(t1 - t0).toFixed(1)} s`));
  return svg;
}

/** A state with the coordinates of its position and their standard deviations. */
function withCoordinates(state) {
  const coordinates = POSITIONS.flatMap(([, , , name, sigmaName], i) => [[name, state.position_m?.[i] ?? null],
    [sigmaName, state.position_covariance ? Math.sqrt(state.position_covariance[i][i]) : null]]);
  return { ...state, ...Object.fromEntries(coordinates) };
}

/** The last known position in words, each coordinate with its standard deviation if it is known. */
function positionText({ states, position_frame: frame }) {
  const last = states.map(withCoordinates).findLast((state) => state.position_m !== null);
  if (!last) return "";
  const coordinates = POSITIONS.map(([axis, , , name, sigmaName]) =>
    `${axis} ${metres(last[name])}${last[sigmaName] === null ? "" : ` ± ${metres(last[sigmaName])}`}`);
  return `${coordinates.join("  ")} m in ${frame}`;
}

function objectPlots(object) {
  const last = object.states.at(-1);
  const states = object.states.map(withCoordinates);
  const quantities = states.some((state) => state.azimuth_rad !== null) ? QUANTITIES : POSITIONS;
  const plots = quantities.map((quantity) => plot(states, quantity)).filter((drawn) => drawn !== null);
  const name = object.label || `object ${object.id}`;
  return make("article", { class: "plot" },
    make("h3", null, `${name} (${object.id}) of ${object.robot}`, badge(last.status)), ...plots,
    make("p", { class: "numbers" }, positionText(object)),
    make("p", { class: "note" }, `${object.states.length} states to ${time(last.stamp_ns)}${last.reasons.length ? `: ${last.reasons.join(", ")}` : ""}`));
}

async function showTracks() {
  const { items: objects } = await ask("api/v1/tracks?limit=500");
  byId("tracks-section").hidden = objects.length === 0;
  if (objects.length === 0) return;
  options("frame", [...new Set(objects.map((o) => o.frame))], byId("tracks-frame"));
  const shown = objects.filter((o) => o.frame === byId("tracks-frame").value);
  // The object that was seen last comes first.
  shown.sort((a, b) => Number(BigInt(b.states.at(-1).stamp_ns) - BigInt(a.states.at(-1).stamp_ns)));
  byId("tracks").replaceChildren(...shown.map(objectPlots));
  byId("tracks-note").textContent = "The band is one standard deviation; hollow points are predictions.";
}

let tracksPending = null;
byId("tracks-frame").addEventListener("change", showTracks);
document.addEventListener("news", () => {
  if (tracksPending === null) tracksPending = setTimeout(() => { tracksPending = null; untilAnswered(showTracks); }, 1500);
});
untilAnswered(showTracks);
