# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rounds of map merging write only changes and continue after a restart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import ConflictError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.types import Pointcloud, PoseGraph
from cdff_core.map_merging.joint_pose_graph import MergedMaps, closures_in_graph
from cdff_core.map_merging.loop_closure import InterRobotCloser, Pair
from cdff_core.map_merging.robot_maps import Closure, KeyframeId, RobotMap
from services.map_merging.merging_rounds import MergingRounds
from tests.support.robot_maps import ROBOTS, closure, error_m, maps, robot_map

#: Translation by more than the search radius of loop closures.
FAR_AWAY = se3.transform(np.eye(3), [100.0, 0.0, 0.0])


class MemoryArchive:
    """Archive in memory with the maps of two robots."""

    def __init__(self, *, has_clouds: bool = True) -> None:
        self.maps = {m.robot: m for m in maps()}
        self.out_of_contact: set[str] = set()
        self.has_clouds = has_clouds
        self.graph: PoseGraph | None = None
        self.writes: list[tuple[str, ...]] = []
        self.metrics: list[Mapping[str, float]] = []
        self.refusals = 0

    def robot_map(self, robot: str) -> RobotMap | None:
        return None if robot in self.out_of_contact else self.maps[robot]

    def merged_graph(self) -> PoseGraph | None:
        return self.graph

    def local_cloud(self, robot_map: RobotMap, keyframe: KeyframeId) -> Pointcloud:
        if not self.has_clouds:
            raise ProductNotFoundError("no cloud")
        return Pointcloud.from_points(
            np.zeros((10, 3)), frame=f"{keyframe.robot}/place", stamp_ns=keyframe.stamp_ns
        )

    def write(
        self,
        merged: MergedMaps,
        maps: Sequence[RobotMap],
        moved_robots: Sequence[str],
        metrics: Mapping[str, float],
    ) -> str:
        if self.refusals:
            self.refusals -= 1
            raise ConflictError("revised by another client")
        self.graph = merged.graph
        self.metrics.append(metrics)
        self.writes.append(tuple(moved_robots))
        self.maps = {
            r: replace(m, anchor=merged.anchors[r] if r in moved_robots else m.anchor)
            for r, m in self.maps.items()
        }
        return "id"


@pytest.fixture(autouse=True)
def _true_loop_closures(monkeypatch: pytest.MonkeyPatch) -> None:
    def compare(self: InterRobotCloser, pair: Pair, _a: object, _b: object, keyframes: int) -> Closure:
        self._compared[pair] = keyframes
        return closure(*(keyframe.stamp_ns // 10**10 - 1 for keyframe in pair))

    monkeypatch.setattr(InterRobotCloser, "compare", compare)


def rounds(archive: MemoryArchive) -> MergingRounds:
    return MergingRounds(archive, MergingConfig(), ROBOTS)  # type: ignore[arg-type]


@pytest.mark.req("CDFF-SUP-190")
def test_the_less_precise_map_is_re_anchored_once() -> None:
    archive = MemoryArchive()
    merging = rounds(archive)
    while merging.run():
        pass
    assert archive.writes[0] == ("minnie",)
    assert error_m({r: m.anchor for r, m in archive.maps.items()}) < 0.02
    write_count = len(archive.writes)
    assert not merging.run()
    assert len(archive.writes) == write_count


@pytest.mark.req("CDFF-SUP-192")
def test_after_a_restart_nothing_is_compared_or_written_again() -> None:
    archive = MemoryArchive()
    merging = rounds(archive)
    while merging.run():
        pass
    write_count = len(archive.writes)
    assert not rounds(archive).run()
    assert len(archive.writes) == write_count


@pytest.mark.req("CDFF-SUP-192")
def test_a_robot_out_of_contact_is_merged_when_it_is_back() -> None:
    archive = MemoryArchive()
    archive.out_of_contact = {"minnie"}
    merging = rounds(archive)
    assert not merging.run()
    assert not archive.writes
    archive.out_of_contact = set()
    assert merging.run()
    assert archive.writes == [("minnie",)]


def test_pairs_without_clouds_are_compared_later() -> None:
    archive = MemoryArchive(has_clouds=False)
    merging = rounds(archive)
    assert not merging.run()
    archive.has_clouds = True
    assert merging.run()


@pytest.mark.req("CDFF-SUP-192")
def test_a_refused_write_is_repeated_by_the_next_round() -> None:
    archive = MemoryArchive()
    merging = rounds(archive)
    while merging.run():
        pass
    closure_count = len(closures_in_graph(archive.graph, ROBOTS)) if archive.graph is not None else 0
    refusing_archive = MemoryArchive()
    refusing_archive.refusals = 1
    merging = rounds(refusing_archive)
    with pytest.raises(ConflictError):
        merging.run()
    while merging.run():
        pass
    assert refusing_archive.graph is not None
    assert len(closures_in_graph(refusing_archive.graph, ROBOTS)) == closure_count > 0


def test_closures_of_removed_keyframes_are_not_counted() -> None:
    archive = MemoryArchive()
    merging = rounds(archive)
    while merging.run():
        pass
    closures_before = archive.metrics[-1]["closures"]
    shorter_map = robot_map("minnie", np.eye(4), 1.5, keyframes=2)
    archive.maps["minnie"] = replace(
        shorter_map, anchor=UncertainTransform(shorter_map.survey.matrix @ FAR_AWAY, np.eye(6))
    )
    merging.run()
    assert archive.graph is not None
    assert archive.metrics[-1]["closures"] == len(closures_in_graph(archive.graph, ROBOTS)) < closures_before
