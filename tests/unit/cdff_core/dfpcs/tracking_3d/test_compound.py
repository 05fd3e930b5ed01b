# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a body from a stream of poses."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError, ProductNotFoundError
from cdff_common.formats.body_motion import body_motion_value
from cdff_common.formats.payload import to_file
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import RigidBodyState, TransformWithCovariance
from cdff_core.dfpcs.tracking_3d.compound import Tracking3D
from cdff_core.rigid_body.torque_free import TorqueFreeBody
from tests.support.tumbling import MOMENTS, MovingBody

SIGMA_M, SIGMA_RAD = 0.005, float(np.deg2rad(0.4))
T_S = 10.0 * np.arange(75)


def _dfpc(**parameters: object) -> Tracking3D:
    dfpc = Tracking3D()
    dfpc.configure({"refit_growth": 0.3, **parameters})
    return dfpc


def _sample(t_s: float, T: np.ndarray, covariance: np.ndarray | None, frame: str = "inertial") -> Sample:
    stamp_ns = 1000 * round(1e6 * t_s)
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent=frame, child="client/body", stamp_ns=stamp_ns
    )
    return Sample("pose", stamp_ns, 0, pose, id=f"pose-{stamp_ns}")


def _run(dfpc: Tracking3D, poses: np.ndarray, covariances: np.ndarray) -> list[Output]:
    outputs = [
        output
        for t_s, T, covariance in zip(T_S, poses, covariances, strict=False)
        for output in dfpc.step(_sample(t_s, T, covariance))
    ]
    return [*outputs, *dfpc.finish()]


def test_poses_without_noise_and_without_rotation_yield_a_state() -> None:
    dfpc = _dfpc()
    velocity = np.array([0.01, -0.02, 0.005])
    poses = [se3.transform(np.eye(3), 5.0 + t_s * velocity) for t_s in T_S[:20]]
    outputs = [
        output for t_s, T in zip(T_S, poses, strict=False) for output in dfpc.step(_sample(t_s, T, None))
    ]
    track = [output for output in [*outputs, *dfpc.finish()] if output.port == "track"][-1]
    assert track.quality.status is not Status.FAILED
    assert "inertia_unobservable" in track.quality.reasons
    np.testing.assert_allclose(track.value.velocities[0], [*velocity, 0.0, 0.0, 0.0], atol=1e-6)


@pytest.fixture(scope="module")
def tracked() -> tuple[Tracking3D, MovingBody, list[Output]]:
    body, dfpc = MovingBody.drawn(1), _dfpc()
    return dfpc, body, _run(dfpc, *body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=2))


@pytest.mark.slow
def test_each_pose_gives_a_state_failed_until_there_are_enough(
    tracked: tuple[Tracking3D, MovingBody, list[Output]],
) -> None:
    tracks = [output for output in tracked[2] if output.port == "track"]
    assert len(tracks) == len(T_S)
    assert [output.quality.status for output in tracks[:5]] == [Status.FAILED] * 5
    assert tracks[4].quality.reasons == ("few_poses:5",)
    assert all(output.quality.status is Status.OK for output in tracks[10:])
    assert tracks[-1].value.velocities is not None


def test_the_prediction_covers_the_horizon_and_agrees_with_the_true_motion(
    tracked: tuple[Tracking3D, MovingBody, list[Output]],
) -> None:
    _, body, outputs = tracked
    prediction = [output for output in outputs if output.port == "prediction"][-1].value
    assert prediction.stamps_ns[-1] - prediction.stamps_ns[0] == 60_000_000_000
    truth = body.poses(1e-9 * prediction.stamps_ns)
    turned = prediction.matrices[:, :3, :3] @ np.swapaxes(truth[:, :3, :3], 1, 2)
    assert np.rad2deg(se3.rotation_angle(turned)).max() < 1.0
    assert np.linalg.norm(prediction.matrices[:, :3, 3] - truth[:, :3, 3], axis=1).max() < 0.02


