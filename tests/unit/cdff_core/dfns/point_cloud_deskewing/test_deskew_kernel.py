# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Each point of the compiled deskewing has the interpolated pose, and the variance of its height."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.point_cloud_deskewing._kernels import deskew


@pytest.mark.parametrize("angle_scale", [1.0, 1e-5, 1e-9, 0.0])
def test_points_and_variances_follow_the_interpolated_poses(angle_scale: float) -> None:
    rng = np.random.default_rng(1)
    poses, n = 4, 12
    R = np.array([se3.exp_so3(v) for v in rng.normal(size=(poses, 3))])
    t, phi = rng.normal(size=(poses, 3)), angle_scale * rng.normal(size=(poses - 1, 3))
    factors = rng.normal(size=(poses, 6, 6))
    cov = factors @ np.swapaxes(factors, 1, 2)
    points, interval = rng.normal(0.0, 5.0, (n, 3)), rng.integers(0, poses - 1, n)
    fraction = rng.random(n)
    fraction[:2] = [0.0, 1.0]
    deskewed, variance = deskew(points, interval, fraction, R, t, phi, cov)
    for i, (k, f) in enumerate(zip(interval, fraction, strict=True)):
        arm = R[k] @ se3.exp_so3(f * phi[k]) @ points[i]
        np.testing.assert_allclose(deskewed[i], arm + (1 - f) * t[k] + f * t[k + 1], rtol=1e-12, atol=1e-13)
        J = np.array([0.0, 0.0, 1.0, arm[1], -arm[0], 0.0])
        expected = J @ ((1 - f) * cov[k] + f * cov[k + 1]) @ J
        assert variance[i] == pytest.approx(expected, rel=1e-11)


def test_a_negative_variance_is_zero_and_an_unknown_one_stays_unknown() -> None:
    R, t, phi = np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.zeros((1, 3))
    points, interval, fraction = np.array([[1.0, 2.0, 3.0]]), np.zeros(1, np.int64), np.array([0.5])
    cov = np.zeros((2, 6, 6))
    assert deskew(points, interval, fraction, R, t, phi, cov)[1].tolist() == [0.0]
    cov[:, 2, 2] = -1.0
    assert deskew(points, interval, fraction, R, t, phi, cov)[1].tolist() == [0.0]
    cov[0, 3, 3] = np.nan
    assert np.isnan(deskew(points, interval, fraction, R, t, phi, cov)[1]).tolist() == [True]
    assert deskew(points[:0], interval[:0], fraction[:0], R, t, phi, cov)[0].shape == (0, 3)
