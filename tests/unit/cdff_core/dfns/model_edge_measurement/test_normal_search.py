# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ModelEdgeMeasurement: offsets of a moved box, hidden edges, empty views, refusals."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.model_edge_measurement.interface import (
    ModelEdgeMeasurementInputs,
    ModelEdgeMeasurementOutputs,
)
from cdff_core.dfns.model_edge_measurement.normal_search import NormalSearch, slopes_along
from tests.support import satellite
from tests.support.satellite_images import CAMERA_MATRIX, image_of

BOX = satellite.box((1.0, 0.8, 0.6))
T_BOX = se3.transform(se3.exp_so3([0.4, 0.5, 0.1]), [0.0, 0.0, 4.0])


def measure(image: np.ndarray, T: np.ndarray, **changes: Any) -> ModelEdgeMeasurementOutputs:
    node = NormalSearch()
    node.configure()
    ports = {"vertices": BOX[0], "triangles": BOX[1], "range_px": 8.0, "camera_matrix": CAMERA_MATRIX}
    return node.process(ModelEdgeMeasurementInputs(image=image.astype(np.float32), pose=T, **ports | changes))


def test_the_offsets_are_those_of_a_box_that_is_seen_elsewhere(rng: np.random.Generator) -> None:
    T_moved = T_BOX.copy()
    T_moved[0, 3] += 0.03
    outputs = measure(image_of(BOX, T_moved, rng), T_BOX)
    assert len(outputs.points) > 100
    expected = 400.0 * 0.03 / 4.0 * outputs.normals[:, 0]
    nearest = np.nan_to_num(np.abs(outputs.offsets - expected[:, None]), nan=99.0).min(axis=1)
    assert np.mean(nearest < 0.5) > 0.9
    assert np.median(nearest) < 0.2


def test_control_points_project_to_their_pixels(rng: np.random.Generator) -> None:
    outputs = measure(image_of(BOX, T_BOX, rng), T_BOX)
    p = outputs.points @ T_BOX[:3, :3].T + T_BOX[:3, 3]
    pixels = p[:, :2] / p[:, 2:] * 400.0 + CAMERA_MATRIX[:2, 2]
    np.testing.assert_allclose(outputs.pixels, pixels, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(outputs.normals, axis=1), 1.0)


def test_edges_on_the_far_side_are_hidden(rng: np.random.Generator) -> None:
    facing = se3.transform(np.eye(3), [0.0, 0.0, 4.0])
    outputs = measure(image_of(BOX, facing, rng), facing)
    # The camera looks along z: only the face with z = -0.3 is seen.
    np.testing.assert_allclose(outputs.points[:, 2], -0.3, atol=1e-9)


def test_an_image_without_contrast_has_no_offsets() -> None:
    outputs = measure(np.full((240, 320), 80.0), T_BOX)
    assert len(outputs.points) > 100
    assert np.isnan(outputs.offsets).all()


@pytest.mark.parametrize("blur_px", [0.0, 1.0], ids=["independent", "correlated"])
def test_the_noise_of_a_dark_image_has_no_edges(rng: np.random.Generator, blur_px: float) -> None:
    noise = rng.normal(20.0, 2.0, (240, 320)).astype(np.float32)
    image = cv2.GaussianBlur(noise, (0, 0), blur_px) if blur_px else noise
    outputs = measure(image, T_BOX)
    assert np.isfinite(outputs.offsets[:, 0]).mean() < 0.1
    seen = measure(image + image_of(BOX, T_BOX, rng), T_BOX)
    assert np.isfinite(seen.offsets[:, 0]).mean() > 0.9
    assert np.median(np.nanmin(np.abs(seen.offsets), axis=1)) < 0.3


def test_the_slopes_of_a_linear_image_are_its_gradient_along_the_normals() -> None:
    rows, columns = np.mgrid[0:60, 0:80]
    image = (3.0 * columns - 2.0 * rows).astype(np.float32)
    angles_rad = np.linspace(0.0, 6.0, 8)
    normals = np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
    slopes = slopes_along(image, np.full((8, 2), [40.3, 30.6]), normals, 6)
    np.testing.assert_allclose(slopes[:, 2:-2], np.tile((normals @ [3.0, -2.0])[:, None], 9), atol=1e-3)
    np.testing.assert_array_equal(slopes[:, [0, 1, -2, -1]], 0.0)


def test_the_slopes_of_a_quadratic_image_are_its_derivatives_and_end_at_the_border() -> None:
    image = np.tile(np.arange(80.0, dtype=np.float32) ** 2, (60, 1))
    (slopes,) = slopes_along(image, np.array([[74.0, 30.0]]), np.array([[1.0, 0.0]]), 9)
    # Columns 65 to 83; the last one that interpolation between two pixels reaches is 78.
    np.testing.assert_allclose(slopes[2:12], 2.0 * np.arange(67.0, 77.0), rtol=1e-5)
    assert np.isnan(slopes[12:17]).all()


@pytest.mark.parametrize("position", [[0.0, 0.0, -4.0], [40.0, 0.0, 4.0]], ids=["behind", "beside"])
def test_a_body_out_of_view_has_no_control_points(position: list[float]) -> None:
    outputs = measure(np.zeros((240, 320)), se3.transform(np.eye(3), position))
    assert outputs.points.shape == (0, 3)
    assert outputs.pixels.shape == outputs.normals.shape == (0, 2)
    assert outputs.offsets.shape == (0, 4)


def test_a_mesh_without_triangles_is_refused() -> None:
    with pytest.raises(InputError, match="no triangle"):
        measure(np.zeros((240, 320)), T_BOX, triangles=np.zeros((0, 3), np.int64))
