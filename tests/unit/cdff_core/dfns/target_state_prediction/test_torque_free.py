# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""TargetStatePrediction against the closed solution of torque-free rotation, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_core.dfns.target_state_prediction.interface import (
    TargetStatePredictionInputs,
    TargetStatePredictionOutputs,
)
from cdff_core.dfns.target_state_prediction.torque_free import TorqueFree
from cdff_core.object_models.inertia import changed_inertia, inertia_of
from cdff_core.rigid_body.torque_free import TorqueFreeBody

MOMENTS = (3.0, 2.5, 1.5)
QUIET = {"acceleration_noise": 0.0, "angular_acceleration_noise": 0.0}
POSE = se3.transform(se3.exp_so3([0.3, -0.2, 1.0]), [1.0, 2.0, 8.0])
CENTRE = np.array([0.1, -0.3, 0.2])
VELOCITY, RATE = np.array([0.02, -0.01, -0.1]), np.array([0.05, 0.03, -0.06])


def predict(
    duration_s: float,
    error: np.ndarray | None = None,
    moments: tuple[float, float, float] = (1.0, 1.0, 1.0),
    **config: object,
) -> TargetStatePredictionOutputs:
    """Return the prediction of the state with an error (20,) added."""
    e = np.zeros(20) if error is None else error
    node = TorqueFree()
    node.configure(config)
    return node.process(
        TargetStatePredictionInputs(
            pose=se3.transform(se3.exp_so3(e[3:6]) @ POSE[:3, :3], POSE[:3, 3] + e[:3]),
            velocity=VELOCITY + e[6:9],
            rate=RATE + e[9:12],
            centre_of_mass_m=CENTRE + e[12:15],
            inertia=changed_inertia(inertia_of(moments), e[15:]),
            covariance=np.eye(20),
            duration_s=duration_s,
        )
    )


@pytest.mark.parametrize("duration_s", [0.1, 5.0, 60.0])
def test_the_rotation_agrees_with_the_closed_solution(duration_s: float) -> None:
    outputs = predict(duration_s, moments=MOMENTS, **QUIET)
    body = TorqueFreeBody(MOMENTS, RATE, POSE[:3, :3])
    angle = se3.rotation_angle(body.orientations([duration_s])[0].T @ outputs.pose[:3, :3])
    assert float(angle) < 1e-4 * max(1.0, duration_s)
    np.testing.assert_allclose(outputs.rate, body.rates([duration_s])[0], atol=1e-5 * duration_s)
    centre = POSE[:3, :3] @ CENTRE + POSE[:3, 3]
    np.testing.assert_allclose(
        outputs.pose[:3, :3] @ CENTRE + outputs.pose[:3, 3], centre + duration_s * VELOCITY, atol=1e-12
    )


def test_the_covariance_follows_the_numerical_derivatives() -> None:
    reference = predict(8.0, moments=MOMENTS, **QUIET)
    step, J = 1e-6, np.eye(20)
    for i in range(20):
        moved_state = predict(8.0, step * np.eye(20)[i], moments=MOMENTS, **QUIET)
        J[:6, i] = pose_error(moved_state.pose, reference.pose) / step
        J[6:9, i] = (moved_state.velocity - reference.velocity) / step
        J[9:12, i] = (moved_state.rate - reference.rate) / step
    np.testing.assert_allclose(reference.covariance, J @ J.T, rtol=2e-3, atol=2e-3 * np.abs(J @ J.T).max())


def test_noise_accumulates_with_time_in_the_axes_of_the_body() -> None:
    quiet = predict(10.0, **QUIET).covariance
    noisy = predict(10.0, acceleration_noise=0.01, angular_acceleration_noise=0.002).covariance - quiet
    arm = predict(10.0, **QUIET).pose[:3, :3] @ CENTRE
    variance = (0.01**2 + 0.002**2 * (arm[1] ** 2 + arm[2] ** 2)) * 1000.0 / 3.0
    assert noisy[0, 0] == pytest.approx(variance)
    assert noisy[6, 6] == pytest.approx(0.01**2 * 10.0)
    assert noisy[9, 9] == pytest.approx(0.002**2 * 10.0)
    assert np.linalg.eigvalsh(predict(10.0).covariance)[0] > 0.0


def test_wrong_parameters_and_times_are_refused() -> None:
    with pytest.raises(InputError, match="duration_s=-1"):
        predict(-1.0)
    node = TorqueFree()
    node.configure({})
    with pytest.raises(InputError, match="positive definite"):
        node.process(
            TargetStatePredictionInputs(
                pose=POSE,
                velocity=VELOCITY,
                rate=RATE,
                centre_of_mass_m=CENTRE,
                inertia=np.diag([1.0, 1.0, -0.5]),
                covariance=np.eye(20),
                duration_s=1.0,
            )
        )
