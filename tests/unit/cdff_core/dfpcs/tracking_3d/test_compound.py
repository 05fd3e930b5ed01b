# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a body from a stream of poses."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError, ProductNotFoundError
from cdff_common.formats.body_motion import body_motion_value
from cdff_common.formats.payload import to_file
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import TransformWithCovariance
from cdff_core.dfpcs.tracking_3d.compound import Tracking3D
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
