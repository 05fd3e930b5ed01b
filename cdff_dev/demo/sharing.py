# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Judges a map that two robots share: where one is as seen from the other, and the elevation of both, against truth."""

from __future__ import annotations

import json
import time
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from numpy.typing import NDArray

from cdff_common.bus import Bus, keys
from cdff_common.errors import CdffError, InputError, UnavailableError
from cdff_common.formats.geotiff import read_map
from cdff_common.geometry import se3
from cdff_common.interfaces.profile import Profile
from cdff_common.types import ElevationMap
from cdff_dev.demo.script import Sharing
from cdff_dev.logs import open_log

Float = NDArray[np.float64]
Poses = Mapping[int, Float]

_CALL_S = 60.0
#: Most poses that the DPM gives at once.
_PAGE = 10_000


@dataclass(frozen=True, slots=True)
class Seen:
    """Errors of the places of one robot as seen from those of the other: how many, root mean square and largest."""

    pairs: int
    rms_m: float
    largest_m: float

    def __str__(self) -> str:
        return f"RMS {self.rms_m:.3f} m, largest {self.largest_m:.3f} m over {self.pairs} pairs of places"


@dataclass(frozen=True, slots=True)
class Heights:
    """Errors of an elevation map: cells compared, mean and root mean square, metres; share of the region observed."""

    cells: int
    bias_m: float
    rms_m: float
    coverage: float

    def __str__(self) -> str:
        return (
            f"bias {self.bias_m:+.3f} m, RMS {self.rms_m:.3f} m over {self.cells} cells, "
            f"{self.coverage:.0%} of the region observed"
        )


@dataclass(frozen=True, slots=True)
class Shared:
    """What two robots share, before and after their maps were put together."""

    revisions: Mapping[str, int]
    closures: int
    seen: tuple[Seen, Seen]
    heights: tuple[Heights, Heights]

    def lines(self) -> Iterator[str]:
        """For a person."""
        revised = ", ".join(f"{frame} {number - 1}" for frame, number in self.revisions.items())
        yield f"closures between the rovers: {self.closures}; times a frame was re-anchored: {revised}"
        for when, seen, heights in zip(("before", "after"), self.seen, self.heights, strict=True):
            yield f"{when} re-anchoring: position seen from the other rover {seen}"
            yield f"{when} re-anchoring: elevation of both {heights}"

    def faults(self, sharing: Sharing) -> list[str]:
        """What is not as it should be."""
        found = []
        if max(self.revisions.values()) < 2:
            found.append("no frame was re-anchored")
        if not self.seen[1].pairs:
            found.append(f"the rovers were never within {sharing.within_m:g} m of one another's way")
        elif self.seen[1].largest_m > sharing.at_most_m:
            found.append(f"{self.seen[1].largest_m:.3f} m off, expected at most {sharing.at_most_m:g} m")
        return found


def settled(sharing: Sharing, profile: Profile, log: Path, bus: Bus, http: str) -> Shared:
    """Look until all is as it should be, or for ``wait_s``: merging goes on after the drive, longer on a busy machine.

    Raises
    ------
    UnavailableError
        As ``shared``.
    """
    deadline_s = time.monotonic() + sharing.wait_s
    while True:
        found = shared(sharing, profile, log, bus, http)
        if not found.faults(sharing) or time.monotonic() > deadline_s:
            return found


def shared(sharing: Sharing, profile: Profile, log: Path, bus: Bus, http: str) -> Shared:
    """Look at what the DPM holds, now and as it was before the first re-anchoring.

    Raises
    ------
    UnavailableError
        If nothing was re-anchored within ``wait_s``.
    """
    revisions = _revised(sharing, bus)
    before = min(int(r[1]["frames_revision"]) for r in revisions.values() if len(r) > 1) - 1
    seen, heights = [], []
    true_poses, terrain = truth(log, profile, sharing.robots)
    for state in (before, None):
        series = [pose_series(http, robot, f"{robot}/lidar", state) for robot in sharing.robots]
        found = [{int(item["stamp_ns"]): np.array(item["T"]) for item in items} for items in series]
        seen.append(relative_errors(found, [true_poses[r] for r in sharing.robots], sharing.within_m))
        heights.append(height_errors(_elevation(bus, sharing, state), terrain))
    graph = bus.call(keys.dpm_rpc(keys.GROUND, "get"), {"type": "pose_graph", "robot": keys.GROUND}, timeout_s=_CALL_S)
    closures = int(graph.attachment["quality"]["metrics"]["closures"])
    counts = {frame: len(found) for frame, found in revisions.items()}
    return Shared(counts, closures, (seen[0], seen[1]), (heights[0], heights[1]))


def truth(log: Path, profile: Profile, robots: Sequence[str]) -> tuple[dict[str, dict[int, Float]], ElevationMap]:
    """``T_site_lidar`` of each robot by time, and the true elevation."""
    poses: dict[str, dict[int, Float]] = {}
    reader = open_log(log)
    for robot in robots:
        T_base_lidar = profile.robot(robot).frame_graph().lookup(f"{robot}/base", f"{robot}/lidar", 0).matrix
        samples = reader.samples([f"/{robot}/truth.pose"])
        poses[robot] = {s.stamp_ns: s.value.transform.matrix @ T_base_lidar for s in samples}
    terrain = next(iter(reader.samples(["/site/truth.terrain"]))).value
    reader.close()
    return poses, terrain


