# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An IMU counts as present while its readings are recent."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer

S = 1_000_000_000


def test_a_gap_and_the_motion_in_it_do_not_change_the_noise_density() -> None:
    densities = []
    for gap_ns, jump in ((0, 0.0), (5 * S, 3.0)):
        buffer = ImuBuffer(60 * S)
        buffer.T_base_imu = np.eye(4)
        noise = np.random.default_rng(3).normal(0.0, 0.1, (60, 2, 3))
        for i, (force, rate) in enumerate(noise):
            late = i >= 30
            buffer.insert(i * S // 100 + late * gap_ns, force + late * jump, rate + late * jump)
        densities.append(buffer.noise(20 * S))
    np.testing.assert_allclose(densities[1], densities[0], rtol=0.05)
    assert densities[0][0] == pytest.approx(0.1 * np.sqrt(0.01), rel=0.2)


def test_an_imu_that_is_silent_for_more_than_a_second_counts_as_absent() -> None:
    buffer = ImuBuffer(60 * S)
    assert not buffer.has_readings(0, S)
    buffer.T_base_imu = np.eye(4)
    for tenth in range(10):
        buffer.insert(tenth * S // 10, np.zeros(3), np.zeros(3))
    assert buffer.has_readings(S // 2, S)
    assert buffer.has_readings(S, 2 * S)
    assert not buffer.has_readings(3 * S, 4 * S)
