# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The compiled integration of inertial readings follows its trapezoidal formula, step by step."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.kalman_prediction._kernels import strapdown


@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_each_step_is_trapezoidal_with_coning_to_second_order(count: int) -> None:
    """The vector of each step is that of Bortz 1971: its cross products with the sum of the earlier ones."""
    rng = np.random.default_rng(count)
    t_s = np.cumsum(np.r_[0.0, rng.uniform(0.01, 0.05, count - 1)])
    readings = rng.normal(0.0, 2.0, (count, 6))
    rotation, integral, dv, dp = strapdown(t_s, readings)
    steps = 0.5 * np.diff(t_s)[:, None] * (readings[1:, :3] + readings[:-1, :3])
    sums = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    coning = np.vstack([np.zeros(3), np.cumsum(0.5 * np.cross(sums[:-1], steps), axis=0)])
    R = [se3.exp_so3(v) for v in sums + coning]
    forces = np.array([r @ f for r, f in zip(R, readings[:, 3:], strict=True)])
    velocities = np.vstack(
        [np.zeros(3), np.cumsum(0.5 * np.diff(t_s)[:, None] * (forces[1:] + forces[:-1]), 0)]
    )
    np.testing.assert_allclose(rotation, R[-1], atol=1e-14)
    np.testing.assert_allclose(integral, np.trapezoid(R, t_s, axis=0), atol=1e-14)
    np.testing.assert_allclose(dv, velocities[-1], atol=1e-14)
    np.testing.assert_allclose(dp, np.trapezoid(velocities, t_s, axis=0), atol=1e-14)


def test_no_rotation_gives_the_identity() -> None:
    rotation, integral, dv, dp = strapdown(
        np.array([0.0, 2.0]), np.array([[0, 0, 0, 1.0, 0, 0], [0, 0, 0, 3.0, 0, 0]])
    )
    np.testing.assert_array_equal(rotation, np.eye(3))
    np.testing.assert_array_equal(integral, 2.0 * np.eye(3))
    np.testing.assert_array_equal(dv, [4.0, 0.0, 0.0])
    np.testing.assert_array_equal(dp, [4.0, 0.0, 0.0])
