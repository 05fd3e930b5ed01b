# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assessment of a map that two robots share: relative position and elevation, compared with the truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.bus import Bus, keys
from cdff_common.errors import InputError, UnavailableError
from cdff_common.interfaces.profile import Profile
from cdff_common.types import ElevationMap
from cdff_dev.logs import open_log
from cdff_dev.missions.script import SharedMapLimits
from cdff_dev.missions.tracks import (
    CALL_S,
    RelativePositionErrors,
    assess_until_settled,
    elevation_window,
    estimated_track,
    read_truth,
    relative_position_errors,
)

#: Choice of a window that contains all heights with equal weight.
POOLED = "pooled"
#: Largest ratio of the error of the shared map to that of the better robot alone.
WORSE = 1.5


@dataclass(frozen=True, slots=True)
class ElevationErrors:
    """Errors of an elevation map: number of compared cells, mean error and root mean square error, metres.

    ``coverage`` is the observed fraction of the region.
    """

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
class SharedMapErrors:
    """Errors of a shared map, before and after the maps of two robots were merged.

    Attributes
    ----------
    revisions : mapping of str to int
        Number of revisions of each robot's map frame; the first is the frame before any re-anchoring.
    closures : int
        Number of loop closures between the robots.
    positions, elevations : tuple
        Errors before the first re-anchoring, and after the last.
    separate : mapping of str to ElevationErrors
        Errors of the map of each robot alone before the first re-anchoring, and of all heights ``pooled``.
    """

    revisions: Mapping[str, int]
    closures: int
    positions: tuple[RelativePositionErrors, RelativePositionErrors]
    elevations: tuple[ElevationErrors, ElevationErrors]
    separate: Mapping[str, ElevationErrors] = field(default_factory=dict)

    def lines(self) -> Iterator[str]:
        """Yield the results as text."""
        revised = ", ".join(f"{frame} {number - 1}" for frame, number in self.revisions.items())
        yield f"loop closures between the rovers: {self.closures}; number of re-anchorings: {revised}"
        for when, position, elevation in zip(
            ("before", "after"), self.positions, self.elevations, strict=True
        ):
            yield f"{when} re-anchoring: relative position {position}"
            yield f"{when} re-anchoring: elevation map of both {elevation}"
        for name, elevation in self.separate.items():
            source = "both, pooled:" if name == POOLED else f"{name} alone:"
            yield f"before re-anchoring: elevation map of {source} {elevation}"

    def faults(self, limits: SharedMapLimits) -> list[str]:
        """Return the limits that are exceeded."""
        faults = []
        if max(self.revisions.values()) < 2:
            faults.append("no frame was re-anchored")
        if not self.positions[1].pairs:
            faults.append(f"the paths of the rovers are nowhere within {limits.within_m:g} m of each other")
        elif self.positions[1].largest_m > limits.max_error_m:
            faults.append(
                f"relative position {self.positions[1].largest_m:.3f} m off, limit {limits.max_error_m:g} m"
            )
        robots = [errors.rms_m for name, errors in self.separate.items() if name != POOLED]
        if robots and self.elevations[0].rms_m > WORSE * min(robots):
            faults.append(
                f"elevation map of both: RMS {self.elevations[0].rms_m:.3f} m before re-anchoring, more than "
                f"{WORSE:g} times that of one robot alone, {min(robots):.3f} m"
            )
        return faults


def assess_shared_map(
    limits: SharedMapLimits, profile: Profile, log: Path, bus: Bus, http_url: str
) -> SharedMapErrors:
    """Assess the map repeatedly, until it has no fault or ``wait_s`` has passed.

    Merging of the maps continues after the drive.

    Raises
    ------
    UnavailableError
        If within ``wait_s`` no frame was re-anchored, or the DPM received no poses of a robot.
    """
    return assess_until_settled(
        lambda: _errors(limits, profile, log, bus, http_url),
        is_settled=lambda errors: not errors.faults(limits),
        wait_s=limits.wait_s,
    )


