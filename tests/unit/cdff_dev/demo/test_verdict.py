# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The judge of the demonstration finds what is wrong with an answer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region, parse_region
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap, Pointcloud, PoseTrajectory, TransformWithCovariance
from cdff_dev.demo.script import Ask
from cdff_dev.demo.verdict import Delivered, faults

S = 1_000_000_000
REGION = parse_region("bbox:0,0,2,2")


def ask(product: str, **wishes: Any) -> Ask:
    return Ask(type=product, at_s=0, robot="mana", max_age_s=2, deadline_ms=1000, **wishes)


def pose(parent: str = "site", child: str = "mana/base") -> Delivered:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4)), parent=parent, child=child, stamp_ns=10 * S
    )
    return Delivered(value, parent, child, 10 * S)


def dem(observed: float = 1.0, resolution_m: float = 0.5, xmin_m: float = 0.0) -> Delivered:
    cells = round(2 / resolution_m)
    mean = np.zeros((cells, cells), np.float32)
    mean.ravel()[round(observed * mean.size) :] = np.nan
    geometry = GridGeometry("site", resolution_m, xmin_m, 2.0, cells, cells)
    return Delivered(
        ElevationMap.from_layers(geometry, {"mean": mean}, t0_ns=9 * S, t1_ns=10 * S), "site", None, 10 * S
    )


def found(wish: Ask, delivered: Delivered, region: Region | None = None, now_s: int = 11) -> str:
    return "; ".join(faults(wish, delivered, now_s * S, region))


def test_answers_that_are_as_asked_have_no_faults() -> None:
    assert found(ask("pose"), pose()) == ""
    assert found(ask("dem", resolution_m=0.5, min_coverage=0.9), dem(), REGION) == ""


def test_an_answer_that_is_too_old_is_found() -> None:
    assert "3.0 s old" in found(ask("pose"), pose(), now_s=13)


def test_another_type_frame_or_robot_is_found() -> None:
    assert "type ElevationMap, expected TransformWithCovariance" in found(ask("pose"), dem())
    assert "expected mana/base in site" in found(ask("pose"), pose(child="minnie/base"))
    assert "frame mana/odom, expected site" in found(ask("pose"), pose(parent="mana/odom"))


@pytest.mark.parametrize("resolution_m", [0.25, 1.0])
def test_cells_of_another_size_are_found(resolution_m: float) -> None:
    assert "expected 0.5 m" in found(ask("dem", resolution_m=0.5), dem(resolution_m=resolution_m), REGION)


def test_too_little_coverage_and_data_outside_are_found() -> None:
    assert "coverage 0.50" in found(ask("dem", min_coverage=0.9), dem(observed=0.5), REGION)
    assert "cells outside the region" in found(ask("dem"), dem(xmin_m=1.0), REGION)
    assert "no cell is observed" in found(ask("dem"), dem(observed=0.0), REGION)


def test_a_navigation_map_that_knows_nothing_is_found() -> None:
    geometry = GridGeometry("site", 0.5, 0.0, 2.0, 4, 4)
    value = NavigationMap.from_layers(geometry, {"class": np.zeros((4, 4), np.uint8)}, t0_ns=0, t1_ns=10 * S)
    assert "no cell is observed" in found(ask("navigation_map"), Delivered(value, "site", None, 10 * S), REGION)


def test_a_cloud_that_is_empty_or_elsewhere_is_found() -> None:
    inside = np.full((200, 3), 1.0)
    cloud = Pointcloud.from_points(inside, frame="site", stamp_ns=10 * S)
    good = Delivered(cloud, "site", None, 10 * S)
    assert found(ask("pointcloud"), good, REGION) == ""
    far = Pointcloud.from_points(inside + 5.0, frame="site", stamp_ns=10 * S)
    assert "outside the region" in found(ask("pointcloud"), replace(good, value=far), REGION)
    few = Pointcloud.from_points(inside[:3], frame="site", stamp_ns=10 * S)
    assert "3 points" in found(ask("pointcloud"), replace(good, value=few), REGION)


def test_a_trajectory_of_one_pose_is_found() -> None:
    value = PoseTrajectory.from_arrays(
        np.array([10 * S]), np.eye(4)[None], np.zeros((1, 6, 6)), parent="site", child="mana/base"
    )
    assert "1 poses" in found(ask("trajectory"), Delivered(value, "site", "mana/base", 10 * S))
