// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
// The operators' page: reads the public interface, again after every event that changes its content.
"use strict";

const PAGE = 24;
/** File formats that a card links to; the details list all. */
const CARD_FORMATS = 2;
const GOOD = new Set(["OK", "ACTIVE", "DONE", "SERVED", "active", "done", "served", "ready", "confirmed", "good"]);
const BAD = new Set(["FAILED", "ERROR", "failed", "error", "faulted", "FAULTED", "EXPIRED", "expired", "CANCELLED", "cancelled", "dead", "critical"]);
const IDLE = new Set(["INACTIVE", "inactive", "CONFIGURED", "configured", "UNCONFIGURED", "unconfigured", "idle", "IDLE"]);

const byId = (id) => document.getElementById(id);
let items = [];
let cursor = null;
let asked = { type: "" };
/** Mission time of the last status, nanoseconds as text. */
let missionNs = null;
/** Product types by name, as /api/v1/product_types lists them. */
let productTypes = new Map();

/** An element with text and attributes; text never becomes markup. */
function make(tag, attributes, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value !== null && value !== undefined) element.setAttribute(name, value);
  }
  for (const child of children) element.append(child);
  return element;
}

/** Off loopback a key is required: it is stored for this tab only and sent with every request. */
const key = () => sessionStorage.getItem("cdff-key");
const authorised = (more) => ({ ...more, ...(key() ? { Authorization: `Bearer ${key()}` } : {}) });

async function get(path, headers) {
  const response = await fetch(path, { headers: authorised(headers) });
  if (response.status === 401 && !byId("key").open) byId("key").showModal();
  return response;
}

/** A link to a file; the browser itself would not send the key. */
function fileLink(path, name, text) {
  const link = make("a", { href: path, download: name }, text);
  if (key()) {
    link.addEventListener("click", async (event) => {
      event.preventDefault();
      const url = URL.createObjectURL(await (await get(path)).blob());
      make("a", { href: url, download: name }).click();
      setTimeout(() => URL.revokeObjectURL(url), 60000);
    });
  }
  return link;
}

async function ask(path) {
  const response = await get(path, { Accept: "application/json" });
  const body = await response.json();
  if (!response.ok) throw new Error(body.detail || response.statusText);
  return body;
}

function badge(state) {
  const kind = GOOD.has(state) ? "ok" : BAD.has(state) ? "bad" : IDLE.has(state) ? "idle" : "warn";
  return make("span", { class: `badge ${kind}` }, String(state).toLowerCase());
}

/** Time of day where the date is of this era, else seconds: simulated missions may begin at 0. */
function time(ns) {
  if (ns === null || ns === undefined) return "–";
  const us = BigInt(ns) / 1000n;
  const ms = Number(us / 1000n);
  if (ms < 1e11) return `t = ${(ms / 1000).toFixed(2)} s`;
  return new Date(ms).toISOString().replace("T", " ").slice(0, 21) + " UTC";
}

/** Age of a capture at the mission time of the last status, in words. */
function age(ns) {
  if (ns === null || ns === undefined || missionNs === null) return "–";
  const seconds = Number((BigInt(missionNs) - BigInt(ns)) / 1000000n) / 1000;
  if (seconds < 0) return `${(-seconds).toFixed(1)} s ahead`;
  if (seconds < 120) return `${seconds.toFixed(seconds < 10 ? 1 : 0)} s old`;
  if (seconds < 7200) return `${(seconds / 60).toFixed(0)} min old`;
  return seconds < 172800 ? `${(seconds / 3600).toFixed(1)} h old` : `${(seconds / 86400).toFixed(1)} d old`;
}

const metres = (value) => (Math.abs(value) < 0.0005 ? 0 : value).toFixed(2);
function bytes(n) {
  if (n >= 1e9) return `${(n / 1e9).toFixed(2)} GB`;
  if (n >= 1e6) return `${(n / 1e6).toFixed(1)} MB`;
  return n >= 1e3 ? `${(n / 1e3).toFixed(0)} kB` : `${n} B`;
}
const words = (name) => name.replaceAll("_", " ");

