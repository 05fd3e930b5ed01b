# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Queries of the DPM for a request to one robot or to any robot, and frame and robots of the match."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import ExtrapolationError, FrameNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, Quality, Status, product_id
from cdff_common.interfaces.profile import load_profile
from cdff_common.types import Pointcloud
from cdff_core.orchestration.request import ProductRequest, parse_request
from services.orchestrator.dpm import DERIVED_DFPC, StoredProduct
from services.orchestrator.product_finder import ProductFinder
from tests.support.dpm_products import S, elevation, navigation, pose

PROFILE = Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml"
ROBOTS = ("mana", "minnie")
NOW_S = 100


class DpmDouble:
    """DPM with one product of each type and robot, captured at ``t1_ns``."""

    def __init__(self, t1_ns: int = 98 * S, status: str = "OK", frame: str = "") -> None:
        self.t1_ns, self.status, self.frame = t1_ns, status, frame
        self.searches: list[dict[str, Any]] = []
        self.windows: list[dict[str, Any]] = []
        self.poses: list[tuple[str, str, str, int | None]] = []
        self.pose_error: Exception | None = None

    def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
        self.searches.append(parameters)
        robot = "mana" if parameters["robot"] == "any" else parameters["robot"]
        return [self._header(robot, parameters["type"]).to_dict() | {"robot": robot, "dfpc": "a_dfpc"}]

    def newest(self, until_s: float, robot: str, **parameters: Any) -> StoredProduct | None:
        (item,) = self.search(until_s, robot=robot, **parameters)
        if item["quality"]["status"] == "FAILED":
            return None
        stored = self.value(item["id"], robot, until_s)
        return replace(stored, manifest={"dfpc": item["dfpc"]})

    def value(self, stored: str, robot: str, until_s: float) -> StoredProduct:
        product = next(p for p in ("pose", "navigation_map", "dem") if stored == stored_id(robot, p))
        value = pose(98, 1.0) if product == "pose" else elevation(0.0)
        return StoredProduct(self._header(robot, product), robot, value, {}, b"", "")

    def window(self, until_s: float, **parameters: Any) -> StoredProduct:
        self.windows.append(parameters)
        header = self._header(str(parameters["robot"]), "dem")
        return StoredProduct(header, str(parameters["robot"]), elevation(0.0), {"oldest_ns": 90 * S}, b"", "")

    def pose(
        self, robot: str, parent: str, child: str, t_ns: int | None, until_s: float
    ) -> UncertainTransform:
        self.poses.append((robot, parent, child, t_ns))
        if self.pose_error is not None:
            raise self.pose_error
        return UncertainTransform.exact(se3.transform(np.eye(3), [1.0, 1.0, 0.0]))

    def _header(self, robot: str, product: str) -> Header:
        return Header(
            id=stored_id(robot, product),
            seq=0,
            t0_ns=self.t1_ns,
            t1_ns=self.t1_ns,
            frame=self.frame or ("site" if product == "pose" else f"{robot}/odom"),
            child=f"{robot}/base" if product == "pose" else None,
            producer="test",
            config_hash="c",
            quality=Quality(Status(self.status)),
        )


def stored_id(robot: str, product: str) -> str:
    return product_id(robot, "a_dfpc", product, 0, 0, "c")


def request(**parameters: str) -> ProductRequest:
    return parse_request({"robot": "any", **parameters}, "ground")


def finder(dpm: DpmDouble) -> ProductFinder:
    clock, profile = ManualClock(NOW_S * S), load_profile(PROFILE)
    return ProductFinder(dpm, clock, lambda: profile)  # type: ignore[arg-type]  # double


