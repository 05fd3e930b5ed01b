# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a body from its poses."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.arrays import FloatArray
from cdff_common.errors import ConfigurationError, InputError, RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.body_motion_estimation.interface import Inputs, Outputs
from cdff_core.dfns.body_motion_estimation.torque_free import TorqueFree
from tests.support.tumbling import MOMENTS, RATE_RAD_S, MovingBody

SIGMA_M, SIGMA_RAD = 0.005, float(np.deg2rad(0.4))
T_S = 10.0 * np.arange(75)


def _dfn() -> TorqueFree:
    dfn = TorqueFree()
    dfn.configure()
    return dfn


def _motion(
    poses: FloatArray,
    covariances: FloatArray,
    *,
    t_s: FloatArray = T_S,
    later_s: tuple[float, ...] = (0.0, 60.0),
    is_noise_known: bool = True,
) -> Outputs:
    inputs = Inputs(
        times_s=t_s,
        poses=poses,
        covariances=covariances,
        is_noise_known=is_noise_known,
        queries_s=t_s[-1] + np.array(later_s),
        is_fitted=False,
    )
    return _dfn().process(inputs)


@pytest.mark.slow
@pytest.mark.req("CDFF-CORE-010")
def test_a_tumbling_body_is_predicted_and_its_moments_and_centre_are_found() -> None:
    body = MovingBody.drawn(1)
    motion = _motion(*body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=2))
    later_s = T_S[-1] + np.array([0.0, 60.0])
    turned = motion.poses[:, :3, :3] @ np.swapaxes(body.poses(later_s)[:, :3, :3], 1, 2)
    assert np.rad2deg(se3.rotation_angle(turned)).max() < 0.6
    assert motion.is_tumbling
    assert motion.moment_ratios is not None
    np.testing.assert_allclose(motion.moment_ratios, np.array(MOMENTS[:2]) / MOMENTS[2], atol=0.02)
    np.testing.assert_allclose(motion.centre_m, body.centre_m, atol=0.01)
    np.testing.assert_allclose(motion.velocities, body.velocities(later_s), atol=2e-4)
    assert motion.axis is not None
    assert motion.axis @ body.rotation.momentum_axis > np.cos(np.deg2rad(0.5))
    error = motion.rate_rad_s - body.rotation.precession_rad_s
    assert abs(error) < 4.0 * motion.rate_sigma_rad_s < 0.02 * motion.rate_rad_s


@pytest.mark.slow
def test_covariances_of_poses_and_velocities_agree_with_their_errors() -> None:
    pose_errors, velocity_errors = [], []
    for seed in range(8):
        body = MovingBody.drawn(seed, is_tumbling=seed % 2 == 0)
        motion = _motion(*body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=100 + seed), later_s=(60.0,))
        later_s = T_S[-1:] + 60.0
        truth = body.poses(later_s)[0]
        turned = se3.log_so3(motion.poses[0, :3, :3] @ truth[:3, :3].T)
        error = np.concatenate([motion.poses[0, :3, 3] - truth[:3, 3], turned])
        pose_errors.append(error @ np.linalg.solve(motion.covariances[0], error))
        error = motion.velocities[0] - body.velocities(later_s)[0]
        velocity_errors.append(error @ np.linalg.solve(motion.velocity_covariances[0], error))
    # Means of 8 values with 6 degrees of freedom: 6 within three standard deviations.
    assert 2.3 < np.mean(pose_errors) < 9.7
    assert 2.3 < np.mean(velocity_errors) < 9.7


@pytest.mark.parametrize("is_noise_known", [True, False])
def test_moments_of_a_rotation_about_one_axis_are_unobservable(is_noise_known: bool) -> None:
    body = MovingBody.drawn(3, is_tumbling=False)
    poses, covariances = body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=4)
    motion = _motion(poses, covariances, is_noise_known=is_noise_known)
    assert not motion.is_tumbling
    assert motion.moment_ratios is None
    assert motion.principal_axes is None
    assert motion.rate_rad_s == pytest.approx(RATE_RAD_S, rel=1e-3)
    # The centre is known only across the axis.
    (direction,) = motion.unobservable
    axis = body.rotation.rates(np.zeros(1))[0] / RATE_RAD_S
    assert abs(direction @ axis) > 0.999
    across = motion.centre_m - body.centre_m
    assert np.linalg.norm(across - (across @ axis) * axis) < 0.01


