# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import DistanceImage, Frame
from cdff_core.visual_map.keyframe_points import points_of_depth, points_of_pair, registered_depth
from cdff_dev.map_building.build import localisation_features
from tests.support import textured_walls as walls


def test_points_of_a_pair_lie_on_the_walls() -> None:
    extractor, match = localisation_features()
    points = points_of_pair(walls.pair(np.eye(4)), extractor, match)
    assert len(points) > 100
    deviation = np.abs(points.positions_m[:, 2, None] - [4.0, 2.5]).min(axis=1)
    assert np.mean(deviation < 3.0 * points.depth_sigmas_m) > 0.9
    assert points.descriptors.shape == (len(points), 128)


def _depth(offset_m: float = 0.0) -> DistanceImage:
    """Return the depth image of a wall at 4 m; the scale is that of another focal length than the image's."""
    return DistanceImage(
        width=400,
        height=300,
        scale_x=1 / 280.0,
        scale_y=1 / 280.0,
        center_x=-200 / 280.0,
        center_y=-150 / 280.0,
        data=np.full(400 * 300, 4.0 - offset_m),
    )


def test_a_depth_image_of_another_camera_gives_the_depths_of_the_features() -> None:
    extractor, _ = localisation_features()
    image = Frame.from_image(walls.view(np.eye(4)), stamp_ns=0, camera_matrix=walls.K)
    T = np.eye(4)
    T[2, 3] = 0.5
    points = points_of_depth(image, _depth(0.5), extractor, T)
    assert len(points) > 100
    np.testing.assert_allclose(points.positions_m[:, 2], 4.0)
    registered = registered_depth(image, _depth(0.5), T)
    assert registered.shape == (240, 320)
    assert np.median(registered) == pytest.approx(4.0)


def test_a_depth_image_of_another_size_than_stated_is_refused() -> None:
    extractor, _ = localisation_features()
    image = Frame.from_image(walls.view(np.eye(4)), stamp_ns=0, camera_matrix=walls.K)
    with pytest.raises(InputError, match="expected 3 x 5"):
        points_of_depth(image, DistanceImage(width=3, height=5), extractor, np.eye(4))


def test_a_depth_image_without_measurements_gives_no_points() -> None:
    extractor, _ = localisation_features()
    image = Frame.from_image(walls.view(np.eye(4)), stamp_ns=0, camera_matrix=walls.K)
    assert not len(
        points_of_depth(image, DistanceImage(width=2, height=1, data=np.zeros(2)), extractor, np.eye(4))
    )
