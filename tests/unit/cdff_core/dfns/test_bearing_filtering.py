# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.bearing_tracking.motion import BearingStates, across, states_at_rest
from cdff_core.dfns.bearing_filtering.constant_angular_velocity import ConstantAngularVelocity
from cdff_core.dfns.bearing_filtering.interface import BearingFilteringInputs, BearingFilteringOutputs

SIGMA = 5e-5


def make() -> ConstantAngularVelocity:
    dfn = ConstantAngularVelocity()
    dfn.configure({"noise_rad2_s3": 1e-16})
    return dfn


def step(
    dfn: ConstantAngularVelocity, states: BearingStates, interval: float, measured: np.ndarray | None = None
) -> BearingFilteringOutputs:
    n = len(states)
    return dfn.process(
        BearingFilteringInputs(
            directions=states.directions,
            rates=states.rates,
            covariances=states.covariances,
            interval=interval,
            measured=measured,
            measured_covariances=None
            if measured is None
            else np.repeat(np.eye(3)[None] * SIGMA**2, n, axis=0),
        )
    )


def small_circle(times_s: np.ndarray, axis_deg: float = 80.0) -> np.ndarray:
    """Directions that turn about an axis 80 degrees away, as a line of sight in an orbit."""
    axis = np.array([0.0, 0.0, 1.1e-3])
    start = np.array([np.sin(np.radians(axis_deg)), 0.0, np.cos(np.radians(axis_deg))])
    return np.einsum("nij,j->ni", se3.exp_so3(np.outer(times_s, axis)), start)


def track(rng: np.random.Generator, times_s: np.ndarray) -> tuple[BearingStates, list[float]]:
    dfn, truth = make(), small_circle(times_s)
    noisy = truth + rng.normal(0.0, SIGMA, truth.shape)
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    states = states_at_rest(noisy[:1], np.eye(3)[None] * SIGMA**2, 1.5e-3)
    nis = []
    for k in range(1, len(times_s)):
        out = step(dfn, states, float(times_s[k] - times_s[k - 1]), noisy[k : k + 1])
        states = BearingStates(out.directions, out.rates, out.covariances)
        nis.append(float(out.nis[0]))
    return states, nis


def test_innovations_and_errors_agree_with_the_covariance() -> None:
    rng, times_s = np.random.default_rng(1), np.arange(0.0, 60.0, 2.0)
    nis, nees = [], []
    for _ in range(60):
        states, values = track(rng, times_s)
        nis += values
        error = small_circle(times_s[-1:])[0] - states.directions[0]
        e = np.linalg.svd(states.directions)[2][1:]
        H = np.cross(states.directions[0], e)
        P = H @ states.covariances[0, :3, :3] @ H.T
        nees.append((e @ error) @ np.linalg.solve(P, e @ error))
    assert np.mean(nis) == pytest.approx(2.0, abs=0.12)
    assert np.mean(nees) == pytest.approx(2.0, abs=0.6)


def test_a_coasting_direction_stays_within_its_growing_covariance_for_35_minutes() -> None:
    states, _ = track(np.random.default_rng(2), np.arange(0.0, 600.0, 5.0))
    dfn, sigmas = make(), []
    for minutes in (1, 10, 35):
        out = step(dfn, states, 60.0 * minutes)
        predicted = BearingStates(out.directions, out.rates, out.covariances)
        position, _ = across(predicted)
        sigmas.append(np.sqrt(np.linalg.eigvalsh(position)[0, -1]))
        error = np.linalg.norm(small_circle(np.array([595.0 + 60.0 * minutes]))[0] - out.directions[0])
        assert error < 3.5 * sigmas[-1]
    assert sigmas[0] < sigmas[1] < sigmas[2]


def test_an_object_without_measurement_is_predicted_only_and_time_going_backwards_is_refused() -> None:
    states = states_at_rest(np.eye(3)[:2], np.repeat(np.eye(3)[None] * SIGMA**2, 2, axis=0), 1e-3)
    out = step(make(), states, 1.0, np.array([[1.0, 1e-4, 0.0], [np.nan] * 3]))
    assert np.isfinite(out.nis[0])
    assert np.isnan(out.nis[1])
    assert out.directions[1] == pytest.approx([0.0, 1.0, 0.0])
    with pytest.raises(InputError, match=r"interval=-1.0: expected seconds, at least 0"):
        step(make(), states, -1.0)
