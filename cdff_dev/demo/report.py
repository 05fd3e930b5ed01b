# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The page that a demonstration leaves: map, ways with covariance beside the truth, requests and answers, resources."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
from numpy.typing import NDArray

from cdff_common.bus import Bus, keys
from cdff_common.errors import FrameNotFoundError, ProductNotFoundError
from cdff_common.formats.geotiff import read_map
from cdff_common.formats.hillshade import hillshade_png
from cdff_common.interfaces.profile import Profile
from cdff_common.output import writing
from cdff_common.types import ElevationMap
from cdff_dev.demo.run import Outcome
from cdff_dev.demo.sharing import pose_series
from cdff_dev.logs import open_log

Float = NDArray[np.float64]

_CALL_S = 60.0
_COLOURS = ("#1f77b4", "#d95f02", "#1b9e77", "#7570b3")
#: Ellipses of covariance along a way, and how many standard deviations they show.
_ELLIPSES, _SIGMAS = 12, 3.0
#: Cells along a side of the map at most; ground shown beside the ways, metres.
_CELLS, _MARGIN_M = 400, 12.0


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Where a robot was found to be: times (n,), positions (n, 3), covariances (n, 3, 3) in the site; the truth."""

    robot: str
    stamps_ns: NDArray[np.int64]
    positions_m: Float
    covariances: Float
    true_m: Mapping[int, Float]

    def errors_m(self) -> Float:
        """Distance from the truth at each time that the log has truth of."""
        rows = [i for i, t in enumerate(self.stamps_ns.tolist()) if t in self.true_m]
        true = np.array([self.true_m[int(self.stamps_ns[i])] for i in rows]).reshape(-1, 3)
        return np.asarray(np.linalg.norm(self.positions_m[rows] - true, axis=1))

    def line(self) -> str:
        """In words."""
        way_m = float(np.linalg.norm(np.diff(self.positions_m, axis=0), axis=1).sum())
        said = f"{self.robot}: {len(self.stamps_ns)} poses, {way_m:.1f} m"
        errors = self.errors_m()
        if not len(errors):
            return f"{said}; the log has no truth"
        rms_m, last_m = float(np.sqrt(np.mean(errors**2))), float(errors[-1])
        return f"{said}; off the truth: RMS {rms_m:.3f} m, last {last_m:.3f} m, largest {errors.max():.3f} m"


@dataclass(frozen=True, slots=True)
class Process:
    """What a service has used: CPU seconds, memory now."""

    name: str
    cpu_s: float
    memory_mb: float


def processes_under(pid: int) -> list[Process]:
    """The services that a supervisor runs, the busiest first."""
    found = []
    for child in psutil.Process(pid).children():
        try:
            line, times = child.cmdline(), child.cpu_times()
            memory_mb = child.memory_info().rss / 1e6
        except psutil.Error:  # it ends at this moment
            continue
        name = line[line.index("--process") + 1] if "--process" in line else line[line.index("-m") + 1]
        found.append(Process(name.removeprefix("services."), times.user + times.system, memory_mb))
    return sorted(found, key=lambda p: -p.cpu_s)


def ways(profile: Profile, log: Path, http: str) -> list[Way]:
    """The way of each robot as the DPM holds it now, in the site; robots without poses are left out."""
    reader = open_log(log)
    found = []
    for robot in profile.robot_ids:
        name = f"/{robot}/truth.pose"
        samples = reader.samples([name]) if name in reader.streams else ()
        true = {s.stamp_ns: np.asarray(s.value.transform.matrix) for s in samples}
        items = pose_series(http, robot, f"{robot}/base")
        if not items:  # its pose is that of the lidar
            try:
                T = profile.robot(robot).frame_graph().lookup(f"{robot}/base", f"{robot}/lidar", 0).matrix
            except FrameNotFoundError:
                continue
            true = {t: T_site_base @ T for t, T_site_base in true.items()}
            items = pose_series(http, robot, f"{robot}/lidar")
        if items:
            poses = np.array([item["T"] for item in items])
            none = np.zeros((6, 6)).tolist()
            covariances = np.array([item["covariance"] or none for item in items])
            stamps = np.array([int(item["stamp_ns"]) for item in items])
            true_m = {t: T[:3, 3] for t, T in true.items()}
            found.append(Way(robot, stamps, poses[:, :3, 3], covariances[:, :3, :3], true_m))
    reader.close()
    return found


def elevation_around(bus: Bus, found: Sequence[Way]) -> ElevationMap | None:
    """The ground around all ways, pooled from the patches of all robots; None where none was mapped."""
    points = np.concatenate([way.positions_m[:, :2] for way in found]) if found else np.zeros((0, 2))
    if not len(points):
        return None
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    cell_m = max(0.1, 0.1 * np.ceil(float((high - low).max()) / _CELLS / 0.1))
    region = "bbox:" + ",".join(f"{v:.2f}" for v in (*low, *high))
    asked = {"type": "dem", "frame": "site", "region": region, "resolution_m": round(cell_m, 3), "format": "tif"}
    try:
        made = read_map(bus.call(keys.dpm_rpc(keys.GROUND, "get"), asked, timeout_s=_CALL_S).payload)
    except ProductNotFoundError:
        return None
    return made if isinstance(made, ElevationMap) else None


def write_report(
    path: Path, title: str, profile: Profile, outcomes: Sequence[Outcome], remarks: Sequence[str],
    found: Sequence[Way], ground: ElevationMap | None, processes: Sequence[Process],
) -> None:  # fmt: skip
    """Write the page; it needs nothing beside itself."""
    text = "\n".join(_page(title, profile, outcomes, remarks, found, ground, processes))
    with writing(path):
        path.write_text(text + "\n", encoding="utf-8")


def _page(
    title: str, profile: Profile, outcomes: Sequence[Outcome], remarks: Sequence[str],
    found: Sequence[Way], ground: ElevationMap | None, processes: Sequence[Process],
) -> Iterator[str]:  # fmt: skip
    answered = sum(not o.faults for o in outcomes)
    yield from head(title)
    yield f"<p>{html.escape(profile.doc)}</p>"
    yield f"<p>{answered} of {len(outcomes)} requests were answered as asked.</p>"
    yield from (f"<p>{html.escape(line)}</p>" for line in remarks)
    if found:
        yield "<h2>Map and ways</h2>"
        yield from drawing(found, ground)
        yield f"<p>Thin: truth. Ellipses: {_SIGMAS:g} standard deviations, as stated. Shades: the ground as mapped.</p>"
        yield from (f"<p>{html.escape(way.line())}</p>" for way in found)
    yield "<h2>Requests and answers</h2><table><tr><th>at<th>asked<th>answered<th>took</tr>"
    for o in outcomes:
        what = html.escape("; ".join(o.faults) or o.summary)
        mark = " class=fail" if o.faults else ""
        yield f"<tr{mark}><td>{o.ask.at_s:g} s<td>{html.escape(o.ask.title)}<td>{what}<td>{o.took_s:.1f} s</tr>"
    yield "</table>"
    yield from resources(processes)


def head(title: str) -> Iterator[str]:
    """The begin of a page that needs nothing beside itself."""
    yield f"<!doctype html><meta charset=utf-8><title>{html.escape(title)}</title>"
    yield "<style>body{font:15px sans-serif;max-width:60em;margin:2em auto;padding:0 1em}td,th{text-align:left;"
    yield "padding:.2em .8em .2em 0;vertical-align:top}.fail{color:#b00020}svg{width:100%;background:#eee}</style>"
    yield f"<h1>{html.escape(title)}</h1>"


def resources(processes: Sequence[Process]) -> Iterator[str]:
    """A table of what each process has used."""
    yield "<h2>Resources</h2><table><tr><th>process<th>CPU<th>memory</tr>"
    for p in processes:
        yield f"<tr><td>{html.escape(p.name)}<td>{p.cpu_s:.1f} s<td>{p.memory_mb:.0f} MB</tr>"
    yield "</table>"


def drawing(found: Sequence[Way], ground: ElevationMap | None) -> Iterator[str]:
    """The ways over the shaded ground; y is up, one unit a metre."""
    points = np.concatenate([way.positions_m[:, :2] for way in found])
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    width, height = high - low
    yield f'<svg viewBox="{low[0]:.2f} {-high[1]:.2f} {width:.2f} {height:.2f}">'
    if ground is not None:
        g = ground.geometry
        picture = base64.b64encode(hillshade_png(ground)).decode()
        yield (
            f'<image x="{g.xmin_m:.2f}" y="{-g.ymax_m:.2f}" width="{g.xmax_m - g.xmin_m:.2f}" '
            f'height="{g.ymax_m - g.ymin_m:.2f}" preserveAspectRatio="none" href="data:image/png;base64,{picture}"/>'
        )
    for way, colour in zip(found, _COLOURS * len(found), strict=False):
        if way.true_m:
            yield _polyline(np.array(list(way.true_m.values())), "#222", 0.05 * width / 40.0)
        yield _polyline(way.positions_m, colour, 0.15 * width / 40.0)
        for row in np.unique(np.linspace(0, len(way.stamps_ns) - 1, _ELLIPSES).astype(int)):
            values, vectors = np.linalg.eigh(way.covariances[row][:2, :2])
            rx, ry = _SIGMAS * np.sqrt(np.maximum(values[::-1], 0.0))
            x, y = way.positions_m[row, :2]
            angle = -np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
            yield (
                f'<ellipse rx="{rx:.3f}" ry="{ry:.3f}" fill="none" stroke="{colour}" stroke-width="{width / 800:.3f}" '
                f'transform="translate({x:.3f} {-y:.3f}) rotate({angle:.1f})"/>'
            )
        x, y = way.positions_m[0, :2]
        yield f'<text x="{x:.2f}" y="{-y:.2f}" font-size="{width / 40:.2f}" fill="{colour}">{way.robot}</text>'
    yield "</svg>"


def _polyline(points: Float, colour: str, width: float) -> str:
    step = -(-len(points) // 1000)
    text = " ".join(f"{x:.2f},{-y:.2f}" for x, y in points[::step, :2])
    return f'<polyline points="{text}" fill="none" stroke="{colour}" stroke-width="{width:.3f}"/>'
