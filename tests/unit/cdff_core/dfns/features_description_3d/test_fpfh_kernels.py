# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled histograms of FPFH on a few points follow the published definition."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.features_description_3d._fpfh_kernels import simplified_histograms, weighted_histograms

Array = np.ndarray


def angles(p: Array, n_p: Array, q: Array, n_q: Array) -> tuple[float, float, float] | None:
    """Return theta, alpha and phi of a pair in the Darboux frame of its origin (Rusu et al. 2009)."""
    line = (q - p) / np.linalg.norm(q - p)
    source, u, n_t = p, n_p, n_q
    if abs(n_q @ line) > abs(n_p @ line):
        source, u, n_t, line = q, n_q, n_p, -line
    v = np.cross(line, u)
    if np.linalg.norm(v) < 1e-12:
        return None
    v /= np.linalg.norm(v)
    w = np.cross(u, v)
    assert source is p or source is q
    return float(np.arctan2(w @ n_t, u @ n_t)), float(v @ n_t), float(u @ line)


def spfh(points: Array, normals: Array, row: int, near: Array) -> Array:
    out, count = np.zeros((3, 11)), 0
    for q in near:
        if np.array_equal(points[q], points[row]):
            continue
        pair_angles = angles(points[row], normals[row], points[q], normals[q])
        if pair_angles is None:
            continue
        count += 1
        for histogram, value in zip(
            out,
            ((pair_angles[0] / np.pi + 1) / 2, (pair_angles[1] + 1) / 2, (pair_angles[2] + 1) / 2),
            strict=True,
        ):
            histogram[min(int(value * 11), 10)] += 1.0
    return 100.0 * out.ravel() / max(count, 1)


def cloud(seed: int, n: int = 25) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    points[3] = points[4]  # coincident points have no direction
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_simplified_histograms_count_the_three_angles_of_each_pair(seed: int) -> None:
    points, normals = cloud(seed)
    rows = np.array([0, 3, 4, 9, 24])
    neighbours = [
        np.arange(25),
        np.array([3, 4]),
        np.array([4, 1, 3, 7]),
        np.zeros(0, np.int64),
        np.array([2, 5]),
    ]
    start, index = np.cumsum([0, *map(len, neighbours)]), np.concatenate(neighbours)
    out = simplified_histograms(points, normals, rows, start, index)
    for k, row in enumerate(rows):
        np.testing.assert_allclose(out[k], spfh(points, normals, row, neighbours[k]), rtol=1e-12)


def test_extreme_angles_are_in_the_outermost_bins_and_parallel_pairs_are_not_counted() -> None:
    points = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    start, index = np.array([0, 1]), np.array([1])
    x, y, z = np.eye(3)
    for n_p, n_q in ((z, z), (z, 0.0 - z), (z, y), (z, 0.0 - y), (x, y), (y, x)):
        normals = np.array([n_p, n_q])
        out = simplified_histograms(points, normals, np.array([0]), start, index)
        np.testing.assert_allclose(out[0], spfh(points, normals, 0, index))
        assert out.sum() == pytest.approx(0.0 if 1.0 in (n_p[0], n_q[0]) else 300.0)


def test_histograms_are_weighted_by_the_inverse_squared_distance_and_scaled_to_100() -> None:
    rng = np.random.default_rng(4)
    points, keypoints = rng.normal(size=(9, 3)), rng.normal(size=(3, 3))
    keypoints[1] = points[2]
    histograms = rng.random((6, 33))
    histograms[:, 22:] = 0.0
    spfh_row = rng.integers(0, 6, 9)
    neighbours = [np.array([0, 1, 5, 8]), np.array([2, 3]), np.zeros(0, np.int64)]
    start, index = np.cumsum([0, *map(len, neighbours)]), np.concatenate(neighbours)
    out = weighted_histograms(points, keypoints, histograms, spfh_row, start, index)
    for k, near in enumerate(neighbours):
        d2 = np.sum((points[near] - keypoints[k]) ** 2, axis=1)
        expected = sum(
            (histograms[spfh_row[q]] / d for q, d in zip(near, d2, strict=True) if d > 0), np.zeros(33)
        )
        for part in expected.reshape(3, 11):
            part *= 100.0 / part.sum() if part.sum() > 0.0 else 1.0
        np.testing.assert_allclose(out[k], expected, rtol=1e-12)
