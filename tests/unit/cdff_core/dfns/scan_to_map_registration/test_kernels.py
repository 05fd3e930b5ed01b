# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled kernels of the registration with voxel planes against numpy and against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.scan_to_map_registration import _kernels as kernels
from cdff_core.dfns.scan_to_map_registration import _voxel_table as voxels
from cdff_core.dfns.scan_to_map_registration._voxel_table import VoxelTable

VOXEL_M, KERNEL_M = 1.0, 0.3
NOISE_M = np.array([0.05, 0.1])


def tilted_points(rng: np.random.Generator, count: int, corner: tuple[float, ...] = (0, 0, 0)) -> np.ndarray:
    """Return noisy points near a tilted plane through the voxel with a corner."""
    xy = rng.uniform(0.02, 0.98, (count, 2))
    z = 0.4 + 0.2 * xy[:, 0] - 0.1 * xy[:, 1] + rng.normal(0, 0.01, count)
    return np.c_[xy, z] + np.array(corner)


def table_of(*clouds: np.ndarray, voxel: float = VOXEL_M, max_points: int = 1000) -> VoxelTable:
    table = voxels.empty_table(256)
    voxels.add(table, np.vstack(clouds), voxel, max_points)
    return table


def row(table: VoxelTable, *cell: int) -> int:
    index = int(voxels.row_of(table.keys, voxels.pack(*cell)))
    assert table.keys[index] != voxels.EMPTY
    return index