def test_elevation_of_any_robot_is_one_window_of_all_robots_in_the_requested_frame() -> None:
    dpm = DpmDouble()
    found, _ = finder(dpm).find(request(type="dem", region="bbox:0,0,1,1"), ROBOTS, 1e9)
    assert [w["robot"] for w in dpm.windows] == ["any"]
    assert dpm.windows[0]["frame"] == "site"
    assert dpm.windows[0]["region"] == "bbox:0,0,1,1"
    assert dpm.searches[0] == {
        "type": "dem", "robot": "any", "region": "bbox:0,0,1,1", "frame": "site", "limit": 5, "t1": None,
    }  # fmt: skip
    assert found is not None
    assert found[0].robots == ()
    assert found[0].candidate.oldest_t1_ns == 90 * S


def test_elevation_of_one_robot_is_a_window_of_its_maps_in_their_frame() -> None:
    dpm = DpmDouble()
    parameters = {"type": "dem", "robot": "minnie", "region": "bbox:0,0,1,1"}
    found, _ = finder(dpm).find(request(**parameters), ("minnie",), 1e9)
    assert [(w["robot"], w["frame"]) for w in dpm.windows] == [("minnie", "minnie/odom")]
    assert dpm.windows[0]["region"] == "polygon:1,1,2,1,2,2,1,2"
    assert dpm.poses == [("minnie", "minnie/odom", "site", 98 * S)]
    assert found is not None
    assert found[0].robots == ("minnie",)


def test_elevation_without_region_is_the_window_of_the_whole_map() -> None:
    dpm = DpmDouble()
    found, _ = finder(dpm).find(request(type="dem", resolution_m="0.2"), ROBOTS, 1e9)
    assert dpm.windows == [{"robot": "any", "resolution_m": 0.2, "t1": None}]
    assert found is not None
    assert found[0].candidate.coverage is None


def test_outdated_elevation_is_stated_without_the_query_of_a_window() -> None:
    dpm = DpmDouble()
    parameters = {"type": "dem", "region": "bbox:0,0,1,1", "max_age_s": "1"}
    found, reason = finder(dpm).find(request(**parameters), ROBOTS, 1e9)
    assert dpm.windows == []
    assert found is not None
    assert found[0].value is None
    assert found[0].frame == "site"
    assert "age: 2.000 s old, asked at most 1 s" in reason


@pytest.mark.parametrize("product", ["pose", "navigation_map"])
def test_another_product_of_any_robot_is_searched_for_each_robot(product: str) -> None:
    dpm = DpmDouble()
    found, _ = finder(dpm).find(request(type=product), ROBOTS, 1e9)
    assert {s["robot"] for s in dpm.searches} == set(ROBOTS)
    assert found is not None
    match, assessment = found
    assert match.is_unmodified
    assert match.candidate.robot in ROBOTS
    assert assessment.satisfies
    assert match.sources == (match.stored.header,)  # type: ignore[union-attr]


def test_a_pose_in_another_frame_is_that_of_the_frame_tree() -> None:
    dpm = DpmDouble()
    found, _ = finder(dpm).find(request(type="pose", frame="mana/odom", robot="mana"), ("mana",), 1e9)
    assert dpm.poses == [("mana", "mana/odom", "mana/base", 98 * S)]
    assert found is not None
    assert (found[0].frame, found[0].child, found[0].is_unmodified) == ("mana/odom", "mana/base", False)
    assert found[0].sources[0].id == stored_id("mana", "pose")


def test_of_tracks_in_several_frames_the_one_in_the_requested_frame_is_delivered() -> None:
    class TracksDouble(DpmDouble):
        def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
            (item,) = super().search(until_s, **parameters)
            return [item | {"id": frame, "frame": frame} for frame in ("inertial", "mana/lvlh")]

        def value(self, stored: str, robot: str, until_s: float) -> StoredProduct:
            header = replace(self._header(robot, "track"), frame=stored)
            return StoredProduct(header, robot, elevation(0.0), {}, b"", "")

    for asked, expected in (("inertial",) * 2, ("mana/lvlh",) * 2, ("site", "inertial")):
        found, _ = finder(TracksDouble()).find(
            request(type="track", robot="mana", frame=asked), ("mana",), 1e9
        )
        assert found is not None
        assert found[0].frame == expected


