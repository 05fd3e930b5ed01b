# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Each filter does what its name says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame
from cdff_core.dfns.image_filtering._interface import ImageFilteringInputs


def filtered(image: np.ndarray, implementation: str, **config: Any) -> np.ndarray:
    node = Registry.default().make_dfn("image_filtering", implementation)
    node.configure(config)
    frame = Frame.from_image(image, stamp_ns=1000, mode="RGB" if image.ndim == 3 else "GRAY")
    made = node.process(ImageFilteringInputs(image=frame)).image
    assert made.stamp_ns == 1000
    return np.asarray(made.image)


def step(noise: float = 0.0, dtype: type = np.uint8) -> np.ndarray:
    """Dark left half, bright right half."""
    image = np.full((60, 80), 60.0)
    image[:, 40:] = 180.0
    return np.clip(image + np.random.default_rng(0).normal(0, noise, image.shape), 0, 255).astype(dtype)


def test_a_gaussian_lowers_noise_by_its_width_and_keeps_the_mean() -> None:
    noisy = np.random.default_rng(1).normal(128, 20, (200, 200)).astype(np.uint8)
    smooth = filtered(noisy, "GaussianFilter", sigma_px=2.0)
    # White noise is divided by 2 sigma sqrt(pi).
    assert smooth.std() == pytest.approx(noisy.std() / (2 * 2.0 * np.sqrt(np.pi)), rel=0.1)
    assert smooth.mean() == pytest.approx(noisy.mean(), abs=0.6)


def test_a_gaussian_of_depths_smooths_beside_gaps_and_leaves_them() -> None:
    rng = np.random.default_rng(3)
    depth = (4.0 + 0.01 * np.arange(120) + rng.normal(0, 0.1, (90, 120))).astype(np.float32)
    depth[30:40, 50:60] = np.nan
    smooth = filtered(depth, "GaussianFilter", sigma_px=2.0)
    assert smooth.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(smooth), np.isnan(depth))
    errors = smooth - (4.0 + 0.01 * np.arange(120))
    beside = errors[27:43, 47:63]
    assert np.nanstd(errors[10:-10, 10:-10]) == pytest.approx(0.1 / (2 * 2.0 * np.sqrt(np.pi)), rel=0.15)
    assert np.nanmax(np.abs(beside)) < 0.1


def test_a_median_takes_bad_pixels_away_and_leaves_edges() -> None:
    image = step()
    bad = image.copy()
    bad[::7, ::9] = 255
    assert (filtered(bad, "MedianFilter", window_px=3) == image).all()


def test_a_bilateral_filter_smooths_beside_an_edge_and_not_across() -> None:
    noisy = step(noise=6.0)
    smooth = filtered(noisy, "BilateralFilter", sigma_px=3.0, sigma_grey=40.0)
    assert smooth[:, 5:35].std() < 0.5 * noisy[:, 5:35].std()
    assert smooth[:, 41].mean() - smooth[:, 38].mean() > 110


def test_local_contrast_spreads_what_lies_in_the_shadow() -> None:
    dark = (np.random.default_rng(2).uniform(10, 30, (128, 128))).astype(np.uint16)
    assert filtered(dark, "LocalContrast", clip_limit=40.0).std() > 3 * dark.std()


def test_the_derivative_of_a_ramp_is_its_slope() -> None:
    ramp = np.tile((2.0 * np.arange(100)).astype(np.uint8), (50, 1))
    for direction, expected in (("x", 2.0), ("y", 0.0), ("magnitude", 2.0)):
        made = filtered(ramp, "DerivativeEdgeDetection", direction=direction)
        assert made.dtype == np.float32
        assert made[10:-10, 10:-10] == pytest.approx(np.full((30, 80), expected), abs=1e-4)


def test_canny_finds_the_edge_of_a_step_once() -> None:
    edges = filtered(step(noise=3.0), "CannyEdgeDetection")
    assert set(np.unique(edges)) == {0, 255}
    rows, cols = np.nonzero(edges[2:-2])
    assert set(cols) <= {39, 40}
    assert len(rows) == 56


def test_colours_are_filtered_and_other_pixels_refused() -> None:
    colours = np.dstack([step()] * 3)
    assert filtered(colours, "GaussianFilter").shape == colours.shape
    assert filtered(colours, "CannyEdgeDetection").ndim == 2
    for implementation in ("GaussianFilter", "CannyEdgeDetection"):
        with pytest.raises(InputError, match="uint16"):
            filtered(step(dtype=np.uint16), implementation)
    with pytest.raises(InputError, match="grey"):
        filtered(colours, "LocalContrast")


def test_wrong_parameters_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="odd"):
        filtered(step(), "MedianFilter", window_px=4)
    with pytest.raises(ConfigurationError, match="above"):
        filtered(step(), "CannyEdgeDetection", low_grey=200.0, high_grey=100.0)
