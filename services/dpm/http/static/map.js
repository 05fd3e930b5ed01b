// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
// The map of the operators' page: tiles of a frame's grid, as /tiles describes them, moved and zoomed without a library.
"use strict";

const TILE_PX = 256;
/** Levels beyond the last one of the grid, in which its tiles are enlarged. */
const ENLARGED_LEVELS = 3;
const map = { layers: [], frame: "site", chosen: false, x: 0, y: 0, z: 18, finest: {}, placed: false, tiles: new Map(), timeMs: null };
const view = () => byId("map");
const layer = () => map.layers.find((known) => known.name === byId("map-layer").value) || map.layers[0];
const sizeOf = (z) => layer().cell_m[0] / 2 ** z;
const cell = () => sizeOf(map.z);
/** Level of the tiles that are shown: the finest with data if the map is closer. */
const tileLevel = () => Math.min(map.z, layer().maxzoom, map.finest[layer().product] ?? layer().maxzoom);

/** Put the middle of the map at x, y, metres, at a level of the grid or beyond. */
function look(x, y, z) {
  Object.assign(map, { x, y, z: Math.min(Math.max(z, layer().minzoom), layer().maxzoom + ENLARGED_LEVELS), placed: true });
  draw();
}

/** Read where the layer's product has data in the frame; a frame that was not chosen is replaced by one with data. */
async function extent() {
  const { items } = await ask("api/v1/maps");
  const frames = items.find((known) => known.layer === layer().name)?.frames.filter((f) => f.box_m) || [];
  options("frame", frames.map((f) => f.frame), byId("map-frame"));
  let held = frames.find((f) => f.frame === map.frame);
  if (!held && !map.chosen && frames.length) {
    [held] = frames;
    byId("map-frame").value = held.frame;
    await showLayers(held.frame);
  }
  const finest = held?.resolution_m ? layer().cell_m.findLastIndex((size) => size >= held.resolution_m * 0.999) : -1;
  map.finest[layer().product] = finest < 0 ? undefined : finest;
  document.dispatchEvent(new CustomEvent("map-read", { detail: held }));
  return [held, frames];
}

/** Level and middle at which everything that the layer's product holds in the frame is seen. */
async function fit() {
  const [held, frames] = await extent();
  if (!held) {
    const others = frames.length ? ` It has data in ${frames.map((f) => f.frame).join(", ")}.` : "";
    byId("map-note").textContent = `Nothing of this layer lies in ${map.frame}.${others}`;
    draw();
    return;
  }
  byId("map-note").textContent = "";
  const [x0, y0, , x1, y1] = held.box_m;
  const cellsWanted = Math.max((x1 - x0) / view().clientWidth, (y1 - y0) / view().clientHeight, held.resolution_m || 0.05);
  const z = layer().cell_m.findLastIndex((size) => size >= cellsWanted);
  look((x0 + x1) / 2, (y0 + y1) / 2, z < 0 ? 0 : z);
}

/** Place the visible tiles, fetch new ones and remove the others. */
function draw() {
  if (!layer()) return;
  const half = layer().bounds[2];
  const z = tileLevel();
  const sidePx = TILE_PX * 2 ** (map.z - z);
  // Edges of tiles are rounded from the same first tile, so that neighbours share their edge.
  const left = (map.x + half) / cell() - view().clientWidth / 2;
  const top = (half - map.y) / cell() - view().clientHeight / 2;
  const [firstColumn, firstRow] = [Math.floor(left / sidePx), Math.floor(top / sidePx)];
  const [x0, y0] = [Math.round(firstColumn * sidePx - left), Math.round(firstRow * sidePx - top)];
  const last = 2 ** z - 1;
  const seen = new Set();
  for (let row = firstRow; y0 + (row - firstRow) * sidePx < view().clientHeight; row += 1) {
    for (let column = firstColumn; x0 + (column - firstColumn) * sidePx < view().clientWidth; column += 1) {
      if (row < 0 || column < 0 || row > last || column > last) continue;
      const address = layer().tiles[0].replace("{z}", z).replace("{x}", column).replace("{y}", row);
      const time = map.timeMs === null ? "" : `&time=${new Date(map.timeMs).toISOString()}`;
      const path = address.slice(address.indexOf("/tiles/") + 1) + time;
      seen.add(path);
      const image = map.tiles.get(path) || added(path);
      image.style.left = `${x0 + (column - firstColumn) * sidePx}px`;
      image.style.top = `${y0 + (row - firstRow) * sidePx}px`;
      image.style.width = image.style.height = `${sidePx}px`;
    }
  }
  for (const [path, image] of map.tiles) {
    if (!seen.has(path)) {
      image.remove();
      URL.revokeObjectURL(image.src);
      map.tiles.delete(path);
    }
  }
  const enlarged = z < map.z ? `, data of ${+(sizeOf(z) * 100).toPrecision(3)} cm enlarged` : "";
  document.dispatchEvent(new Event("map-drawn"));
  byId("map-scale").textContent = `1 pixel is ${cell() < 1 ? `${+(cell() * 100).toPrecision(3)} cm` : `${cell()} m`}${enlarged}`;
}

function added(path) {
  const image = make("img", { alt: "", draggable: "false" });
  map.tiles.set(path, image);
  view().append(image);
  load(path, image);
  return image;
}

/** Fetch a tile with the key, which the address of an image cannot carry. Unchanged tiles are not drawn again. */
async function load(path, image) {
  const answer = await get(path);
  const tag = answer.headers.get("ETag");
  if (!answer.ok || tag === image.dataset.tag) return;
  const before = image.src;
  image.src = URL.createObjectURL(await answer.blob());
  image.dataset.tag = tag;
  if (before) URL.revokeObjectURL(before);
}

