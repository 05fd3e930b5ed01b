# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of MatchedFilter: maxima against a comparison of all neighbours, owners of regions."""

from __future__ import annotations

import numpy as np

from cdff_core.dfns.point_source_detection._kernels import local_maxima, measure_regions
from cdff_core.point_sources.regions import AREA


def test_maxima_are_those_above_all_neighbours_and_the_threshold() -> None:
    rng = np.random.default_rng(2)
    image = rng.integers(0, 6, (30, 40)).astype(np.float32)  # with many equal neighbours
    noise = rng.uniform(0.5, 1.5, image.shape).astype(np.float32)
    expected = []
    for r in range(1, 29):
        for c in range(1, 39):
            window = image[r - 1 : r + 2, c - 1 : c + 2].ravel()
            first = int(np.argmax(window))  # of equal neighbours, the first in reading order
            if first == 4 and image[r, c] > 2.0 * 0.8 * noise[r, c]:
                expected.append((r, c))
    assert len(expected) > 40
    pixels, snr, count = local_maxima(image, noise, 2.0, 0.8, 1000)
    assert [tuple(p) for p in pixels.tolist()] == expected
    np.testing.assert_allclose(snr, [image[p] / (0.8 * noise[p]) for p in expected], rtol=1e-6)
    assert count == len(expected)
    few, few_snr, all_of_them = local_maxima(image, noise, 2.0, 0.8, 7)
    assert [tuple(p) for p in few.tolist()] == expected[:7]
    assert (len(few_snr), all_of_them) == (7, len(expected))


def test_a_maximum_at_the_threshold_is_none() -> None:
    image = np.zeros((5, 5), np.float32)
    image[2, 2] = 3.0
    ones = np.ones_like(image)
    assert local_maxima(image, ones, 3.0, 1.0, 9)[2] == 0
    assert local_maxima(image, ones, 2.99, 1.0, 9)[2] == 1


def test_a_maximum_in_the_region_of_a_brighter_one_belongs_to_that_one() -> None:
    residual = np.zeros((20, 20), np.float32)
    residual[5:8, 5:11] = 50.0
    residual[6, 6], residual[6, 9] = 100.0, 80.0
    residual[15, 15], residual[15, 4] = 100.0, 8.0
    ones, labels = np.ones_like(residual), np.zeros(residual.shape, np.int32)
    pixels = np.array([[6, 6], [15, 15], [6, 9], [15, 4]])
    regions, owner = measure_regions(
        residual, ones, np.zeros(residual.shape, np.uint8), pixels, np.array([100.0, 10.0, 80.0, 8.0]), 10.0,
        5.0, labels,
    )  # fmt: skip
    assert owner.tolist() == [0, 1, 0, 3]
    assert regions[:, AREA].tolist() == [18.0, 1.0, 0.0, 0.0]
    assert (labels == 1).sum() == 18
    assert labels[15, 15] == 2
    assert labels[15, 4] == 0  # faint: without a region


def test_a_bright_maximum_whose_pixel_is_at_the_threshold_has_no_region() -> None:
    residual = np.zeros((9, 9), np.float32)
    residual[4, 4] = 5.0
    labels = np.zeros(residual.shape, np.int32)
    regions, owner = measure_regions(
        residual, np.ones_like(residual), np.zeros((9, 9), np.uint8), np.array([[4, 4]]), np.array([99.0]),
        10.0, 5.0, labels,
    )  # fmt: skip
    assert owner.tolist() == [0]
    assert not regions.any()
    assert not labels.any()
