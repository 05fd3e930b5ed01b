# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.stereo_matching_2d.epipolar_zncc import EpipolarZncc
from cdff_core.dfns.stereo_matching_2d.interface import StereoMatching2DInputs
from tests.support.corridor import texture

IMAGE = np.clip(texture(8, 256), 0, 255).astype(np.uint8)
POINTS = np.stack(np.meshgrid(np.arange(80.0, 220.0, 20.0), np.arange(60.0, 200.0, 20.0)), axis=-1).reshape(
    -1, 2
)


def make_node() -> EpipolarZncc:
    dfn = EpipolarZncc()
    dfn.configure({"max_disparity_px": 60})
    return dfn


def test_disparities_are_estimated_with_and_without_a_guess() -> None:
    right = np.roll(IMAGE, -23, axis=1)
    for guess in (None, np.full(len(POINTS), 24.6)):
        outputs = make_node().process(
            StereoMatching2DInputs(left=IMAGE, right=right, features=POINTS, guess=guess)
        )
        assert outputs.valid.mean() > 0.9
        assert np.abs(outputs.disparities[outputs.valid] - 23.0).max() < 0.1
        assert np.abs(outputs.row_offsets[outputs.valid]).max() < 0.1


def test_ground_at_a_grazing_angle_is_matched_with_and_without_a_given_slope() -> None:
    """The disparity is 30 px in the middle row and grows by 0.3 px per row, which is 5 px over a patch."""
    smooth = cv2.GaussianBlur(texture(8, 256), (0, 0), 1.0)
    shear = np.array([[1.0, -0.3, -30.0 + 0.3 * 128.0], [0.0, 1.0, 0.0]])
    left, right = (
        np.clip(m, 0, 255).astype(np.uint8) for m in (smooth, cv2.warpAffine(smooth, shear, (256, 256)))
    )
    true_disparity_px = 30.0 + 0.3 * (POINTS[:, 1] - 128.0)
    inside = POINTS[:, 0] - true_disparity_px > 30.0
    rms_px = []
    for slopes in (None, np.tile([0.0, 0.3], (len(POINTS), 1)), np.zeros((len(POINTS), 2))):
        outputs = make_node().process(
            StereoMatching2DInputs(
                left=left,
                right=right,
                features=POINTS,
                guess=None if slopes is None else true_disparity_px,
                slopes=slopes,
            )
        )
        rms_px.append(np.sqrt(np.mean((outputs.disparities - true_disparity_px)[outputs.valid] ** 2)))
        if slopes is None or slopes.any():
            assert np.percentile(np.abs(outputs.disparities - true_disparity_px)[outputs.valid], 95) < 0.06
            assert np.percentile(np.abs(outputs.slopes - [0.0, 0.3])[outputs.valid], 95) < 0.03
            assert outputs.valid[inside].mean() > 0.5
    assert rms_px[2] > 5.0 * max(rms_px[:2])  # a slope of zero, as for a plane parallel to the image


def test_images_of_different_scenes_do_not_match() -> None:
    other = np.clip(texture(9, 256), 0, 255).astype(np.uint8)
    assert (
        make_node().process(StereoMatching2DInputs(left=IMAGE, right=other, features=POINTS)).valid.sum() <= 1
    )


def test_points_on_a_repeating_texture_are_invalid() -> None:
    repeated = np.tile(IMAGE[:, :16], (1, 16))
    assert (
        make_node()
        .process(StereoMatching2DInputs(left=repeated, right=repeated, features=POINTS))
        .valid.sum()
        == 0
    )


def test_arrays_whose_sizes_differ_are_refused() -> None:
    with pytest.raises(InputError, match="r=256 of left"):
        make_node().process(StereoMatching2DInputs(left=IMAGE, right=IMAGE[:200], features=POINTS))
    with pytest.raises(InputError, match="slopes"):
        make_node().process(
            StereoMatching2DInputs(left=IMAGE, right=IMAGE, features=POINTS, slopes=np.zeros((1, 2)))
        )
