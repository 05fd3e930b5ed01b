# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_core.dfns.moving_region_detection.interface import (
    MovingRegionDetectionInputs,
    MovingRegionDetectionOutputs,
)
from cdff_core.dfns.moving_region_detection.registered_background import RegisteredBackground
from tests.support.distant_scene import CAMERA, Body, DistantScene


def node() -> RegisteredBackground:
    result = RegisteredBackground()
    result.configure()
    return result


def detected(
    detection: RegisteredBackground, image: np.ndarray, pan_px: float | None = 0.0
) -> MovingRegionDetectionOutputs:
    """Return the regions; ``pan_px`` None starts the background."""
    u, v = np.meshgrid(np.arange(image.shape[1]), np.arange(image.shape[0]))
    places = None if pan_px is None else np.stack([u + pan_px, v], axis=-1).astype(np.float32)
    return detection.process(
        MovingRegionDetectionInputs(image=image, places=places, is_at_rest=pan_px in (None, 0.0))
    )


def test_noise_and_exposure_give_no_region_and_a_body_gives_its_box() -> None:
    empty, scene = DistantScene([]), DistantScene([Body((120.0, 80.0), (0.0, 0.0))])
    detection = node()
    detected(detection, empty.image(0), None)
    for k in range(1, 12):
        assert len(detected(detection, (empty.image(k) * (1.0 + 0.02 * (k % 3))).astype(np.uint8)).boxes) == 0
    regions = detected(detection, scene.image(12))
    assert len(regions.boxes) == 1
    assert regions.centroids[0] == pytest.approx([120.0, 80.0], abs=0.25)
    assert regions.boxes[0] == pytest.approx([110.0, 130.0, 73.0, 87.0], abs=0.8)
    assert regions.areas[0] == pytest.approx(280.0, rel=0.1)
    assert regions.labels[80, 120] == 1
    assert regions.noise == pytest.approx(1.5, abs=0.5)


def test_the_place_that_an_object_has_left_is_no_region() -> None:
    scene, detection = DistantScene([Body((60.0, 80.0), (6.0, 0.0))]), node()
    detected(detection, scene.image(0), None)
    for k in range(1, 10):
        regions = detected(detection, scene.image(k))
    assert len(regions.boxes) == 1
    assert regions.centroids[0] == pytest.approx(scene.bodies[0].place(9), abs=0.5)


@pytest.mark.parametrize("has_departed", [True, False])
def test_a_smooth_object_before_rough_ground_is_not_learnt_as_background(has_departed: bool) -> None:
    """The object looks as if another one had left the ground, unless it is known to have moved there."""
    rng, detection = np.random.default_rng(3), node()
    v, u = np.mgrid[0 : CAMERA.rows, 0 : CAMERA.cols]
    ground = 100.0 + 30.0 * ((u // 3 + v // 3) % 2)
    box = (slice(70, 90), slice(100, 128))
    known = np.zeros(ground.shape, bool)
    known[67:93, 97:131] = True
    places = np.stack([u, v], axis=-1).astype(np.float32)
    for k in range(16):
        image = ground + rng.normal(0.0, 1.5, ground.shape)
        if k == 14:
            image[box] = 115.0
        regions = detection.process(
            MovingRegionDetectionInputs(
                image=image.clip(0, 255).astype(np.uint8),
                places=places if k else None,
                is_at_rest=True,
                excluded=known if k == 14 else None,
                departed=known if k == 14 and has_departed else None,
            )
        )
    assert (len(regions.boxes) == 0) == has_departed


def test_the_background_moves_with_the_camera() -> None:
    still, scene = DistantScene([], pan_px=2.5), DistantScene([Body((150.0, 80.0), (0.0, 0.0))], pan_px=2.5)
    detection = node()
    detected(detection, still.image(0), None)
    for k in range(1, 6):
        assert len(detected(detection, still.image(k), 2.5).boxes) == 0
    regions = detected(detection, scene.image(6), 2.5)
    assert len(regions.boxes) == 1
    assert regions.centroids[0] == pytest.approx([135.0, 80.0], abs=0.4)


def test_a_smooth_cloud_is_less_sharp_than_a_body() -> None:
    empty, body, detection = DistantScene([]), DistantScene([Body((60.0, 60.0), (0.0, 0.0))]), node()
    detected(detection, empty.image(0), None)
    detected(detection, empty.image(1))
    v, u = np.mgrid[0 : CAMERA.rows, 0 : CAMERA.cols]
    cloud = 40.0 * np.exp(-0.5 * ((u - 180) ** 2 + (v - 90) ** 2) / 12.0**2)
    regions = detected(detection, (body.image(2) + cloud).clip(0, 255).astype(np.uint8))
    by_side = {bool(c[0] > 120): s for c, s in zip(regions.centroids, regions.sharpness, strict=True)}
    assert by_side[True] < 0.12 < by_side[False]


@pytest.mark.parametrize(("level", "reason"), [(255, "saturated"), (0, "dark"), (30, "scene_changed")])
def test_unusable_images_are_refused_by_name(level: int, reason: str) -> None:
    detection = node()
    detected(detection, DistantScene([]).image(0), None)
    for k in range(1, 6):
        detected(detection, DistantScene([]).image(k))
    image = np.full((CAMERA.rows, CAMERA.cols), level, np.uint8)
    if reason == "scene_changed":
        image[:, ::2] = 220
    with pytest.raises(RefusedError) as caught:
        detected(detection, image)
    assert reason in caught.value.reasons


def test_an_image_of_another_size_is_refused() -> None:
    detection = node()
    detected(detection, DistantScene([]).image(0), None)
    with pytest.raises(InputError, match="expected the size of the previous ones"):
        detected(detection, np.zeros((10, 10), np.uint8), None)
