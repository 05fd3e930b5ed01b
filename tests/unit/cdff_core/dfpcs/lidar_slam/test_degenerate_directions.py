# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_core.dfns.scan_to_map_registration.interface import ScanToMapRegistrationOutputs
from cdff_core.dfpcs.lidar_slam.degenerate_directions import degenerate_directions


def registration(sigma_m: list[float], gains: list[float]) -> ScanToMapRegistrationOutputs:
    return ScanToMapRegistrationOutputs(
        transform=np.eye(4),
        sweep=np.eye(4),
        covariance=np.eye(6),
        residual_covariance=np.eye(6),
        calibration_covariance=np.eye(6),
        directions=np.eye(6),
        agreement=np.ones(6),
        sigma_m=np.array(sigma_m),
        gains=np.array(gains),
        radius_m=10.0,
        inlier_ratio=1.0,
        support_ratio=1.0,
        rms_m=0.01,
        iterations=3,
        converged=True,
    )


def test_all_directions_of_a_lost_sweep_follow_the_prediction() -> None:
    directions = degenerate_directions(None, 0.09)
    np.testing.assert_array_equal(directions.projection(1.0 - directions.gains), np.eye(6))
    np.testing.assert_array_equal(directions.covariance, np.zeros((6, 6)))


def test_the_noise_along_a_degenerate_direction_is_that_of_the_map_times_its_weight() -> None:
    directions = degenerate_directions(
        registration([0.2, 0.01, 0.01, 0.01, 0.01, 0.5], [0.5, 1.0, 1.0, 1.0, 1.0, 0.1]), 0.09
    )
    np.testing.assert_allclose(directions.projection(np.ones(2)), np.diag([1.0, 0, 0, 0, 0, 1.0]))
    sigma = np.sqrt(np.diag(directions.covariance))
    np.testing.assert_allclose(sigma, [0.1, 0, 0, 0, 0, 0.005])  # metres, radians at a radius of 10 m