def test_the_motion_has_period_and_ratios_of_moments_in_words(
    tracked: tuple[Tracking3D, MovingBody, list[Output]],
) -> None:
    motion = json.loads(to_file(tracked[0].get_motion(), "json"))
    assert motion["kind"] == "tumbling"
    assert motion["inertia_ratios"] == pytest.approx(np.array(MOMENTS[:2]) / MOMENTS[2], abs=0.05)
    period_s = 2 * np.pi / tracked[1].rotation.precession_rad_s
    assert motion["period_s"] == pytest.approx(period_s, rel=0.02)
    assert motion["frame"] == "inertial"


def test_a_grasp_point_moves_with_the_body(tracked: tuple[Tracking3D, MovingBody, list[Output]]) -> None:
    dfpc, body, _ = tracked
    t_ns = 1000 * round(1e6 * T_S[-1]) + 30_000_000_000
    track = dfpc.predict_point(0.5, -0.2, 0.1, t_ns)
    times_s = 1e-9 * track.stamps_ns
    truth = se3.transform_points(body.poses(times_s)[-1], np.array([[0.5, -0.2, 0.1]]))[0]
    assert np.linalg.norm(track.matrices[-1, :3, 3] - truth) < 0.03
    step = (track.matrices[-1, :3, 3] - track.matrices[-2, :3, 3]) / (times_s[-1] - times_s[-2])
    np.testing.assert_allclose(track.velocities[-1, :3], step, atol=1e-4)
    pose = dfpc.predict(t_ns)
    np.testing.assert_allclose(pose.transform.matrix[:3, :3], track.matrices[-1, :3, :3], atol=1e-9)
    with pytest.raises(InputError, match="precedes the last pose"):
        dfpc.predict(t_ns - 60_000_000_000)


def _turning(t_s: float) -> np.ndarray:
    """Return R_inertial_base of a servicer that turns by 0.5 degrees per second and swings by 20 degrees."""
    swing = np.deg2rad(20.0) * np.sin(2.0 * np.pi * t_s / 130.0)
    return np.asarray(se3.exp_so3([0.0, 0.0, np.deg2rad(0.5) * t_s]) @ se3.exp_so3([0.3 * swing, swing, 0.0]))


_MOUNT = se3.transform(se3.exp_so3([0.2, -0.1, 0.4]), np.zeros(3))


def _turning_samples(body: MovingBody, poses: np.ndarray, covariances: np.ndarray) -> list[list[Sample]]:
    """Return the attitude of a turning servicer and the pose in its lidar at each time."""
    noise = np.zeros((6, 6))
    noise[3:, 3:] = np.deg2rad(0.01) ** 2 * np.eye(3)
    rng, pairs = np.random.default_rng(11), []
    for t_s, T, covariance in zip(T_S, poses, covariances, strict=True):
        R_true = _turning(t_s)
        R = se3.exp_so3(rng.normal(size=3) * np.deg2rad(0.01)) @ R_true
        stamp_ns = 1000 * round(1e6 * t_s)
        value = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(R, np.zeros(3)), noise),
            parent="inertial",
            child="servicer/base",
            stamp_ns=stamp_ns,
        )
        T_lidar_inertial = se3.inverse(se3.transform(R_true, np.zeros(3)) @ _MOUNT)
        to_lidar = np.kron(np.eye(2), T_lidar_inertial[:3, :3])
        pose = _sample(t_s, T_lidar_inertial @ T, to_lidar @ covariance @ to_lidar.T, frame="servicer/lidar")
        attitude = Sample("attitude", stamp_ns, 0, value, id=f"attitude-{stamp_ns}")
        pairs.append([attitude, pose])
    return pairs


def _on_servicer(**parameters: object) -> Tracking3D:
    frames = FrameGraph()
    frames.set_static("servicer/base", "servicer/lidar", UncertainTransform(_MOUNT))
    dfpc = Tracking3D()
    dfpc.configure({"refit_growth": 0.3, **parameters}, DfpcContext("servicer", frames))
    return dfpc


