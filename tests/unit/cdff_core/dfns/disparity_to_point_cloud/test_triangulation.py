# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.dfns.disparity_to_point_cloud.interface import (
    DisparityToPointCloudInputs,
    DisparityToPointCloudOutputs,
)
from cdff_core.dfns.disparity_to_point_cloud.triangulation import Triangulation

K = np.array([[400.0, 0, 32], [0, 400, 24], [0, 0, 1]])
BASELINE_M = 0.25


def disparity_image(disparity: np.ndarray, camera_matrix: np.ndarray | None = K) -> Frame:
    return Frame.from_image(
        disparity.astype(np.float32), stamp_ns=0, mode="UNDEF", camera_matrix=camera_matrix
    )


def triangulate(
    disparity: np.ndarray, baseline_m: float = BASELINE_M, left: Frame | None = None, **config: Any
) -> DisparityToPointCloudOutputs:
    node = Triangulation()
    node.configure({"max_depth_sigma_m": 100.0, **config})
    return node.process(
        DisparityToPointCloudInputs(disparity=disparity_image(disparity), baseline_m=baseline_m, left=left)
    )


def test_points_project_back_to_their_pixels_and_disparities(rng: np.random.Generator) -> None:
    disparity = rng.uniform(5, 40, (48, 64))
    points = triangulate(disparity).points
    u, v = 400 * points[:, 0] / points[:, 2] + 32, 400 * points[:, 1] / points[:, 2] + 24
    rows, cols = np.rint(v).astype(int), np.rint(u).astype(int)
    assert len(points) == disparity.size
    np.testing.assert_allclose(u, cols, atol=1e-9)
    np.testing.assert_allclose(400 * BASELINE_M / points[:, 2], disparity[rows, cols], rtol=1e-6)


def test_pixels_without_disparity_or_at_infinity_give_no_point() -> None:
    disparity = np.full((4, 4), np.nan)
    disparity[0] = [10.0, 0.0, -1.0, np.inf]
    assert len(triangulate(disparity).points) == 1


def test_the_depth_sigma_equals_the_scatter_of_repeated_measurements(rng: np.random.Generator) -> None:
    out = triangulate(20.0 + rng.normal(0.0, 0.3, (100, 100)), sigma_px=0.3)
    assert np.std(out.points[:, 2]) == pytest.approx(np.median(out.depth_sigma_m), rel=0.05)


def test_the_common_error_is_that_of_focal_length_and_baseline() -> None:
    out = triangulate(np.full((4, 4), 20.0), focal_length_ratio=0.003, baseline_ratio=0.004)
    assert out.scale_sigma == pytest.approx(0.005)


def test_points_too_uncertain_or_out_of_range_are_omitted() -> None:
    disparity = np.array([[50.0, 20.0, 10.0, 5.0]])  # 2, 5, 10, 20 m
    assert triangulate(disparity, sigma_px=0.5, max_depth_sigma_m=0.6).points[:, 2].tolist() == [
        2.0,
        5.0,
        10.0,
    ]
    assert triangulate(disparity, min_depth_m=3.0, max_depth_m=12.0).points[:, 2].tolist() == [5.0, 10.0]


def test_a_step_of_n_pixels_uses_every_nth_pixel_without_changing_its_point() -> None:
    all_points, every_fourth = (
        triangulate(np.full((8, 8), 10.0)),
        triangulate(np.full((8, 8), 10.0), step_px=4),
    )
    assert len(every_fourth.points) == 4
    assert {tuple(p) for p in every_fourth.points} <= {tuple(p) for p in all_points.points}


def test_intensity_is_the_grey_value_of_the_left_image() -> None:
    left = Frame.from_image(np.arange(16, dtype=np.uint8).reshape(4, 4), stamp_ns=0, camera_matrix=K)
    assert triangulate(np.full((4, 4), 10.0), left=left).intensity.tolist() == list(range(16))


def test_inputs_without_camera_baseline_or_size_are_refused() -> None:
    node = Triangulation()
    node.configure()
    flat = np.full((4, 4), 10.0)
    with pytest.raises(InputError, match="camera matrix"):
        node.process(DisparityToPointCloudInputs(disparity=disparity_image(flat, None), baseline_m=0.2))
    with pytest.raises(InputError, match="baseline"):
        triangulate(flat, baseline_m=0.0)
    with pytest.raises(InputError, match="size"):
        triangulate(flat, left=Frame.from_image(np.zeros((5, 4), np.uint8), stamp_ns=0))
