// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
// Over the map: robots and tracked objects with their paths and position errors, outlines of maps, scale bar, north, colours
// of the layer, and the time of the maps.
"use strict";

/** Poses of a path, outlines of maps, and standard deviations of an ellipse that are drawn. */
const [MOST_POSES, MOST_OUTLINES, SIGMAS] = [2000, 200, 3];
/** States of all tracked objects that are drawn. */
const MOST_STATES = 200;
/** Pause before the overlay of a frame is read again. */
const PAUSE_MS = 1000;
/** Pause after a movement of the slider, after which it is read for another time. */
const SLIDER_PAUSE_MS = 250;
const overlay = { robots: [], tracks: [], outlines: [], goals: [], north: null, read: 0, span: null };

function shape(name, attributes, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

/** Pixel of a point of the frame. */
const pixel = ([x, y]) => [(x - map.x) / cell() + view().clientWidth / 2, (map.y - y) / cell() + view().clientHeight / 2];
const line = (points) => points.map((point) => pixel(point).map((v) => v.toFixed(1)).join(",")).join(" ");

/** Half axes, metres, and direction of the ellipse of a position error, from its covariance. */
function ellipseOf([[xx, xy], [, yy]]) {
  const middle = (xx + yy) / 2;
  const half = Math.hypot((xx - yy) / 2, xy);
  return { a: Math.sqrt(middle + half), b: Math.sqrt(Math.max(middle - half, 0)), angle: Math.atan2(2 * xy, xx - yy) / 2 };
}

/** Corners of the polygons of a WKT text. */
const rings = (wkt) => [...wkt.matchAll(/\(([-\d.e, ]+)\)/g)].map(([, ring]) => ring.split(",").map((p) => p.trim().split(" ").map(Number)));

/** Read what lies in the frame; a part that cannot be read is left out. */
async function readOverlay() {
  const mine = overlay.read += 1;
  const frame = encodeURIComponent(map.frame);
  const part = (path) => ask(path).catch(() => null);
  const until = map.timeMs === null ? "" : `&datetime=../${new Date(map.timeMs).toISOString()}`;
  const [known, place, tracked, goals] = await Promise.all([part("api/v1/robots"), part(`api/v1/places/${frame}`),
    part(`api/v1/tracks?limit=${MOST_STATES}&position_frame=${frame}`), readGoals(map.frame, map.timeMs)]);
  const robots = await Promise.all((known?.items || []).map(async ({ id }) => {
    const series = await part(`api/v1/poses?robot=${encodeURIComponent(id)}&frame=${frame}&limit=${MOST_POSES}&thin=true`);
    return { id, poses: series?.items || [] };
  }));
  const filter = encodeURIComponent(`frame = '${map.frame}'`);
  const items = await part(`ogc/collections/${layer().product}/items?limit=${MOST_OUTLINES}&filter=${filter}&properties=outline_m,t1&skipGeometry=true${until}`);
  if (mine !== overlay.read) return;
  overlay.robots = robots.filter(({ poses }) => poses.length);
  overlay.north = place?.anchor ? place.anchor.azimuth_deg : null;
  overlay.tracks = tracked?.items || [];
  overlay.goals = goals;
  overlay.outlines = (items?.features || []).map(({ properties }) => properties).filter(({ outline_m: wkt }) => wkt)
    .map(({ outline_m: wkt, t1 }) => ({ rings: rings(wkt), endMs: Date.parse(t1) }));
  drawOverlay();
}

/** The ellipse of a position error around a point of the map. */
function drawError(into, covariance, [x, y]) {
  const { a, b, angle } = ellipseOf(covariance);
  const turn = `translate(${x} ${y}) rotate(${-angle * 180 / Math.PI})`;
  into.append(shape("ellipse", { class: "error-ellipse", rx: SIGMAS * a / cell(), ry: SIGMAS * b / cell(), transform: turn },
    shape("title", {}, `${SIGMAS} σ: ${metres(SIGMAS * a)} m × ${metres(SIGMAS * b)} m`)));
}

/** Those of the states in the order of time that are not later than the time of the map. */
const until = (states) => (map.timeMs === null ? states : states.filter((state) => Number(state.stamp_ns) / 1e6 <= map.timeMs));

function drawRobot(into, { id, poses }) {
  const known = until(poses);
  if (!known.length) return;
  const last = known[known.length - 1];
  into.append(shape("polyline", { class: "path", points: line(known.map(({ T }) => [T[0][3], T[1][3]])) }));
  const [x, y] = pixel([last.T[0][3], last.T[1][3]]);
  if (last.covariance) drawError(into, last.covariance, [x, y]);
  const heading = -Math.atan2(last.T[1][0], last.T[0][0]) * 180 / Math.PI;
  into.append(shape("path", { class: "robot-mark", d: "M9 0 L-6 6 L-3 0 L-6 -6 Z", transform: `translate(${x} ${y}) rotate(${heading})` }));
  into.append(shape("text", { x: x + 10, y: y - 8 }, id));
}

/** A tracked object: its path, and a square at its last position, hollow if the position was predicted. */
function drawTrack(into, { id, label, robot, states }) {
  const known = until(states).filter((state) => state.position_m !== null);
  if (!known.length) return;
  const last = known[known.length - 1];
  const group = shape("g", { class: "track", "data-object": `${robot}/${id}` });
  group.append(shape("polyline", { class: "path", points: line(known.map((state) => state.position_m)) }));
  const [x, y] = pixel(last.position_m);
  if (last.position_covariance) drawError(group, last.position_covariance, [x, y]);
  group.append(shape("rect", { class: `track-mark ${last.status}`, x: x - 5, y: y - 5, width: 10, height: 10 }));
  group.append(shape("text", { x: x + 9, y: y + 14 }, `${label || `object ${id}`}, ${last.status}`));
  into.append(group);
}

/** A bar of 1, 2 or 5 times a power of ten, at most a fifth of the map or 60 pixels. */
function drawScale(into) {
  const most = Math.max(view().clientWidth / 5, 60) * cell();
  const power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((n) => n * power).find((n) => n <= most);
  const [px, y] = [length / cell(), view().clientHeight - 14];
  into.append(shape("path", { class: "scale-bar", d: `M12 ${y - 5} V${y} H${12 + px} V${y - 5}` }));
  const text = length < 1 ? `${+(length * 100).toPrecision(1)} cm` : length < 1000 ? `${length} m` : `${length / 1000} km`;
  into.append(shape("text", { x: 16 + px, y }, text));
}

function drawNorth(into) {
  if (overlay.north === null) return;
  const turn = `translate(${view().clientWidth - 26} 30) rotate(${-overlay.north})`;
  into.append(shape("g", { class: "north", transform: turn }, shape("path", { d: "M0 -18 L6 6 L0 2 L-6 6 Z" }),
    shape("text", { x: -4, y: 20 }, "N")));
}

function drawOverlay() {
  if (!layer()) return;
  let svg = view().querySelector("svg");
  if (!svg) {
    svg = shape("svg", { class: "overlay", "aria-hidden": "true" });
    view().append(svg);
  }
  svg.replaceChildren();
  if (byId("map-outlines").checked) {
    const captured = overlay.outlines.filter(({ endMs }) => map.timeMs === null || endMs <= map.timeMs);
    for (const ring of captured.flatMap((outline) => outline.rings)) svg.append(shape("polygon", { class: "outline", points: line(ring) }));
  }
  for (const goal of goalsAt(overlay.goals, map.timeMs)) drawGoal(svg, goal);
  for (const track of overlay.tracks) drawTrack(svg, track);
  for (const robot of overlay.robots) drawRobot(svg, robot);
  drawScale(svg);
  drawNorth(svg);
}

/** The colours of the layer with the values of the ends. */
function drawLegend() {
  const colors = layer()?.colors;
  if (!colors) return;
  const classes = ["safe", "caution", "hazard"];
  const isClasses = layer().name === "navigation_map";
  const unit = layer().unit === "1" ? "" : ` ${layer().unit}`;
  byId("map-legend").replaceChildren(...colors.map(([value, color], i) => {
    const swatch = make("i");
    swatch.style.background = color;
    if (isClasses) return make("span", null, swatch, classes[i]);
    const text = `${value}${unit}`;
    if (i === 0) return make("span", null, `${text} `, swatch);
    return make("span", null, swatch, i === colors.length - 1 ? text : "");
  }));
}

/** The interval of the slider is that of the captures of the layer; at its end the newest maps are shown. */
function setSpan(held) {
  const slider = byId("map-time");
  overlay.span = held ? [Number(held.t0_ns) / 1e6, Number(held.newest_ns) / 1e6] : null;
  slider.disabled = !overlay.span || overlay.span[0] >= overlay.span[1];
  showTime();
}

function showTime() {
  const slider = byId("map-time");
  const fraction = slider.value / slider.max;
  const isNewest = slider.disabled || fraction >= 1;
  map.timeMs = isNewest ? null : overlay.span[0] + fraction * (overlay.span[1] - overlay.span[0]);
  const text = isNewest ? "all captures" : `captures until ${new Date(map.timeMs).toISOString().replace("T", " ").slice(0, 19)} UTC`;
  byId("map-time-text").textContent = text;
  slider.setAttribute("aria-valuetext", text);
}

byId("map-time").addEventListener("input", () => {
  showTime();
  draw();
  // Outlines and goals that are not among those that were read.
  clearTimeout(overlay.timer);
  overlay.timer = setTimeout(() => untilAnswered(readOverlay), SLIDER_PAUSE_MS);
});
byId("map-outlines").addEventListener("change", drawOverlay);
document.addEventListener("map-drawn", () => { drawLegend(); drawOverlay(); });
document.addEventListener("map-read", (event) => {
  setSpan(event.detail);
  clearTimeout(overlay.timer);
  const pause = overlay.readFrame === map.frame ? PAUSE_MS : 0;
  overlay.timer = setTimeout(() => untilAnswered(readOverlay), pause);
  overlay.readFrame = map.frame;
});
