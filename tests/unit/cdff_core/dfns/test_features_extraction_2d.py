# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.features_extraction_2d.adaptive_fast import AdaptiveFast
from cdff_core.dfns.features_extraction_2d.grid_fast import GridFast
from cdff_core.dfns.features_extraction_2d.grid_gftt import GridGftt
from cdff_core.dfns.features_extraction_2d.interface import (
    FeaturesExtraction2DInputs,
    FeaturesExtraction2DInterface,
)
from cdff_core.dfns.features_extraction_2d.orb import Orb
from cdff_core.dfns.features_extraction_2d.sift import Sift
from tests.support.corridor import texture

GRID_DETECTORS = pytest.mark.parametrize("implementation", [GridGftt, GridFast])


def make_node(implementation: type[FeaturesExtraction2DInterface]) -> FeaturesExtraction2DInterface:
    dfn = implementation()
    dfn.configure({"features": 200})
    return dfn


@GRID_DETECTORS
def test_features_cover_the_image_at_the_minimum_distance(implementation: type) -> None:
    image = np.clip(texture(5, 256), 0, 255).astype(np.uint8)
    features = make_node(implementation).process(FeaturesExtraction2DInputs(image=image)).features
    assert 80 <= len(features) <= 260
    quadrants = np.bincount((features[:, 0] < 128) + 2 * (features[:, 1] < 128), minlength=4)
    assert min(quadrants) > 12
    gaps = np.linalg.norm(features[:, None] - features[None], axis=-1) + 1e9 * np.eye(len(features))
    assert gaps.min() > 2.0
    assert features.min() >= 12
    assert features.max() < 256 - 12


@GRID_DETECTORS
def test_a_corner_is_located_exactly_and_a_flat_image_has_none(implementation: type) -> None:
    image = np.full((100, 100), 50, np.uint8)
    assert len(make_node(implementation).process(FeaturesExtraction2DInputs(image=image)).features) == 0
    image[40:, 60:] = 200
    image[40, 60] = 255  # FAST ignores a corner with a neighbour of equal strength
    features = make_node(implementation).process(FeaturesExtraction2DInputs(image=image)).features
    assert np.linalg.norm(features - [60, 40], axis=1).min() < 3.0


@GRID_DETECTORS
def test_a_colour_image_is_refused(implementation: type) -> None:
    with pytest.raises(InputError, match="uint8"):
        make_node(implementation).process(FeaturesExtraction2DInputs(image=np.zeros((64, 64, 3), np.uint8)))


@pytest.mark.parametrize("implementation", [AdaptiveFast, Sift, Orb])
def test_other_detectors_refuse_colour_images_and_find_nothing_in_a_flat_image(implementation: type) -> None:
    dfn = make_node(implementation)
    assert len(dfn.process(FeaturesExtraction2DInputs(image=np.full((100, 100), 50, np.uint8))).features) == 0
    with pytest.raises(InputError, match="uint8"):
        dfn.process(FeaturesExtraction2DInputs(image=np.zeros((64, 64, 3), np.uint8)))


def test_adaptive_suppression_keeps_features_in_low_contrast_regions() -> None:
    image = np.clip(texture(5, 256), 0, 255)
    image[:, :128] = 40 + (image[:, :128] - 40) * 0.3  # the left half has a third of the contrast
    features = (
        make_node(AdaptiveFast).process(FeaturesExtraction2DInputs(image=image.astype(np.uint8))).features
    )
    assert 100 <= len(features) <= 200
    assert np.mean(features[:, 0] < 128) > 0.25


def test_sift_estimates_the_size_and_position_of_blobs() -> None:
    y, x = np.mgrid[:200, :200]
    image = np.full((200, 200), 60.0)
    for cx, cy, sigma in ((60.3, 70.6, 4.0), (140.0, 120.0, 8.0)):
        image += 150.0 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2.0 * sigma**2))
    out = make_node(Sift).process(FeaturesExtraction2DInputs(image=image.astype(np.uint8)))
    for cx, cy, sigma in ((60.3, 70.6, 4.0), (140.0, 120.0, 8.0)):
        distance_px = np.hypot(out.features[:, 0] - cx, out.features[:, 1] - cy)
        best = int(np.argmin(distance_px + np.abs(out.sizes - 2.0 * sigma)))
        assert distance_px[best] < 0.5
        assert out.sizes[best] == pytest.approx(2.0 * sigma, rel=0.25)


@pytest.mark.parametrize("implementation", [GridGftt, GridFast, AdaptiveFast, Sift, Orb])
def test_a_mask_excludes_points_and_leaves_the_others(implementation: type) -> None:
    image = np.clip(texture(5, 256), 0, 255).astype(np.uint8)
    mask = np.ones((256, 256), bool)
    mask[:, :100] = False
    features = make_node(implementation).process(FeaturesExtraction2DInputs(image=image, mask=mask)).features
    assert len(features) > 40
    assert features[:, 0].min() > 99.0 - 2.0  # sub-pixel refinement


def test_a_mask_of_another_size_is_refused() -> None:
    with pytest.raises(InputError, match="mask"):
        FeaturesExtraction2DInputs(image=np.zeros((64, 64), np.uint8), mask=np.ones((32, 64), bool))
