# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of the IMU change readings by the stated amounts."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_dev.simulate.faults.imu import ImuFaults, Misalignment, Vibration, WarmUp, disturbed

T_S = np.arange(0, 4000) / 100.0
GRAVITY = np.tile([0.0, 0.0, 3.71], (len(T_S), 1))
NO_RATE = np.zeros((len(T_S), 3))


def driving(speed_m_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return T_S, np.full(len(T_S), speed_m_s), speed_m_s * T_S


def test_vibration_has_the_stated_rms_in_proportion_to_the_speed(rng: np.random.Generator) -> None:
    faults = ImuFaults(vibration=Vibration(acc_m_s2=0.8, gyro_rad_s=0.02, spacing_m=0.047))
    for speed in (1.0, 0.4):
        acc, gyro = disturbed(faults, GRAVITY, NO_RATE, driving(speed), rng)
        np.testing.assert_allclose((acc - GRAVITY).std(axis=0), 0.8 * speed, rtol=0.05)
        np.testing.assert_allclose(gyro.std(axis=0), 0.02 * speed, rtol=0.05)
    acc, gyro = disturbed(faults, GRAVITY, NO_RATE, driving(0.0), rng)
    np.testing.assert_array_equal(acc, GRAVITY)


def test_vibration_has_the_frequency_of_the_grousers(rng: np.random.Generator) -> None:
    faults = ImuFaults(vibration=Vibration(acc_m_s2=1.0, spacing_m=0.1))
    acc, _ = disturbed(faults, GRAVITY, NO_RATE, driving(0.5), rng)
    spectrum = np.abs(np.fft.rfft(acc[:, 0]))
    strongest = np.fft.rfftfreq(len(T_S), 0.01)[np.argsort(spectrum)[-3:]]
    np.testing.assert_allclose(np.sort(strongest), [5.0, 10.0, 15.0], atol=0.05)


def test_the_bias_grows_to_its_final_value() -> None:
    faults = ImuFaults(warm_up=WarmUp(gyro_sigma_rad_s=2e-3, acc_sigma_m_s2=0.05, time_constant_s=10.0))
    finals = []
    for seed in range(200):
        _, gyro = disturbed(faults, GRAVITY, NO_RATE, driving(0.0), np.random.default_rng(seed))
        assert not gyro[0].any()
        np.testing.assert_allclose(gyro[1000], gyro[-1] * (1 - np.exp(-1)) / (1 - np.exp(-3.999)), rtol=1e-6)
        finals.append(gyro[-1] / (1 - np.exp(-3.999)))
    assert np.std(finals) == pytest.approx(2e-3, rel=0.1)


def test_misalignment_tilts_gravity_by_the_stated_angle() -> None:
    faults = ImuFaults(misalignment=Misalignment(rotation_sigma_deg=1.0))
    tilts = []
    for seed in range(300):
        acc, _ = disturbed(faults, GRAVITY, NO_RATE, driving(0.0), np.random.default_rng(seed))
        tilts.append(np.degrees(acc[0, :2] / 3.71))
        assert np.linalg.norm(acc[0]) == pytest.approx(3.71)
    assert np.std(tilts) == pytest.approx(1.0, rel=0.1)