async function showStatus() {
  const status = await ask("api/v1/status");
  missionNs = status.now_ns;
  const list = [["Products", status.products], ["Stored", bytes(status.payload_bytes)], ["Mission time", time(status.now_ns)],
    ["Newest data", age(status.newest_t1_ns)]];
  if (status.mission) list.unshift(["Mission", status.mission]);
  byId("summary").replaceChildren(...list.map(([name, value]) =>
    make("div", null, make("dt", null, name), make("dd", null, String(value)))));
  const types = new Set();
  for (const products of Object.values(status.by_robot)) Object.keys(products).forEach((type) => types.add(type));
  options("type", [...types].sort());
  // Poses come several times a second and would hide everything else; deliveries are copies.
  const maps = [...types].filter((type) => type !== "pose" && type !== "delivery").sort().join(",");
  const first = byId("filter").elements.type.options[0];
  if (first.value === asked.type && maps !== "") asked.type = maps;
  first.value = maps;
  options("robot", Object.keys(status.by_robot));
  showServices(status.health);
  showStreams(status.overview ? status.overview.streams : []);
}

function showServices(services) {
  byId("services-section").hidden = services.length === 0;
  byId("services").tBodies[0].replaceChildren(...services.map((service) => make("tr", null, ...[
    badge(service.health), words(service.service), service.scope, age(service.newest_t1_ns), service.text].map((cell) => make("td", null, cell)))));
}

/** A row of a sensor stream: rate against the stated one, stamp against mission time, gaps, frame, faults. */
function streamRow(stream) {
  const rate = `${stream.rate_hz ? stream.rate_hz.toFixed(1) : "–"} of ${stream.stated_hz ? `${+stream.stated_hz.toPrecision(3)} Hz` : "–"}`;
  const measured = stream.count !== undefined;
  const stamp = measured && stream.offset_s !== null ? `${stream.offset_s > 0 ? "+" : ""}${stream.offset_s.toFixed(3)} s` : "–";
  const faults = stream.faults.length ? make("span", { class: "badge warn" }, stream.faults.join("; ")) : measured ? badge("OK") : "no active DFPC reads it";
  const cells = [`${stream.robot}/${stream.sensor}.${stream.stream}`, stream.mode || "–", rate, stamp, measured ? String(stream.lost) : "–", stream.frame || "–", stream.last || "–", faults];
  return make("tr", null, ...cells.map((cell) => make("td", null, cell)));
}

function showStreams(streams) {
  byId("streams-section").hidden = streams.length === 0;
  byId("streams").tBodies[0].replaceChildren(...streams.map(streamRow));
}

function options(name, values, select = byId("filter").elements[name]) {
  for (const value of values) {
    if (![...select.options].some((option) => option.value === value)) {
      select.append(make("option", { value }, words(value)));
    }
  }
}

function robotCard(robot) {
  const card = make("article", { class: "robot" }, make("h3", null, robot.id));
  if (robot.pose) {
    const T = robot.pose.T;
    const yaw = (Math.atan2(T[1][0], T[0][0]) * 180) / Math.PI;
    const sigma = robot.pose.covariance ? ` ± ${metres(Math.sqrt(robot.pose.covariance[0][0] + robot.pose.covariance[1][1]))} m` : "";
    card.append(make("p", null,
      `x ${metres(T[0][3])}  y ${metres(T[1][3])}  z ${metres(T[2][3])} m${sigma}, heading ${yaw.toFixed(1)}° in ${robot.pose.parent}, ${time(robot.pose.stamp_ns)}, ${age(robot.pose.stamp_ns)}`));
  } else {
    card.append(make("p", { title: robot.pose_missing }, "No pose known yet."));
  }
  const rows = robot.dfpcs.map((dfpc) => {
    const counts = [];
    if (dfpc.outputs) counts.push(`${dfpc.outputs} out`);
    if (dfpc.dropped) counts.push(`${dfpc.dropped} dropped`);
    const what = make("span", { class: "what" }, counts.join(", "), " ", badge(dfpc.alive ? dfpc.state : "dead"));
    return make("li", { title: dfpc.last_error || null }, make("span", { class: "name" }, words(dfpc.name || "?")), what);
  });
  const none = robot.has_left ? "The robot has left; its products stay." : "No DFPC answers.";
  card.append(rows.length ? make("ul", { class: "dfpcs" }, ...rows) : make("p", { class: "empty" }, none));
  if (robot.profile_revision) card.append(make("p", { class: "empty" }, `Joined with profile revision ${robot.profile_revision}.`));
  return card;
}

