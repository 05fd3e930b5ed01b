# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_core.dfns.star_field_background.interface import (
    StarFieldBackgroundInputs,
    StarFieldBackgroundOutputs,
)
from cdff_core.dfns.star_field_background.tile_median import TileMedian


def removed(image: np.ndarray, saturation: float = float("inf")) -> StarFieldBackgroundOutputs:
    dfn = TileMedian()
    dfn.configure()
    return dfn.process(StarFieldBackgroundInputs(image=image.astype(np.float32), saturation=saturation))


def noisy(rows: int = 300, cols: int = 410, sigma: float = 7.0, seed: int = 1) -> np.ndarray:
    v, u = np.mgrid[:rows, :cols]
    level = 500.0 + 0.05 * u + 0.04 * v
    return level + np.random.default_rng(seed).normal(0.0, sigma, level.shape)


def test_a_sloping_background_is_removed_to_a_fifth_of_the_noise_also_at_the_borders() -> None:
    result = removed(noisy())
    means = result.residual[:288, :400].reshape(9, 32, 10, 40).mean(axis=(1, 3))
    # A tile's median of 256 pixels has an error of 0.08 of the noise, more where it is continued to a corner.
    assert np.abs(means).max() < 3.0
    assert np.abs(means).mean() < 0.7
    assert result.noise.mean() == pytest.approx(7.0, rel=0.05)


def test_stars_change_neither_background_nor_noise() -> None:
    image = noisy()
    rng = np.random.default_rng(2)
    image[rng.integers(0, 300, 400), rng.integers(0, 410, 400)] += 3000.0
    difference = removed(image).noise - removed(noisy()).noise
    assert np.abs(difference).max() < 0.8


def test_noise_of_an_image_in_coarse_steps_is_right() -> None:
    image = (
        np.rint((np.full((256, 256), 3000.0) + np.random.default_rng(3).normal(0, 20, (256, 256))) / 16.0)
        * 16.0
    )
    assert removed(image).noise.mean() == pytest.approx(np.hypot(20.0, 16.0 / np.sqrt(12.0)), rel=0.05)


def test_a_long_thin_trail_is_masked_and_a_star_is_not() -> None:
    image = noisy()
    for k in range(120):
        image[100 + k // 2, 80 + k] += 150.0
    image[200:203, 300:303] += 400.0
    mask = removed(image).mask
    assert all(mask[100 + k // 2, 80 + k] == 2 for k in range(120))
    assert not mask[195:208, 295:308].any()


def test_saturated_pixels_are_marked_and_a_saturated_image_is_refused() -> None:
    image = noisy()
    image[50:55, 60:65] = 4095.0
    result = removed(image, saturation=4095.0)
    assert (result.mask[50:55, 60:65] == 1).all()
    assert result.saturated == pytest.approx(25 / image.size)
    image[:200] = 4095.0
    with pytest.raises(RefusedError, match=r"67% of the pixels are saturated.*shorten the exposure"):
        removed(image, saturation=4095.0)


def test_a_small_image_is_refused() -> None:
    with pytest.raises(InputError, match=r"image \(40, 100\): expected at least 64 x 64"):
        removed(np.zeros((40, 100)))
