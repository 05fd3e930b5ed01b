# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""TargetTracking: a tumbling body from noisy poses; outliers, gaps, disorder, another body."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import ObjectTrackStatusT, TransformWithCovariance
from cdff_core.rigid_body.torque_free import TorqueFreeBody

MOMENTS = (3.0, 2.5, 1.5)
BODY = TorqueFreeBody(MOMENTS, [0.05, 0.02, -0.04], se3.exp_so3([0.4, -1.0, 0.3]))
VELOCITY = np.array([0.01, 0.0, -0.02])
SIGMA_M, SIGMA_RAD = 0.005, 0.007
STEP_S = 1.0


def truth(t_s: float) -> np.ndarray:
    """Return T_sensor_body at a time."""
    return se3.transform(BODY.orientations([t_s])[0], np.array([0.3, -0.2, 8.0]) + t_s * VELOCITY)


def measurement(t_s: float, rng: np.random.Generator, error: np.ndarray | None = None) -> Sample:
    """Return the measured pose at a time, with an additional error (6,)."""
    e = rng.normal(0.0, [SIGMA_M] * 3 + [SIGMA_RAD] * 3) + (np.zeros(6) if error is None else error)
    T = truth(t_s)
    measured = se3.transform(se3.exp_so3(e[3:]) @ T[:3, :3], T[:3, 3] + e[:3])
    covariance = np.diag([SIGMA_M**2] * 3 + [SIGMA_RAD**2] * 3)
    stamp_ns = round(1e6 * t_s) * 1000
    value = TransformWithCovariance.from_transform(
        UncertainTransform(measured, covariance),
        parent="servicer/lidar",
        child="tango/body",
        stamp_ns=stamp_ns,
    )
    return Sample("measurement", stamp_ns, 0, value, id=f"m{stamp_ns}")


def make_dfpc(**config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("target_tracking")
    dfpc.configure(config)
    return dfpc


def track(dfpc: Dfpc, sample: Sample) -> tuple[Output, Output]:
    pose, state = dfpc.step(sample)
    assert (pose.port, state.port) == ("pose", "track")
    assert pose.quality == state.quality
    return pose, state


def errors(pose: Output, t_s: float) -> np.ndarray:
    return pose_error(truth(t_s), pose.value.transform.matrix)


def test_pose_velocity_and_rate_converge_below_the_noise(rng: np.random.Generator) -> None:
    dfpc, nees, angle = make_dfpc(inertia_ratios=MOMENTS, inertia_sigma=0.0), [], []
    for i in range(80):
        pose, state = track(dfpc, measurement(STEP_S * i, rng))
        if i >= 40:
            error = errors(pose, STEP_S * i)
            nees.append(error @ np.linalg.solve(pose.value.transform.covariance, error))
            angle.append(np.linalg.norm(error[3:]))
    assert np.median(angle) < 0.5 * SIGMA_RAD * np.sqrt(3.0)
    assert 2.0 < np.mean(nees) < 12.0
    rate = truth(79.0)[:3, :3] @ BODY.rates([79.0])[0]
    np.testing.assert_allclose(state.value.velocities[0, 3:], rate, atol=0.01 * np.linalg.norm(rate))
    np.testing.assert_allclose(state.value.velocities[0, :3], VELOCITY, atol=2e-3)
    assert state.value.metadata.status is ObjectTrackStatusT.TRACK_CONFIRMED
    assert state.value.metadata.label == "tango"
    sigma = np.sqrt(np.diag(state.value.velocity_covariances[0]))
    assert (np.abs(state.value.velocities[0, 3:] - rate) < 5.0 * sigma[3:]).all()


def test_outliers_are_not_used_and_flagged(rng: np.random.Generator) -> None:
    dfpc = make_dfpc()
    for i in range(40):
        is_outlier = i in (20, 25, 26, 33)
        error = np.array([0.0, 0.0, 0.0, np.pi, 0.0, 0.0]) if is_outlier else None
        pose, _ = track(dfpc, measurement(STEP_S * i, rng, error))
        if i > 10:
            assert (pose.quality.status is Status.DEGRADED) == is_outlier
            assert np.linalg.norm(errors(pose, STEP_S * i)[3:]) < 0.02
            if is_outlier:
                assert pose.quality.reasons[0] == "coasting"


def test_twelve_lost_frames_and_every_fourth_frame_do_not_lose_the_track(rng: np.random.Generator) -> None:
    dfpc = make_dfpc()
    times = [*range(20), *range(32, 52), *range(55, 120, 4)]
    for t_s in times:
        pose, state = track(dfpc, measurement(float(t_s), rng))
        if t_s > 5:
            assert pose.quality.status is Status.OK
    assert state.value.metadata.track_id == 1
    assert np.linalg.norm(errors(pose, float(times[-1]))[3:]) < 0.015


def test_late_repeated_and_uncertain_measurements_keep_the_state(rng: np.random.Generator) -> None:
    dfpc = make_dfpc()
    for i in range(10):
        track(dfpc, measurement(STEP_S * i, rng))
    for t_s, reason in ((3.0, "late:6s"), (9.0, "repeated_stamp")):
        pose, _ = track(dfpc, measurement(t_s, rng))
        assert (pose.quality.status, pose.quality.reasons, pose.value) == (Status.FAILED, (reason,), None)
    bare = TransformWithCovariance.from_transform(
        UncertainTransform(truth(10.0)), parent="servicer/lidar", child="tango/body", stamp_ns=10**10
    )
    pose, _ = track(dfpc, Sample("measurement", 10**10, 0, bare))
    assert pose.quality.reasons == ("no_covariance",)
    pose, _ = track(dfpc, measurement(11.0, rng))
    assert pose.quality.status is Status.OK


def test_consistent_poses_elsewhere_start_a_new_track(rng: np.random.Generator) -> None:
    dfpc = make_dfpc(restart_after=4)
    for i in range(10):
        track(dfpc, measurement(STEP_S * i, rng))
    jump, ids = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 1.0]), []
    for i in range(10, 18):
        pose, state = track(dfpc, measurement(STEP_S * i, rng, jump))
        ids.append(state.value.metadata.track_id)
    assert ids == [1, 1, 1, 2, 2, 2, 2, 2]
    assert np.linalg.norm(errors(pose, 17.0)[:3] + jump[:3]) < 0.05


