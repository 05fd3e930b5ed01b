# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Texture of a body: it measures the motion from image to image, and adds no knowledge of the pose itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs
from cdff_core.object_models.inertia import inertia_of
from cdff_core.object_models.texture_fit import SeenBody, TextureFitter, relative_prior
from cdff_core.object_models.tracked_state import STATE_ERROR_DIM, TrackedState
from tests.support import satellite
from tests.support.satellite_images import CAMERA_MATRIX

SHIFT_PX, DISTANCE_M = 4.0, 3.0


def state(sigma_m: float, sigma_rad: float) -> TrackedState:
    covariance = np.zeros((STATE_ERROR_DIM, STATE_ERROR_DIM))
    covariance[:6, :6] = np.diag(np.repeat([sigma_m, sigma_rad], 3) ** 2)
    T = se3.transform(np.eye(3), np.array([0.0, 0.0, DISTANCE_M]))
    return TrackedState(0, T, np.zeros(3), np.zeros(3), np.zeros(3), inertia_of((1.0, 1.0, 1.0)), covariance)


def moved_covariance(previous: TrackedState, sigma_m: float, sigma_rad: float) -> TrackedState:
    """Return a prediction with the noise of the motion."""
    noise = np.zeros((STATE_ERROR_DIM, STATE_ERROR_DIM))
    noise[:6, :6] = np.diag(np.repeat([sigma_m, sigma_rad], 3) ** 2)
    return replace(previous, covariance=previous.covariance + noise)


def fitter() -> TextureFitter:
    def dfn(name: str, implementation: str, **parameters: Any) -> Any:
        node = Registry.default().make_dfn(name, implementation)
        node.configure(parameters)
        return node

    return TextureFitter(
        dfn("features_extraction_2d", "GridGftt", features=300),
        dfn("features_tracking_2d", "PyramidalKlt"),
        dfn("measured_pose_refinement", "IteratedFilter"),
        24.0,
    )


def prepared() -> Any:
    prepare = Registry.default().make_dfn("model_preparation")
    prepare.configure({"points": 2000, "views": 60, "view_pixels": 64, "grid_cells": 24})
    vertices, triangles = satellite.box((1.2, 0.9, 0.4))
    return prepare.process(ModelPreparationInputs(vertices=vertices, triangles=triangles))


def test_the_error_of_a_motion_without_noise_is_zero() -> None:
    previous = state(0.1, 0.05)
    prior = relative_prior(previous, previous, np.eye(STATE_ERROR_DIM))
    np.testing.assert_allclose(prior[:6, :6], 0.0, atol=1e-15)
    np.testing.assert_allclose(prior[6:12, 6:12], previous.covariance[:6, :6])


def test_the_motion_of_the_texture_moves_the_body_and_keeps_the_old_uncertainty(
    rng: np.random.Generator,
) -> None:
    noise = cv2.GaussianBlur(rng.uniform(0.0, 255.0, (240, 320)), (0, 0), 2.0)
    image = np.asarray(np.clip(128.0 + 4.0 * (noise - noise.mean()), 0, 255), np.uint8)
    previous = state(0.05, 0.001)
    predicted = moved_covariance(previous, 0.1, 0.001)
    shifted = np.ascontiguousarray(np.roll(image, int(SHIFT_PX), axis=1))
    seen_body = SeenBody(image, previous)
    fit = fitter().fit(prepared(), seen_body, predicted, np.eye(STATE_ERROR_DIM), shifted, CAMERA_MATRIX)
    assert fit.points > 20
    assert fit.agreement > 0.9
    front_m = DISTANCE_M - 0.2
    moved_m = fit.state.T[0, 3] - previous.T[0, 3]
    assert moved_m == pytest.approx(SHIFT_PX * front_m / CAMERA_MATRIX[0, 0], rel=0.15)
    sigmas_m = np.sqrt(np.diag(fit.state.covariance)[:2])
    assert (sigmas_m < 0.06).all()
    assert (sigmas_m > 0.045).all()


def test_a_body_without_texture_is_refused() -> None:
    image = np.full((240, 320), 80, np.uint8)
    previous = state(0.05, 0.01)
    with pytest.raises(RefusedError) as refusal:
        fitter().fit(
            prepared(), SeenBody(image, previous), previous, np.eye(STATE_ERROR_DIM), image, CAMERA_MATRIX
        )
    assert refusal.value.reasons[0].startswith("few_features")