def _prediction_error_deg(outputs: list[Output], body: MovingBody, to_lidar: bool) -> float:
    """Return the largest error of the orientation in the last prediction, in the frame of the prediction."""
    prediction = [output for output in outputs if output.port == "prediction"][-1].value
    t_s = 1e-9 * prediction.stamps_ns
    truth = body.poses(t_s)[:, :3, :3]
    if to_lidar:
        truth = np.array([(_turning(t) @ _MOUNT[:3, :3]).T @ R for t, R in zip(t_s, truth, strict=True)])
    turned = prediction.matrices[:, :3, :3] @ np.swapaxes(truth, 1, 2)
    return float(np.rad2deg(se3.rotation_angle(turned)).max())


@pytest.mark.slow
def test_the_motion_of_a_body_seen_from_a_turning_servicer_is_that_in_inertial_axes() -> None:
    body = MovingBody.drawn(1)
    pairs = _turning_samples(body, *body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=2))
    with_attitude, without = _on_servicer(), _on_servicer()
    outputs = [o for pair in pairs for sample in pair for o in with_attitude.step(sample)]
    outputs += with_attitude.finish()
    relative = [o for pair in pairs for o in without.step(pair[1])] + list(without.finish())
    assert _prediction_error_deg(outputs, body, to_lidar=False) < 1.0
    assert _prediction_error_deg(relative, body, to_lidar=True) > 5.0
    # The ratios of the moments belong to the body, the axis to the inertial frame.
    motion = body_motion_value(with_attitude.get_motion())
    assert motion["frame"] == "inertial"
    assert motion["inertia_ratios"] == pytest.approx(np.array(MOMENTS[:2]) / MOMENTS[2], abs=0.05)
    tracks = [output for output in outputs if output.port == "track"]
    assert all(output.quality.status is Status.OK for output in tracks[10:])
    assert tracks[-1].frame == "inertial"
    error = pose_error(body.poses(T_S[-1:])[0], tracks[-1].value.matrices[-1])
    assert error @ np.linalg.solve(tracks[-1].value.covariances[-1], error) < 22.5  # 99.9 % of chi squared, 6
    # Without attitude, no state is stated with confidence.
    states = [output for output in relative if output.port in ("track", "motion", "prediction")]
    assert all(output.quality.status is not Status.OK for output in states)
    assert all("attitude_missing" in o.quality.reasons for o in states if o.value is not None)


@pytest.mark.slow
def test_the_position_of_a_body_at_rest_in_orbital_axes_is_predicted_with_navigation() -> None:
    rng = np.random.default_rng(5)
    radius_m, orbit_rate = 7.0e6, float(np.sqrt(3.986e14 / 7.0e6**3))

    def predicted_errors_m(*, with_navigation: bool) -> list[float]:
        """Return the errors of the predictions 60 s ahead of a body 12 m behind its observer."""
        dfpc, found = _dfpc(refit_growth=0.2, max_poses=100), []
        covariance = np.diag([0.003**2] * 3 + [0.002**2] * 3)

        def position_m(t_s: float) -> np.ndarray:
            angle = orbit_rate * t_s
            return 12.0 * np.array([np.sin(angle), -np.cos(angle), 0.0])

        for t_s in 2.0 * np.arange(110):
            angle, stamp_ns = orbit_rate * t_s, 1000 * round(1e6 * t_s)
            if with_navigation and t_s % 10.0 == 0.0:
                state = RigidBodyState(
                    target_frame="inertial",
                    source_frame="servicer/base",
                    pos=radius_m * np.array([np.cos(angle), np.sin(angle), 0.0]) + rng.normal(size=3),
                    velocity=radius_m * orbit_rate * np.array([-np.sin(angle), np.cos(angle), 0.0])
                    + 0.02 * rng.normal(size=3),
                )
                list(dfpc.step(Sample("navigation", stamp_ns, 0, state, id=f"n-{stamp_ns}")))
            R = se3.exp_so3([0.0, 0.0, np.deg2rad(1.0) * t_s]) @ se3.exp_so3(rng.normal(size=3) * 0.002)
            T = se3.transform(R, position_m(t_s) + rng.normal(size=3) * 0.003)
            for output in dfpc.step(_sample(t_s, T, covariance)):
                if output.port == "prediction" and t_s > 120.0:
                    states = output.value
                    truth = position_m(1e-9 * float(states.stamps_ns[-1]))
                    found.append(float(np.linalg.norm(states.matrices[-1, :3, 3] - truth)))
        return found

    assert np.median(predicted_errors_m(with_navigation=True)) < 0.005
    assert np.median(predicted_errors_m(with_navigation=False)) > 0.02


