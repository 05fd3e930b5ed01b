# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Features of the point pairs, their table, and the votes for poses."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.partial_views.pair_voting import PairTable, _aligning_rotation, pair_table, vote

Array = np.ndarray


@pytest.mark.parametrize(
    "normal", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, -1), (2, 1, -3), (5, 1, 2), (0.7, 0.7, 0.1)]
)
def test_the_aligning_rotation_maps_a_normal_to_x(normal: tuple[float, float, float]) -> None:
    n = np.array(normal, dtype=np.float64) / np.linalg.norm(normal)
    R = _aligning_rotation(n)
    np.testing.assert_allclose(R @ n, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def feature(p: Array, n: Array, q: Array, m: Array, step_m: float, bins: int) -> int | None:
    """Return the number of a pair's distance and angles (Drost et al. 2010), 15 bins per angle."""
    offset = q - p
    distance = float(np.linalg.norm(offset))
    if distance < step_m or int(distance / step_m) >= bins:
        return None
    angles = [np.arccos(np.clip(c, -1.0, 1.0)) for c in (n @ offset / distance, m @ offset / distance, n @ m)]
    a, b, c = (min(int(angle / np.pi * 15), 14) for angle in angles)
    return ((int(distance / step_m) * 15 + a) * 15 + b) * 15 + c


def rotation_about_normal(n: Array, offset: Array) -> float:
    """Return the angle of an offset in the frame in which the normal is x."""
    local = _aligning_rotation(n) @ offset
    return float(np.arctan2(local[2], local[1]))


def unit_normals(rng: np.random.Generator, n: int) -> Array:
    normals = rng.normal(size=(n, 3))
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def test_the_table_has_all_ordered_pairs_by_feature() -> None:
    rng = np.random.default_rng(1)
    points, normals = rng.normal(size=(12, 3)), unit_normals(rng, 12)
    points[5] = points[4] + [0.1, 0.0, 0.0]  # closer than a step
    normals[1] = normals[0]
    table = pair_table(points, normals, 0.4)
    centre = points.mean(axis=0)
    assert table.diameter_m == pytest.approx(2.0 * np.linalg.norm(points - centre, axis=1).max())
    bins = int(table.diameter_m / 0.4) + 1
    assert len(table.start) == bins * 15**3 + 1
    expected: dict[int, list[tuple[int, float]]] = {}
    for i in range(12):
        for j in range(12):
            key = None if i == j else feature(points[i], normals[i], points[j], normals[j], 0.4, bins)
            if key is not None:
                angle = rotation_about_normal(normals[i], points[j] - points[i])
                expected.setdefault(key, []).append((i, angle))
    assert sum(map(len, expected.values())) == table.start[-1] == len(table.first)
    for key, pairs in expected.items():
        rows = slice(table.start[key], table.start[key + 1])
        assert table.first[rows].tolist() == [i for i, _ in pairs]
        np.testing.assert_allclose(table.rotation[rows], [angle for _, angle in pairs], atol=1e-12)


def votes_of(table: PairTable, points: Array, normals: Array, i: int, near: Array) -> Array:
    """Return the votes (model points, 36) of a reference point, smoothed along the rotation."""
    n = len(table.points_m)
    bins = int(table.diameter_m / table.step_m) + 1
    votes = np.zeros((n, 36))
    for j in near:
        key = None if j == i else feature(points[i], normals[i], points[j], normals[j], table.step_m, bins)
        if key is None:
            continue
        rows = np.arange(table.start[key], table.start[key + 1])
        if 0 < len(rows) <= n:
            scene_angle = rotation_about_normal(normals[i], points[j] - points[i])
            turn = np.rint((scene_angle - table.rotation[rows]) * 36 / (2 * np.pi)).astype(int) % 36
            np.add.at(votes, (table.first[rows], turn), 1.0 / np.sqrt(len(rows)))
    return votes + 0.5 * np.roll(votes, 1, axis=1) + 0.5 * np.roll(votes, -1, axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "in_plane", "noise_m"), [(2, 0, 0.0), (3, 0, 0.05), (4, 9, 0.05), (5, 9, 0.1)]
)
def test_the_poses_are_those_of_the_most_votes(seed: int, in_plane: int, noise_m: float) -> None:
    """Pairs in a plane have few features, which do not discriminate between points and do not vote."""
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(15, 3)), unit_normals(rng, 15)
    points[:in_plane, 2], normals[:in_plane] = 0.0, [0.0, 0.0, 1.0]
    table = pair_table(points, normals, 0.9 if in_plane else 0.5)
    assert (np.diff(table.start).max() > 15) == (in_plane > 0)
    T = se3.exp_se3(rng.normal(size=6))
    scene = se3.transform_points(T, points) + rng.normal(0.0, noise_m, (15, 3))
    scene_normals = normals @ T[:3, :3].T
    references = np.array([2, 7, 9])
    near = [np.arange(15), np.arange(5, 12), np.arange(0, 15, 2)]
    start, index = np.cumsum([0, *map(len, near)]), np.concatenate(near)
    poses = vote(table, scene, scene_normals, references, start, index, 3)
    assert poses.shape == (9, 4, 4)
    for r, i in enumerate(references):
        smooth = votes_of(table, scene, scene_normals, i, near[r])
        for peak in range(3):
            m, b = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
            turn = se3.exp_so3([2.0 * np.pi * b / 36, 0.0, 0.0])
            R = _aligning_rotation(scene_normals[i]).T @ turn @ _aligning_rotation(normals[m])
            pose = poses[3 * r + peak]
            np.testing.assert_allclose(pose, se3.transform(R, scene[i] - R @ points[m]), atol=1e-6)
            smooth[m, (b + np.arange(-2, 3)) % 36] = 0.0
    if noise_m == 0.0:
        assert np.linalg.norm(se3.log_so3(poses[0, :3, :3] @ T[:3, :3].T)) < np.radians(6.0)
