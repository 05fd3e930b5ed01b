# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An IMU counts as present while its readings are recent."""

from __future__ import annotations

import numpy as np

from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer

S = 1_000_000_000


def test_an_imu_that_is_silent_for_more_than_a_second_counts_as_absent() -> None:
    buffer = ImuBuffer(60 * S)
    assert not buffer.has_readings(0, S)
    buffer.T_base_imu = np.eye(4)
    for tenth in range(10):
        buffer.insert(tenth * S // 10, np.zeros(3), np.zeros(3))
    assert buffer.has_readings(S // 2, S)
    assert buffer.has_readings(S, 2 * S)
    assert not buffer.has_readings(3 * S, 4 * S)