def test_a_pose_without_an_attitude_at_its_time_is_not_used() -> None:
    body = MovingBody.drawn(1)
    pairs = _turning_samples(body, *body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=2))
    dfpc = _on_servicer()
    for pair in pairs[:15]:
        for sample in pair:
            last = list(dfpc.step(sample))
    assert last[0].quality.status is Status.OK
    (output,) = dfpc.step(pairs[16][1])  # the star tracker is dark
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons == ("attitude_missing:20s",)
    for sample in pairs[17]:
        (output, *_) = list(dfpc.step(sample)) or [output]
    assert output.quality.status is Status.OK


def test_poses_before_the_first_attitude_are_removed() -> None:
    body = MovingBody.drawn(1)
    pairs = _turning_samples(body, *body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=2))
    dfpc = _on_servicer()
    for pair in pairs[:10]:
        list(dfpc.step(pair[1]))
    assert list(dfpc.step(pairs[10][0])) == []
    (output,) = dfpc.step(pairs[10][1])
    assert output.quality.reasons == ("few_poses:1",)


def test_an_attitude_of_an_unconnected_frame_is_refused() -> None:
    body, dfpc = MovingBody.drawn(1), _dfpc()
    attitude, pose = _turning_samples(body, *body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=2))[0]
    list(dfpc.step(attitude))
    (output,) = dfpc.step(pose)
    assert output.quality.reasons == ("mount_of_attitude_unknown",)


def test_queries_before_the_first_fit_are_refused() -> None:
    dfpc = _dfpc()
    with pytest.raises(ProductNotFoundError, match="0 poses, no motion was fitted yet"):
        dfpc.get_motion()
    with pytest.raises(ProductNotFoundError):
        dfpc.predict(0)


def test_poses_of_other_frames_or_before_the_newest_one_are_refused() -> None:
    body, dfpc = MovingBody.drawn(3), _dfpc()
    poses, covariances = body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=4)
    _run(dfpc, poses[:20], covariances[:20])
    for sample, reason in (
        (_sample(50.0, poses[10], covariances[10]), "expected after 190000000000 ns"),
        (
            _sample(500.0, poses[50], covariances[50], frame="mana/odom"),
            "expected ('inertial', 'client/body')",
        ),
    ):
        (output,) = dfpc.step(sample)
        assert output.quality.status is Status.FAILED
        assert reason in output.quality.reasons[0]
    assert next(iter(dfpc.step(_sample(200.0, poses[20], covariances[20])))).quality.status is Status.OK


def test_states_between_two_fits_to_a_limited_number_of_poses_are_those_of_their_times() -> None:
    body, dfpc = MovingBody.drawn(7, is_tumbling=False), _dfpc(max_poses=20, refit_growth=0.5)
    poses, covariances = body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=8)
    outputs = [output for output in _run(dfpc, poses, covariances) if output.port == "track"]
    truth = body.poses(T_S)
    errors = [pose_error(truth[i], output.value.matrices[0]) for i, output in enumerate(outputs) if i >= 20]
    assert np.rad2deg(max(np.linalg.norm(error[3:]) for error in errors)) < 1.5