def test_a_body_at_rest_has_no_axis() -> None:
    rng = np.random.default_rng(5)
    R = se3.exp_so3(rng.normal(size=(60, 3)) * SIGMA_RAD)
    poses = se3.transform(R, rng.normal(size=(60, 3)) * SIGMA_M)
    covariance = np.diag([SIGMA_M**2] * 3 + [SIGMA_RAD**2] * 3)
    motion = _motion(poses, np.repeat(covariance[None], 60, axis=0), t_s=T_S[:60])
    assert motion.axis is None
    assert len(motion.unobservable) == 3


@pytest.mark.slow
def test_the_mirrored_motion_gives_the_mirrored_axis_and_the_same_moments() -> None:
    body = MovingBody.drawn(6)
    poses, covariances = body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=7)
    mirror = np.diag([1.0, 1.0, -1.0])
    mirrored = se3.transform(mirror @ poses[:, :3, :3] @ mirror, poses[:, :3, 3] @ mirror)
    first, second = _motion(poses, covariances), _motion(mirrored, covariances)
    assert first.axis is not None
    assert second.axis is not None
    # An axial vector changes its sign with the reflection.
    np.testing.assert_allclose(second.axis, -mirror @ first.axis, atol=1e-4)
    np.testing.assert_allclose(second.moment_ratios, first.moment_ratios, atol=1e-3)


@pytest.mark.slow
def test_wrong_poses_are_excluded_and_counted() -> None:
    body = MovingBody.drawn(8)
    poses, covariances = body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=9)
    wrong = np.arange(10, 75, 10)
    poses[wrong, :3, :3] = se3.exp_so3([0.0, 0.0, np.pi / 2]) @ poses[wrong, :3, :3]
    motion = _motion(poses, covariances, later_s=(0.0,))
    assert motion.outliers == len(wrong)
    turned = motion.poses[0, :3, :3] @ body.poses(T_S[-1:])[0, :3, :3].T
    assert np.rad2deg(se3.rotation_angle(turned)) < 0.6


@pytest.mark.slow
def test_a_later_fit_starts_from_the_previous_one_and_agrees_with_a_new_one() -> None:
    body = MovingBody.drawn(10)
    poses, covariances = body.measured(T_S, SIGMA_M, SIGMA_RAD, seed=11)
    dfn, results = _dfn(), []
    for stop in (50, 75):
        inputs = Inputs(
            times_s=T_S[:stop],
            poses=poses[:stop],
            covariances=covariances[:stop],
            is_noise_known=True,
            queries_s=T_S[stop - 1 : stop],
            is_fitted=False,
        )
        results.append(dfn.process(inputs))
    new = _motion(poses, covariances, later_s=(0.0,))
    np.testing.assert_allclose(results[1].poses, new.poses, atol=1e-4)
    assert results[1].covariances[0, 5, 5] < results[0].covariances[0, 5, 5]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, q, T: (t[::-1], q, T), "expected ascending times"),
        (lambda t, q, T: (t, q - 1000.0, T), "precedes the last pose"),
        (lambda t, q, T: (t, q, 2.0 * T), "expected a rigid transform"),
    ],
)
def test_times_and_poses_that_are_wrong_are_refused(change: object, message: str) -> None:
    t, q, T = change(T_S[:10], T_S[10:11], np.repeat(np.eye(4)[None], 10, axis=0))  # type: ignore[operator]
    covariances = np.repeat(np.eye(6)[None], 10, axis=0)
    with pytest.raises(InputError, match=message):
        _dfn().process(
            Inputs(
                times_s=t,
                poses=T,
                covariances=covariances,
                is_noise_known=True,
                queries_s=q,
                is_fitted=False,
            )
        )


def test_too_few_poses_are_refused() -> None:
    body = MovingBody.drawn(12)
    with pytest.raises(RefusedError, match="5 poses, expected at least 6"):
        _motion(*body.measured(T_S[:5], SIGMA_M, SIGMA_RAD, seed=1), t_s=T_S[:5])


def test_an_unknown_parameter_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="misspelt"):
        TorqueFree().configure({"misspelt": 1})
