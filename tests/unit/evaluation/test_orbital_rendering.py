# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Distances of silhouettes from edges, and the correlation with photographs of the comet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from evaluation.orbital_rendering import comet, silhouette_distance_px, table


def disc(radius_px: float, shift_px: float = 0.0) -> np.ndarray:
    """Return the image (200, 240) of a white disc on black, with soft edges."""
    v, u = np.mgrid[0:200, 0:240]
    sharp = 200.0 * (np.hypot(u - 120.0 - shift_px, v - 100.0) < radius_px)
    return np.asarray(cv2.GaussianBlur(sharp.astype(np.float32), (0, 0), 1.0))


def test_the_distance_of_a_silhouette_is_the_difference_of_radii() -> None:
    mask = disc(50.0) > 100.0
    assert silhouette_distance_px(mask, disc(50.0)) <= 0.5
    assert silhouette_distance_px(mask, disc(55.0)) == pytest.approx(5.0, abs=0.6)
    assert silhouette_distance_px(mask, disc(44.0)) == pytest.approx(6.0, abs=0.6)


def test_the_table_has_all_parts() -> None:
    figures = {
        "comet": {"images": 60, "median_correlation": 0.9711, "smallest_correlation": 0.95},
        "silhouettes": {"images": 25, "median_px": 4.0, "largest_px": 9.0},
        "cost": {
            "coverage": 0.24,
            "frames_per_cpu_s": 27.7,
            "images_per_cpu_s": 13.0,
            "lidar_coverage": 0.1,
            "lidar_beams_per_cpu_s": 7_500_000,
            "lidar_rays_cast_per_cpu_s": 12_600_000,
        },
    }
    text = table(figures)
    assert "| 60 | 0.971 | 0.950 |" in text
    assert "12.6 · 10⁶" in text


@pytest.mark.slow
def test_renderings_of_the_comet_correlate_with_its_photographs(real_data: Callable[[str], Path]) -> None:
    figures = comet(real_data("rosetta_67p/truth.csv").parent.parent)
    assert figures["median_correlation"] >= 0.97
    assert figures["smallest_correlation"] >= 0.93