async function showRobots() {
  const { items: robots } = await ask("api/v1/robots");
  byId("robots").replaceChildren(...(robots.length ? robots.map(robotCard) : [make("p", { class: "empty" }, "No robot known.")]));
}

function requestRow(job) {
  const request = job.request || {};
  const result = job.result || {};
  const last = result.id && result.stored !== false
    ? make("a", { href: `api/v1/products/${encodeURIComponent(result.id)}` }, result.kind || "product")
    : make("span", null, job.reason || (result.id ? `${result.kind || "product"}, not stored` : ""));
  const cells = [badge(job.state), words(request.type || "?"), request.robot || "", request.region || "–", time(job.accepted_ns), last];
  return make("tr", null, ...cells.map((cell) => make("td", null, cell)));
}

async function showRequests() {
  const body = byId("requests").tBodies[0];
  let rows;
  try {
    const { jobs } = await ask("api/v1/requests");
    rows = jobs.length ? jobs.map(requestRow) : [nothing("No request yet.")];
  } catch (error) {
    rows = [nothing(`The orchestrator does not answer: ${error.message}`)];
  }
  body.replaceChildren(...rows);
}

// Cells state the heading of their column, which the style shows on narrow screens.
for (const table of document.querySelectorAll("main table")) {
  const headings = [...table.tHead.rows[0].cells].map((cell) => cell.textContent), body = table.tBodies[0];
  new MutationObserver(() => {
    for (const row of body.rows)
      for (const cell of row.cells) if (cell.colSpan === 1) cell.dataset.label = headings[cell.cellIndex];
  }).observe(body, { childList: true });
}
const nothing = (text) => make("tr", null, make("td", { colspan: 6, class: "empty" }, text));

function picture(product) {
  const box = make("div", { class: "picture" });
  if (productTypes.get(product.product)?.thumbnail && product.quality.status !== "FAILED") {
    const image = make("img", { alt: `${words(product.product)} seen from above`, loading: "lazy" });
    image.addEventListener("error", () => image.replaceWith(make("span", null, "no picture")));
    if (key()) get(product.links.thumbnail).then((answer) => answer.blob()).then((blob) => { image.src = URL.createObjectURL(blob); });
    else image.src = product.links.thumbnail;
    box.append(image);
  } else if (product.box_m) {
    const [x, y, z] = product.box_m;
    box.append(make("span", { class: "numbers" }, `x ${metres(x)}\ny ${metres(y)}\nz ${metres(z)} m`));
  } else {
    box.append(make("span", null, product.quality.status === "FAILED" ? "no value" : words(product.product)));
  }
  return box;
}

function productCard(product) {
  const frame = product.child ? `${product.child} in ${product.frame}` : product.frame;
  const detail = [bytes(product.size)];
  if (product.resolution_m) detail.unshift(`${product.resolution_m * 100 < 100 ? +(product.resolution_m * 100).toFixed(1) + " cm" : product.resolution_m + " m"} cells`);
  const metrics = product.quality.metrics || {};
  if (metrics.coverage !== undefined) detail.push(`${(metrics.coverage * 100).toFixed(0)} % covered`);
  const details = make("a", { href: product.links.self, class: "details" }, "details");
  details.addEventListener("click", (event) => { event.preventDefault(); showDetail(product.id); });
  const links = make("p", { class: "links" }, details);
  if (product.quality.status !== "FAILED") {
    for (const format of (productTypes.get(product.product)?.file_formats || []).slice(0, CARD_FORMATS)) {
      links.append(fileLink(`${product.links.payload}?format=${format}`, `${product.id}.${format}`, format));
    }
  }
  const reasons = product.quality.reasons || [];
  return make("li", { class: "card" }, picture(product),
    make("div", { class: "text" },
      make("h3", null, words(product.product), badge(product.quality.status)),
      make("p", null, `${product.robot}, ${words(product.dfpc)}`),
      make("p", null, frame), make("p", null, time(product.t1_ns)), make("p", null, detail.join(", ")),
      ...(reasons.length ? [make("p", { class: "warn" }, reasons.join(", "))] : []), links));
}

