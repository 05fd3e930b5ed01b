# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of SHOT on a few points: frames, variances and each bin follow the published definition."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cdff_core.dfns.features_description_3d._shot_kernels import arctangent, histograms, local_frames

Array = np.ndarray
RADIUS_M = 1.5


def within(points: Array, keypoints: Array) -> tuple[Array, Array]:
    """Return start and index of the neighbours of each keypoint within the radius."""
    rows = [np.flatnonzero(np.linalg.norm(points - q, axis=1) <= RADIUS_M) for q in keypoints]
    return np.cumsum([0, *map(len, rows)]), np.concatenate([*rows, np.zeros(0, np.int64)]).astype(np.int64)


def unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize("seed", range(6))
def test_frames_and_variances_are_those_of_the_weighted_scatter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(40, 3)) * [1.0, 0.7, 0.3] + [0.2, -0.1, 0.1]
    keypoints = rng.normal(0.0, 0.3, (4, 3))
    start, index = within(points, keypoints)
    frames, variance = local_frames(points, keypoints, start, index, RADIUS_M)
    for k, q in enumerate(keypoints):
        offset = points[index[start[k] : start[k + 1]]] - q
        weight = RADIUS_M - np.linalg.norm(offset, axis=1)
        values, vectors = np.linalg.eigh((weight[:, None] * offset).T @ offset / weight.sum())
        np.testing.assert_allclose(variance[k], values, rtol=1e-9)
        axes = []
        for vector in (vectors[:, 2], vectors[:, 0]):
            s = offset @ vector
            majority = np.sum(s > 0) - np.sum(s < 0)
            axes.append(vector * (1.0 if (majority or s.sum()) > 0 else -1.0))
        x, z = axes
        np.testing.assert_allclose(frames[k], [x, np.cross(z, x), z], atol=1e-8)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_axes_point_to_the_side_of_more_neighbours_or_of_the_larger_sum(sign: float) -> None:
    """One far neighbour against two near ones; one against one; the keypoint itself is on neither side."""
    for along in ([-1.2, 0.3, 0.4], [-0.3, 0.9], [-0.9, 0.3, 0.0]):
        offset = np.array([[sign * a, 0.0, 0.0] for a in along] + [[0.0, 0.5, 0.1], [0.0, -0.5, 0.1]])
        start = np.array([0, len(offset)])
        frames, variance = local_frames(offset, np.zeros((1, 3)), start, np.arange(len(offset)), RADIUS_M)
        s = np.array(along)
        majority = np.sum(s > 0) - np.sum(s < 0)
        expected = sign if (majority or s.sum()) > 0 else -sign
        np.testing.assert_allclose(frames[0, 0], [expected, 0.0, 0.0], atol=1e-12)
        assert variance[0, 1] < variance[0, 2]
        np.testing.assert_allclose(np.linalg.det(frames[0]), 1.0)


def test_without_weight_there_is_no_frame() -> None:
    """No neighbour, or one at the radius only: the weights sum up to zero."""
    points, keypoints = np.array([[1.5, 0.0, 0.0]]), np.zeros((3, 3))
    start, index = np.array([0, 0, 1, 1]), np.zeros(1, np.int64)
    frames, variance = local_frames(points, keypoints, start, index, RADIUS_M)
    assert not frames.any()
    assert not variance.any()
    frames, _ = local_frames(points, keypoints, start, index, RADIUS_M + 1e-6)
    np.testing.assert_allclose(np.abs(frames[1, 0]), [1.0, 0.0, 0.0], atol=1e-9)
    assert not frames[0].any()


def histogram(offset: Array, normals: Array, axes: Array, signed: bool) -> Array:
    """Return the histogram (352,): each bin gets ``max(0, 1 - d)`` of each dimension, d in bin spacings."""
    azimuths = -np.pi + (np.arange(8) + 0.5) * np.pi / 4
    elevations = np.array([-np.pi / 4, np.pi / 4])
    shells = np.array([0.25, 0.75]) * RADIUS_M
    h = np.zeros((8, 2, 2, 11))
    for p, n in zip(offset, normals, strict=True):
        x, y, z = axes @ p
        distance = np.linalg.norm(p)
        if distance < 1e-12 * RADIUS_M:
            continue
        cosine = axes[2] @ n if signed else 2.0 * abs(axes[2] @ n) - 1.0
        cosine = min(max(cosine, -1.0), 1.0)
        turn = np.abs((np.arctan2(y, x) - azimuths + np.pi) % (2 * np.pi) - np.pi)
        h += np.einsum(
            "a,e,r,c->aerc",
            np.maximum(1.0 - turn / (np.pi / 4), 0.0),
            np.maximum(1.0 - np.abs(np.arctan2(z, np.hypot(x, y)) - elevations) / (np.pi / 2), 0.0),
            np.maximum(1.0 - np.abs(distance - shells) / (0.5 * RADIUS_M), 0.0),
            np.maximum(1.0 - np.abs(cosine - (-1.0 + 0.2 * np.arange(11))) / 0.2, 0.0),
        )
    norm = np.linalg.norm(h)
    return h.ravel() / norm if norm else h.ravel()


