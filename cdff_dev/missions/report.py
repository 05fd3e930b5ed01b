# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The report of a mission or demonstration: one HTML page without external files."""

from __future__ import annotations

import base64
import html
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil  # type: ignore[import-untyped]

from cdff_common.bus import Bus
from cdff_common.errors import ProductNotFoundError
from cdff_common.formats.hillshade import hillshade_png
from cdff_common.geometry.se3 import FloatArray
from cdff_common.output import storage_errors
from cdff_common.types import ElevationMap
from cdff_dev.missions.autonomy import Arrival, RequestRecord
from cdff_dev.missions.requests import Outcome
from cdff_dev.missions.tracks import Track, elevation_window

_COLOURS = ("#1f77b4", "#d95f02", "#1b9e77", "#7570b3")
#: Number of covariance ellipses along a path, and their semi-axes in standard deviations.
_ELLIPSES, _SIGMAS = 12, 3.0
#: Largest number of cells along a side of the map; margin around the paths, metres.
_CELLS, _MARGIN_M = 400, 12.0
#: Width and height of an error plot, SVG units, and its largest number of points.
_WIDTH, _HEIGHT, _POINTS = 1000.0, 220.0, 600
PAGE_STYLE = (
    "body{font:15px sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "td,th{text-align:left;padding:.2em .8em .2em 0;vertical-align:top}"
    ".fail{color:#b00020}svg{width:100%;background:#eee}"
)


@dataclass(frozen=True, slots=True)
class Process:
    """Resources used by a service: CPU time so far, current memory."""

    name: str
    cpu_s: float
    memory_mb: float


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """Contents of a report page; sections without data are omitted."""

    title: str
    paragraphs: Sequence[str]
    faults: Sequence[str]
    tracks: Sequence[Track]
    ground: ElevationMap | None
    outcomes: Sequence[Outcome]
    processes: Sequence[Process]
    start_ns: int = 0
    arrivals: Sequence[Arrival] = ()
    guidance_requests: Sequence[RequestRecord] = ()


def resource_usage(supervisor_pid: int) -> list[Process]:
    """Return CPU time and memory of each service of a supervisor, in descending order of CPU time."""
    services = []
    for child in psutil.Process(supervisor_pid).children():
        try:
            line, times = child.cmdline(), child.cpu_times()
            memory_mb = child.memory_info().rss / 1e6
        except psutil.Error:  # the process has ended since it was listed
            continue
        name = line[line.index("--process" if "--process" in line else "-m") + 1]
        services.append(Process(name.removeprefix("services."), times.user + times.system, memory_mb))
    return sorted(services, key=lambda p: -p.cpu_s)


def elevation_around(bus: Bus, tracks: Sequence[Track]) -> ElevationMap | None:
    """Return the elevation map around all tracks from the maps of all robots in the DPM.

    Return None if nothing is mapped.
    """
    if not tracks:
        return None
    low, high = _extent(tracks)
    cell_m = max(0.1, 0.1 * np.ceil(float((high - low).max()) / _CELLS / 0.1))
    region = "bbox:" + ",".join(f"{v:.2f}" for v in (*low, *high))
    try:
        return elevation_window(bus, region, round(cell_m, 3))
    except ProductNotFoundError:
        return None


def write_report(path: Path, report: Report) -> None:
    """Write the page; raises StorageError if the file cannot be written."""
    with storage_errors(path):
        path.write_text("\n".join(_page(report)) + "\n", encoding="utf-8")


def _page(report: Report) -> Iterator[str]:
    """Yield the HTML of the report."""
    title = html.escape(report.title)
    yield f"<!doctype html><meta charset=utf-8><title>{title}</title><style>{PAGE_STYLE}</style>"
    yield f"<h1>{title}</h1>"
    yield from (f"<p>{html.escape(text)}</p>" for text in report.paragraphs)
    yield from (f"<p class=fail>{html.escape(fault)}</p>" for fault in report.faults)
    if report.tracks:
        yield "<h2>Map and paths</h2>"
        yield from _drawing(report.tracks, report.ground)
        ellipses = f"Ellipses: {_SIGMAS:g} stated standard deviations."
        yield f"<p>Thin lines: ground truth. {ellipses} Shading: elevation.</p>"
        for track in report.tracks:
            yield f"<p>{html.escape(str(track))}</p>"
            yield from _error_plot(track)
    if report.arrivals:
        yield from table_section("Tasks", ("robot", "task", "completed at"), _task_rows(report))
    if report.guidance_requests:
        guidance_columns = ("robot", "request", "number", "median duration", "longest", "last answer")
        rows = _guidance_rows(report.guidance_requests)
        yield from table_section("Requests of the guidance", guidance_columns, rows)
    if report.outcomes:
        columns = ("sent at", "request", "answer", "duration")
        failed = {row for row, outcome in enumerate(report.outcomes) if outcome.faults}
        yield from table_section("Requests and answers", columns, map(outcome_row, report.outcomes), failed)
    resources = ((p.name, f"{p.cpu_s:.1f} s", f"{p.memory_mb:.0f} MB") for p in report.processes)
    yield from table_section("Resources", ("process", "CPU", "memory"), resources)


def table_section(
    title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], failed: Collection[int] = ()
) -> Iterator[str]:
    """Yield a heading and a table; ``failed`` are the indices of rows that are marked as failed."""
    yield f"<h2>{title}</h2><table><tr>" + "".join(f"<th>{column}" for column in columns) + "</tr>"
    for i, row in enumerate(rows):
        mark = " class=fail" if i in failed else ""
        yield f"<tr{mark}>" + "".join(f"<td>{html.escape(cell)}" for cell in row) + "</tr>"
    yield "</table>"