@pytest.mark.parametrize(
    ("tracks", "expected"),
    [
        # t1 in seconds, has a position, reasons: newest first; of an equal t1 the one stored last.
        ([(5, False, ["coasting"]), (4, True, []), (4, False, ["coasting"]), (3, True, [])], 1),
        ([(5, True, ["coasting"]), (4, True, [])], 1),
        ([(5, True, []), (5, False, []), (4, True, [])], 0),
        ([(5, False, ["lost"]), (4, False, ["coasting"]), (3, True, [])], 0),
        ([(5, False, ["coasting"]), (4, False, ["range_unobservable"])], 1),
    ],
)
def test_the_object_with_a_position_answers_also_while_an_image_is_being_stored(
    tracks: list[tuple[int, bool, list[str]]], expected: int
) -> None:
    class TracksDouble(DpmDouble):
        def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
            (item,) = super().search(until_s, **parameters)
            box = [0.0] * 6
            return [
                item
                | {"id": str(k), "frame": "inertial", "t1_ns": t1_s * S, "box_m": box if is_placed else None}
                | {"quality": {"status": "DEGRADED" if reasons else "OK", "reasons": reasons}}
                for k, (t1_s, is_placed, reasons) in enumerate(tracks)
            ]

        def value(self, stored: str, robot: str, until_s: float) -> StoredProduct:
            header = replace(self._header(robot, "track"), id=stored)
            return StoredProduct(header, robot, elevation(0.0), {}, b"", "")

    found, _ = finder(TracksDouble()).find(
        request(type="track", robot="mana", frame="inertial"), ("mana",), 1e9
    )
    assert found is not None
    assert found[0].candidate.id == str(expected)


def test_failed_and_derived_products_are_not_used() -> None:
    found, reason = finder(DpmDouble(status="FAILED")).find(request(type="pose"), ROBOTS, 1e9)
    assert found is None
    assert reason == "the DPM holds no pose of mana for it; the DPM holds no pose of minnie for it"


@pytest.mark.parametrize(("dfpc", "is_used"), [("a_dfpc", True), ("dpm", False), (DERIVED_DFPC, False)])
def test_a_product_that_was_derived_from_others_is_not_used(dfpc: str, is_used: bool) -> None:
    class Derived(DpmDouble):
        def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
            return [item | {"dfpc": dfpc} for item in super().search(until_s, **parameters)]

    found, _ = finder(Derived()).find(request(type="navigation_map"), ("mana",), 1e9)
    assert (found is not None) == is_used


def test_a_degraded_product_is_delivered_as_degraded() -> None:
    found, _ = finder(DpmDouble(status="DEGRADED")).find(request(type="navigation_map"), ("mana",), 1e9)
    assert found is not None
    assert found[0].candidate.status == "DEGRADED"


@pytest.mark.parametrize(
    ("product", "robot", "pooled"),
    [("dem", "any", True), ("dem", "mana", False), ("pointcloud", "any", False)],
)
def test_only_elevation_of_any_robot_is_pooled(product: str, robot: str, pooled: bool) -> None:
    wanted = request(type=product, robot=robot, region="bbox:0,0,1,1")
    coverage = finder(DpmDouble()).coverage(wanted, ROBOTS, None, 1e9, 10.0)
    assert coverage.pooled is pooled
    assert coverage.stored == 0
    assert coverage.requested != 0


