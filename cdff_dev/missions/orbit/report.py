# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The report of a mission in orbit: one HTML page without external files."""

from __future__ import annotations

import html
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.geometry.se3 import FloatArray
from cdff_common.output import storage_errors
from cdff_dev.missions.orbit.mission_run import OrbitResult
from cdff_dev.missions.orbit.pictures import image_uri, model_views
from cdff_dev.missions.report import PAGE_STYLE, outcome_row, polyline, table_section

#: Width and height of a plot, SVG units, and its largest number of points.
_WIDTH, _HEIGHT, _POINTS = 1000.0, 200.0, 800
_COLOURS = ("#d95f02", "#777", "#1f77b4")


def write_report(path: Path, result: OrbitResult) -> None:
    """Write the page; raises StorageError if the file cannot be written."""
    with storage_errors(path):
        path.write_text("\n".join(_page(result)) + "\n", encoding="utf-8")


def _page(result: OrbitResult) -> Iterator[str]:
    """Yield the HTML of the report."""
    title = html.escape(f"Mission {result.name}")
    yield f"<!doctype html><meta charset=utf-8><title>{title}</title><style>{PAGE_STYLE}</style>"
    yield f"<h1>{title}</h1>"
    duration = f"{result.mission_s:.0f} s of mission time, run in {result.run_s:.0f} s. Simulated data."
    faults = result.faults
    success = [] if faults else ["All limits of the mission are met."]
    for text in (result.mission.doc, duration, *success, *result.lines()):
        yield f"<p>{html.escape(text)}</p>"
    yield from (f"<p class=fail>{html.escape(fault)}</p>" for fault in faults)
    yield from _pictures(result)
    yield from _plots(result)
    events = ((f"{event.at_s:g} s", event.text) for event in result.autonomy.events)
    yield from table_section("Motions and faults", ("time", "event"), events)
    outcomes = result.autonomy.outcomes
    failed = {row for row, outcome in enumerate(outcomes) if outcome.faults}
    columns = ("sent at", "request", "answer", "duration")
    yield from table_section("Requests and answers", columns, map(outcome_row, outcomes), failed)
    refusals = ((f"{at_s:g} s", title, reason) for at_s, title, reason in result.autonomy.refusals)
    yield from table_section("Refused requests", ("sent at", "request", "reason"), refusals)
    resources = ((p.name, f"{p.cpu_s:.1f} s", f"{p.memory_mb:.0f} MB") for p in result.processes)
    yield from table_section("Resources", ("process", "CPU", "memory"), resources)


def _pictures(result: OrbitResult) -> Iterator[str]:
    """Yield the stored images and views of the delivered model."""
    if result.images:
        yield "<h2>Images in the DPM</h2>"
    for at_s, image in result.images:
        yield f'<figure><img width=420 src="{image_uri(image)}">'
        yield f"<figcaption>{at_s:.0f} s, {html.escape(image.frame)}</figcaption></figure>"
    if result.model is not None:
        yield "<h2>Delivered model</h2><p>"
        yield from (f'<img width=310 src="{uri}">' for uri in model_views(result.model))
        yield "</p><p>Distance from the true surface: white 0, red at least 0.1 m.</p>"


def _plots(result: OrbitResult) -> Iterator[str]:
    """Yield plots of the distance, and of the errors of the poses with three stated standard deviations."""
    seconds, distances_m = result.distance
    yield from _plot("Distance to the client", "m", seconds, [distances_m])
    poses = result.poses
    if len(poses.stamps_ns) < 2:
        return
    start_ns = result.autonomy.start_ns
    t_s = (poses.stamps_ns - start_ns) / NS_PER_S
    title = f"{poses.dfpc}: error (orange), three stated standard deviations (grey)"
    yield from _plot(f"Position, {title}", "m", t_s, [poses.position_m, 3.0 * poses.sigma_m])
    yield from _plot(f"Rotation, {title}", "°", t_s, [poses.rotation_deg, 3.0 * poses.sigma_deg])


def _plot(title: str, unit: str, seconds: FloatArray, series: list[FloatArray]) -> Iterator[str]:
    """Yield an SVG of one or more series (n,) over time; values above the 98th percentile are cut off."""
    if len(seconds) < 2:
        return
    scale = max(float(np.percentile(np.concatenate(series), 98)), 1e-9)
    step = -(-len(seconds) // _POINTS)
    span_s = max(float(seconds[-1] - seconds[0]), 1e-9)
    yield f'<h3>{html.escape(title)}</h3><svg viewBox="0 0 {_WIDTH:g} {_HEIGHT + 20:g}">'
    for values, colour in zip(series, _COLOURS, strict=False):
        x = _WIDTH * (seconds[::step] - seconds[0]) / span_s
        yield polyline(x, _HEIGHT * (1.0 - np.minimum(values[::step] / scale, 1.0)), colour, 1.5)
    yield f'<text x="4" y="14" font-size="13">{scale:.3g} {unit}</text>'
    yield f'<text x="4" y="{_HEIGHT + 15:g}" font-size="13">{seconds[0]:.0f} s</text>'
    yield f'<text x="{_WIDTH - 90:g}" y="{_HEIGHT + 15:g}" font-size="13">{seconds[-1]:.0f} s</text></svg>'
