// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
// The map of the operators' page: tiles of a frame's grid, as /tiles describes them, moved and zoomed without a library.
"use strict";

const TILE_PX = 256;
const map = { layers: [], frame: "site", x: 0, y: 0, z: 18, placed: false, tiles: new Map() };
const view = () => byId("map");
const layer = () => map.layers.find((known) => known.name === byId("map-layer").value) || map.layers[0];
const cell = () => layer().cell_m[map.z];

/** Put the middle of the map at x, y, metres, at a level of the grid. */
function look(x, y, z) {
  Object.assign(map, { x, y, z: Math.min(Math.max(z, layer().minzoom), layer().maxzoom), placed: true });
  draw();
}

/** Level and middle at which everything that the layer's product holds in the frame is seen. */
async function fit() {
  const { items } = await ask("/api/v1/maps");
  const held = items.find((known) => known.layer === layer().name)?.frames.find((f) => f.frame === map.frame && f.box_m);
  if (!held) {
    byId("map-note").textContent = `Nothing of this layer lies in ${map.frame}.`;
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
  const side = cell() * TILE_PX;
  const left = map.x - (view().clientWidth / 2) * cell();
  const top = map.y + (view().clientHeight / 2) * cell();
  const last = 2 ** map.z - 1;
  const seen = new Set();
  for (let row = Math.floor((half - top) / side); row * side - half < -top + view().clientHeight * cell(); row += 1) {
    for (let column = Math.floor((left + half) / side); column * side - half < left + view().clientWidth * cell(); column += 1) {
      if (row < 0 || column < 0 || row > last || column > last) continue;
      const address = layer().tiles[0].replace("{z}", map.z).replace("{x}", column).replace("{y}", row);
      const path = address.slice(address.indexOf("/tiles/"));
      seen.add(path);
      const image = map.tiles.get(path) || added(path);
      image.style.left = `${Math.round((column * side - half - left) / cell())}px`;
      image.style.top = `${Math.round((top - half + row * side) / cell())}px`;
    }
  }
  for (const [path, image] of map.tiles) {
    if (!seen.has(path)) {
      image.remove();
      URL.revokeObjectURL(image.src);
      map.tiles.delete(path);
    }
  }
  byId("map-scale").textContent = `1 pixel is ${cell() < 1 ? `${+(cell() * 100).toPrecision(3)} cm` : `${cell()} m`}`;
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

async function showLayers() {
  const { items } = await ask(`/tiles?frame=${encodeURIComponent(map.frame)}`);
  map.layers = items;
  if (!byId("map-layer").options.length) {
    byId("map-layer").replaceChildren(...items.map((known) => make("option", { value: known.name }, known.title)));
  }
  for (const image of map.tiles.values()) image.remove();
  map.tiles.clear();
  if (map.placed) draw();
  else await fit();
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
    const found = await ask(`/api/v1/maps/dem/profile?path=${path}&step_m=0.01&frame=${encodeURIComponent(map.frame)}`);
    const [mean] = found.mean_m;
    const [sigma] = found.sigma_m;
    byId("map-note").textContent = mean === null ? `Nothing was measured at x ${metres(x)}, y ${metres(y)} m.`
      : `x ${metres(x)}, y ${metres(y)}: height ${metres(mean)} m${sigma === null ? "" : ` ± ${metres(sigma)} m`}, ${found.count[0]} measurements`;
  } catch (error) {
    byId("map-note").textContent = error.message;
  }
}

let held = null;
view().addEventListener("pointerdown", (event) => {
  held = { x: event.clientX, y: event.clientY, moved: false };
  view().setPointerCapture(event.pointerId);
});
view().addEventListener("pointermove", (event) => {
  if (!layer()) return;
  if (held) {
    const [dx, dy] = [event.clientX - held.x, event.clientY - held.y];
    if (!held.moved && Math.hypot(dx, dy) < 4) return;
    held = { x: event.clientX, y: event.clientY, moved: true };
    look(map.x - dx * cell(), map.y + dy * cell(), map.z);
  }
  const [x, y] = at(event);
  byId("map-at").textContent = `x ${metres(x)}  y ${metres(y)} m`;
});
view().addEventListener("pointerup", (event) => {
  if (held && !held.moved && layer()) identify(...at(event));
  held = null;
});
view().addEventListener("wheel", (event) => {
  event.preventDefault();
  const [x, y] = at(event);
  const factor = event.deltaY < 0 ? 0.5 : 2;
  const z = map.z + (event.deltaY < 0 ? 1 : -1);
  if (z >= layer().minzoom && z <= layer().maxzoom) look(x + (map.x - x) * factor, y + (map.y - y) * factor, z);
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
byId("map-layer").addEventListener("change", () => { byId("map-note").textContent = ""; draw(); });
byId("map-frame").addEventListener("change", (event) => {
  map.frame = event.target.value;
  map.placed = false;
  untilAnswered(showLayers);
});
document.addEventListener("news", () => {
  if (!map.placed) untilAnswered(fit);
  else for (const [path, image] of map.tiles) load(path, image);
});
window.addEventListener("resize", draw);
untilAnswered(showLayers);