def outcome_row(outcome: Outcome) -> Sequence[str]:
    """Return time, request, answer and duration of a request."""
    text = "; ".join(outcome.faults) or outcome.summary
    return f"{outcome.request.at_s:g} s", outcome.request.title, text, f"{outcome.duration_s:.1f} s"


def _task_rows(report: Report) -> Iterator[Sequence[str]]:
    for arrival in report.arrivals:
        goal = ""
        if arrival.goal_m is not None:  # + 0.0: no minus sign before zero
            goal = " ({:g}, {:g})".format(*(round(v, 1) + 0.0 for v in arrival.goal_m))
        time_s = 1e-9 * (arrival.t_ns - report.start_ns)
        yield arrival.robot, f"{arrival.task.do}{goal}", f"{time_s:.0f} s"


def _guidance_rows(requests: Sequence[RequestRecord]) -> Iterator[Sequence[str]]:
    """Yield a row for each robot and product, with the number of requests, durations and the last answer."""
    for robot, product in sorted({(r.robot, r.product) for r in requests}):
        group = [r for r in requests if (r.robot, r.product) == (robot, product)]
        duration_s = np.array([r.duration_s for r in group])
        durations = f"{np.median(duration_s):.2f} s", f"{duration_s.max():.2f} s"
        last_answer = f"{group[-1].answer} at {group[-1].at_s:.0f} s"
        yield robot, product, str(len(group)), *durations, last_answer


def _extent(tracks: Sequence[Track]) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest (x, y) of all tracks, metres, with a margin."""
    points = np.concatenate([track.positions_m[:, :2] for track in tracks])
    return points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M


def _drawing(tracks: Sequence[Track], ground: ElevationMap | None) -> Iterator[str]:
    """Yield an SVG of the tracks over the shaded terrain: y points up, one unit is a metre."""
    low, high = _extent(tracks)
    width, height = high - low
    yield f'<svg viewBox="{low[0]:.2f} {-high[1]:.2f} {width:.2f} {height:.2f}">'
    if ground is not None:
        geometry = ground.geometry
        shading_png = base64.b64encode(hillshade_png(ground)).decode()
        yield (
            f'<image x="{geometry.xmin_m:.2f}" y="{-geometry.ymax_m:.2f}" '
            f'width="{geometry.xmax_m - geometry.xmin_m:.2f}" '
            f'height="{geometry.ymax_m - geometry.ymin_m:.2f}" preserveAspectRatio="none" '
            f'href="data:image/png;base64,{shading_png}"/>'
        )
    for track, colour in zip(tracks, _COLOURS * len(tracks), strict=False):
        for points, stroke, size in (
            (track.truth.positions_m, "#222", 0.05),
            (track.positions_m, colour, 0.15),
        ):
            step = -(-len(points) // 1000) or 1
            yield polyline(points[::step, 0], -points[::step, 1], stroke, size * width / 40.0)
        for row in np.unique(np.linspace(0, len(track.stamps_ns) - 1, _ELLIPSES).astype(int)):
            values, vectors = np.linalg.eigh(track.covariances[row][:2, :2])
            rx, ry = _SIGMAS * np.sqrt(np.maximum(values[::-1], 0.0))
            x, y = track.positions_m[row, :2]
            angle = -np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
            yield (
                f'<ellipse rx="{rx:.3f}" ry="{ry:.3f}" fill="none" stroke="{colour}" '
                f'stroke-width="{width / 800:.3f}" '
                f'transform="translate({x:.3f} {-y:.3f}) rotate({angle:.1f})"/>'
            )
        x, y = track.positions_m[0, :2]
        place = f'x="{x:.2f}" y="{-y:.2f}" font-size="{width / 40:.2f}"'
        yield f'<text {place} fill="{colour}">{track.robot}</text>'
    yield "</svg>"


def _error_plot(track: Track) -> Iterator[str]:
    """Yield an SVG of the position error over time, with its three-sigma bound in the worst direction.

    Without ground truth nothing is yielded.
    """
    inside, error = track.errors_m()
    if not inside.any():
        return
    error_m = np.linalg.norm(error, axis=1)
    bound_m = 3.0 * np.sqrt(np.linalg.eigvalsh(track.covariances[inside])[:, -1].clip(min=0.0))
    scale_m = max(float(np.percentile(bound_m, 99)), float(error_m.max()), 1e-3)
    seconds = 1e-9 * (track.stamps_ns[inside] - track.stamps_ns[inside][0])
    yield f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT + 20:g}">'
    for values_m, colour in ((bound_m, "#999"), (error_m, "#d95f02")):
        step = -(-len(seconds) // _POINTS)
        x = _WIDTH * seconds[::step] / max(seconds[-1], 1e-9)
        yield polyline(x, _HEIGHT * (1.0 - np.minimum(values_m[::step] / scale_m, 1.0)), colour, 1.5)
    yield f'<text x="4" y="14" font-size="13">{scale_m:.3f} m</text>'
    yield f'<text x="{_WIDTH - 90:g}" y="{_HEIGHT + 15:g}" font-size="13">{seconds[-1]:.0f} s</text></svg>'
    yield "<p>Orange: position error. Grey: three stated standard deviations of the worst direction.</p>"


def polyline(x: FloatArray, y: FloatArray, colour: str, width: float) -> str:
    """Return an SVG line through points (n,), SVG units."""
    points = " ".join(f"{a:.2f},{b:.2f}" for a, b in zip(x, y, strict=True))
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width:.3f}"/>'
