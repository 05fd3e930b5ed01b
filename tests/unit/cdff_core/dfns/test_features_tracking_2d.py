# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.features_tracking_2d._interface import FeaturesTracking2DInputs, FeaturesTracking2DInterface
from cdff_core.dfns.features_tracking_2d.pyramidal_klt import PyramidalKlt
from cdff_core.dfns.features_tracking_2d.warped_klt import WarpedKlt
from tests.corridor import texture

BOTH = pytest.mark.parametrize("implementation", [WarpedKlt, PyramidalKlt])
POINTS = np.stack(np.meshgrid(np.arange(60.0, 200.0, 20.0), np.arange(60.0, 200.0, 20.0)), axis=-1).reshape(-1, 2)
IMAGE = np.clip(texture(6, 256), 0, 255).astype(np.uint8)


def made(implementation: type[FeaturesTracking2DInterface]) -> FeaturesTracking2DInterface:
    dfn = implementation()
    dfn.configure()
    return dfn


@BOTH
def test_points_are_followed_over_more_than_a_patch_without_a_guess(implementation: type) -> None:
    moved = np.roll(IMAGE, (6, 11), axis=(0, 1))
    out = made(implementation).process(FeaturesTracking2DInputs(IMAGE, moved, POINTS))
    assert out.valid.mean() > 0.8
    assert np.percentile(np.abs(out.matches[out.valid] - POINTS[out.valid] - [11, 6]), 95) < 0.1


@BOTH
def test_points_of_another_image_are_not_found(implementation: type) -> None:
    other = np.clip(texture(7, 256), 0, 255).astype(np.uint8)
    out = made(implementation).process(FeaturesTracking2DInputs(IMAGE, other, POINTS))
    assert out.valid.mean() < 0.05


@BOTH
def test_half_the_light_changes_nothing(implementation: type) -> None:
    out = made(implementation).process(FeaturesTracking2DInputs(IMAGE, (IMAGE // 2 + 20).astype(np.uint8), POINTS))
    if implementation is WarpedKlt:
        assert out.valid.all()
    np.testing.assert_allclose(out.matches[out.valid], POINTS[out.valid], atol=0.1)


@BOTH
def test_no_points_give_no_matches_and_wrong_shapes_are_refused(implementation: type) -> None:
    dfn = made(implementation)
    assert len(dfn.process(FeaturesTracking2DInputs(IMAGE, IMAGE, np.zeros((0, 2)))).matches) == 0
    with pytest.raises(InputError):
        dfn.process(FeaturesTracking2DInputs(IMAGE, IMAGE, POINTS, POINTS[:3]))