def test_the_cells_of_a_region_are_larger_than_those_of_the_stored_product() -> None:
    wanted = request(type="dem", region="bbox:0,0,12,12")
    products = finder(DpmDouble())
    found, _ = products.find(wanted, ROBOTS, 1e9)
    assert found is not None
    fine = products.coverage(wanted, ROBOTS, found[0], 1e9, 10.0)
    coarse_candidate = replace(found[0].candidate, resolution_m=2.0)
    coarse = products.coverage(wanted, ROBOTS, replace(found[0], candidate=coarse_candidate), 1e9, 10.0)
    assert fine.requested.bit_count() == 24 * 24
    assert coarse.requested.bit_count() == 4 * 4
    failed = replace(found[0], candidate=replace(coarse_candidate, status="FAILED"))
    assert coarse.stored != 0
    assert products.coverage(wanted, ROBOTS, failed, 1e9, 10.0).stored == 0


def test_a_robot_at_an_unknown_position_may_reach_the_whole_region() -> None:
    dpm = DpmDouble()
    wanted = request(type="dem", region="bbox:500,500,501,501")
    far = finder(dpm).coverage(wanted, ("mana",), None, 1e9, 10.0)
    assert far.reach["mana"] == 0
    dpm.pose_error = ExtrapolationError("pose too old")
    assert finder(dpm).coverage(wanted, ("mana",), None, 1e9, 10.0).reach == {}


def test_a_frame_is_known_if_it_is_connected_at_any_time() -> None:
    dpm = DpmDouble()
    assert finder(dpm).has_frame("mana/odom", ROBOTS, 1e9)
    dpm.pose_error = FrameNotFoundError("no edge")
    assert not finder(dpm).has_frame("mana/odom", ROBOTS, 1e9)
    queried = [(robot, parent) for robot in ROBOTS for parent in ("site", f"{robot}/base")]
    assert [pose[:2] for pose in dpm.poses[1:]] == queried
    assert {pose[2] for pose in dpm.poses} == {"mana/odom"}


@pytest.mark.parametrize(("max_age_s", "merged"), [("10", 2), ("9.999", 1)])
def test_navigation_maps_are_merged_up_to_the_largest_age(max_age_s: str, merged: int) -> None:
    class TwoMaps(DpmDouble):
        def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
            (newest,) = super().search(until_s, **parameters)
            return [newest, newest | {"t1_ns": (NOW_S - 10) * S}]

        def value(self, stored: str, robot: str, until_s: float) -> StoredProduct:
            header = self._header(robot, "navigation_map")
            return StoredProduct(header, robot, navigation(), {}, b"", "")

    parameters = {"type": "navigation_map", "robot": "mana", "region": "bbox:0,0,4,4", "min_coverage": "0.9"}
    products = finder(TwoMaps(frame="site"))
    found, _ = products.find(request(**parameters, max_age_s=max_age_s), ("mana",), 1e9)
    assert found is not None
    assert len(found[0].sources) == merged
    assert found[0].frame == "site"


class TwoClouds(DpmDouble):
    """DPM with a cloud of the left half of a square of 4 m, 2 s old, and one of its right half, 10 s old."""

    def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
        (item,) = super().search(until_s, **parameters)
        return [item | {"id": "left"}, item | {"id": "right", "t1_ns": (NOW_S - 10) * S}]

    def value(self, stored: str, robot: str, until_s: float) -> StoredProduct:
        x, y = np.meshgrid(np.arange(0.25, 2.0, 0.5), np.arange(0.25, 4.0, 0.5))
        shift_m = 0.0 if stored == "left" else 2.0
        points = np.column_stack([x.ravel() + shift_m, y.ravel(), np.zeros(x.size)])
        cloud = Pointcloud.from_points(points, frame=self.frame, stamp_ns=98 * S)
        header = replace(self._header(robot, "pointcloud"), id=stored)
        if stored == "right":
            header = replace(header, t0_ns=(NOW_S - 10) * S, t1_ns=(NOW_S - 10) * S)
        return StoredProduct(header, robot, cloud, {}, b"", "")