@pytest.mark.slow
def test_a_motion_that_may_be_a_tumble_is_not_stated_with_confidence() -> None:
    # A strong tumble, whose first degrees look like a rotation about an axis that drifts.
    rotation = TorqueFreeBody(
        (160.0, 60.0, 190.0), np.radians([0.7, 1.0, 0.6]), se3.exp_so3([0.3, -0.2, 0.5])
    )
    body, dfpc, found = MovingBody(rotation, np.zeros(3), np.zeros(3)), _dfpc(refit_growth=0.1), []
    t_s = 2.0 * np.arange(70)
    for t, T, covariance in zip(t_s, *body.measured(t_s, SIGMA_M, SIGMA_RAD, seed=9), strict=True):
        for output in dfpc.step(_sample(t, T, covariance)):
            if output.port != "prediction":
                continue
            states, row = output.value, 30
            truth = body.poses(np.array([1e-9 * states.stamps_ns[row]]))[0]
            error = pose_error(truth, states.matrices[row])[3:]
            sigma = np.sqrt(np.linalg.eigvalsh(states.covariances[row][3:, 3:])[-1])
            found.append((float(np.linalg.norm(error)), float(sigma), output.quality))
    confident = [(error, sigma) for error, sigma, quality in found if quality.status is Status.OK]
    assert all(error < max(5.0 * sigma, np.deg2rad(1.0)) for error, sigma in confident)
    assert any("tumble_undetermined" in quality.reasons for _, _, quality in found)
    assert found[-1][0] < np.deg2rad(1.0)
    assert found[-1][2].status is Status.OK


def test_poses_that_a_tracker_predicted_are_not_used() -> None:
    body, dfpc = MovingBody.drawn(3), _dfpc()
    poses, covariances = body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=4)
    _run(dfpc, poses[:8], covariances[:8])
    predicted = replace(
        _sample(80.0, poses[8], covariances[8]), quality=Quality(Status.DEGRADED, ("coasting", "no_overlap"))
    )
    (output,) = dfpc.step(predicted)
    assert (output.quality.status, output.quality.reasons) == (Status.FAILED, ("pose_is_predicted",))
    outputs = list(dfpc.step(_sample(90.0, poses[9], covariances[9])))
    assert outputs[0].quality.metrics["poses"] == 9


def test_poses_too_rare_for_their_rotation_are_reported() -> None:
    body, dfpc = MovingBody.drawn(5, is_tumbling=False), _dfpc()
    t_s = 240.0 * np.arange(20)  # 168 degrees between poses
    poses, covariances = body.measured(t_s, SIGMA_M, SIGMA_RAD, seed=6)
    outputs = [
        o for t, T, C in zip(t_s, poses, covariances, strict=True) for o in dfpc.step(_sample(t, T, C))
    ]
    newest = [output for output in outputs if output.port == "track"][-1]
    assert newest.quality.status is Status.DEGRADED
    assert newest.quality.reasons[0].startswith("ambiguous_rotation")


@pytest.mark.slow
def test_the_moments_of_the_servicing_target_are_unobservable(real_data: Callable[[str], Path]) -> None:
    with gzip.open(real_data("shirt_trajectories") / "roe1.csv.gz", "rt") as file:
        rows = np.array([line.split(",") for line in file.read().splitlines()[1:151]], dtype=float)
    R = se3.matrix_from_quaternion_xyzw(rows[:, [2, 3, 4, 1]])
    rng = np.random.default_rng(7)
    noisy = se3.exp_so3(rng.normal(size=(150, 3)) * SIGMA_RAD) @ R
    poses = se3.transform(noisy, rows[:, 5:] + rng.normal(size=(150, 3)) * SIGMA_M)
    dfpc, covariance = _dfpc(), np.diag([SIGMA_M**2] * 3 + [SIGMA_RAD**2] * 3)
    for k, T in enumerate(poses):
        list(dfpc.step(_sample(5.0 * k, T, covariance)))
    list(dfpc.finish())
    motion = body_motion_value(dfpc.get_motion())
    assert motion["inertia_ratios"] == "unobservable"
    assert motion["period_s"] == pytest.approx(5.0 * 360.0 / 4.696, rel=0.002)


def test_an_unknown_parameter_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="misspelt"):
        Tracking3D().configure({"misspelt": 1})
