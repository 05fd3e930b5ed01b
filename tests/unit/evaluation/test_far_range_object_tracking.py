# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bound of the error of centroids, and the tables of the page."""

from __future__ import annotations

import numpy as np
import pytest

from evaluation.far_range_object_tracking import table
from evaluation.scenes.star_frames import centroid_bound_px


def test_the_bound_of_a_wide_point_spread_is_that_of_a_gaussian_in_white_noise() -> None:
    # Winick (1986): the square root of 2 times the width over the signal-to-noise ratio.
    assert centroid_bound_px(10.0, spread_px=2.0) == pytest.approx(np.sqrt(2.0) * 2.0 / 10.0, rel=0.02)


def test_photon_noise_raises_the_bound_of_bright_sources_most() -> None:
    ratios = [centroid_bound_px(snr, noise_ratio=0.05) / centroid_bound_px(snr) for snr in (5.0, 20.0)]
    assert 1.0 < ratios[0] < ratios[1]


def test_the_tables_contain_the_recorded_parts_only() -> None:
    centroid = {
        "rms_px": 0.2235,
        "over_bound": 1.162,
        "over_bound_without_photon_noise": 1.179,
        "squared_error": 2.12,
        "sources": 396,
    }
    text = table({"centroids": {"seed": 921, "snr_5": centroid}})
    assert "| 5 | 396 | 0.224 | 1.16 | 1.18 | 2.12 |" in text
    assert "photograph" not in text
