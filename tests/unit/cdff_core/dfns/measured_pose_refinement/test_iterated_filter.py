# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MeasuredPoseRefinement: convergence, wrong hypotheses, prediction, covariance, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_core.dfns.measured_pose_refinement.interface import (
    MeasuredPoseRefinementInputs,
    MeasuredPoseRefinementOutputs,
)
from cdff_core.dfns.measured_pose_refinement.iterated_filter import IteratedFilter

K = np.array([[400.0, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]])
T_START = se3.transform(se3.exp_so3([0.1, -0.2, 0.3]), [0.1, 0.0, 4.0])
ERROR = np.array([0.02, -0.01, 0.03, 0.01, -0.02, 0.015])
WIDE = np.diag(np.repeat([0.1, 0.1], 3) ** 2)


def moved(T: np.ndarray, error: np.ndarray) -> np.ndarray:
    return se3.transform(se3.exp_so3(error[3:6]) @ T[:3, :3], T[:3, 3] + error[:3])


def pixels_of(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    p = points @ T[:3, :3].T + T[:3, 3]
    return np.asarray(p[:, :2] / p[:, 2:] * 400.0 + K[:2, 2])


def measured(rng: np.random.Generator, hypotheses: int = 1, sigma_px: float = 0.1) -> dict[str, Any]:
    """Return the ports of 200 points of a body that is at ERROR from the start."""
    points = rng.uniform(-0.5, 0.5, (200, 3))
    angle = rng.uniform(0.0, 2.0 * np.pi, 200)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start = pixels_of(points, T_START)
    offsets = rng.uniform(-12.0, 12.0, (200, hypotheses))
    true = np.einsum("ij,ij->i", normals, pixels_of(points, moved(T_START, ERROR)) - start)
    offsets[:, -1] = true + rng.normal(0.0, sigma_px, 200)
    return {"points": points, "pixels": start, "normals": normals, "offsets": offsets}


def refine(ports: dict[str, Any], **changes: Any) -> MeasuredPoseRefinementOutputs:
    node = IteratedFilter()
    node.configure()
    others = {"camera_matrix": K, "pose": T_START, "limit_px": 12.0, "prior_covariance": WIDE}
    return node.process(MeasuredPoseRefinementInputs(**ports | others | changes))


def distance(outputs: MeasuredPoseRefinementOutputs) -> float:
    error = pose_error(moved(T_START, ERROR), moved(T_START, outputs.correction))
    return float(np.linalg.norm(error))


def test_the_start_converges_to_the_measured_pose(rng: np.random.Generator) -> None:
    outputs = refine(measured(rng))
    assert distance(outputs) < 0.004
    assert outputs.agreement > 0.95
    assert outputs.sigma_px < 0.2


def test_the_right_one_of_several_hypotheses_is_used(rng: np.random.Generator) -> None:
    outputs = refine(measured(rng, hypotheses=2))
    assert distance(outputs) < 0.01


def test_a_third_of_wrong_points_has_no_weight(rng: np.random.Generator) -> None:
    ports = measured(rng)
    ports["offsets"][::3] += 9.0
    outputs = refine(ports)
    assert distance(outputs) < 0.006
    assert 0.6 < outputs.agreement < 0.72


def test_a_certain_prediction_is_kept(rng: np.random.Generator) -> None:
    outputs = refine(measured(rng), prior_covariance=1e-14 * np.eye(6), limit_px=20.0)
    np.testing.assert_allclose(outputs.correction, 0.0, atol=1e-6)


def test_other_errors_of_the_state_follow_their_correlation_with_the_pose(rng: np.random.Generator) -> None:
    P = np.zeros((8, 8))
    P[:6, :6] = WIDE
    P[6, 6], P[7, 7] = 1.0, 1.0
    P[0, 6] = P[6, 0] = 0.1
    outputs = refine(measured(rng), prior_covariance=P, prior_error=np.zeros(8))
    assert outputs.correction[6] == pytest.approx(10.0 * ERROR[0], rel=0.1)
    assert outputs.correction[7] == 0.0
    assert outputs.covariance[6, 6] < 0.01
    assert outputs.covariance[7, 7] == pytest.approx(1.0)


def test_more_points_give_a_smaller_covariance(rng: np.random.Generator) -> None:
    ports = measured(rng)
    few = {name: values[:40] for name, values in ports.items()}
    assert np.trace(refine(ports).covariance) < np.trace(refine(few).covariance)


def test_points_without_image_edges_are_refused(rng: np.random.Generator) -> None:
    ports = measured(rng)
    ports["offsets"][5:] = np.nan
    with pytest.raises(RefusedError) as error:
        refine(ports)
    assert error.value.reasons[0] == "few_edges:5<6"


def test_six_points_are_enough(rng: np.random.Generator) -> None:
    ports = measured(rng)
    ports["offsets"][:6], ports["offsets"][6:] = 0.0, np.nan
    np.testing.assert_allclose(refine(ports).correction, 0.0, atol=1e-9)


def test_a_state_without_the_errors_of_a_pose_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="expected at least 6 errors"):
        refine(measured(rng), prior_covariance=np.eye(3))


def test_points_with_a_large_standard_deviation_have_little_weight(rng: np.random.Generator) -> None:
    ports = measured(rng)
    wrong = ports["offsets"].copy()
    wrong[::2] += 2.0
    sigmas = np.where(np.arange(len(wrong)) % 2, 0.2, 20.0)
    plain = refine(ports | {"offsets": wrong})
    weighted = refine(ports | {"offsets": wrong, "sigmas": sigmas})
    assert distance(weighted) < 0.5 * distance(plain)
    assert distance(weighted) < 0.003
