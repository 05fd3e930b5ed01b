# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What moves is told from what does not."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.dfns.background_subtraction._interface import BackgroundSubtractionInputs
from cdff_core.dfns.background_subtraction.mixture_of_gaussians import MixtureOfGaussians


def node() -> MixtureOfGaussians:
    made = MixtureOfGaussians()
    made.configure({"history": 100})
    return made


def mask(subtraction: MixtureOfGaussians, image: np.ndarray) -> np.ndarray:
    frame = Frame.from_image(image, stamp_ns=0)
    return np.asarray(subtraction.process(BackgroundSubtractionInputs(image=frame)).mask.image)


def test_a_square_that_moves_over_noise_is_found_and_the_noise_is_not() -> None:
    rng, subtraction = np.random.default_rng(0), node()
    scene = rng.uniform(60, 120, (90, 120))
    found = []
    for i in range(-80, 20):
        image = scene + rng.normal(0, 3, scene.shape)
        if i >= 0:
            image[30:50, 4 * i : 4 * i + 20] = 220
        found.append(mask(subtraction, np.clip(image, 0, 255).astype(np.uint8)))
    assert not found[0].any()
    last = found[-1] == 255
    square = np.zeros_like(last)
    square[30:50, 76:96] = True
    assert (last & square).sum() / square.sum() > 0.95
    assert (last & ~square).mean() < 0.005


def test_what_stays_becomes_background() -> None:
    subtraction = node()
    empty = np.full((40, 40), 80, np.uint8)
    for _ in range(30):
        mask(subtraction, empty)
    placed = empty.copy()
    placed[10:20, 10:20] = 200
    assert mask(subtraction, placed)[12:18, 12:18].all()
    for _ in range(150):
        last = mask(subtraction, placed)
    assert not last.any()


def test_images_of_another_size_or_depth_are_refused() -> None:
    subtraction = node()
    mask(subtraction, np.zeros((10, 10), np.uint8))
    with pytest.raises(InputError, match="expected uint8"):
        mask(subtraction, np.zeros((10, 12), np.uint8))
    with pytest.raises(InputError, match="uint16"):
        mask(node(), np.zeros((10, 10), np.uint16))
