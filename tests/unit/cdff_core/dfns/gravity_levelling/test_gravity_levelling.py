# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gravity levelling: roll, pitch and gyro bias from readings at rest."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.gravity_levelling.interface import GravityLevellingInputs, GravityLevellingOutputs
from cdff_core.dfns.gravity_levelling.mean_specific_force import MeanSpecificForce

MARS_M_S2 = 3.71


def level(force: np.ndarray, rates: np.ndarray) -> GravityLevellingOutputs:
    node = MeanSpecificForce()
    node.configure({})
    return node.process(GravityLevellingInputs(specific_force=force, rates_rad_s=rates))


def at_rest(R_level_body: np.ndarray, rng: np.random.Generator, n: int = 50) -> tuple[np.ndarray, np.ndarray]:
    up_body = R_level_body.T @ [0, 0, MARS_M_S2]
    return up_body + 0.01 * rng.standard_normal((n, 3)), 0.001 * rng.standard_normal((n, 3))


def test_tilt_is_estimated_and_heading_unchanged(rng: np.random.Generator) -> None:
    tilt = se3.exp_so3([0, 0.15, 0]) @ se3.exp_so3([-0.1, 0, 0])
    out = level(*at_rest(tilt, rng))
    assert se3.rotation_angle(out.rotation @ tilt.T) < 3e-3
    assert out.rotation[1, 0] == pytest.approx(0.0, abs=1e-12)
    assert out.at_rest


def test_the_gyro_bias_is_the_mean_rate_at_rest(rng: np.random.Generator) -> None:
    force, rates = at_rest(np.eye(3), rng, 400)
    out = level(force, rates + np.array([0.002, -0.001, 0.0005]))
    np.testing.assert_allclose(out.gyro_bias_rad_s, [0.002, -0.001, 0.0005], atol=2e-4)


def test_errors_are_consistent_with_the_covariance(rng: np.random.Generator) -> None:
    nees = []
    for _ in range(200):
        tilt = se3.exp_so3([0, rng.normal(0, 0.1), 0]) @ se3.exp_so3([rng.normal(0, 0.1), 0, 0])
        force, rates = at_rest(tilt, rng)
        out = level(force + 0.01 * rng.standard_normal(3), rates)
        error = se3.log_so3(tilt @ out.rotation.T)[:2]
        nees.append(error @ np.linalg.solve(out.covariance[:2, :2], error))
    assert 1.6 < np.mean(nees) < 2.5


def test_a_moving_body_is_levelled_with_a_larger_sigma_and_without_bias(rng: np.random.Generator) -> None:
    force, rates = at_rest(np.eye(3), rng)
    out = level(force + rng.normal(0, 0.5, (len(force), 3)), rates + np.array([0.1, 0, 0]))
    assert not out.at_rest
    assert not out.gyro_bias_rad_s.any()
    assert out.covariance[0, 0] == pytest.approx(0.05**2)


def test_free_fall_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(DegenerateGeometryError) as refused:
        level(0.001 * rng.standard_normal((50, 3)), np.zeros((50, 3)))
    assert refused.value.directions == ("roll", "pitch")


def test_gravity_along_x_leaves_the_heading_undefined() -> None:
    with pytest.raises(DegenerateGeometryError, match="x axis"):
        level(np.tile([MARS_M_S2, 0, 0], (50, 1)), np.zeros((50, 3)))


def test_too_few_readings_are_refused() -> None:
    with pytest.raises(RefusedError) as refused:
        level(np.tile([0, 0, MARS_M_S2], (3, 1)), np.zeros((3, 3)))
    assert refused.value.reasons == ("few_samples:3",)


def test_inconsistent_readings_are_refused() -> None:
    with pytest.raises(InputError, match=r"n=50 of specific_force"):
        level(np.zeros((50, 3)), np.zeros((49, 3)))
