# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A round of merging: read the maps, compare a few pairs of key frames, solve, revise."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence

import numpy as np

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, ProductNotFoundError
from cdff_common.interfaces.merging import MergingConfig
from cdff_common.types import Pointcloud
from cdff_core.map_merging.closing import InterRobotCloser, Pair
from cdff_core.map_merging.places import Closure, Place, RobotMap
from cdff_core.map_merging.solving import MapMerger, Merged, closures_of
from services.map_merging.archive import Archive

logger = logging.getLogger(__name__)

#: How often is looked for news, longest time between two rounds, shortest after one that failed, seconds.
POLL_S, PERIOD_S, RETRY_S = 0.1, 5.0, 1.0


def follow(bus: Bus, rounds: Rounds, stop: threading.Event) -> None:
    """A round whenever a robot's graph is new or the last round left something, until ``stop``."""
    news = threading.Event()

    def on_inserted(message: Message) -> None:
        ours = message.key.split("/")[2] == keys.GROUND
        if unpack(message.payload).get("product") == "pose_graph" and not ours:
            news.set()

    bus.subscribe(keys.event("*", "inserted"), on_inserted, depth=1024)
    next_s = monotonic_s()
    while not stop.wait(POLL_S):
        if not news.is_set() and monotonic_s() < next_s:
            continue
        news.clear()
        next_s = monotonic_s() + PERIOD_S
        try:
            if rounds.run():
                news.set()
        except CdffError as error:  # the DPM is away, or somebody revised a frame: the next round reads anew
            logger.warning("%s", error)
            next_s = monotonic_s() + RETRY_S


class Rounds:
    """What is known from one round to the next: the closures, which a restart reads back from the newest graph.

    A robot that died or is out of contact is one whose products do not change: what it delivered before stays merged,
    and what it delivers later is compared then.

    Parameters
    ----------
    archive : Archive
    config : MergingConfig
    robots : sequence of str
        All of the mission.
    """

    def __init__(self, archive: Archive, config: MergingConfig, robots: Sequence[str]) -> None:
        self._archive, self._config, self._robots = archive, config, tuple(robots)
        self._closer, self._merger = InterRobotCloser(config), MapMerger(config, robots)
        self._closures: list[Closure] | None = None
        self._unwritten = False

    def run(self) -> bool:
        """One round; whether another may find more. Raises what the DPM answers."""
        if self._closures is None:
            before = self._archive.merged_graph()
            self._closures = [] if before is None else closures_of(before, self._robots)
        maps = [m for m in map(self._archive.map_of, self._robots) if m is not None]
        if len(maps) < 2:
            return False
        found, compared = self._found(maps)
        closures = [*self._closures, *found]
        if closures:
            merged = self._merger.merged(maps, closures)
            moved = [m.robot for m in maps if self._is_news(m, merged)]
            # Kept before they are written: their pairs are not compared again where the DPM refuses.
            self._closures = [c for c in closures if c not in merged.rejected]
            self._unwritten = self._unwritten or bool(found)
            if self._unwritten or moved:
                self._write(merged, maps, moved)
                self._unwritten = False
        return compared > 0

    def _found(self, maps: Sequence[RobotMap]) -> tuple[list[Closure], int]:
        """New closures, and how many pairs were compared for them."""
        clouds: dict[Place, Pointcloud] = {}
        by_robot = {m.robot: m for m in maps}
        found, compared = [], 0
        for pair in self._closer.pairs(maps, self._closures or ()):
            try:
                for place in pair:
                    if place not in clouds:
                        clouds[place] = self._archive.surroundings(by_robot[place.robot], place)
            except ProductNotFoundError:
                continue  # its clouds are still on their way
            compared += 1
            closure = self._compared(pair, clouds, by_robot)
            if closure is not None:
                found.append(closure)
        return found, compared

    def _compared(self, pair: Pair, clouds: dict[Place, Pointcloud], maps: dict[str, RobotMap]) -> Closure | None:
        places = sum(len(maps[place.robot].places) for place in pair)
        closure = self._closer.compared(pair, clouds[pair[0]], clouds[pair[1]], places)
        names = " and ".join(f"{place.robot} at {place.stamp_ns}" for place in pair)
        logger.info("%s: %s", names, "the same place" if closure is not None else "not shown to be the same place")
        return closure

    def _is_news(self, m: RobotMap, merged: Merged) -> bool:
        """Whether the anchor found differs enough from the one stated, or is known so much better."""
        new, poses = merged.anchors[m.robot], np.array(list(m.places.values()))
        shift_m = float(np.linalg.norm((new.matrix @ poses - m.anchor.matrix @ poses)[:, :3, 3], axis=1).max())
        if shift_m > self._config.shift_m or m.anchor.covariance is None or new.covariance is None:
            return True
        return bool(np.trace(new.covariance) < self._config.sigma_share**2 * np.trace(m.anchor.covariance))

    def _write(self, merged: Merged, maps: Sequence[RobotMap], moved: Sequence[str]) -> None:
        closures = len(closures_of(merged.graph, self._robots))
        metrics = {"closures": float(closures), "rejected": float(len(merged.rejected))}
        metrics |= {f"bent_m_{robot}": value for robot, value in merged.bent_m.items()}
        graph = self._archive.write(merged, maps, moved, metrics)
        logger.info("graph %s of %d closures; re-anchored: %s", graph, closures, ", ".join(moved) or "nobody")
