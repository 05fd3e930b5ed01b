# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.features_tracking_2d.interface import (
    FeaturesTracking2DInputs,
    FeaturesTracking2DInterface,
)
from cdff_core.dfns.features_tracking_2d.pyramidal_klt import PyramidalKlt
from cdff_core.dfns.features_tracking_2d.warped_klt import WarpedKlt
from tests.support.corridor import texture

TRACKERS = pytest.mark.parametrize("implementation", [WarpedKlt, PyramidalKlt])
POINTS = np.stack(np.meshgrid(np.arange(60.0, 200.0, 20.0), np.arange(60.0, 200.0, 20.0)), axis=-1).reshape(
    -1, 2
)
IMAGE = np.clip(texture(6, 256), 0, 255).astype(np.uint8)


def make_node(implementation: type[FeaturesTracking2DInterface]) -> FeaturesTracking2DInterface:
    dfn = implementation()
    dfn.configure()
    return dfn


@TRACKERS
def test_points_are_tracked_beyond_the_patch_size_without_a_guess(implementation: type) -> None:
    moved_image = np.roll(IMAGE, (6, 11), axis=(0, 1))
    out = make_node(implementation).process(
        FeaturesTracking2DInputs(reference=IMAGE, image=moved_image, features=POINTS)
    )
    assert out.valid.mean() > 0.8
    assert np.percentile(np.abs(out.matches[out.valid] - POINTS[out.valid] - [11, 6]), 95) < 0.1


@TRACKERS
def test_points_of_another_scene_are_not_tracked(implementation: type) -> None:
    other = np.clip(texture(7, 256), 0, 255).astype(np.uint8)
    out = make_node(implementation).process(
        FeaturesTracking2DInputs(reference=IMAGE, image=other, features=POINTS)
    )
    assert out.valid.mean() < 0.05


@TRACKERS
def test_halved_brightness_does_not_change_the_result(implementation: type) -> None:
    out = make_node(implementation).process(
        FeaturesTracking2DInputs(reference=IMAGE, image=(IMAGE // 2 + 20).astype(np.uint8), features=POINTS)
    )
    if implementation is WarpedKlt:
        assert out.valid.all()
    np.testing.assert_allclose(out.matches[out.valid], POINTS[out.valid], atol=0.1)


@TRACKERS
def test_no_points_give_no_matches_and_wrong_shapes_are_refused(implementation: type) -> None:
    dfn = make_node(implementation)
    assert (
        len(
            dfn.process(
                FeaturesTracking2DInputs(reference=IMAGE, image=IMAGE, features=np.zeros((0, 2)))
            ).matches
        )
        == 0
    )
    with pytest.raises(InputError):
        dfn.process(FeaturesTracking2DInputs(reference=IMAGE, image=IMAGE, features=POINTS, guess=POINTS[:3]))