def plane_of(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean, eigenvalues of the covariance and normal of points."""
    values, vectors = np.linalg.eigh(np.cov(points.T, bias=True))
    return points.mean(axis=0), values, vectors[:, 0]


@pytest.fixture
def ground(rng: np.random.Generator) -> VoxelTable:
    """Table of 4 x 4 voxels with tilted planes."""
    return table_of(*(tilted_points(rng, 40, (i, j, 0)) for i in range(-2, 2) for j in range(-2, 2)))


def test_a_voxel_has_the_plane_of_its_points_and_of_each_half(rng: np.random.Generator) -> None:
    points = tilted_points(rng, 41, (-3.0, 2.0, 5.0))
    table = table_of(points)
    plane = table.planes[row(table, -3, 2, 5)]
    mean, values, normal = plane_of(points)
    np.testing.assert_allclose(plane[voxels.MEAN : voxels.MEAN + 3], mean, atol=1e-9)
    assert plane[voxels.VARIANCE] == pytest.approx(values[0], rel=1e-6)
    assert plane[voxels.ANGLE_VARIANCE] == pytest.approx(10.0 / (41 * values[1]), rel=1e-6)
    fitted = plane[voxels.NORMAL : voxels.NORMAL + 3]
    assert abs(fitted @ normal) == pytest.approx(1.0, abs=1e-9)
    for column, half in ((voxels.FIRST_NORMAL, points[::2]), (voxels.SECOND_NORMAL, points[1::2])):
        of_half = plane[column : column + 3]
        assert of_half @ fitted > 0.99
        assert abs(of_half @ plane_of(half)[2]) == pytest.approx(1.0, abs=1e-9)


def test_lines_clusters_and_few_points_have_no_plane(rng: np.random.Generator) -> None:
    points = tilted_points(rng, 30)
    line = np.c_[points[:, 0], np.full(30, 0.5), points[:, 0]]
    cluster = 0.5 + 0.04 * (points - points.mean(axis=0))
    cube = rng.uniform(0.1, 0.9, (30, 3))
    for without_plane in (line, cluster, cube, points[:5]):
        table = table_of(without_plane)
        assert table.planes[row(table, 0, 0, 0), voxels.VARIANCE] < 0.0
    with_plane = table_of(points[:6])
    assert with_plane.planes[row(with_plane, 0, 0, 0), voxels.VARIANCE] >= 0.0


def test_a_voxel_keeps_its_first_points_only(rng: np.random.Generator) -> None:
    points = tilted_points(rng, 40)
    table = table_of(points, max_points=20)
    plane = table.planes[row(table, 0, 0, 0)]
    assert table.counts[row(table, 0, 0, 0), :2].tolist() == [10, 10]
    np.testing.assert_allclose(plane[:3], points[:20].mean(axis=0), atol=1e-9)
    assert table.used[0] == 1


def test_a_plane_is_fitted_again_when_its_points_have_grown_by_a_quarter(rng: np.random.Generator) -> None:
    points = tilted_points(rng, 8)
    table = table_of(points[:6])
    at = row(table, 0, 0, 0)
    voxels.add(table, points[6:7], VOXEL_M, 1000)
    np.testing.assert_allclose(table.planes[at, :3], points[:6].mean(axis=0), atol=1e-9)
    voxels.add(table, points[7:], VOXEL_M, 1000)
    np.testing.assert_allclose(table.planes[at, :3], points.mean(axis=0), atol=1e-9)


def test_voxels_within_the_radius_are_copied(ground: VoxelTable) -> None:
    near = voxels.empty_table(256)
    voxels.copy_near(ground, near, np.array([0.5, 0.5, 0.5]), 1.0, VOXEL_M)
    cells = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]
    assert near.used[0] == np.count_nonzero(near.keys != voxels.EMPTY) == len(cells)
    for cell in cells:
        before, after = row(ground, *cell), row(near, *cell)
        for name in ("counts", "sums", "planes"):
            np.testing.assert_array_equal(getattr(near, name)[after], getattr(ground, name)[before])


def test_the_first_finite_point_of_each_voxel_remains(rng: np.random.Generator) -> None:
    points = rng.uniform(-3.0, 3.0, (2000, 3))
    points[::7] = np.nan
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    _, first = np.unique(np.floor(points[finite] / 0.5), axis=0, return_index=True)
    np.testing.assert_array_equal(voxels.first_in_voxels(points, 0.5), np.sort(finite[first]))


@pytest.mark.parametrize("angle_rad", [1e-3, 9e-3, 1.2e-2, 0.7])
def test_a_point_is_moved_by_the_motion_after_its_measurement(
    angle_rad: float, rng: np.random.Generator
) -> None:
    theta, rho, point = angle_rad * np.array([0.6, 0.0, -0.8]), rng.normal(size=3), rng.normal(size=3)
    for fraction in (-1.0, -0.3, 0.0):
        moved_point = np.empty(3)
        kernels.deskew_point(point, fraction, theta, rho, moved_point)
        expected = se3.exp_so3(fraction * theta) @ point + fraction * rho
        np.testing.assert_allclose(moved_point, expected, atol=1e-10)


@pytest.mark.parametrize("offset", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])
def test_a_plane_is_searched_in_the_voxel_of_a_point_and_in_those_with_a_common_face(
    offset: tuple[int, int, int], rng: np.random.Generator
) -> None:
    table = table_of(tilted_points(rng, 30, (3, 4, 5)))
    centre = np.array([3.5, 4.5, 5.5])
    expected = (0, row(table, 3, 4, 5))
    assert kernels.nearest_plane((table,), VOXEL_M, 0, *centre) == expected
    assert kernels.nearest_plane((table,), VOXEL_M, 0, *(centre + offset)) == expected
    assert kernels.nearest_plane((table,), VOXEL_M, 0, *(centre + 2 * np.array(offset)))[1] == -1
    beside_an_edge = centre + offset + np.roll(offset, 1)
    assert kernels.nearest_plane((table,), VOXEL_M, 0, *beside_an_edge) == (1, -1)


def test_the_nearest_mean_and_the_finest_level_with_a_plane_are_preferred(
    rng: np.random.Generator,
) -> None:
    left, right = tilted_points(rng, 30), tilted_points(rng, 30, (1, 0, 0))
    fine, coarse = table_of(left, right), table_of(left, right, voxel=2.0)
    both = (fine, coarse)
    assert kernels.nearest_plane(both, VOXEL_M, 0, 0.95, 0.5, 0.5) == (0, row(fine, 0, 0, 0))
    assert kernels.nearest_plane(both, VOXEL_M, 0, 1.05, 0.5, 0.5) == (0, row(fine, 1, 0, 0))
    assert kernels.nearest_plane(both, VOXEL_M, 1, 0.95, 0.5, 0.5) == (1, row(coarse, 0, 0, 0))
    assert kernels.nearest_plane(both, VOXEL_M, 0, 0.5, 0.5, 2.5) == (1, row(coarse, 0, 0, 0))
    assert kernels.nearest_plane(both, VOXEL_M, 0, 0.5, 0.5, 9.0) == (2, -1)


def matched(table: VoxelTable, point: np.ndarray) -> tuple[np.ndarray, float, float, float]:
    """Return plane, signed distance, weight and support of a point of the finest level."""
    _, at = kernels.nearest_plane((table,), VOXEL_M, 0, *point)
    plane = table.planes[at]
    offset = point - plane[:3]
    r = float(plane[voxels.NORMAL : voxels.NORMAL + 3] @ offset)
    support = (KERNEL_M**2 / (KERNEL_M**2 + r**2)) ** 2
    angle_part = plane[voxels.ANGLE_VARIANCE] * (offset @ offset - r * r)
    variance = (NOISE_M[0] ** 2 + plane[voxels.VARIANCE]) * (1.0 + angle_part)
    return plane, r, support * NOISE_M[0] ** 2 / variance, support


def sensor_points(rng: np.random.Generator, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return points off the ground by up to 0.2 m in the frame of the sensor."""
    points = np.c_[rng.uniform(-1.8, 1.8, (50, 2)), rng.uniform(0.3, 0.7, 50)]
    return (points - t) @ R


def test_the_normal_equations_are_those_of_finite_differences(
    ground: VoxelTable, rng: np.random.Generator
) -> None:
    R, t = se3.exp_so3(np.array([0.1, -0.2, 0.3])), np.array([0.2, -0.1, 0.8])
    points, fractions = sensor_points(rng, R, t), rng.uniform(-1.0, 0.0, 50)
    zero = np.zeros(3)
    H, b, sums, level_sums = kernels.normal_equations(
        (ground,), VOXEL_M, 0, points, fractions, R, t, zero, zero, KERNEL_M, NOISE_M
    )
    expected_H, expected_b, expected_sums = np.zeros((12, 12)), np.zeros(12), np.zeros(5)
    for q, f in zip(points, fractions, strict=True):
        plane, r, w, support = matched(ground, R @ q + t)
        J = np.empty(12)
        for i, step in enumerate(1e-6 * np.eye(12)):
            moved = se3.exp_so3(f * step[9:]) @ q + f * step[6:9]
            moved = se3.exp_so3(step[3:6]) @ R @ moved + t + step[:3]
            J[i] = (plane[voxels.NORMAL : voxels.NORMAL + 3] @ (moved - plane[:3]) - r) / 1e-6
        expected_H += w * np.outer(J, J)
        expected_b += w * r * J
        expected_sums += [w, 1.0, w * r * r, w * q @ q, support]
    np.testing.assert_allclose(H, expected_H, atol=1e-4)
    np.testing.assert_allclose(b, expected_b, atol=1e-5)
    np.testing.assert_allclose(sums, expected_sums, rtol=1e-9)
    np.testing.assert_allclose(level_sums[0, 0], expected_sums[4], rtol=1e-9)
    squared = [(r, s) for _, r, _, s in (matched(ground, R @ q + t) for q in points)]
    assert level_sums[0, 1] == pytest.approx(sum(s * r * r for r, s in squared), rel=1e-9)


def test_the_support_is_the_mean_weight_of_the_kernel(ground: VoxelTable, rng: np.random.Generator) -> None:
    R, t = se3.exp_so3(np.array([0.1, -0.2, 0.3])), np.array([0.2, -0.1, 0.8])
    points = np.vstack([sensor_points(rng, R, t), np.full((10, 3), 50.0)])
    poses = np.array([se3.transform(R, t), se3.transform(R, t + 0.1)])
    fractions = rng.uniform(-1.0, 0.0, len(points))
    motions = np.array([np.zeros(6), [0.1, 0.05, -0.05, 0.02, -0.03, 0.04]])
    expected = []
    for T, motion in zip(poses, motions, strict=True):
        turned = se3.exp_so3(fractions[:, None] * motion[3:]) @ points[:, :, None]
        in_map = se3.transform_points(T, turned[:, :, 0] + fractions[:, None] * motion[:3])
        expected.append(sum(matched(ground, p)[3] for p in in_map[:50]) / len(points))
    supports = kernels.supports((ground,), VOXEL_M, 0, points, fractions, poses, motions, KERNEL_M)
    np.testing.assert_allclose(supports, expected, rtol=1e-9)


def test_the_common_information_is_that_on_which_both_halves_agree(
    ground: VoxelTable, rng: np.random.Generator
) -> None:
    R, t, radius_m = se3.exp_so3(np.array([0.1, -0.2, 0.3])), np.array([0.2, -0.1, 0.8]), 3.0
    points = sensor_points(rng, R, t)
    H, X, total = kernels.common_information(
        (ground,), VOXEL_M, points, R, t, KERNEL_M, NOISE_M, radius_m, 40
    )
    expected_H, expected_X, weights = np.zeros((6, 6)), np.zeros((6, 6)), 0.0
    for q in points:
        plane, _, w, _ = matched(ground, R @ q + t)
        normals = [plane[c : c + 3] for c in (voxels.FIRST_NORMAL, voxels.SECOND_NORMAL)]
        a, b = (np.r_[n, np.cross(R @ q, n) / radius_m] for n in normals)
        expected_H += 0.5 * w * (np.outer(a, a) + np.outer(b, b))
        expected_X += 0.5 * w * (np.outer(a, b) + np.outer(b, a))
        weights += w
    assert total == pytest.approx(weights, rel=1e-9)
    np.testing.assert_allclose(H, expected_H / weights, atol=1e-9)
    np.testing.assert_allclose(X, expected_X / weights, atol=1e-9)
    assert kernels.common_information(
        (ground,), VOXEL_M, points, R, t, KERNEL_M, NOISE_M, radius_m, 41
    )[2] == 0.0  # fmt: skip
