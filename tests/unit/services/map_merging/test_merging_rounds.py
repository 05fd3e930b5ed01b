# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A round of merging writes only changes, and continues after a restart."""

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

#: Farther than the search radius.
APART = se3.transform(np.eye(3), [100.0, 0.0, 0.0])


class MemoryArchive:
    """Archive in memory with the maps of two robots."""

    def __init__(self, *, clouds: bool = True) -> None:
        self.maps = {m.robot: m for m in maps()}
        self.away: set[str] = set()
        self.clouds = clouds
        self.graph: PoseGraph | None = None
        self.writes: list[tuple[str, ...]] = []
        self.metrics: list[Mapping[str, float]] = []
        self.refusals = 0

    def robot_map(self, robot: str) -> RobotMap | None:
        return None if robot in self.away else self.maps[robot]

    def merged_graph(self) -> PoseGraph | None:
        return self.graph

    def local_cloud(self, robot_map: RobotMap, keyframe: KeyframeId) -> Pointcloud:
        if not self.clouds:
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
def _comparisons_are_right(monkeypatch: pytest.MonkeyPatch) -> None:
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
    written = len(archive.writes)
    assert not merging.run()
    assert len(archive.writes) == written


@pytest.mark.req("CDFF-SUP-192")
def test_after_a_restart_nothing_is_compared_or_written_again() -> None:
    archive = MemoryArchive()
    first = rounds(archive)
    while first.run():
        pass
    written = len(archive.writes)
    assert not rounds(archive).run()
    assert len(archive.writes) == written


@pytest.mark.req("CDFF-SUP-192")
def test_a_robot_out_of_contact_is_merged_when_it_is_back() -> None:
    archive = MemoryArchive()
    archive.away = {"minnie"}
    merging = rounds(archive)
    assert not merging.run()
    assert not archive.writes
    archive.away = set()
    assert merging.run()
    assert archive.writes == [("minnie",)]


def test_pairs_without_clouds_are_compared_later() -> None:
    archive = MemoryArchive(clouds=False)
    merging = rounds(archive)
    assert not merging.run()
    archive.clouds = True
    assert merging.run()


@pytest.mark.req("CDFF-SUP-192")
def test_a_refused_write_is_repeated_by_the_next_round() -> None:
    archive = MemoryArchive()
    merging = rounds(archive)
    while merging.run():
        pass
    undisturbed = len(closures_in_graph(archive.graph, ROBOTS)) if archive.graph is not None else 0
    again = MemoryArchive()
    again.refusals = 1
    merging = rounds(again)
    with pytest.raises(ConflictError):
        merging.run()
    while merging.run():
        pass
    assert again.graph is not None
    assert len(closures_in_graph(again.graph, ROBOTS)) == undisturbed > 0


def test_closures_of_removed_keyframes_are_not_counted() -> None:
    archive = MemoryArchive()
    merging = rounds(archive)
    while merging.run():
        pass
    all_of_them = archive.metrics[-1]["closures"]
    far = robot_map("minnie", np.eye(4), 1.5, keyframes=2)
    archive.maps["minnie"] = replace(far, anchor=UncertainTransform(far.survey.matrix @ APART, np.eye(6)))
    merging.run()
    assert archive.graph is not None
    assert archive.metrics[-1]["closures"] == len(closures_in_graph(archive.graph, ROBOTS)) < all_of_them
