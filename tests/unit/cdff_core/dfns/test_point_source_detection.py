# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.stars import add_sources
from cdff_core.dfns.point_source_detection.interface import (
    PointSourceDetectionInputs,
    PointSourceDetectionOutputs,
)
from cdff_core.dfns.point_source_detection.matched_filter import MatchedFilter

SHAPE, SPREAD = (256, 320), np.eye(2) * 0.49


def detected(residual: np.ndarray, **config: float) -> PointSourceDetectionOutputs:
    dfn = MatchedFilter()
    dfn.configure(config)
    return dfn.process(
        PointSourceDetectionInputs(
            residual=residual.astype(np.float32),
            noise=np.ones(residual.shape, np.float32),
            mask=np.zeros(residual.shape, np.uint8),
            point_spread=SPREAD,
        )
    )


def sky(pixels: np.ndarray, snr: float, seed: int = 1) -> np.ndarray:
    image = np.random.default_rng(seed).normal(0.0, 1.0, SHAPE).astype(np.float32)
    flux = snr * np.sqrt(4.0 * np.pi * (0.49 + 1.0 / 12.0))
    add_sources(image, pixels, np.full(len(pixels), flux), 0.7)
    return image


def grid() -> np.ndarray:
    u, v = np.meshgrid(np.arange(20, 300, 20), np.arange(20, 240, 20))
    return np.column_stack([u.ravel(), v.ravel()]) + np.random.default_rng(4).uniform(-0.5, 0.5, (u.size, 2))


def test_sources_well_above_the_limit_are_all_found_within_half_a_pixel() -> None:
    pixels = grid()
    sources = detected(sky(pixels, 9.0), min_snr=5.0)
    distances = np.linalg.norm(sources.points[None] - pixels[:, None], axis=2).min(axis=1)
    assert distances.max() < 0.6
    assert np.median(sources.snr) == pytest.approx(9.0, rel=0.07)
    assert (np.diff(sources.snr) <= 0.0).all()


def test_the_number_of_false_sources_is_that_of_maxima_of_filtered_noise() -> None:
    counts = [len(detected(sky(np.zeros((0, 2)), 0.0, seed), min_snr=4.0).points) for seed in range(20)]
    # Maxima of a Gaussian field with the correlation of the filter above 4 sigma: 5e-5 to 1e-4 a pixel.
    assert 2.0 < np.mean(counts) < 10.0


def test_a_body_is_one_extended_source_at_its_centre_and_a_bright_star_is_a_point() -> None:
    image = sky(np.array([[60.0, 60.0]]), 300.0)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    image[(u - 200) ** 2 + (v - 120) ** 2 < 12.0**2] += 25.0
    sources = detected(image, min_snr=5.0)
    extended = np.flatnonzero(sources.is_extended)
    assert len(extended) == 1
    assert sources.points[extended[0]] == pytest.approx([200.0, 120.0], abs=0.3)
    assert sources.areas[extended[0]] == pytest.approx(np.pi * 144.0, rel=0.1)
    assert sources.boxes[extended[0]] == pytest.approx([188, 212, 108, 132], abs=2)
    star = np.linalg.norm(sources.points - 60.0, axis=1).argmin()
    assert not sources.is_extended[star]


def test_too_many_maxima_and_a_wrong_point_spread_are_refused() -> None:
    with pytest.raises(RefusedError, match="sources, expected at most 10"):
        detected(sky(grid(), 9.0), max_sources=10)
    with pytest.raises(InputError, match=r"pointSpread.*positive definite"):
        detected_with(np.diag([1.0, -1.0]))


def detected_with(spread: np.ndarray) -> PointSourceDetectionOutputs:
    dfn = MatchedFilter()
    dfn.configure()
    image = np.zeros(SHAPE, np.float32)
    return dfn.process(
        PointSourceDetectionInputs(
            residual=image, noise=image + 1, mask=np.zeros(SHAPE, np.uint8), point_spread=spread
        )
    )


def test_the_filter_follows_a_smeared_point_spread() -> None:
    image = np.random.default_rng(5).normal(0.0, 1.0, SHAPE).astype(np.float32)
    add_sources(image, [[150.0, 100.0]], [60.0], 0.7, [8.0, 4.0])
    smeared = np.eye(2) * 0.5 + np.outer([8.0, 4.0], [8.0, 4.0]) / 12.0
    dfn = MatchedFilter()
    dfn.configure({"min_snr": 4.0})
    ratios = []
    for spread in (SPREAD, smeared):
        sources = dfn.process(
            PointSourceDetectionInputs(
                residual=image,
                noise=np.ones(SHAPE, np.float32),
                mask=np.zeros(SHAPE, np.uint8),
                point_spread=spread,
            )
        )
        near = np.linalg.norm(sources.points - [150.0, 100.0], axis=1) < 5.0
        ratios.append(sources.snr[near].max(initial=0.0))
    assert ratios[1] > 1.3 * ratios[0]
