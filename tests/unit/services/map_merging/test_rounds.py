# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A round of merging writes what is new and nothing else, and goes on where it was after a restart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import ConflictError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.merging import MergingConfig
from cdff_common.types import Pointcloud, PoseGraph
from cdff_core.map_merging.closing import InterRobotCloser, Pair
from cdff_core.map_merging.places import Closure, Place, RobotMap
from cdff_core.map_merging.solving import Merged, closures_of
from services.map_merging.rounds import Rounds
from tests.unit.cdff_core.map_merging.test_solving import ROBOTS, chain, closure, maps, off_m

#: Farther than any two key frames that are compared.
APART = se3.transform(np.eye(3), [100.0, 0.0, 0.0])


class Archive:
    """A DPM with the maps of two robots, written to at once."""

    def __init__(self, *, clouds: bool = True) -> None:
        self.maps = {m.robot: m for m in maps()}
        self.away: set[str] = set()
        self.clouds = clouds
        self.graph: PoseGraph | None = None
        self.writes: list[tuple[str, ...]] = []
        self.metrics: list[Mapping[str, float]] = []
        self.refusals = 0

    def map_of(self, robot: str) -> RobotMap | None:
        return None if robot in self.away else self.maps[robot]

    def merged_graph(self) -> PoseGraph | None:
        return self.graph

    def surroundings(self, robot_map: RobotMap, place: Place) -> Pointcloud:
        if not self.clouds:
            raise ProductNotFoundError("no cloud")
        return Pointcloud.from_points(np.zeros((10, 3)), frame=f"{place.robot}/place", stamp_ns=place.stamp_ns)

    def write(
        self, merged: Merged, maps: Sequence[RobotMap], moved: Sequence[str], metrics: Mapping[str, float]
    ) -> str:
        if self.refusals:
            self.refusals -= 1
            raise ConflictError("somebody else was first")
        self.graph = merged.graph
        self.metrics.append(metrics)
        self.writes.append(tuple(moved))
        self.maps = {r: replace(m, anchor=merged.anchors[r] if r in moved else m.anchor) for r, m in self.maps.items()}
        return "id"


@pytest.fixture(autouse=True)
def _comparisons_are_right(monkeypatch: pytest.MonkeyPatch) -> None:
    def compared(self: InterRobotCloser, pair: Pair, _a: object, _b: object, places: int) -> Closure:
        self._compared[pair] = places
        return closure(*(place.stamp_ns // 10**10 - 1 for place in pair))

    monkeypatch.setattr(InterRobotCloser, "compared", compared)


def rounds(archive: Archive) -> Rounds:
    return Rounds(archive, MergingConfig(), ROBOTS)  # type: ignore[arg-type]


@pytest.mark.req("CDFF-SUP-190")
def test_the_map_of_the_robot_that_is_known_worse_is_re_anchored_once() -> None:
    archive = Archive()
    merging = rounds(archive)
    while merging.run():
        pass
    assert archive.writes[0] == ("minnie",)
    assert off_m({r: m.anchor for r, m in archive.maps.items()}) < 0.02
    written = len(archive.writes)
    assert not merging.run()
    assert len(archive.writes) == written


@pytest.mark.req("CDFF-SUP-192")
def test_after_a_restart_nothing_is_compared_or_written_again() -> None:
    archive = Archive()
    first = rounds(archive)
    while first.run():
        pass
    written = len(archive.writes)
    assert not rounds(archive).run()
    assert len(archive.writes) == written


@pytest.mark.req("CDFF-SUP-192")
def test_a_robot_out_of_contact_is_merged_when_it_is_back() -> None:
    archive = Archive()
    archive.away = {"minnie"}
    merging = rounds(archive)
    assert not merging.run()
    assert not archive.writes
    archive.away = set()
    assert merging.run()
    assert archive.writes == [("minnie",)]


def test_pairs_whose_clouds_are_still_on_their_way_are_compared_later() -> None:
    archive = Archive(clouds=False)
    merging = rounds(archive)
    assert not merging.run()
    archive.clouds = True
    assert merging.run()


@pytest.mark.req("CDFF-SUP-192")
def test_what_the_dpm_refused_to_write_is_written_by_the_next_round() -> None:
    archive = Archive()
    merging = rounds(archive)
    while merging.run():
        pass
    undisturbed = len(closures_of(archive.graph, ROBOTS)) if archive.graph is not None else 0
    again = Archive()
    again.refusals = 1
    merging = rounds(again)
    with pytest.raises(ConflictError):
        merging.run()
    while merging.run():
        pass
    assert again.graph is not None
    assert len(closures_of(again.graph, ROBOTS)) == undisturbed > 0


def test_closures_with_a_place_that_is_gone_are_not_counted() -> None:
    archive = Archive()
    merging = rounds(archive)
    while merging.run():
        pass
    all_of_them = archive.metrics[-1]["closures"]
    far = chain("minnie", np.eye(4), 1.5, places=2)
    archive.maps["minnie"] = replace(far, anchor=UncertainTransform(far.surveyed.matrix @ APART, np.eye(6)))
    merging.run()
    assert archive.graph is not None
    assert archive.metrics[-1]["closures"] == len(closures_of(archive.graph, ROBOTS)) < all_of_them
