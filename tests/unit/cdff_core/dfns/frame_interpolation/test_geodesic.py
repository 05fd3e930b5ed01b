# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Geodesic interpolation: exact at the ends and for constant motion, with propagated covariance."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.frame_interpolation.interface import FrameInterpolationInputs, FrameInterpolationOutputs

A = se3.exp_se3([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
B = se3.transform(A[:3, :3] @ se3.exp_so3([0, 0, 0.4]), [2.0, 2.0, 2.0])
C = np.diag([0.04, 0.04, 0.04, 0.01, 0.01, 0.01])


def interpolate(
    time: int, cross: np.ndarray | None = None, covariance: np.ndarray | None = C, **config: float
) -> FrameInterpolationOutputs:
    node = Registry.default().make_dfn("frame_interpolation")
    node.configure({"acceleration_m_s2": 0.0, "angular_acceleration_rad_s2": 0.0, **config})
    ends = np.array([0, 1_000_000_000])
    return node.process(
        FrameInterpolationInputs(
            first=A,
            second=B,
            interval_ns=ends,
            time_ns=time,
            first_covariance=covariance,
            second_covariance=covariance,
            cross_covariance=cross,
        )
    )


def test_the_midpoint_has_the_mean_position_and_half_the_rotation() -> None:
    out = interpolate(500_000_000)
    np.testing.assert_allclose(out.pose[:3, 3], [1.5, 2.0, 2.5])
    np.testing.assert_allclose(out.pose[:3, :3], A[:3, :3] @ se3.exp_so3([0, 0, 0.2]), atol=1e-12)
    np.testing.assert_allclose(interpolate(0).pose, A, atol=1e-12)
    np.testing.assert_allclose(interpolate(1_000_000_000).pose, B, atol=1e-12)


def test_the_covariance_of_the_midpoint_depends_on_the_cross_covariance() -> None:
    np.testing.assert_allclose(interpolate(500_000_000).covariance, C)
    np.testing.assert_allclose(interpolate(500_000_000, C).covariance, C)
    np.testing.assert_allclose(interpolate(500_000_000, np.zeros((6, 6))).covariance, 0.5 * C)


def test_the_uncertainty_of_motion_in_between_is_added() -> None:
    wider = interpolate(500_000_000, acceleration_m_s2=0.8).covariance
    assert wider[0, 0] - C[0, 0] == pytest.approx((0.8 / 8) ** 2)
    assert interpolate(0, acceleration_m_s2=0.8).covariance[0, 0] == pytest.approx(C[0, 0])


def test_an_unknown_covariance_stays_unknown_and_a_time_outside_is_refused() -> None:
    assert np.isnan(interpolate(1, covariance=None).covariance).all()
    with pytest.raises(ExtrapolationError, match="within"):
        interpolate(-1)
