# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.stereo_matching_2d._interface import StereoMatching2DInputs
from cdff_core.dfns.stereo_matching_2d.epipolar_zncc import EpipolarZncc
from tests.corridor import texture

IMAGE = np.clip(texture(8, 256), 0, 255).astype(np.uint8)
POINTS = np.stack(np.meshgrid(np.arange(80.0, 220.0, 20.0), np.arange(60.0, 200.0, 20.0)), axis=-1).reshape(-1, 2)


def matcher() -> EpipolarZncc:
    dfn = EpipolarZncc()
    dfn.configure({"max_disparity_px": 60})
    return dfn


def test_disparities_are_found_with_and_without_a_guess() -> None:
    right = np.roll(IMAGE, -23, axis=1)
    for guess in (None, np.full(len(POINTS), 24.6)):
        out = matcher().process(StereoMatching2DInputs(IMAGE, right, POINTS, guess))
        assert out.valid.mean() > 0.9
        assert np.abs(out.disparities[out.valid] - 23.0).max() < 0.1
        assert np.abs(out.row_offsets[out.valid]).max() < 0.1


def test_images_of_two_scenes_do_not_match() -> None:
    other = np.clip(texture(9, 256), 0, 255).astype(np.uint8)
    assert matcher().process(StereoMatching2DInputs(IMAGE, other, POINTS)).valid.sum() <= 1


def test_a_repeating_texture_is_ambiguous_not_matched() -> None:
    tile = np.tile(IMAGE[:, :16], (1, 16))
    assert matcher().process(StereoMatching2DInputs(tile, tile, POINTS)).valid.sum() == 0


def test_images_of_different_size_are_refused() -> None:
    with pytest.raises(InputError, match="equal size"):
        matcher().process(StereoMatching2DInputs(IMAGE, IMAGE[:200], POINTS))
