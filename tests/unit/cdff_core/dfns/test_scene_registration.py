# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_core.dfns.scene_registration.interface import SceneRegistrationInputs
from cdff_core.dfns.scene_registration.sparse_flow import SparseFlow
from tests.support.distant_scene import Body, DistantScene


def registered(previous: np.ndarray, current: np.ndarray):
    node = SparseFlow()
    node.configure()
    return node.process(SceneRegistrationInputs(previous=previous, current=current))


def test_a_camera_at_rest_is_recognised_in_spite_of_noise_and_a_moving_body() -> None:
    scene = DistantScene([Body((60.0, 80.0), (4.0, 0.0), (40, 30))])
    registration = registered(scene.image(0), scene.image(1))
    assert registration.is_at_rest
    assert np.array_equal(registration.homography, np.eye(3))
    assert registration.places[70, 100].tolist() == [100.0, 70.0]


def test_the_places_follow_a_camera_that_turns_and_not_a_body_in_view() -> None:
    scene = DistantScene([Body((120.0, 80.0), (5.0, 0.0), (24, 20))], pan_px=3.3)
    registration = registered(scene.image(0), scene.image(1))
    assert not registration.is_at_rest
    u = np.arange(20, 220)
    error = registration.places[80, u, 0] - (u + 3.3)
    assert np.abs(error).max() < 0.4
    assert np.sqrt(np.mean(error**2)) < 0.15
    assert np.abs(registration.places[80, u, 1] - 80.0).max() < 0.3
    assert registration.sigma.min() > 0.0


def test_images_without_texture_and_of_other_size_are_refused() -> None:
    flat = np.full((100, 120), 90, np.uint8)
    with pytest.raises(RefusedError, match="0 points, expected at least 12"):
        registered(flat, flat)
    with pytest.raises(InputError, match="with r=100 of previous"):
        registered(flat, flat[:50])