const facts = (pairs) => make("dl", { class: "facts" }, ...pairs.filter(([, value]) => value !== null && value !== undefined && value !== "")
  .flatMap(([name, value]) => [make("dt", null, name), make("dd", null, value)]));

/** Inputs or results of a product, with links to those that are stored. */
function generations(title, provenance) {
  const rows = provenance.items.map((item) => {
    if (!item.known) return make("li", null, `${item.id} (not stored here)`);
    const link = make("a", { href: `api/v1/products/${item.id}` }, `${words(item.product)} of ${item.robot}, ${words(item.dfpc)}`);
    link.addEventListener("click", (event) => { event.preventDefault(); showDetail(item.id); });
    return make("li", null, link, ` ${time(item.t1_ns)}${item.deleted_ns ? ", deleted" : ""}${item.generation > 1 ? `, generation ${item.generation}` : ""}`);
  });
  return make("div", null, make("h4", null, title), rows.length ? make("ul", null, ...rows) : make("p", { class: "empty" }, "nothing"));
}

async function showDetail(id) {
  const base = `api/v1/products/${encodeURIComponent(id)}`;
  const body = byId("detail-body");
  body.replaceChildren(make("p", { class: "empty" }, "Loading …"));
  if (!byId("detail").open) byId("detail").showModal();
  try {
    const [product, up, down, revisions] = await Promise.all([ask(base), ask(`${base}/provenance?direction=up`),
      ask(`${base}/provenance?direction=down`), ask(`${base}/revisions`)]);
    const note = product.annotation;
    const metrics = Object.entries(product.quality.metrics || {}).map(([name, value]) => `${words(name)} ${value === null ? "–" : +value.toPrecision(4)}`);
    const files = make("p", { class: "links" }, ...product.formats.map((format) =>
      fileLink(`${product.links.payload}?format=${format}`, `${product.id}.${format}`, format)));
    body.replaceChildren(
      make("h3", { id: "detail-title" }, words(product.product), " ", badge(product.quality.status)), picture(product),
      facts([["Robot", product.robot], ["Produced by", `${product.dfpc}/${product.port}, ${product.producer}`],
        ["Configuration", product.config_hash], ["Frame", product.child ? `${product.child} in ${product.frame}` : product.frame],
        ["Captured", `${time(product.t0_ns)} to ${time(product.t1_ns)}`], ["Stored", time(product.inserted_ns)],
        ["Box", product.box_m ? `${product.box_m.map(metres).join(", ")} m` : null],
        ["Cells", product.resolution_m ? `${product.resolution_m} m` : null], ["Size", bytes(product.size)],
        ["Reasons", (product.quality.reasons || []).join(", ")], ["Quality", metrics.join(", ")],
        ["Tags", note.tags.join(", ")], ["Notes", note.notes], ["Pinned", note.pinned ? "yes: never deleted or retired" : null],
        ["Superseded by", note.superseded_by],
        ["Revisions", revisions.items.map((r) => `r${r.revision} by ${r.author}, ${time(r.stamp_ns)}`).join("; ")],
        ["Id", product.id], ["SHA-256", product.sha256]]),
      files, generations("Inputs", up), generations("Results", down));
  } catch (error) {
    body.replaceChildren(make("p", { class: "error" }, error.message));
  }
}

function position(T) {
  const yaw = (Math.atan2(T[1][0], T[0][0]) * 180) / Math.PI;
  return `${metres(T[0][3])}, ${metres(T[1][3])}, ${metres(T[2][3])} m, ${yaw.toFixed(1)}°`;
}