def relative_errors(found: Sequence[Poses], true: Sequence[Poses], within_m: float) -> Seen:
    """How far off each place of the second robot is, as seen from each place of the first within a distance.

    Parameters
    ----------
    found, true : sequence of 2 mappings of int to ndarray, shape (4, 4)
        ``T_site_robot`` of both robots by time; only times that both know of a robot count.
    within_m : float
        Pairs of places, whenever either robot was there, that are no farther apart.
    """
    stamps = [sorted(set(f) & set(t)) for f, t in zip(found, true, strict=True)]
    errors: list[Float] = []
    at = [np.array([poses[1][s][:3, 3] for s in stamps[1]]).reshape(-1, 3) for poses in (found, true)]
    for stamp in stamps[0]:
        seen = [
            se3.transform_points(se3.inverse(poses[0][stamp]), p) for poses, p in zip((found, true), at, strict=True)
        ]
        near = np.linalg.norm(seen[1], axis=1) <= within_m
        errors.append(np.linalg.norm(seen[0] - seen[1], axis=1)[near])
    all_m = np.concatenate(errors) if errors else np.zeros(0)
    if not len(all_m):
        return Seen(0, float("nan"), float("nan"))
    return Seen(len(all_m), float(np.sqrt(np.mean(all_m**2))), float(all_m.max()))


def height_errors(found: ElevationMap, true: ElevationMap) -> Heights:
    """Errors of observed cells, each against the true cell around its centre."""
    x, y = found.geometry.centres_m()
    rows, cols = true.geometry.rows, true.geometry.cols
    row = np.floor((true.geometry.ymax_m - y) / true.geometry.resolution_m).astype(int)
    col = np.floor((x - true.geometry.xmin_m) / true.geometry.resolution_m).astype(int)
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    height = np.full(found.geometry.shape, np.nan)
    height[inside] = true.layer("mean")[row[inside], col[inside]]
    observed = np.isfinite(found.layer("mean"))
    error = (found.layer("mean") - height)[observed & np.isfinite(height)]
    if not len(error):
        raise InputError("elevation of both robots: no cell that is observed lies on the true ground")
    return Heights(len(error), float(error.mean()), float(np.sqrt(np.mean(error**2))), float(observed.mean()))


def _revised(sharing: Sharing, bus: Bus) -> dict[str, list[dict[str, Any]]]:
    """Revisions of each robot's map frame, once one of them was re-anchored."""
    deadline_s = time.monotonic() + sharing.wait_s
    frames = [_map_frame(bus, robot) for robot in sharing.robots]
    while True:
        found = {
            frame: bus.call(keys.dpm_rpc(keys.GROUND, "frames"), {"frame": frame}, timeout_s=_CALL_S).body()[
                "revisions"
            ]
            for frame in frames
        }
        if any(len(revisions) > 1 for revisions in found.values()):
            return found
        if time.monotonic() > deadline_s:
            raise UnavailableError(f"none of {', '.join(frames)} was re-anchored within {sharing.wait_s:g} s")
        time.sleep(0.5)


def _map_frame(bus: Bus, robot: str) -> str:
    asked = {"type": "pose_graph", "robot": robot, "limit": 1}
    items = bus.call(keys.dpm_rpc(keys.GROUND, "search"), asked, timeout_s=_CALL_S).body()["items"]
    if not items:
        raise UnavailableError(f"{robot} has put no pose graph into the DPM")
    return str(items[0]["frame"])


def pose_series(http: str, robot: str, child: str, state: int | None = None) -> list[dict[str, Any]]:
    """Poses of a frame of a robot in the site, as the DPM holds them in a state of its frames, now without one."""
    asked: dict[str, Any] = {"robot": robot, "frame": "site", "child": child, "limit": _PAGE}
    asked |= {} if state is None else {"frames_revision": state}
    items: list[dict[str, Any]] = []
    while True:
        try:
            with urllib.request.urlopen(f"http://{http}/api/v1/poses?{urlencode(asked)}", timeout=_CALL_S) as response:
                page = json.load(response)["items"]
            items += page
            if len(page) < _PAGE:
                return items
            asked["t0"] = int(page[-1]["stamp_ns"]) + 1000
        except (OSError, ValueError, KeyError) as error:
            raise CdffError(f"poses of {robot} over HTTP at {http}: {error}") from error


def _elevation(bus: Bus, sharing: Sharing, state: int | None) -> ElevationMap:
    """The window that the DPM pools from the patches of both robots."""
    asked = {
        "type": "dem", "frame": "site", "region": sharing.region, "resolution_m": sharing.resolution_m, "format": "tif",
    }  # fmt: skip
    asked |= {} if state is None else {"frames_revision": state}
    made = read_map(bus.call(keys.dpm_rpc(keys.GROUND, "get"), asked, timeout_s=_CALL_S).payload)
    assert isinstance(made, ElevationMap)  # of a GeoTIFF of elevation
    return made
