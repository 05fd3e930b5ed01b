# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.rigid_body.torque_free import TorqueFreeBody, principal_axes

TRIAXIAL = np.diag([1.0, 1.5, 2.0])
TIMES_S = np.linspace(0.0, 200.0, 21)


def integrated(
    inertia: FloatArray, rate: FloatArray, R_inertial_body: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rates (n, 3) and orientations (n, 3, 3) at ``TIMES_S`` by integration of Euler's equations."""

    def derivative(_: float, state: FloatArray) -> FloatArray:
        w, R = state[:3], state[3:].reshape(3, 3)
        return np.concatenate(
            [np.linalg.solve(inertia, -np.cross(w, inertia @ w)), (R @ se3.skew(w)).ravel()]
        )

    start = np.concatenate([rate, R_inertial_body.ravel()])
    options = {"t_eval": TIMES_S, "method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    states = solve_ivp(derivative, (0.0, TIMES_S[-1]), start, **options).y.T
    return states[:, :3], states[:, 3:].reshape(-1, 3, 3)


def random_inertia(rng: np.random.Generator) -> FloatArray:
    moments = np.sort(rng.uniform(1.0, 3.0, 3))
    moments[2] = min(moments[2], moments[0] + moments[1])
    Q = se3.exp_so3(rng.normal(size=3))
    return np.asarray(Q @ np.diag(moments) @ Q.T)


@pytest.mark.parametrize(
    ("inertia", "rate"),
    [
        *(
            (random_inertia(np.random.default_rng(k)), np.random.default_rng(k).normal(0, 0.1, 3))
            for k in range(6)
        ),
        (np.diag([2.0, 2.0, 3.0]), np.array([0.05, 0.1, 0.1])),
        (np.diag([2.0, 3.0, 3.0]), np.array([0.05, -0.1, 0.1])),
        (np.diag([2.0, 2.0, 2.0]), np.array([0.05, -0.1, 0.1])),
        (TRIAXIAL, np.array([0.0, 0.0, -0.1])),
        (TRIAXIAL, np.array([0.1, 0.0, 0.0])),
        (TRIAXIAL, np.array([0.0, 0.1, 0.0])),
        (TRIAXIAL, np.array([1e-7, 0.0, 0.1])),
        (TRIAXIAL, np.array([0.0, 0.1, 1e-4])),
        (TRIAXIAL, np.zeros(3)),
    ],
)
def test_the_closed_form_equals_the_integrated_motion(inertia: FloatArray, rate: FloatArray) -> None:
    R = se3.exp_so3(np.array([0.3, -1.0, 0.5]))
    rates, orientations = integrated(inertia, rate, R)
    body = TorqueFreeBody(inertia, rate, R)
    assert body.rates(TIMES_S) == pytest.approx(rates, abs=1e-10)
    assert body.orientations(TIMES_S) == pytest.approx(orientations, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_energy_and_momentum_are_constant_for_a_day(seed: int) -> None:
    rng = np.random.default_rng(seed)
    inertia, rate = random_inertia(rng), rng.normal(0.0, 0.1, 3)
    body, times_s = TorqueFreeBody(inertia, rate), np.linspace(0.0, 86400.0, 500)
    rates = body.rates(times_s)
    energies = np.einsum("ni,ij,nj->n", rates, inertia, rates)
    momenta = np.einsum("nij,jk,nk->ni", body.orientations(times_s), inertia, rates)
    assert energies == pytest.approx(np.full(500, rate @ inertia @ rate), rel=1e-9)
    momentum = inertia @ rate
    assert np.linalg.norm(momenta - momentum, axis=1).max() < 1e-9 * np.linalg.norm(momentum)


def test_orientations_are_rotations_whose_derivative_is_the_rate() -> None:
    body = TorqueFreeBody(TRIAXIAL, [0.02, 0.1, -0.05])
    times_s, step_s = np.linspace(0.0, 100.0, 11), 1e-4
    R = body.orientations(times_s)
    assert R.swapaxes(1, 2) @ R == pytest.approx(np.repeat(np.eye(3)[None], 11, axis=0), abs=1e-12)
    assert np.linalg.det(R) == pytest.approx(np.ones(11))
    turned = body.orientations(times_s + step_s)
    for start, end, rate in zip(R, turned, body.rates(times_s + step_s / 2), strict=True):
        assert se3.log_so3(start.T @ end) / step_s == pytest.approx(rate, abs=1e-7)


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        ([1.0, 1.0, 2.1], "at most the sum"),
        ([0.0, 1.0, 1.0], "above 0"),
        ([[2.0, 0.1, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], "symmetric"),
        ([1.0, 2.0], r"\(3,\) or \(3, 3\)"),
        ([1.0, np.nan, 1.0], "finite"),
    ],
)
def test_an_inertia_that_no_body_has_is_refused(inertia: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        principal_axes(inertia)


def test_bad_rates_and_orientations_are_refused() -> None:
    with pytest.raises(InputError, match="rate_rad_s"):
        TorqueFreeBody(TRIAXIAL, [0.0, np.inf, 0.0])
    with pytest.raises(InputError, match="R_inertial_body"):
        TorqueFreeBody(TRIAXIAL, [0.0, 0.1, 0.0], np.eye(3) * 2.0)
