# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Place search by elevation correlation: accuracy and separation of the candidates, refused scans."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.place_search.interface import PlaceSearchInputs
from tests.support.mapped_hills import Hills


def search(map_points: np.ndarray, scan: np.ndarray, **config: object) -> Any:
    node = Registry.default().make_dfn("place_search")
    node.configure(config)
    return node.process(PlaceSearchInputs(map_points=map_points, sweep_points=scan))


@pytest.mark.parametrize("seed", range(5))
def test_the_first_candidate_is_within_the_convergence_range_of_registration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hills = Hills(seed)
    T = hills.pose(*rng.uniform(-20, 20, 2), rng.uniform(-np.pi, np.pi))
    outputs = search(hills.map(rng, 0.4), hills.scan(rng, T))
    E = se3.inverse(T) @ outputs.transforms[0]
    assert np.linalg.norm(E[:3, 3]) < 2.0
    assert np.degrees(se3.rotation_angle(E[:3, :3])) < 15.0
    assert np.all(np.diff(outputs.residuals_m) >= 0.0)
    assert outputs.searched > 10_000


def test_candidates_differ_in_position_or_heading(rng: np.random.Generator) -> None:
    hills = Hills()
    outputs = search(hills.map(rng, 0.4), hills.scan(rng, hills.pose(0, 0, 0)), candidates=10)
    for i, A in enumerate(outputs.transforms):
        for B in outputs.transforms[:i]:
            distance_m = np.linalg.norm(A[:3, 3] - B[:3, 3])
            rotation_deg = np.degrees(se3.rotation_angle(A[:3, :3].T @ B[:3, :3]))
            assert distance_m > 2.0 or rotation_deg > 12.0


def test_a_map_smaller_than_the_scan_gives_no_candidates(rng: np.random.Generator) -> None:
    hills = Hills()
    whole_map = hills.map(rng, 0.4)
    small_map = whole_map[(np.abs(whole_map[:, 0]) < 1.0) & (np.abs(whole_map[:, 1]) < 1.0)]
    assert len(search(small_map, hills.scan(rng, hills.pose(0, 0, 0))).transforms) == 0


def ring(
    rng: np.random.Generator, low_m: float, high_m: float, count: int, T_robot_map: np.ndarray
) -> np.ndarray:
    """Return points of the plane z = 0 of the map around the robot, in its frame."""
    angle, distance_m = rng.uniform(0, 2 * np.pi, count), rng.uniform(low_m, high_m, count)
    points = np.column_stack([distance_m * np.cos(angle), distance_m * np.sin(angle), np.zeros(count)])
    return se3.transform_points(T_robot_map, points)


def test_tilt_and_height_above_a_plane_are_exact_despite_objects_on_the_ground(
    rng: np.random.Generator,
) -> None:
    x, y = np.meshgrid(np.arange(-30.0, 30.0, 0.25), np.arange(-30.0, 30.0, 0.25))
    plane = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    T_map_robot = se3.transform(se3.exp_so3([0.08, -0.05, 0.0]), [0.0, 0.0, 1.5])
    scan = ring(rng, 0.5, 15.0, 2000, se3.inverse(T_map_robot))
    scan[:150, 2] += rng.uniform(0.3, 1.0, 150)  # objects
    outputs = search(plane, scan)
    assert len(outputs.transforms) == 6
    np.testing.assert_allclose(outputs.transforms[:, 2, 3], 1.5, atol=0.02)
    expected = se3.inverse(T_map_robot)[:3, 2]  # the vertical in the frame of the robot
    np.testing.assert_allclose(outputs.transforms[:, 2, :3], np.tile(expected, (6, 1)), atol=0.005)


@pytest.mark.parametrize(("low_m", "high_m"), [(7.0, 11.0), (11.0, 11.9)])
def test_the_ground_is_searched_within_twice_the_radius(
    rng: np.random.Generator, low_m: float, high_m: float
) -> None:
    T_robot_map = se3.transform(np.eye(3), [0.0, 0.0, -1.0])
    x, y = np.meshgrid(np.arange(-30.0, 30.0, 0.25), np.arange(-30.0, 30.0, 0.25))
    plane = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    outputs = search(plane, ring(rng, low_m, high_m, 300, T_robot_map), foot_m=6.0)
    np.testing.assert_allclose(outputs.transforms[:, 2, 3], 1.0, atol=1e-3)
    with pytest.raises(RefusedError, match="fewer than 30 points within 12 m"):
        search(plane, ring(rng, 12.1, 14.0, 300, T_robot_map), foot_m=6.0)


def test_29_points_of_ground_are_too_few_and_30_are_sufficient(rng: np.random.Generator) -> None:
    far = ring(rng, 13.0, 17.0, 100, np.eye(4))
    near = ring(rng, 1.0, 5.0, 30, np.eye(4))
    map_points = ring(rng, 0.0, 40.0, 5000, np.eye(4))
    search(map_points, np.vstack([near, far]))
    with pytest.raises(RefusedError, match="fewer than 30"):
        search(map_points, np.vstack([near[:29], far]))


def test_a_scan_without_ground_is_refused(rng: np.random.Generator) -> None:
    distant_object = rng.normal([30.0, 0.0, 0.0], 1.0, (100, 3))
    with pytest.raises(RefusedError, match="of the robot"):
        search(Hills().map(rng, 0.5), distant_object)


def test_invalid_clouds_are_refused() -> None:
    with pytest.raises(InputError, match="map"):
        search(np.zeros((3, 2)), np.zeros((40, 3)))
