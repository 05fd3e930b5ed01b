# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.types import Frame
from cdff_core.dfns.disparity_image.bm import Bm
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs


def match(left: np.ndarray, right: np.ndarray, **config: Any) -> np.ndarray:
    node = Bm()
    node.configure({"num_disparities": 32, **config})
    left, right = (Frame.from_image(image, stamp_ns=0, mode="GRAY") for image in (left, right))
    return node.process(DisparityImageInputs(left=left, right=right)).disparity.image


def texture(rng: np.random.Generator) -> np.ndarray:
    noise = cv2.GaussianBlur(rng.uniform(0, 255, (120, 240)).astype(np.float32), (0, 0), 1.2)
    return cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


@pytest.mark.parametrize("disparity_px", [3, 10, 21])
def test_a_plane_parallel_to_the_images_has_one_disparity(
    rng: np.random.Generator, disparity_px: int
) -> None:
    left = texture(rng)
    disparity = match(left, np.roll(left, -disparity_px, axis=1))
    inner = disparity[12:-12, 50:-50]
    assert np.isfinite(inner).mean() > 0.95
    assert np.nanmedian(inner) == pytest.approx(disparity_px, abs=0.1)


def test_regions_without_texture_have_no_disparity(rng: np.random.Generator) -> None:
    left = texture(rng)
    left[30:90, 80:180] = 128
    disparity = match(left, np.roll(left, -9, axis=1))
    assert np.isfinite(disparity[45:75, 105:165]).mean() == 0.0
    assert np.isfinite(disparity[12:-12, 50:70]).mean() > 0.9


@pytest.mark.parametrize("config", [{"num_disparities": 20}, {"block_px": 8}, {"block_px": 3}, {"paths": 3}])
def test_parameters_out_of_bounds_are_refused(config: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        Bm().configure(config)


def test_a_middlebury_pair_has_mostly_correct_disparities(real_data: Callable[[str], Path]) -> None:
    folder = real_data("middlebury/teddy")
    left, right, truth = (
        cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE) for name in ("im2.png", "im6.png", "disp2.png")
    )
    disparity = match(left, right, num_disparities=64)
    has_both = (truth > 0) & np.isfinite(disparity)
    assert np.mean(np.abs(disparity - truth / 4.0)[has_both] > 1.0) < 0.11
    assert has_both.sum() / (truth > 0).sum() > 0.65
