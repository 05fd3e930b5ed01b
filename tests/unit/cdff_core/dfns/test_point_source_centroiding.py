# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.stars import add_sources
from cdff_core.dfns.point_source_centroiding.interface import (
    PointSourceCentroidingInputs,
    PointSourceCentroidingOutputs,
)
from cdff_core.dfns.point_source_centroiding.point_spread_fit import PointSpreadFit
from evaluation.scenes.star_frames import centroid_bound_px

SIDE, SPREAD_PX = 21, 0.7


def fitted(
    image: np.ndarray, points: np.ndarray, spread: np.ndarray | None = None
) -> PointSourceCentroidingOutputs:
    dfn = PointSpreadFit()
    dfn.configure({"floor_px": 0.0})
    return dfn.process(
        PointSourceCentroidingInputs(
            residual=image.astype(np.float32),
            noise=np.ones(image.shape, np.float32),
            points=points,
            point_spread=np.eye(2) * SPREAD_PX**2 if spread is None else spread,
        )
    )


def scene(snr: float, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    image = rng.normal(0.0, 1.0, (SIDE, SIDE * count)).astype(np.float32)
    centres = np.column_stack([SIDE * np.arange(count) + 10.0, np.full(count, 10.0)])
    centres += rng.uniform(-0.5, 0.5, centres.shape)
    add_sources(image, centres, np.full(count, snr * np.sqrt(4 * np.pi * (0.49 + 1 / 12))), SPREAD_PX)
    return image, centres


@pytest.mark.parametrize("snr", [5.0, 8.0, 20.0])
def test_errors_are_near_the_bound_and_agree_with_the_covariance(snr: float) -> None:
    image, centres = scene(snr, 1500, 3)
    result = fitted(image, centres + 0.2)
    error = result.centroids - centres
    usable = np.isfinite(error).all(axis=1)
    assert usable.mean() > 0.99
    rms_px = np.sqrt((error[usable] ** 2).mean())
    assert rms_px < 1.2 * centroid_bound_px(snr, SPREAD_PX)
    nees = np.einsum("ni,nij,nj->n", error[usable], np.linalg.inv(result.covariances[usable]), error[usable])
    assert 1.6 < nees.mean() < 2.6
    assert np.nanmean(result.snr) == pytest.approx(snr, rel=0.05)


def test_a_single_bright_pixel_is_a_defect_and_a_star_is_not() -> None:
    image, centres = scene(9.0, 300, 4)
    assert fitted(image, centres).is_single_pixel.mean() < 0.02
    hot = np.random.default_rng(5).normal(0.0, 1.0, image.shape)
    places = np.column_stack([SIDE * np.arange(300) + 10, np.full(300, 10)])
    hot[10, places[:, 0]] += 12.0
    result = fitted(hot, places.astype(float))
    assert result.is_single_pixel.mean() > 0.95
    assert np.median(result.defect_evidence) > 0.0


def test_the_shape_of_bright_sources_is_measured() -> None:
    image, centres = scene(60.0, 9, 6)
    spreads = fitted(image, centres, np.eye(2)).spreads
    assert np.nanmedian(spreads[:, 0]) == pytest.approx(0.49, rel=0.15)
    assert np.isnan(fitted(*scene(8.0, 4, 7)).spreads).all()


def test_a_source_at_the_border_or_without_light_is_nan() -> None:
    image = np.zeros((SIDE, SIDE))
    assert np.isnan(fitted(image, np.array([[10.0, 10.0], [-3.0, 5.0]])).centroids).all()


def test_a_point_spread_that_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(InputError, match=r"pointSpread.*positive definite"):
        fitted(np.zeros((SIDE, SIDE)), np.zeros((1, 2)), np.diag([1.0, 0.0]))
