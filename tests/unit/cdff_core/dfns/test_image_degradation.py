# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image degradation: smaller images keep the viewing rays of their pixels."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.types import Frame, FramePair
from cdff_core.dfns.image_degradation.area_average import AreaAverage
from cdff_core.dfns.image_degradation.interface import ImageDegradationInputs
from cdff_core.dfns.stereo_degradation.area_average import AreaAverage as StereoAreaAverage
from cdff_core.dfns.stereo_degradation.interface import StereoDegradationInputs

K = np.array([[300.0, 0.0, 99.5], [0.0, 310.0, 60.0], [0.0, 0.0, 1.0]])


def shrink(image: np.ndarray, columns: int, rows: int) -> Frame:
    node = AreaAverage()
    node.configure({"columns_per_pixel": columns, "rows_per_pixel": rows})
    frame = Frame.from_image(image, stamp_ns=5000, mode="RGB" if image.ndim == 3 else "GRAY", camera_matrix=K)
    return node.process(ImageDegradationInputs(image=frame)).image


def test_a_pixel_is_the_mean_of_its_block_and_remainders_are_cropped(rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (121, 203, 3), dtype=np.uint8)
    small = shrink(image, 3, 2).image
    assert small.shape == (60, 67, 3)
    blocks = image[:120, :201].reshape(60, 2, 67, 3, 3).mean(axis=(1, 3))
    assert np.abs(small.astype(float) - blocks).max() <= 0.51


def test_the_centre_of_a_block_keeps_its_viewing_ray() -> None:
    small = CameraModel.of_frame(shrink(np.zeros((120, 200), np.uint8), 4, 2))
    original = CameraModel(120, 200, 300.0, 310.0, 99.5, 60.0)
    block = np.array([[10.0, 20.0], [0.0, 0.0]])
    centres = block * [4.0, 2.0] + [1.5, 0.5]
    assert small.rays(block) == pytest.approx(original.rays(centres))


def test_the_result_of_an_image_without_a_camera_has_no_camera() -> None:
    node = AreaAverage()
    node.configure()
    outputs = node.process(
        ImageDegradationInputs(image=Frame.from_image(np.zeros((4, 4), np.uint16), stamp_ns=0))
    ).image
    assert not outputs.camera_matrix.any()
    assert outputs.image.dtype == np.uint16


def test_a_degraded_rectified_pair_is_rectified() -> None:
    image = np.zeros((120, 200), np.uint8)
    pair = FramePair.from_images(image, image, baseline_m=0.2, camera_matrix=K, stamp_ns=9000)
    node = StereoAreaAverage()
    node.configure()
    small = node.process(StereoDegradationInputs(pair=pair)).pair
    assert small.baseline == 0.2
    assert small.left.image.shape == (60, 100)
    assert (small.left.camera_matrix == small.right.camera_matrix).all()


def test_too_small_or_unequal_images_are_refused() -> None:
    with pytest.raises(InputError, match="at least 8 x 8"):
        shrink(np.zeros((4, 100), np.uint8), 8, 8)
    node = StereoAreaAverage()
    node.configure()
    left, right = (Frame.from_image(np.zeros((10, cols), np.uint8), stamp_ns=0) for cols in (10, 12))
    with pytest.raises(InputError, match="same size"):
        node.process(StereoDegradationInputs(pair=FramePair(baseline=0.1, left=left, right=right)))