@pytest.mark.parametrize(("max_age_s", "names"), [("10", ["left", "right"]), ("9.999", ["left"])])
def test_clouds_are_merged_up_to_the_largest_age_until_they_cover_the_region(
    max_age_s: str, names: list[str]
) -> None:
    parameters = {"type": "pointcloud", "robot": "mana", "region": "bbox:0,0,4,4", "min_coverage": "0.9"}
    dpm = TwoClouds(frame="site")
    found, _ = finder(dpm).find(request(**parameters, max_age_s=max_age_s), ("mana",), 1e9)
    assert found is not None
    assert [header.id for header in found[0].sources] == names
    candidate = found[0].candidate
    assert candidate.coverage == pytest.approx(0.5 * len(names))
    assert len(found[0].value.points_m) == 32 * len(names)
    oldest_s = 98 if len(names) == 1 else NOW_S - 10
    assert (candidate.t1_ns, candidate.oldest_t1_ns) == (98 * S, oldest_s * S)
    assert dpm.searches[0]["limit"] == 8
    enough, _ = finder(dpm).find(request(**parameters | {"min_coverage": "0.5"}), ("mana",), 1e9)
    assert enough is not None
    assert len(enough[0].sources) == 1


def test_clouds_in_another_frame_are_moved_with_the_pose_at_their_time() -> None:
    """The double's frames are 1 m apart along x and y, so that a part of the cloud leaves the region."""
    parameters = {"type": "pointcloud", "robot": "mana", "region": "bbox:0,0,4,4"}
    dpm = TwoClouds(frame="mana/odom")
    found, _ = finder(dpm).find(request(**parameters), ("mana",), 1e9)
    assert found is not None
    assert dpm.poses[0] == ("mana", "site", "mana/odom", 98 * S)
    assert found[0].frame == "site"
    np.testing.assert_allclose(found[0].value.points_m.min(axis=0), [1.25, 1.25, 0.0])
    assert found[0].moved_by is not None


@pytest.mark.parametrize(("frame", "is_used"), [("mana/base", True), ("site", False)])
def test_a_cloud_without_a_fixed_position_is_searched_without_the_region(frame: str, is_used: bool) -> None:
    class OutsideOfRegions(TwoClouds):
        def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
            items = super().search(until_s, **parameters)
            return [] if "region" in parameters else items

    dpm = OutsideOfRegions(frame=frame)
    parameters = {"type": "pointcloud", "robot": "mana", "region": "bbox:0,0,4,4"}
    found, _ = finder(dpm).find(request(**parameters), ("mana",), 1e9)
    assert (found is not None) == is_used
    assert [(search.get("region"), search.get("frame")) for search in dpm.searches] == [
        ("bbox:0,0,4,4", "site"),
        (None, None),
    ]


@pytest.mark.parametrize("product", ["dem", "pointcloud", "navigation_map"])
def test_a_region_without_products_has_no_match_and_coverage_0(product: str) -> None:
    class Nothing(DpmDouble):
        def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
            return []

    found, reason = finder(Nothing()).find(
        request(type=product, robot="mana", region="bbox:0,0,1,1"), ("mana",), 1e9
    )
    assert found is None
    assert reason == f"the DPM holds no {product} of mana in the region (coverage 0)"


def test_the_distance_of_a_region_is_that_of_its_farthest_corner_from_the_robot() -> None:
    dpm = DpmDouble()
    located = finder(dpm)
    for region, distance_m in (
        ("bbox:0,0,4,5", 5.0),
        ("bbox:-2,-3,1,2", 5.0),
        ("near:mana/base,2", 2.0 * 2**0.5),
    ):
        distance = located.distance_m(request(type="dem", region=region), "mana", 1e9)
        assert distance == pytest.approx(distance_m), region
    assert dpm.poses[0] == ("mana", "site", "mana/base", None)
    assert located.distance_m(request(type="dem"), "mana", 1e9) is None
    dpm.pose_error = FrameNotFoundError("no pose")
    assert located.distance_m(request(type="dem", region="bbox:0,0,4,5"), "mana", 1e9) is None