def test_a_track_without_use_for_long_is_lost(rng: np.random.Generator) -> None:
    dfpc = make_dfpc(lost_after_s=5.0, restart_after=100)
    for i in range(10):
        track(dfpc, measurement(STEP_S * i, rng))
    outlier = rng.normal(0.0, 1.0, (10, 6))
    statuses = [track(dfpc, measurement(10.0 + i, rng, outlier[i]))[0].quality.status for i in range(8)]
    assert statuses == [Status.DEGRADED] * 5 + [Status.FAILED] * 3


def test_a_body_that_rotates_about_another_point_is_predicted_after_a_revolution(
    rng: np.random.Generator,
) -> None:
    spin, centre = np.array([0.0, 0.0, np.radians(12.0)]), np.array([0.3, -0.1, 0.2])

    def pose_at(t_s: float) -> np.ndarray:
        R = se3.exp_so3(t_s * spin)
        return se3.transform(R, np.array([0.0, 0.0, 8.0]) + t_s * VELOCITY - R @ centre)

    dfpc = make_dfpc(predict={"acceleration_noise": 1e-5, "angular_acceleration_noise": 1e-5})
    for t_s in [*range(40), 55]:
        T = pose_at(t_s)
        e = rng.normal(0.0, [SIGMA_M] * 3 + [SIGMA_RAD] * 3)
        measured = se3.transform(se3.exp_so3(e[3:]) @ T[:3, :3], T[:3, 3] + e[:3])
        covariance = np.diag([SIGMA_M**2] * 3 + [SIGMA_RAD**2] * 3)
        value = TransformWithCovariance.from_transform(
            UncertainTransform(measured, covariance), parent="lidar", child="tango/body", stamp_ns=t_s * 10**9
        )
        pose, state = track(dfpc, Sample("measurement", t_s * 10**9, 0, value))
    error = pose_error(pose_at(55), pose.value.transform.matrix)
    assert np.linalg.norm(error[:3]) < 0.02
    assert np.linalg.norm(error[3:]) < 0.03
    velocity = VELOCITY - np.cross(spin, se3.exp_so3(55 * spin) @ centre)
    np.testing.assert_allclose(state.value.velocities[0, :3], velocity, atol=0.012)


def test_the_velocity_of_a_track_is_unknown_at_first(rng: np.random.Generator) -> None:
    dfpc = make_dfpc()
    pose, state = track(dfpc, measurement(0.0, rng))
    assert pose.quality.reasons == ("new_track",)
    assert state.value.metadata.status is ObjectTrackStatusT.TRACK_TENTATIVE
    assert np.sqrt(state.value.velocity_covariances[0, 0, 0]) > 0.3 - 1e-9
    dfpc.restart()
    pose, _ = track(dfpc, measurement(0.0, rng))
    assert pose.quality.reasons == ("new_track",)