def _errors(limits: SharedMapLimits, profile: Profile, log: Path, bus: Bus, http_url: str) -> SharedMapErrors:
    """Assess the products of the DPM with the frames before the first re-anchoring and with the newest."""
    revisions = _revisions(limits, bus)
    state_before = min(int(r[1]["frames_revision"]) for r in revisions.values() if len(r) > 1) - 1
    truths = read_truth(log, limits.robots)
    with closing(open_log(log)) as reader:
        terrain = next(iter(reader.samples(["/site/truth.terrain"]))).value
    positions, elevations = [], []
    for state in (state_before, None):
        tracks = [estimated_track(profile, robot, http_url, truths[robot], state) for robot in limits.robots]
        positions.append(relative_position_errors(tracks, limits.within_m))
        revision: dict[str, object] = {} if state is None else {"frames_revision": state}
        window = elevation_window(bus, limits.region, limits.resolution_m, **revision)
        elevations.append(elevation_errors(window, terrain))
    options: dict[str, dict[str, object]] = {robot: {"robot": robot} for robot in limits.robots}
    separate = {
        name: elevation_errors(
            elevation_window(
                bus, limits.region, limits.resolution_m, frames_revision=state_before, **selection
            ),
            terrain,
        )
        for name, selection in (options | {POOLED: {"choice": POOLED}}).items()
    }
    query = {"type": "pose_graph", "robot": keys.GROUND}
    graph = bus.call(keys.dpm_rpc(keys.GROUND, "get"), query, timeout_s=CALL_S)
    return SharedMapErrors(
        {frame: len(entries) for frame, entries in revisions.items()},
        int(graph.attachment["quality"]["metrics"]["closures"]),
        (positions[0], positions[1]),
        (elevations[0], elevations[1]),
        separate,
    )


def elevation_errors(window: ElevationMap, true: ElevationMap) -> ElevationErrors:
    """Compare the height of each observed cell with that of the true cell that contains its centre."""
    x, y = window.geometry.centres_m()
    geometry = true.geometry
    row = np.floor((geometry.ymax_m - y) / geometry.resolution_m).astype(int)
    col = np.floor((x - geometry.xmin_m) / geometry.resolution_m).astype(int)
    inside = (row >= 0) & (row < geometry.rows) & (col >= 0) & (col < geometry.cols)
    true_height = np.full(window.geometry.shape, np.nan)
    true_height[inside] = true.layer("mean")[row[inside], col[inside]]
    observed = np.isfinite(window.layer("mean"))
    error = (window.layer("mean") - true_height)[observed & np.isfinite(true_height)]
    if not len(error):
        raise InputError("elevation of both robots: no observed cell is within the true terrain")
    rms_m = float(np.sqrt(np.mean(error**2)))
    return ElevationErrors(len(error), float(error.mean()), rms_m, float(observed.mean()))


def _revisions(limits: SharedMapLimits, bus: Bus) -> dict[str, list[dict[str, Any]]]:
    """Return the revisions of each robot's map frame; raises UnavailableError if none was re-anchored."""
    key, revisions = keys.dpm_rpc(keys.GROUND, "frames"), {}
    for robot in limits.robots:
        frame = _map_frame(bus, robot)
        revisions[frame] = bus.call(key, {"frame": frame}, timeout_s=CALL_S).body()["revisions"]
    if all(len(entries) < 2 for entries in revisions.values()):
        raise UnavailableError(f"none of {', '.join(revisions)} was re-anchored within {limits.wait_s:g} s")
    return revisions


def _map_frame(bus: Bus, robot: str) -> str:
    query = {"type": "pose_graph", "robot": robot, "limit": 1}
    items = bus.call(keys.dpm_rpc(keys.GROUND, "search"), query, timeout_s=CALL_S).body()["items"]
    if not items:
        raise UnavailableError(f"the DPM has no pose graph of {robot}")
    return str(items[0]["frame"])
