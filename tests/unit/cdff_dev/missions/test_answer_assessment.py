# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The assessment of an answer reports its faults."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region, parse_region
from cdff_common.interfaces.product import Header
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap, Pointcloud, PoseTrajectory, TransformWithCovariance
from cdff_dev.missions.answer_assessment import assess_answer
from cdff_dev.missions.script import TimedRequest

S = 1_000_000_000
REGION = parse_region("bbox:0,0,2,2")


def timed_request(product: str, **parameters: Any) -> TimedRequest:
    return TimedRequest(type=product, at_s=0, robot="mana", max_age_s=2, deadline_ms=1000, **parameters)


@dataclass(frozen=True)
class DecodedAnswer:
    """The value of an answer, and the fields of its header that are assessed."""

    value: Any
    frame: str
    t1_ns: int = 10 * S


def pose(parent: str = "site", child: str = "mana/base") -> DecodedAnswer:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4)), parent=parent, child=child, stamp_ns=10 * S
    )
    return DecodedAnswer(value, parent)


def dem(observed: float = 1.0, resolution_m: float = 0.5, xmin_m: float = 0.0) -> DecodedAnswer:
    cells = round(2 / resolution_m)
    mean = np.zeros((cells, cells), np.float32)
    mean.ravel()[round(observed * mean.size) :] = np.nan
    geometry = GridGeometry("site", resolution_m, xmin_m, 2.0, cells, cells)
    return DecodedAnswer(
        ElevationMap.from_layers(geometry, {"mean": mean}, t0_ns=9 * S, t1_ns=10 * S), "site"
    )


def faults_of(
    request: TimedRequest, delivered: DecodedAnswer, region: Region | None = None, now_s: int = 11
) -> str:
    header = Header("", 0, delivered.t1_ns, delivered.t1_ns, delivered.frame, "test")
    return "; ".join(assess_answer(request, delivered.value, header, now_s * S, region))


def test_answers_that_satisfy_the_request_have_no_faults() -> None:
    assert faults_of(timed_request("pose"), pose()) == ""
    assert faults_of(timed_request("dem", resolution_m=0.5, min_coverage=0.9), dem(), REGION) == ""


def test_an_answer_older_than_requested_is_detected() -> None:
    assert "3.0 s old" in faults_of(timed_request("pose"), pose(), now_s=13)


def test_a_wrong_type_frame_or_robot_is_detected() -> None:
    assert "type ElevationMap, expected TransformWithCovariance" in faults_of(timed_request("pose"), dem())
    assert "expected mana/base in site" in faults_of(timed_request("pose"), pose(child="minnie/base"))
    assert "frame mana/odom, expected site" in faults_of(timed_request("pose"), pose(parent="mana/odom"))


@pytest.mark.parametrize("resolution_m", [0.25, 1.0])
def test_a_wrong_cell_size_is_detected(resolution_m: float) -> None:
    assert "expected 0.5 m" in faults_of(
        timed_request("dem", resolution_m=0.5), dem(resolution_m=resolution_m), REGION
    )


def test_insufficient_coverage_and_data_outside_are_detected() -> None:
    assert "coverage 0.50" in faults_of(timed_request("dem", min_coverage=0.9), dem(observed=0.5), REGION)
    assert "cells outside the region" in faults_of(timed_request("dem"), dem(xmin_m=1.0), REGION)
    assert "no cell is observed" in faults_of(timed_request("dem"), dem(observed=0.0), REGION)


def test_a_navigation_map_without_observed_cells_is_detected() -> None:
    geometry = GridGeometry("site", 0.5, 0.0, 2.0, 4, 4)
    value = NavigationMap.from_layers(geometry, {"class": np.zeros((4, 4), np.uint8)}, t0_ns=0, t1_ns=10 * S)
    assert "no cell is observed" in faults_of(
        timed_request("navigation_map"), DecodedAnswer(value, "site"), REGION
    )


def test_an_empty_or_misplaced_cloud_is_detected() -> None:
    inside = np.full((200, 3), 1.0)
    cloud = Pointcloud.from_points(inside, frame="site", stamp_ns=10 * S)
    good = DecodedAnswer(cloud, "site")
    assert faults_of(timed_request("pointcloud"), good, REGION) == ""
    far = Pointcloud.from_points(inside + 5.0, frame="site", stamp_ns=10 * S)
    assert "outside the region" in faults_of(timed_request("pointcloud"), replace(good, value=far), REGION)
    few = Pointcloud.from_points(inside[:3], frame="site", stamp_ns=10 * S)
    assert "3 points" in faults_of(timed_request("pointcloud"), replace(good, value=few), REGION)


def test_a_trajectory_of_one_pose_is_detected() -> None:
    value = PoseTrajectory.from_arrays(
        np.array([10 * S]), np.eye(4)[None], np.zeros((1, 6, 6)), parent="site", child="mana/base"
    )
    assert "1 poses" in faults_of(timed_request("trajectory"), DecodedAnswer(value, "site"))
