# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image filters: Gaussian, derivative and Canny."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame
from cdff_core.dfns.image_filtering.interface import ImageFilteringInputs


def apply_filter(image: np.ndarray, implementation: str, **config: Any) -> np.ndarray:
    node = Registry.default().make_dfn("image_filtering", implementation)
    node.configure(config)
    frame = Frame.from_image(image, stamp_ns=1000, mode="RGB" if image.ndim == 3 else "GRAY")
    outputs = node.process(ImageFilteringInputs(image=frame)).image
    assert outputs.stamp_ns == 1000
    return np.asarray(outputs.image)


def step(noise: float = 0.0, dtype: type = np.uint8) -> np.ndarray:
    """Return an image with a dark left half and a bright right half."""
    image = np.full((60, 80), 60.0)
    image[:, 40:] = 180.0
    return np.clip(image + np.random.default_rng(0).normal(0, noise, image.shape), 0, 255).astype(dtype)


def test_a_gaussian_reduces_noise_by_its_width_and_keeps_the_mean() -> None:
    noisy = np.random.default_rng(1).normal(128, 20, (200, 200)).astype(np.uint8)
    smooth = apply_filter(noisy, "GaussianFilter", sigma_px=2.0)
    # The filter divides the standard deviation of white noise by 2 sigma sqrt(pi).
    assert smooth.std() == pytest.approx(noisy.std() / (2 * 2.0 * np.sqrt(np.pi)), rel=0.1)
    assert smooth.mean() == pytest.approx(noisy.mean(), abs=0.6)


def test_a_gaussian_on_depths_ignores_and_preserves_nan_pixels() -> None:
    rng = np.random.default_rng(3)
    depth = (4.0 + 0.01 * np.arange(120) + rng.normal(0, 0.1, (90, 120))).astype(np.float32)
    depth[30:40, 50:60] = np.nan
    smooth = apply_filter(depth, "GaussianFilter", sigma_px=2.0)
    assert smooth.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(smooth), np.isnan(depth))
    errors = smooth - (4.0 + 0.01 * np.arange(120))
    near_gap = errors[27:43, 47:63]
    assert np.nanstd(errors[10:-10, 10:-10]) == pytest.approx(0.1 / (2 * 2.0 * np.sqrt(np.pi)), rel=0.15)
    assert np.nanmax(np.abs(near_gap)) < 0.1


def test_the_derivative_of_a_ramp_is_its_slope() -> None:
    ramp = np.tile((2.0 * np.arange(100)).astype(np.uint8), (50, 1))
    for direction, expected in (("x", 2.0), ("y", 0.0), ("magnitude", 2.0)):
        result = apply_filter(ramp, "DerivativeEdgeDetection", direction=direction)
        assert result.dtype == np.float32
        assert result[10:-10, 10:-10] == pytest.approx(np.full((30, 80), expected), abs=1e-4)


def test_canny_detects_a_step_once() -> None:
    edges = apply_filter(step(noise=3.0), "CannyEdgeDetection")
    assert set(np.unique(edges)) == {0, 255}
    rows, cols = np.nonzero(edges[2:-2])
    assert set(cols) <= {39, 40}
    assert len(rows) == 56


def test_colour_images_are_filtered_and_other_pixel_types_refused() -> None:
    colours = np.dstack([step()] * 3)
    assert apply_filter(colours, "GaussianFilter").shape == colours.shape
    assert apply_filter(colours, "CannyEdgeDetection").ndim == 2
    for implementation in ("GaussianFilter", "CannyEdgeDetection"):
        with pytest.raises(InputError, match="uint16"):
            apply_filter(step(dtype=np.uint16), implementation)


def test_wrong_parameters_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="above"):
        apply_filter(step(), "CannyEdgeDetection", low_grey=200.0, high_grey=100.0)
