# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Colours of a body: they are learned where both sides of its outline are seen, and correct the pose."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs
from cdff_core.object_models.inertia import inertia_of
from cdff_core.object_models.region_fit import RegionFitter
from cdff_core.object_models.tracked_state import STATE_ERROR_DIM, TrackedState
from tests.support.coloured_boxes import BOX, T_BOX, colour_image
from tests.support.satellite_images import CAMERA_MATRIX


def dfn(name: str, implementation: str, **parameters: Any) -> Any:
    node = Registry.default().make_dfn(name, implementation)
    node.configure(parameters)
    return node


@pytest.fixture
def fitter() -> RegionFitter:
    """A fitter without colours."""
    return RegionFitter(
        dfn("model_region_measurement", "OutlineLines"),
        dfn("measured_pose_refinement", "IteratedFilter", sigma_px=1.0, bias_px=0.2),
        dfn("region_colour_learning", "LineHistograms"),
        24.0,
    )


@pytest.fixture
def model() -> Any:
    """The prepared box."""
    prepare = dfn("model_preparation", "VisibleSurface", points=2000, views=60, view_pixels=64, grid_cells=24)
    return prepare.process(ModelPreparationInputs(vertices=BOX[0], triangles=BOX[1]))


def state(T: np.ndarray) -> TrackedState:
    covariance = np.zeros((STATE_ERROR_DIM, STATE_ERROR_DIM))
    covariance[:6, :6] = np.diag(np.repeat([0.03, 0.01], 3) ** 2)
    return TrackedState(0, T, np.zeros(3), np.zeros(3), np.zeros(3), inertia_of((1.0, 1.0, 1.0)), covariance)


def moved(x_m: float) -> np.ndarray:
    """Return the pose of the box, moved along the rows of the image."""
    T = T_BOX.copy()
    T[0, 3] += x_m
    return T


def test_colours_are_learned_when_the_body_is_in_the_image(
    fitter: RegionFitter, model: Any, rng: np.random.Generator
) -> None:
    with pytest.raises(RefusedError) as refusal:
        fitter.fit(model, state(moved(9.0)), colour_image(moved(9.0), rng), CAMERA_MATRIX)
    assert refusal.value.reasons == ("no_colours",)
    first_fit = fitter.fit(model, state(T_BOX), colour_image(T_BOX, rng), CAMERA_MATRIX)
    assert first_fit.lines > 80
    second_fit = fitter.fit(model, state(T_BOX), colour_image(moved(0.04), rng), CAMERA_MATRIX)
    assert second_fit.agreement > 0.9
    assert second_fit.state.T[0, 3] == pytest.approx(0.04, abs=0.005)


def test_colours_stay_when_the_body_leaves_the_image(
    fitter: RegionFitter, model: Any, rng: np.random.Generator
) -> None:
    fitter.learn(model, T_BOX, colour_image(T_BOX, rng), CAMERA_MATRIX)
    fitter.learn(model, moved(9.0), np.zeros((240, 320, 3), np.uint8), CAMERA_MATRIX)
    fit = fitter.fit(model, state(T_BOX), colour_image(T_BOX, rng), CAMERA_MATRIX)
    assert fit.lines > 80
    fitter.clear()
    far = dataclasses.replace(state(T_BOX), T=moved(9.0))
    with pytest.raises(RefusedError, match="no pixel"):
        fitter.fit(model, far, colour_image(T_BOX, rng), CAMERA_MATRIX)
