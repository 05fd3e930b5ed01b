# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.features_extraction_2d._interface import FeaturesExtraction2DInputs, FeaturesExtraction2DInterface
from cdff_core.dfns.features_extraction_2d.grid_fast import GridFast
from cdff_core.dfns.features_extraction_2d.grid_gftt import GridGftt
from tests.corridor import texture

BOTH = pytest.mark.parametrize("implementation", [GridGftt, GridFast])


def made(implementation: type[FeaturesExtraction2DInterface]) -> FeaturesExtraction2DInterface:
    dfn = implementation()
    dfn.configure({"features": 200})
    return dfn


@BOTH
def test_features_cover_the_whole_image_and_keep_their_distance(implementation: type) -> None:
    image = np.clip(texture(5, 256), 0, 255).astype(np.uint8)
    features = made(implementation).process(FeaturesExtraction2DInputs(image)).features
    assert 80 <= len(features) <= 260
    quadrants = np.bincount((features[:, 0] < 128) + 2 * (features[:, 1] < 128), minlength=4)
    assert min(quadrants) > 12
    gaps = np.linalg.norm(features[:, None] - features[None], axis=-1) + 1e9 * np.eye(len(features))
    assert gaps.min() > 2.0
    assert features.min() >= 12
    assert features.max() < 256 - 12


@BOTH
def test_a_corner_is_where_it_is_and_a_flat_image_has_none(implementation: type) -> None:
    image = np.full((100, 100), 50, np.uint8)
    assert len(made(implementation).process(FeaturesExtraction2DInputs(image)).features) == 0
    image[40:, 60:] = 200
    image[40, 60] = 255  # FAST drops a corner that is as strong as its neighbour
    features = made(implementation).process(FeaturesExtraction2DInputs(image)).features
    assert np.linalg.norm(features - [60, 40], axis=1).min() < 3.0


@BOTH
def test_a_colour_image_is_refused(implementation: type) -> None:
    with pytest.raises(InputError, match="uint8"):
        made(implementation).process(FeaturesExtraction2DInputs(np.zeros((64, 64, 3), np.uint8)))
