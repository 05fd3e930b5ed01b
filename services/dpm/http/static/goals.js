// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
// Goals on the map: the region that a request or a scheduled request names, in any frame that is connected to that of the map.
"use strict";

/** States in which nothing more is expected; such requests are drawn thinner and without a mark. */
const ENDED = new Set(["done", "failed", "cancelled", "missed"]);
/** Ended requests that are drawn, the newest ones. */
const MOST_ENDED = 20;

/** The transform T_map_frame of a frame at a mission time, or the newest one. */
async function transformOf(frame, mapFrame, timeMs) {
  if (frame === mapFrame) return [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]];
  const when = timeMs === null ? { newest: true } : { t: new Date(timeMs).toISOString() };
  const query = new URLSearchParams({ robot: frame.split("/")[0], frame: mapFrame, child: frame, ...when });
  const { items } = await ask(`api/v1/poses?${query}`);
  return items[0].T;
}

/** Corners of a region, its distance around them, and whether they enclose an area, in the frame of the region; null if unknown. */
function outlineOf(region) {
  const [kind, text = ""] = region.split(":");
  const parts = text.split(",");
  const numbers = parts.map(Number);
  const pairs = (list) => list.filter((_, i) => i % 2 === 0).map((x, i) => [x, list[2 * i + 1]]);
  const box = ([x0, y0, x1, y1]) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
  switch (kind) {
    case "bbox": return { corners: box(numbers), isArea: true };
    case "box": return { corners: box([numbers[0], numbers[1], numbers[3], numbers[4]]), isArea: true };
    case "polygon": return { corners: pairs(numbers), isArea: true };
    case "circle": return { corners: [numbers.slice(0, 2)], distance: numbers[2] };
    case "path": return { corners: pairs(numbers.slice(1)), distance: numbers[0] };
    case "near": return { corners: [[0, 0]], distance: numbers[1], frame: parts[0] };
    default: return null;
  }
}

/** Milliseconds of a mission time in nanoseconds, which may be unknown. */
const milliseconds = (ns) => (ns === null || ns === undefined ? null : Number(BigInt(ns) / 1000n) / 1000);

/** Whether a request had been made at a mission time; without a time, and if its time is unknown, it had. */
const isPresent = (job, timeMs) => timeMs === null || (milliseconds(job.opened_ns) ?? timeMs) <= timeMs;

/** State of a request at a mission time: "open" before its end. */
function stateAt(job, timeMs) {
  const endMs = milliseconds(job.ended_ns);
  return timeMs !== null && endMs !== null && endMs > timeMs ? "open" : job.state;
}

/** The goals of a mission time with their states at that time. */
const goalsAt = (goals, timeMs) => goals.filter(({ job }) => isPresent(job, timeMs))
  .map((goal) => ({ ...goal, state: stateAt(goal.job, timeMs) }));

/** Read the goals of requests whose region lies in a frame that is connected to the map's. */
async function readGoals(mapFrame, timeMs) {
  const answer = await ask("api/v1/requests").catch(() => ({}));
  const jobs = [...(answer.scheduled || []), ...(answer.jobs || [])].filter((job) => job.request?.region);
  const present = jobs.filter((job) => isPresent(job, timeMs));
  const ended = present.filter((job) => ENDED.has(stateAt(job, timeMs))).slice(0, MOST_ENDED);
  const goals = await Promise.all(present.filter((job) => !ENDED.has(stateAt(job, timeMs)) || ended.includes(job)).map(async (job) => {
    const outline = outlineOf(job.request.region);
    if (!outline) return null;
    const frame = outline.frame || job.request.region_frame || job.request.frame || "site";
    const T = await transformOf(frame, mapFrame, timeMs).catch(() => null);
    if (!T) return null;
    const corners = outline.corners.map(([x, y]) => [0, 1].map((row) => T[row][0] * x + T[row][1] * y + T[row][3]));
    return { ...outline, corners, job, text: `${words(job.request.type || "?")} of ${job.request.robot || "any"}` };
  }));
  return goals.filter((goal) => goal !== null);
}

/** The region of a request; one that is not ended also has a mark and a label in its middle. */
function drawGoal(into, { corners, distance, isArea, state, text }) {
  const isOpen = !ENDED.has(state);
  const group = shape("g", { class: `goal ${isOpen ? "open" : "ended"}`, "data-state": state }, shape("title", {}, `${text}, ${state}`));
  if (corners.length === 1) {
    const [cx, cy] = pixel(corners[0]);
    group.append(shape("circle", { class: "request-region", cx, cy, r: distance / cell() }));
  } else if (isArea) {
    group.append(shape("polygon", { class: "request-region", points: line(corners) }));
  } else {
    group.append(shape("polyline", { class: "request-corridor", points: line(corners), "stroke-width": Math.max(2 * distance / cell(), 1) }));
    group.append(shape("polyline", { class: "request-region", points: line(corners) }));
  }
  if (isOpen) {
    const middle = isArea ? [0, 1].map((i) => corners.reduce((sum, corner) => sum + corner[i], 0) / corners.length) : corners[corners.length - 1];
    const [x, y] = pixel(middle);
    group.append(shape("path", { class: "goal-mark", d: "M-7 0 H7 M0 -7 V7", transform: `translate(${x} ${y})` }));
    group.append(shape("text", { x: x + 10, y: y + 4 }, `${text}, ${state}`));
  }
  into.append(group);
}
