# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Background subtraction: moving pixels are separated from static ones."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.dfns.background_subtraction.interface import BackgroundSubtractionInputs
from cdff_core.dfns.background_subtraction.mixture_of_gaussians import MixtureOfGaussians


def make_node() -> MixtureOfGaussians:
    result = MixtureOfGaussians()
    result.configure({"history": 100})
    return result


def foreground_mask(subtraction: MixtureOfGaussians, image: np.ndarray) -> np.ndarray:
    frame = Frame.from_image(image, stamp_ns=0)
    return np.asarray(subtraction.process(BackgroundSubtractionInputs(image=frame)).mask.image)


def test_only_a_moving_square_is_detected_in_noise() -> None:
    rng, subtraction = np.random.default_rng(0), make_node()
    scene = rng.uniform(60, 120, (90, 120))
    masks = []
    for i in range(-80, 20):
        image = scene + rng.normal(0, 3, scene.shape)
        if i >= 0:
            image[30:50, 4 * i : 4 * i + 20] = 220
        masks.append(foreground_mask(subtraction, np.clip(image, 0, 255).astype(np.uint8)))
    assert not masks[0].any()
    last_mask = masks[-1] == 255
    square = np.zeros_like(last_mask)
    square[30:50, 76:96] = True
    assert (last_mask & square).sum() / square.sum() > 0.95
    assert (last_mask & ~square).mean() < 0.005


def test_static_objects_become_background() -> None:
    subtraction = make_node()
    empty = np.full((40, 40), 80, np.uint8)
    for _ in range(30):
        foreground_mask(subtraction, empty)
    with_object = empty.copy()
    with_object[10:20, 10:20] = 200
    assert foreground_mask(subtraction, with_object)[12:18, 12:18].all()
    for _ in range(150):
        last_mask = foreground_mask(subtraction, with_object)
    assert not last_mask.any()


def test_images_of_another_size_or_depth_are_refused() -> None:
    subtraction = make_node()
    foreground_mask(subtraction, np.zeros((10, 10), np.uint8))
    with pytest.raises(InputError, match="expected uint8"):
        foreground_mask(subtraction, np.zeros((10, 12), np.uint8))
    with pytest.raises(InputError, match="uint16"):
        foreground_mask(make_node(), np.zeros((10, 10), np.uint16))
