# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gyro integration: rotation and covariance from angular rates."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.gyro_integration.interface import GyroIntegrationInputs, GyroIntegrationOutputs
from cdff_core.dfns.gyro_integration.midpoint_rates import MidpointRates

MS = 1_000_000


def integrate(
    stamps_ns: np.ndarray, rates_rad_s: np.ndarray, start_ns: int, end_ns: int, bias: object = (0, 0, 0)
) -> GyroIntegrationOutputs:
    node = MidpointRates()
    node.configure({"noise_rad_s_sqrt_hz": 0.001, "bias_sigma_rad_s": 0.0002, "max_gap_s": 0.1})
    return node.process(
        GyroIntegrationInputs(
            stamps_ns=stamps_ns,
            rates_rad_s=rates_rad_s,
            bias_rad_s=np.asarray(bias, dtype=float),
            interval_ns=np.array([start_ns, end_ns]),
        )
    )


def constant_rates(rate: list[float], n: int = 101) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(n, dtype=np.int64) * 10 * MS, np.tile(np.array(rate), (n, 1))


def test_a_constant_rate_gives_rate_times_time() -> None:
    out = integrate(*constant_rates([0.3, -0.2, 0.5]), 100 * MS, 900 * MS)
    np.testing.assert_allclose(out.rotation, se3.exp_so3(0.8 * np.array([0.3, -0.2, 0.5])), atol=1e-12)


def test_the_bias_is_subtracted() -> None:
    out = integrate(*constant_rates([0.01, 0.02, 0.03]), 0, 1000 * MS, bias=[0.01, 0.02, 0.03])
    np.testing.assert_allclose(out.rotation, np.eye(3), atol=1e-12)


def test_interval_ends_between_readings_are_interpolated() -> None:
    stamps = np.arange(11, dtype=np.int64) * 100 * MS
    rates = np.stack([np.zeros(11), np.zeros(11), stamps * 1e-9], axis=1)
    out = integrate(stamps, rates, 250 * MS, 750 * MS)
    np.testing.assert_allclose(se3.log_so3(out.rotation), [0, 0, (0.75**2 - 0.25**2) / 2], atol=1e-12)


def test_a_coning_motion_is_integrated_to_second_order() -> None:
    t = np.arange(0, 1001) * 1e-3
    w = 2 * np.pi * 2.0
    rates = 0.5 * np.stack([np.cos(w * t), np.sin(w * t), np.zeros_like(t)], axis=1)
    reference = np.eye(3)
    for k in range(1000):
        for s in (0.25, 0.75):
            t_s = (k + s) * 1e-3
            reference = reference @ se3.exp_so3(
                0.5e-3 * 0.5 * np.array([np.cos(w * t_s), np.sin(w * t_s), 0])
            )
    out = integrate(np.arange(0, 1001, 10) * MS, rates[::10], 0, 1000 * MS)
    assert se3.rotation_angle(reference.T @ out.rotation) < 1e-3


def test_the_covariance_grows_with_time() -> None:
    short = integrate(*constant_rates([0, 0, 0.1]), 0, 100 * MS).covariance
    long = integrate(*constant_rates([0, 0, 0.1]), 0, 1000 * MS).covariance
    assert np.all(np.diag(long) > 9 * np.diag(short))


def test_the_covariance_is_that_of_noise_and_bias() -> None:
    covariance = integrate(*constant_rates([0, 0, 0.1]), 0, 1000 * MS).covariance
    np.testing.assert_allclose(covariance, (0.001**2 * 1.0 + (0.0002 * 1.0) ** 2) * np.eye(3), rtol=1e-12)


@pytest.mark.parametrize(("start", "end"), [(-500, 100), (800, 1400), (2000, 2100)])
def test_an_interval_without_readings_is_refused(start: int, end: int) -> None:
    with pytest.raises(RefusedError) as refused:
        integrate(*constant_rates([0, 0, 0]), start * MS, end * MS)
    assert refused.value.reasons == ("gyro_gap",)


def test_a_gap_in_the_readings_is_refused() -> None:
    stamps, rates = constant_rates([0, 0, 0])
    keep = (stamps < 300 * MS) | (stamps > 500 * MS)
    with pytest.raises(RefusedError):
        integrate(stamps[keep], rates[keep], 0, 1000 * MS)


def test_no_readings_are_refused() -> None:
    with pytest.raises(RefusedError):
        integrate(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), 0, 10 * MS)


def test_non_increasing_stamps_are_refused() -> None:
    stamps, rates = constant_rates([0, 0, 0])
    with pytest.raises(InputError, match="ascending"):
        integrate(stamps[::-1].copy(), rates, 0, 100 * MS)