function alarmRow(alarm) {
  const known = alarm.acknowledged_by ? `${alarm.acknowledged_by}, ${time(alarm.acknowledged_ns)}` : make("button", { type: "button" }, "Acknowledge");
  if (!alarm.acknowledged_by) known.addEventListener("click", () => acknowledge(alarm));
  const cells = [badge(alarm.severity), words(alarm.kind), alarm.source, time(alarm.since_ns), `${alarm.what}: ${alarm.remedy}`, known];
  return make("tr", null, ...cells.map((cell) => make("td", null, cell)));
}

async function acknowledge({ kind, source }) {
  const headers = authorised({ "Content-Type": "application/json" });
  const answer = await fetch("api/v1/alarms/acknowledge", { method: "POST", headers, body: JSON.stringify({ kind, source }) });
  byId("alarms-error").textContent = answer.ok ? "" : (await answer.json()).detail;
  await showAlarms();
}

async function showAlarms() {
  const { items: alarms } = await ask("api/v1/alarms");
  byId("alarms-section").hidden = alarms.length === 0;
  byId("alarms").tBodies[0].replaceChildren(...alarms.map(alarmRow));
}

function gatewayRow(topic) {
  const dropped = Object.entries(topic.dropped).map(([reason, count]) => `${count} ${words(reason)}`).join(", ") || "0";
  const least = topic.least_age_ms === null ? "" : `${topic.least_age_ms.toFixed(1)} ms`;
  const cells = [topic.robot, topic.gateway.replace("gateway_", ""), `${topic.direction} ${topic.topic}`, topic.received, topic.forwarded, dropped,
    `${topic.latency_ms.toFixed(1)} ms`, least, topic.last_fault];
  return make("tr", null, ...cells.map((cell) => make("td", null, cell)));
}

async function showGateways() {
  const { items: topics } = await ask("api/v1/gateways");
  byId("gateways-section").hidden = topics.length === 0;
  byId("gateways").tBodies[0].replaceChildren(...topics.map(gatewayRow));
}

async function showFrames() {
  const { items: fixed, tracks } = await ask("api/v1/frames");
  const rows = fixed.map((f) => [f.frame, f.parent, "fixed", `r${f.revision}`, position(f.T), time(f.inserted_ns)]);
  const moving = tracks.map((t) => [t.child, t.parent, `moving, ${t.source}`, "", `${t.count} poses`, `${time(t.t0_ns)} to ${time(t.t1_ns)}`]);
  const all = [...rows, ...moving].map((cells) => make("tr", null, ...cells.map((cell) => make("td", null, cell))));
  byId("frames").tBodies[0].replaceChildren(...(all.length ? all : [nothing("No frame known.")]));
  const names = [...new Set([...fixed.map((f) => f.frame), ...tracks.map((t) => t.parent)])].filter((f) => f !== "site").sort();
  options("frame", names);
  options("frame", names, byId("map-frame"));
  const { anchor } = await ask("api/v1/places/site");
  byId("place").textContent = anchor
    ? `The site lies on ${words(anchor.body)} at ${anchor.lon_deg.toFixed(5)}° east, ${anchor.lat_deg.toFixed(5)}° north, ${metres(anchor.height_m)} m.`
    : "The site is not anchored on a body: products have no longitude and latitude.";
}

async function showPlan() {
  byId("plan-sum").textContent = "Loading …";
  try {
    const plan = await ask("api/v1/retention");
    byId("plan-sum").textContent = plan.rules
      ? `${plan.retired} products with ${bytes(plan.bytes)} would be deleted, ${plan.kept} are kept for another reason.`
      : "The profile has no rule: everything is kept.";
    byId("plan-scroll").hidden = plan.verdicts.length === 0;
    byId("decisions").tBodies[0].replaceChildren(...plan.verdicts.map((v) => make("tr", null, ...[
      make("span", { class: `badge ${v.retire ? "warn" : "ok"}` }, v.retire ? "delete" : "keep"), words(v.product), v.robot,
      time(v.t1_ns), bytes(v.size), v.why].map((cell) => make("td", null, cell)))));
  } catch (error) {
    byId("plan-sum").textContent = error.message;
  }
}