def assert_histograms(offsets: list[Array], normals: Array, axes: Array, signed: bool) -> None:
    """Compare the histograms of keypoints with the given neighbours, the same normals for each."""
    keypoints = np.array([[10.0 * k, 1.0, -2.0] for k in range(len(offsets))])
    points = np.concatenate([o + q for o, q in zip(offsets, keypoints, strict=True)])
    start = np.cumsum([0, *map(len, offsets)])
    all_normals = np.concatenate([normals[: len(o)] for o in offsets])
    frames = np.tile(axes, (len(offsets), 1, 1))
    out = histograms(points, all_normals, keypoints, frames, start, np.arange(len(points)), RADIUS_M, signed)
    assert out.dtype == np.float32
    for k, q in enumerate(keypoints):
        exact = points[start[k] : start[k + 1]] - q
        expected = histogram(exact, all_normals[start[k] : start[k + 1]], axes, signed)
        np.testing.assert_allclose(out[k], expected, atol=2e-7)


@pytest.mark.parametrize("signed", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_histograms_follow_the_definition(seed: int, signed: bool) -> None:
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    offsets = [unit(rng.normal(size=(n, 3))) * rng.uniform(0.0, RADIUS_M, (n, 1)) for n in (1, 30, 7, 0, 12)]
    assert_histograms(offsets, unit(rng.normal(size=(30, 3))), axes, signed)


@pytest.mark.parametrize("signed", [True, False])
def test_each_direction_distance_and_cosine_has_its_bins(signed: bool) -> None:
    """Single neighbours along the axes, at centres and borders of bins, at the keypoint and at the radius."""
    axes = np.eye(3)
    degrees = np.radians(np.arange(0.0, 360.0, 22.5))
    offsets = [np.array([[math.cos(a), math.sin(a), 0.1]]) for a in degrees]
    offsets += [RADIUS_M * f * np.array([[0.6, 0.0, 0.8]]) for f in (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)]
    offsets += [np.array([[0.5 * math.cos(e), 0.0, 0.5 * math.sin(e)]]) for e in np.linspace(-1.57, 1.57, 9)]
    offsets += [np.array([[0.0, 0.0, 0.7]]), np.array([[0.0, 0.0, -0.7]]), np.array([[1e-13, 0.0, 0.0]])]
    for cosine in (-1.0, -0.9, -0.2, 0.0, 0.1, 0.99, 1.0):
        normal = np.array([[math.sqrt(1.0 - cosine**2), 0.0, cosine]])
        assert_histograms(offsets, normal, axes, signed)


def test_normals_longer_than_one_are_in_the_outermost_bins() -> None:
    offsets = [np.array([[0.5, 0.2, 0.3]])]
    for z in (1.2, -1.2):
        for signed in (True, False):
            assert_histograms(offsets, np.array([[0.0, 0.0, z]]), np.eye(3), signed)


def test_the_arctangent_is_that_of_the_library_within_a_billionth() -> None:
    angles = np.concatenate([np.linspace(-np.pi, np.pi, 401), np.arange(-8, 9) * np.pi / 8])
    for scale in (1e-200, 1.0, 1e100):
        for angle in angles:
            y, x = scale * math.sin(angle), scale * math.cos(angle)
            assert arctangent(y, x) == pytest.approx(math.atan2(y, x), abs=1e-9)
    assert arctangent(0.0, 0.0) == 0.0
    assert arctangent(0.0, -1.0) == pytest.approx(math.pi)
    assert arctangent(2.0, 0.0) == pytest.approx(0.5 * math.pi)
    assert arctangent(-2.0, 0.0) == pytest.approx(-0.5 * math.pi)
