# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The page of a mission: score, map, ways with covariance beside the truth, errors, requests, answers, resources."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cdff_common.output import writing
from cdff_dev.demo.report import Way, drawing, head, resources
from cdff_dev.missions.autonomy import Asked
from cdff_dev.missions.run import Result

_WIDTH, _HEIGHT = 1000.0, 220.0
#: Most points of a curve.
_POINTS = 600


def write(path: Path, name: str, result: Result) -> None:
    """Write the page; it needs nothing beside itself."""
    text = "\n".join(_page(name, result))
    with writing(path):
        path.write_text(text + "\n", encoding="utf-8")


def _page(name: str, result: Result) -> Iterator[str]:
    faults = result.faults()
    yield from head(f"Mission {name}")
    yield f"<p>{html.escape(result.mission.doc)}</p><p>{html.escape(result.profile.doc)}</p>"
    yield f"<p>{result.mission_s:.0f} s of mission time, run in {result.took_s:.0f} s.</p><h2>Score</h2>"
    if faults:
        yield from (f"<p class=fail>{html.escape(fault)}</p>" for fault in faults)
    else:
        yield "<p><b>All that the mission demands holds.</b></p>"
    yield from (f"<p>{html.escape(line)}</p>" for line in (*result.score.lines(), *result.remarks))
    yield "<h2>Map and ways</h2>"
    yield from drawing(result.ways, result.ground)
    yield "<p>Thin: truth. Ellipses: 3 standard deviations, as stated. Shades: the ground as the DPM holds it.</p>"
    yield "<h2>Error of the position</h2>"
    for way in result.ways:
        yield from _errors(way)
    yield "<h2>Tasks</h2><table><tr><th>robot<th>task<th>done at</tr>"
    for a in result.arrivals:
        goal = "" if a.goal_m is None else " ({:g}, {:g})".format(*(round(v, 1) + 0.0 for v in a.goal_m))
        yield f"<tr><td>{html.escape(a.robot)}<td>{a.task.do}{goal}<td>{1e-9 * (a.t_ns - result.begin_ns):.0f} s</tr>"
    yield "</table><h2>Requests and answers</h2>"
    yield from _requests(result.asked)
    if result.outcomes:
        yield "<table><tr><th>at<th>asked<th>answered<th>took</tr>"
        for o in result.outcomes:
            mark = " class=fail" if o.faults else ""
            what = html.escape("; ".join(o.faults) or o.summary)
            yield f"<tr{mark}><td>{o.ask.at_s:g} s<td>{html.escape(o.ask.title)}<td>{what}<td>{o.took_s:.1f} s</tr>"
        yield "</table>"
    yield from resources(result.processes)


def _requests(asked: Sequence[Asked]) -> Iterator[str]:
    """What guidance asked for, by kind, and the last answer of each."""
    yield "<table><tr><th>robot<th>asked by guidance<th>times<th>median<th>slowest<th>last answer</tr>"
    for robot, what in sorted({(a.robot, a.what) for a in asked}):
        mine = [a for a in asked if (a.robot, a.what) == (robot, what)]
        took = np.array([a.took_s for a in mine])
        yield (
            f"<tr><td>{html.escape(robot)}<td>{html.escape(what)}<td>{len(mine)}<td>{np.median(took):.2f} s"
            f"<td>{took.max():.2f} s<td>{html.escape(mine[-1].answer)} at {mine[-1].at_s:.0f} s</tr>"
        )
    yield "</table>"


def _errors(way: Way) -> Iterator[str]:
    """Error over time, and what was stated: three sigmas of the worst direction."""
    known = np.array(list(way.true_m), dtype=np.int64)
    true = np.array(list(way.true_m.values()))
    inside = (way.stamps_ns >= known[0]) & (way.stamps_ns <= known[-1])
    t = way.stamps_ns[inside]
    at = np.stack([np.interp(t, known, true[:, axis]) for axis in range(3)], axis=1)
    error = np.linalg.norm(way.positions_m[inside] - at, axis=1)
    stated = 3.0 * np.sqrt(np.linalg.eigvalsh(way.covariances[inside])[:, -1].clip(min=0.0))
    top = max(float(np.percentile(stated, 99)), float(error.max()), 1e-3)
    seconds = 1e-9 * (t - t[0])
    yield f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT + 20:g}">'
    for values, colour in ((stated, "#999"), (error, "#d95f02")):
        step = -(-len(t) // _POINTS)
        x = _WIDTH * seconds[::step] / max(seconds[-1], 1e-9)
        y = _HEIGHT * (1.0 - np.minimum(values[::step] / top, 1.0))
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        yield f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>'
    yield f'<text x="4" y="14" font-size="13">{top:.3f} m</text>'
    yield f'<text x="{_WIDTH - 90:g}" y="{_HEIGHT + 15:g}" font-size="13">{seconds[-1]:.0f} s</text></svg>'
    said = "Orange: distance from the truth. Grey: three sigmas as stated, of the worst direction."
    yield f"<p>{html.escape(way.robot)}. {said}</p>"