async function showProducts(older) {
  const query = new URLSearchParams({ ...asked, limit: PAGE });
  if (query.get("type") === "") query.delete("type");
  if (older && cursor) query.set("cursor", cursor);
  const page = await ask(`api/v1/products?${query}`);
  const known = new Map([...byId("list").children].map((card) => [card.dataset.id, card]));
  items = older ? items.concat(page.items) : page.items;
  cursor = page.cursor;
  // An existing card stays: its picture is not fetched again and the focus is not lost.
  const cards = items.map((product) => {
    const card = known.get(product.id) || productCard(product);
    card.dataset.id = product.id;
    return card;
  });
  byId("list").replaceChildren(...(cards.length ? cards : [make("li", { class: "empty" }, "No product matches.")]));
  byId("more").hidden = cursor === null;
}

async function loadProductTypes() {
  const { items: types } = await ask("api/v1/product_types");
  productTypes = new Map(types.map((type) => [type.name, type]));
}

async function refresh() {
  if (productTypes.size === 0) await loadProductTypes().catch(() => {});
  await showStatus().catch(() => live("lost", "No answer, trying again …"));
  const others = [showAlarms(), showGateways(), showRobots(), showRequests(), showFrames()];
  if (items.length <= PAGE) others.push(showProducts(false));
  await Promise.allSettled(others);
}

let pending = null;
function soon() {
  if (pending === null) pending = setTimeout(() => { pending = null; refresh(); }, 1500);
}

function live(state, text) {
  byId("live").dataset.state = state;
  byId("live").textContent = text;
}

// What the page shows may have changed with these; poses come several times a second: the clock below is enough for them.
const NEWS = new Set(["inserted", "deleted", "activated", "deactivated", "reanchored", "updated", "sensor_mode", "alarm"]);

function heard(block) {
  const fields = Object.fromEntries(block.split("\n").map((line) => [line.slice(0, line.indexOf(": ")), line.slice(line.indexOf(": ") + 2)]));
  if (NEWS.has(fields.event) && !(fields.event === "inserted" && JSON.parse(fields.data).product === "pose")) {
    soon();
    document.dispatchEvent(new Event("news"));
  }
  return fields.id;
}

/** The stream of events; by fetch, because an EventSource cannot send a key. */
async function follow() {
  let last = null;
  for (;;) {
    try {
      const answer = await get("api/v1/events", { Accept: "text/event-stream", ...(last ? { "Last-Event-ID": last } : {}) });
      if (!answer.ok) throw new Error(answer.statusText);
      live("live", "Live");
      soon();
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      for (let rest = "", part = await reader.read(); !part.done; part = await reader.read()) {
        const blocks = (rest + part.value).split("\n\n");
        rest = blocks.pop();
        for (const block of blocks) last = heard(block) || last;
      }
    } catch (error) {
      console.debug(error);
    }
    live("lost", "Connection lost, trying again …");
    await new Promise((resolve) => setTimeout(resolve, 2000));
  }
}

byId("key").addEventListener("close", () => {
  sessionStorage.setItem("cdff-key", byId("key").querySelector("input").value.trim());
  location.reload();
});
byId("filter").addEventListener("submit", async (event) => {
  event.preventDefault();
  asked = Object.fromEntries([...new FormData(event.target)].filter(([name, value]) => value !== "" || name === "type"));
  byId("filter-error").textContent = "";
  try {
    await showProducts(false);
  } catch (error) {
    byId("filter-error").textContent = error.message;
  }
});
for (const name of ["type", "robot", "status"]) {
  byId("filter").elements[name].addEventListener("change", () => byId("filter").requestSubmit());
}
byId("more").addEventListener("click", () => showProducts(true));
byId("plan").addEventListener("click", showPlan);
refresh();
follow();
setInterval(soon, 5000);
