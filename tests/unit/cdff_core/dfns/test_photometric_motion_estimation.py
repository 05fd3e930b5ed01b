# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Photometric alignment of a textured plane: known motion, refusal of unusable input."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.photometric_motion_estimation.interface import Inputs, Outputs
from cdff_core.dfns.photometric_motion_estimation.normalised_pyramid import NormalisedPyramid

ROWS, COLS, BASELINE_M, DEPTH_M = 240, 320, 0.2, 4.0
K = np.array([[250.0, 0.0, 160.0], [0.0, 250.0, 120.0], [0.0, 0.0, 1.0]])
MOTION = se3.transform(se3.exp_so3([0.01, -0.02, 0.015]), [0.05, -0.03, 0.2])


def texture() -> NDArray[np.float32]:
    rng = np.random.default_rng(3)
    noise = sum(cv2.GaussianBlur(rng.normal(size=(ROWS, COLS)), (0, 0), s) * s for s in (1.5, 4.0, 10.0))
    return np.asarray(120.0 + 35.0 * noise, np.float32)


def view(T_current_reference: NDArray[np.float64], offset_m: float = 0.0) -> NDArray[np.uint8]:
    """Return the plane at ``DEPTH_M`` in the reference, seen from another pose."""
    normal = np.array([[0.0, 0.0, 1.0 / DEPTH_M]])
    t = T_current_reference[:3, 3] - [offset_m, 0.0, 0.0]
    H = K @ (T_current_reference[:3, :3] + t[:, None] @ normal) @ np.linalg.inv(K)
    warped = cv2.warpPerspective(texture(), H, (COLS, ROWS), flags=cv2.INTER_CUBIC, borderValue=120.0)
    return np.clip(warped, 0, 255).astype(np.uint8)


def align(motion: NDArray[np.float64] = MOTION, **changes: Any) -> Outputs:
    T = se3.inverse(motion)
    inputs: dict[str, Any] = {
        "reference": view(np.eye(4)),
        "disparity": np.full((ROWS, COLS), 250.0 * BASELINE_M / DEPTH_M, np.float32),
        "left": view(T),
        "right": view(T, BASELINE_M),
        "camera_matrix": K,
        "baseline": BASELINE_M,
        "guess": np.eye(4),
    }
    node = NormalisedPyramid()
    node.configure(None)
    return node.process(Inputs(**inputs | changes))


def test_the_motion_is_found_without_a_guess() -> None:
    out = align()
    assert np.linalg.norm(out.motion[:3, 3] - MOTION[:3, 3]) < 0.01
    assert np.linalg.norm(se3.log_so3(out.motion[:3, :3].T @ MOTION[:3, :3])) < 2e-3
    assert out.correlation > 0.9
    assert out.correlation_right > 0.9


def test_a_shadow_over_half_of_the_image_is_tolerated() -> None:
    shadowed = [view(se3.inverse(MOTION), offset) for offset in (0.0, BASELINE_M)]
    for image in shadowed:
        image[:, COLS // 2 :] //= 3
    out = align(left=shadowed[0], right=shadowed[1])
    assert np.linalg.norm(out.motion[:3, 3] - MOTION[:3, 3]) < 0.02


def test_the_covariance_is_symmetric_and_positive() -> None:
    out = align()
    assert np.allclose(out.covariance, out.covariance.T)
    assert np.all(np.linalg.eigvalsh(out.covariance) > 0.0)
    assert np.all(np.linalg.eigvalsh(out.covariance - out.noise_covariance) > -1e-12)


def test_another_scene_has_a_low_correlation() -> None:
    other = np.ascontiguousarray(view(np.eye(4))[::-1, ::-1])
    assert align(left=other, right=other).correlation < 0.45


def test_pixels_that_are_not_usable_are_not_compared() -> None:
    """A part of the robot covers the right half of both images."""
    covered = [view(se3.inverse(MOTION), offset) for offset in (0.0, BASELINE_M)]
    mask = np.ones((ROWS, COLS), bool)
    for image in covered:
        image[:, COLS // 2 :] = image[::-1, COLS // 2 :]
    mask[:, COLS // 2 :] = False
    out = align(left=covered[0], right=covered[1], left_mask=mask, right_mask=mask)
    assert np.linalg.norm(out.motion[:3, 3] - MOTION[:3, 3]) < 0.02
    assert out.correlation > 0.9
    assert out.correlation_right > 0.9
    assert 0.4 < out.overlap < 0.6


def test_images_without_disparities_are_refused() -> None:
    with pytest.raises(RefusedError, match="0 pixels"):
        align(disparity=np.full((ROWS, COLS), np.nan, np.float32))


def test_a_guess_that_is_not_rigid_is_refused() -> None:
    with pytest.raises(InputError, match="rigid"):
        align(guess=2.0 * np.eye(4))


def test_an_offset_of_the_columns_of_the_right_camera_is_estimated() -> None:
    motion, offset_px = se3.transform(np.eye(3), [0.0, 0.0, 1.0]), 0.4
    right = view(se3.inverse(motion), BASELINE_M)
    right = cv2.warpAffine(right, np.array([[1.0, 0.0, -offset_px], [0.0, 1.0, 0.0]]), (COLS, ROWS))
    disparity = np.full((ROWS, COLS), 250.0 * BASELINE_M / DEPTH_M + offset_px, np.float32)
    inputs = {"right": np.asarray(right, np.uint8), "disparity": disparity, "guess": motion}
    fixed = align(motion, **inputs)
    assert np.abs(fixed.calibration).max() < 1e-6
    prior = {"calibration": np.zeros(2), "calibration_covariance": np.diag([0.25, 1e-6])}
    estimated = align(motion, **inputs, **prior)
    assert estimated.calibration[0] == pytest.approx(-offset_px, abs=0.15)
    assert estimated.calibration_covariance[0, 0] < 0.1
    errors = [np.linalg.norm(out.motion[:3, 3] - motion[:3, 3]) for out in (fixed, estimated)]
    assert errors[1] < 0.5 * errors[0]


def test_a_prior_of_another_number_of_parameters_is_refused() -> None:
    with pytest.raises(InputError, match="offset and decentring"):
        align(calibration=np.zeros(3), calibration_covariance=np.eye(3))
