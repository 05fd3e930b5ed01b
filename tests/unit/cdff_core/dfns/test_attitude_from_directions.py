# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.attitude_from_directions.interface import (
    AttitudeFromDirectionsInputs,
    AttitudeFromDirectionsOutputs,
)
from cdff_core.dfns.attitude_from_directions.weighted_wahba import WeightedWahba

R = se3.exp_so3([0.3, -1.2, 2.0])


def solved(directions: np.ndarray, references: np.ndarray, sigma: float) -> AttitudeFromDirectionsOutputs:
    dfn = WeightedWahba()
    dfn.configure()
    return dfn.process(
        AttitudeFromDirectionsInputs(
            directions=directions, references=references, sigmas=np.full(len(directions), sigma)
        )
    )


def field(
    rng: np.random.Generator, count: int, sigma: float, width: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    v = np.column_stack([rng.uniform(-width, width, (count, 2)), np.ones(count)])
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    measured = v + rng.normal(0.0, sigma, v.shape)
    return measured / np.linalg.norm(measured, axis=1, keepdims=True), v @ R.T


def test_errors_agree_with_the_covariance_and_the_roll_is_the_weakest_axis() -> None:
    rng, sigma = np.random.default_rng(1), 5e-5
    squares = []
    for _ in range(300):
        result = solved(*field(rng, 15, sigma), sigma)
        error = se3.log_so3(R @ result.rotation.T)
        squares.append(error @ np.linalg.solve(result.covariance, error))
    assert np.mean(squares) == pytest.approx(3.0, abs=0.5)
    weakest = np.linalg.eigh(result.covariance)[1][:, -1]
    assert abs(weakest @ R[:, 2]) > 0.99


def test_wrong_pairs_are_rejected() -> None:
    measured, references = field(np.random.default_rng(2), 20, 5e-5)
    references[[3, 7]] = references[[7, 3]]
    result = solved(measured, references, 5e-5)
    assert not result.inliers[[3, 7]].any()
    assert result.inliers.sum() >= 17
    assert se3.rotation_angle(R @ result.rotation.T) < 5e-3


def test_one_direction_and_two_equal_ones_are_refused() -> None:
    measured, references = field(np.random.default_rng(3), 5, 1e-5)
    with pytest.raises(RefusedError, match="1 directions agree, expected at least 2"):
        solved(measured[:1], references[:1], 1e-5)
    with pytest.raises(DegenerateGeometryError, match="closer together than their errors"):
        solved(measured[[0, 0]], references[[0, 0]], 1e-5)
