# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rounds of map merging: read the maps, compare some pairs of keyframes, optimise, revise the frames."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import on_map
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, ProductNotFoundError
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_core.map_merging.joint_pose_graph import MapMerger, MergedMaps, closures_in_graph
from cdff_core.map_merging.loop_closure import LidarCloser, Pair
from cdff_core.map_merging.robot_maps import Closure, KeyframeId, RobotMap
from cdff_core.map_merging.visual_closure import VisualCloser
from services.map_merging.archive import VISUAL_MAP, MapArchive

logger = logging.getLogger(__name__)

#: Longest time between two rounds, and shortest time after a failed one, seconds.
PERIOD_S, RETRY_S = 5.0, 1.0
#: Period of the check for the end, and pause before a round, which collects new graphs, seconds.
_POLL_S, _COLLECT_S = 0.5, 0.1


def follow(bus: Bus, rounds: MergingRounds, stop: threading.Event) -> None:
    """Run a round whenever a robot has a new graph or the last round left pairs, until ``stop``."""
    has_new_graph = threading.Event()

    def on_inserted(key: str, body: dict[str, Any]) -> None:
        is_joint_graph = key.split("/")[2] == keys.GROUND
        if body.get("product") in ("pose_graph", VISUAL_MAP) and not is_joint_graph:
            has_new_graph.set()

    bus.subscribe(keys.event("*", "inserted"), on_map(on_inserted), depth=1024)
    next_s = monotonic_s()
    while not stop.is_set():
        if not has_new_graph.wait(_POLL_S) and monotonic_s() < next_s:
            continue
        if stop.wait(_COLLECT_S):
            return
        has_new_graph.clear()
        next_s = monotonic_s() + PERIOD_S
        try:
            if rounds.run():
                has_new_graph.set()
        except CdffError as error:
            # DPM unavailable, or a frame revised by another client: the next round reads again.
            logger.warning("%s", error)
            next_s = monotonic_s() + RETRY_S
            stop.wait(RETRY_S)


class MergingRounds:
    """State between rounds: the closures, which are read back from the newest joint graph after a restart.

    Products of a robot that is out of contact stay merged; later ones are compared as they arrive.

    Parameters
    ----------
    archive : MapArchive
    config : MergingConfig
    robots : sequence of str
        All robots of the mission.
    """

    def __init__(self, archive: MapArchive, config: MergingConfig, robots: Sequence[str]) -> None:
        self._archive, self._config, self._robots = archive, config, tuple(robots)
        self._closer: LidarCloser | VisualCloser = (
            LidarCloser(config) if config.maps == "lidar" else VisualCloser(config)
        )
        self._merger = MapMerger(config, robots)
        self._closures: list[Closure] | None = None
        self._unwritten = False

    def run(self) -> bool:
        """Run one round; return True if another one may find more. Errors of the DPM are raised."""
        if self._closures is None:
            graph = self._archive.merged_graph()
            self._closures = [] if graph is None else closures_in_graph(graph, self._robots)
        maps = [m for m in map(self._archive.robot_map, self._robots) if m is not None]
        if len(maps) < 2:
            return False
        new, compared = self._compare_pairs(maps)
        closures = [*self._closures, *new]
        if closures:
            merged = self._merger.merge(maps, closures)
            moved_robots = [m.robot for m in maps if self._has_moved(m, merged)]
            # Stored before the write, so that pairs are not compared again if the DPM refuses it.
            self._closures = [c for c in closures if c not in merged.rejected]
            self._unwritten = self._unwritten or bool(new)
            if self._unwritten or moved_robots:
                self._write(merged, maps, moved_robots)
                self._unwritten = False
        return compared > 0

    def _compare_pairs(self, maps: Sequence[RobotMap]) -> tuple[list[Closure], int]:
        """Return the new closures and the number of compared pairs."""
        places: dict[KeyframeId, Any] = {}
        read = self._archive.local_cloud if self._config.maps == "lidar" else self._archive.local_points
        by_robot = {m.robot: m for m in maps}
        closures, compared = [], 0
        for pair in self._closer.pairs(maps, self._closures or ()):
            try:
                for keyframe in pair:
                    if keyframe not in places:
                        places[keyframe] = read(by_robot[keyframe.robot], keyframe)
            except ProductNotFoundError:
                continue  # its cloud or its points have not arrived yet
            compared += 1
            closure = self._compare(pair, places, by_robot)
            if closure is not None:
                closures.append(closure)
        return closures, compared

    def _compare(
        self, pair: Pair, places: dict[KeyframeId, Any], maps: dict[str, RobotMap]
    ) -> Closure | None:
        keyframes = sum(len(maps[keyframe.robot].keyframes) for keyframe in pair)
        closure = self._closer.compare(pair, places[pair[0]], places[pair[1]], keyframes)
        names = " and ".join(f"{keyframe.robot} at {keyframe.stamp_ns}" for keyframe in pair)
        logger.info("%s: %s", names, "loop closed" if closure is not None else "no loop closure")
        return closure

    def _has_moved(self, robot_map: RobotMap, merged: MergedMaps) -> bool:
        """Return True if the new anchor differs enough from the published one or is more precise."""
        new, poses = merged.anchors[robot_map.robot], np.array(list(robot_map.keyframes.values()))
        displacement_m = float(
            np.linalg.norm((new.matrix @ poses - robot_map.anchor.matrix @ poses)[:, :3, 3], axis=1).max()
        )
        if (
            displacement_m > self._config.revision_distance_m
            or robot_map.anchor.covariance is None
            or new.covariance is None
        ):
            return True
        return bool(
            np.trace(new.covariance)
            < self._config.revision_sigma_ratio**2 * np.trace(robot_map.anchor.covariance)
        )

    def _write(self, merged: MergedMaps, maps: Sequence[RobotMap], moved_robots: Sequence[str]) -> None:
        closures = len(closures_in_graph(merged.graph, self._robots))
        metrics = {"closures": float(closures), "rejected": float(len(merged.rejected))}
        metrics |= {f"bent_m_{robot}": value for robot, value in merged.deformation_m.items()}
        graph = self._archive.write(merged, maps, moved_robots, metrics)
        logger.info(
            "graph %s of %d closures; re-anchored: %s", graph, closures, ", ".join(moved_robots) or "none"
        )