/** Show the tiles of a frame. */
async function showLayers(frame) {
  const { items } = await ask(`tiles?frame=${encodeURIComponent(frame)}`);
  Object.assign(map, { frame, layers: items, finest: {} });
  if (!byId("map-layer").options.length) {
    byId("map-layer").replaceChildren(...items.map((known) => make("option", { value: known.name }, known.title)));
  }
  for (const image of map.tiles.values()) image.remove();
  map.tiles.clear();
}

/** Show a frame from above with all its data. */
async function showFrame(frame) {
  await showLayers(frame);
  await fit();
}

/** Run a part of the drawing; if the DPM does not answer, again after two seconds. */
async function untilAnswered(part) {
  try {
    await part();
  } catch (error) {
    setTimeout(() => untilAnswered(part), 2000);
  }
}

function at(event) {
  const box = view().getBoundingClientRect();
  return [map.x + (event.clientX - box.left - box.width / 2) * cell(), map.y - (event.clientY - box.top - box.height / 2) * cell()];
}

/** Height under a click, as the profile of a line of one cell has it. */
async function identify(x, y) {
  try {
    const path = [x, y, x + 0.001, y].map((v) => v.toFixed(4)).join(",");
    const found = await ask(`api/v1/maps/dem/profile?path=${path}&step_m=0.01&frame=${encodeURIComponent(map.frame)}${map.timeMs === null ? "" : `&t1=${new Date(map.timeMs).toISOString()}`}`);
    const [mean] = found.mean_m;
    const [sigma] = found.sigma_m;
    byId("map-note").textContent = mean === null ? `Nothing was measured at x ${metres(x)}, y ${metres(y)} m.`
      : `x ${metres(x)}, y ${metres(y)}: height ${metres(mean)} m${sigma === null ? "" : ` ± ${metres(sigma)} m`}, ${found.count[0]} measurements`;
  } catch (error) {
    byId("map-note").textContent = error.message;
  }
}

/** Pointers that touch the map, by id; two of them zoom. */
const touches = new Map();
let pinch = null;
let moved = false;

/** Distance of the two pointers, and the point between them. */
function between() {
  const [a, b] = [...touches.values()];
  return { px: Math.hypot(a.x - b.x, a.y - b.y), clientX: (a.x + b.x) / 2, clientY: (a.y + b.y) / 2 };
}

/** Zoom by whole levels so that a point of the screen keeps its place. */
function zoomAt(event, levels) {
  const z = Math.min(Math.max(map.z + levels, layer().minzoom), layer().maxzoom + ENLARGED_LEVELS);
  const [x, y] = at(event);
  const factor = 2 ** (map.z - z);
  if (z !== map.z) look(x + (map.x - x) * factor, y + (map.y - y) * factor, z);
}

view().addEventListener("pointerdown", (event) => {
  moved = touches.size > 0;
  touches.set(event.pointerId, { x: event.clientX, y: event.clientY });
  if (event.isTrusted) view().setPointerCapture(event.pointerId);
  pinch = touches.size === 2 ? between() : null;
});
view().addEventListener("pointermove", (event) => {
  if (!layer()) return;
  const touch = touches.get(event.pointerId);
  if (touch) {
    const [dx, dy] = [event.clientX - touch.x, event.clientY - touch.y];
    if (touches.size === 1 && !moved && Math.hypot(dx, dy) < 4) return;
    moved = true;
    touches.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (touches.size === 1) look(map.x - dx * cell(), map.y + dy * cell(), map.z);
    else if (pinch) {
      const now = between();
      look(map.x - (now.clientX - pinch.clientX) * cell(), map.y + (now.clientY - pinch.clientY) * cell(), map.z);
      const levels = Math.trunc(Math.log2(Math.max(now.px, 1) / Math.max(pinch.px, 1)) * 1.5);
      zoomAt(now, levels);
      pinch = { ...now, px: levels ? now.px : pinch.px };
    }
  }
  const [x, y] = at(event);
  byId("map-at").textContent = `x ${metres(x)}  y ${metres(y)} m`;
});
function released(event) {
  const touched = touches.delete(event.pointerId);
  pinch = null;
  if (touched && event.type === "pointerup" && !moved && !touches.size && layer()) identify(...at(event));
}
view().addEventListener("pointerup", released);
view().addEventListener("pointercancel", released);
view().addEventListener("wheel", (event) => {
  event.preventDefault();
  if (layer()) zoomAt(event, event.deltaY < 0 ? 1 : -1);
}, { passive: false });
view().addEventListener("keydown", (event) => {
  const step = 64 * cell();
  const moves = { ArrowLeft: [-step, 0, 0], ArrowRight: [step, 0, 0], ArrowUp: [0, step, 0], ArrowDown: [0, -step, 0], "+": [0, 0, 1], "-": [0, 0, -1] };
  const move = moves[event.key];
  if (!move) return;
  event.preventDefault();
  look(map.x + move[0], map.y + move[1], map.z + move[2]);
});
byId("map-in").addEventListener("click", () => look(map.x, map.y, map.z + 1));
byId("map-out").addEventListener("click", () => look(map.x, map.y, map.z - 1));
byId("map-fit").addEventListener("click", fit);
byId("map-layer").addEventListener("change", () => {
  byId("map-note").textContent = "";
  untilAnswered(async () => { await extent(); draw(); });
});
byId("map-frame").addEventListener("change", (event) => {
  map.placed = false;
  map.chosen = true;
  untilAnswered(() => showFrame(event.target.value));
});
document.addEventListener("news", () => {
  if (!map.placed) untilAnswered(fit);
  else untilAnswered(async () => { await extent(); draw(); for (const [path, image] of map.tiles) load(path, image); });
});
window.addEventListener("resize", draw);
untilAnswered(() => showFrame(map.frame));
