# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keypoints: the direction of the grey-value centroid, and the image that describes a point."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cdff_core.imaging.keypoints import centroid_angles, sift_keypoints


def test_the_centroid_is_that_of_a_disc_with_repeated_edges(rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (30, 40)).astype(np.uint8)
    points = np.array([[20.2, 14.7], [0.0, 0.0], [39.0, 29.0], [3.4, 28.0]])
    padded = np.pad(image, 10, mode="edge").astype(np.float64)
    y, x = np.mgrid[-10:11, -10:11]
    disc = x**2 + y**2 <= 100
    for (column, row), angle_deg in zip(
        np.rint(points).astype(int), centroid_angles(image, points), strict=True
    ):
        patch = padded[row : row + 21, column : column + 21] * disc
        expected = np.degrees(np.arctan2((patch * y).sum(), (patch * x).sum())) % 360.0
        assert angle_deg == pytest.approx(expected, abs=1e-9)


def test_the_angle_is_clockwise_from_the_direction_of_the_columns() -> None:
    image = np.zeros((41, 41), np.uint8)
    image[20:, :] = 200  # brighter below
    assert centroid_angles(image, np.array([[20.0, 20.0]]))[0] == pytest.approx(90.0)


@pytest.mark.parametrize(
    ("size_px", "octave", "layer"),
    [
        (0.5, 0, 0),
        (3.2, 0, 0),
        (4.0, 0, 1),
        (5.0, 0, 2),
        (6.4, 1, 0),
        (8.0, 1, 1),
        (12.8, 2, 0),
        (102.4, 5, 0),
    ],
)
def test_a_point_is_described_in_the_smallest_image_with_its_blur(
    size_px: float, octave: int, layer: int
) -> None:
    keypoint = sift_keypoints(np.array([[7.5, 3.25]]), np.array([size_px]), np.array([30.0]))[0]
    assert (keypoint.octave & 255, keypoint.octave >> 8) == (octave, layer)
    assert (keypoint.pt, keypoint.angle, keypoint.class_id) == ((7.5, 3.25), 30.0, 0)
    assert keypoint.size == pytest.approx(size_px)


def test_descriptors_of_the_next_octave_agree_with_those_of_the_last_layer(rng: np.random.Generator) -> None:
    """Both have the blur of 3.2 px; the smaller image has a quarter of the pixels."""
    noise = rng.normal(size=(200, 200))
    image = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3.0), None, 0, 255, cv2.NORM_MINMAX).astype(
        np.uint8
    )
    points = rng.uniform(60.0, 140.0, (30, 2))
    keypoints = sift_keypoints(points, np.full(30, 6.4), np.zeros(30))
    last_layer = [cv2.KeyPoint(*p, 6.4, 0.0, 0.0, 3 << 8, i) for i, p in enumerate(points.tolist())]
    sift = cv2.SIFT.create()
    small, large = (sift.compute(image, points)[1] for points in (keypoints, last_layer))
    distances = np.linalg.norm(small - large, axis=1)
    between_points = np.linalg.norm(large[:-1] - large[1:], axis=1)
    assert np.median(distances) < 0.3 * np.median(between_points)
