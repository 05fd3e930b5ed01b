# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""EdgeOrientation: a lit satellite near a predicted pose, and images that do not show it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.image_pose_refinement.interface import Inputs, Outputs
from tests.support import satellite
from tests.unit.cdff_core.dfns.image_pose_search.test_edge_orientation import CAMERA, R, T, photograph

COVARIANCE = np.diag(np.square([0.15, 0.15, 0.24, 0.03, 0.03, 0.03]))
K = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]])


def refined(image: np.ndarray, pose: np.ndarray, camera_matrix: np.ndarray = K, **config: Any) -> Outputs:
    dfn = Registry.default().make_dfn("image_pose_refinement")
    dfn.configure({"window_px": 96, "generations": 12, **config})
    vertices, triangles = satellite.satellite()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    outputs: Outputs = dfn.process(
        Inputs(
            image=image,
            camera_matrix=camera_matrix,
            pose=pose,
            covariance=COVARIANCE,
            vertices=vertices,
            triangles=triangles,
            centre_m=0.5 * (low + high),
            diameter_m=float(np.ptp(vertices, axis=0).max()),
        )
    )
    return outputs


def prediction() -> np.ndarray:
    return se3.transform(se3.exp_so3([0.03, -0.03, 0.03]) @ R, T[:3, 3] + [0.15, -0.15, 0.24])


def test_a_pose_near_the_prediction_is_found_with_a_covariance_that_contains_its_error() -> None:
    outputs = refined(photograph(), prediction())
    error = pose_error(outputs.pose, T)
    start = pose_error(prediction(), T)
    assert np.linalg.norm(error[3:]) < np.linalg.norm(start[3:])
    assert np.linalg.norm(error[:2]) < 0.03
    assert abs(error[2]) < abs(start[2])
    assert error @ np.linalg.solve(outputs.covariance, error) < 20.0
    assert np.trace(outputs.covariance[:2, :2]) < 0.05 * np.trace(COVARIANCE[:2, :2])
    assert 0.4 < outputs.correlation <= 1.0
    repeated = refined(photograph(), prediction())
    np.testing.assert_array_equal(repeated.pose, outputs.pose)


def test_an_image_without_the_body_is_refused() -> None:
    noise = np.random.default_rng(5).normal(8.0, 2.0, (240, 320))
    with pytest.raises(RefusedError) as refused:
        refined(np.clip(noise, 0, 255).astype(np.uint8), prediction(), generations=2)
    assert refused.value.reasons[0].startswith("no_edges:")
    with pytest.raises(RefusedError) as refused:
        refined(np.zeros((240, 320), np.uint8), prediction(), generations=2)
    assert refused.value.reasons[0].startswith("no_edges:")


@pytest.mark.parametrize(
    ("position", "reason"), [([0.0, 0.0, -5.0], "behind_camera"), ([9.0, 0.0, 5.0], "outside_image")]
)
def test_a_body_that_the_camera_cannot_see_is_refused(position: list[float], reason: str) -> None:
    with pytest.raises(RefusedError) as refused:
        refined(photograph(), se3.transform(R, position))
    assert list(refused.value.reasons) == [reason]


def test_a_focal_length_of_zero_is_invalid() -> None:
    with pytest.raises(InputError, match="focal lengths 0"):
        refined(photograph(), prediction(), np.diag([0.0, 700.0, 1.0]))
