# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_core.dfns.stereo_motion_estimation.interface import StereoMotionEstimationInputs
from cdff_core.dfns.stereo_motion_estimation.reprojection_lm import ReprojectionLm
from cdff_core.imaging.calibration_errors import (
    CalibrationUncertainty,
    corner_radius_px,
    measurement_errors,
)
from cdff_core.imaging.rectified_camera import RectifiedCamera
from tests.support.corridor import BASELINE_M, CAMERA

T_REFERENCE_CURRENT = se3.transform(se3.exp_so3([0.01, -0.02, 0.005]), [0.03, -0.01, 0.12])
Observations = tuple[NDArray[np.float64], NDArray[np.float64]]


def scene(
    rng: np.random.Generator, n: int = 200, near_m: float = 1.5, far_m: float = 12.0
) -> NDArray[np.float64]:
    z = rng.uniform(near_m, far_m, n)
    return np.column_stack([rng.uniform(-0.5, 0.5, n) * z, rng.uniform(-0.4, 0.4, n) * z, z])


def stereo_observations(
    rng: np.random.Generator, points: NDArray[np.float64], sigma_px: float, offset_px: float = 0.0
) -> Observations:
    """Return the observations of a stereo camera before and after the motion; ``offset_px`` reduces each
    disparity.
    """
    camera = RectifiedCamera.from_matrix(CAMERA, BASELINE_M)
    reference = camera.project(points)
    current = camera.project(se3.transform_points(se3.inverse(T_REFERENCE_CURRENT), points))
    reference[:, 2] += rng.normal(0.0, sigma_px, len(points)) - offset_px
    current += rng.normal(0.0, sigma_px, current.shape) - [0.0, 0.0, offset_px]
    return reference, current


def make_node(**config: float) -> ReprojectionLm:
    dfn = ReprojectionLm()
    dfn.configure(dict(config))
    return dfn


def test_exact_measurements_give_the_exact_motion_from_a_distant_guess(rng: np.random.Generator) -> None:
    reference, current = stereo_observations(rng, scene(rng), 0.0)
    outputs = make_node().process(
        StereoMotionEstimationInputs(
            reference=reference, current=current, camera_matrix=CAMERA, baseline=BASELINE_M, guess=np.eye(4)
        )
    )
    np.testing.assert_allclose(outputs.motion, T_REFERENCE_CURRENT, atol=1e-7)
    assert outputs.inliers.all()


def test_outliers_are_rejected_and_do_not_affect_the_result(rng: np.random.Generator) -> None:
    reference, current = stereo_observations(rng, scene(rng), 0.1)
    current[:40, :2] += rng.uniform(5.0, 30.0, (40, 2))
    outputs = make_node().process(
        StereoMotionEstimationInputs(
            reference=reference, current=current, camera_matrix=CAMERA, baseline=BASELINE_M, guess=np.eye(4)
        )
    )
    assert not outputs.inliers[:40].any()
    assert outputs.inliers[40:].mean() > 0.97
    assert np.linalg.norm(cov.pose_error(T_REFERENCE_CURRENT, outputs.motion)[:3]) < 0.005


@pytest.mark.slow
def test_errors_are_consistent_with_the_covariance(rng: np.random.Generator) -> None:
    """The 99.9 % interval of the mean NEES of 150 trials is 5.1 to 6.9; Cauchy weights widen it slightly."""
    exact = dict.fromkeys(CalibrationUncertainty.model_fields, 0.0)
    dfn = make_node(sigma_common_px=0.0, sigma_common_disparity_px=0.0, noise_factor=1.0, calibration=exact)
    nees = []
    for _ in range(150):
        reference, current = stereo_observations(rng, scene(rng), 0.2)
        outputs = dfn.process(
            StereoMotionEstimationInputs(
                reference=reference,
                current=current,
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
                guess=np.eye(4),
            )
        )
        error = cov.pose_error(T_REFERENCE_CURRENT, outputs.motion)
        nees.append(float(error @ np.linalg.solve(outputs.covariance, error)))
    assert 4.6 < np.mean(nees) < 7.0


@pytest.mark.parametrize("mode", range(6))
def test_a_common_error_of_all_points_changes_the_motion_by_its_stated_response(
    rng: np.random.Generator, mode: int
) -> None:
    """The modes are offsets (column, row, disparity), a magnification, a stretch of rows and a rotation."""
    reference, current = stereo_observations(rng, scene(rng), 0.0)
    u, v = ((c - c.mean()) / c.std() for c in reference[:, :2].T)
    one, none = np.ones(len(u)), np.zeros(len(u))
    mode_errors = [
        (one, none, none),
        (none, one, none),
        (none, none, one),
        (u, v, none),
        (none, v, none),
        (-v, u, none),
    ][mode]
    sigma_px = 0.015 if mode == 2 else 0.02
    observations = [current, current + sigma_px * np.column_stack(mode_errors)]
    nominal, perturbed = (
        make_node().process(
            StereoMotionEstimationInputs(
                reference=reference, current=c, camera_matrix=CAMERA, baseline=BASELINE_M, guess=np.eye(4)
            )
        )
        for c in observations
    )
    error = cov.pose_error(perturbed.motion, nominal.motion)
    np.testing.assert_allclose(
        error, nominal.common_response[:, mode], atol=0.05 * float(np.abs(error).max())
    )


def test_the_noise_factor_scales_independent_but_not_common_errors(rng: np.random.Generator) -> None:
    reference, current = stereo_observations(rng, scene(rng), 0.2)
    inputs = StereoMotionEstimationInputs(
        reference=reference, current=current, camera_matrix=CAMERA, baseline=BASELINE_M, guess=np.eye(4)
    )
    once, thrice = (make_node(noise_factor=factor).process(inputs) for factor in (1.0, 3.0))
    np.testing.assert_allclose(thrice.noise_covariance, 3.0 * once.noise_covariance, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(
        thrice.covariance - once.covariance, 2.0 * once.noise_covariance, rtol=1e-6, atol=1e-15
    )
    np.testing.assert_array_equal(thrice.common_response, once.common_response)


def test_an_error_of_the_calibration_changes_the_motion_by_its_stated_response(
    rng: np.random.Generator,
) -> None:
    reference, current = stereo_observations(rng, scene(rng), 0.0)
    basis, variance = np.ones((len(reference), 1)), np.array([[1e-12]])
    nominal, perturbed = (
        make_node().process(
            StereoMotionEstimationInputs(
                reference=reference,
                current=current,
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
                guess=np.eye(4),
                reference_basis=basis,
                current_basis=basis,
                calibration=np.array([known_px]),
                calibration_covariance=variance,
            )
        )
        for known_px in (0.0, 0.02)
    )
    error = cov.pose_error(perturbed.motion, nominal.motion)
    np.testing.assert_allclose(
        error, 0.02 * nominal.calibration_response[:, 0], atol=0.05 * float(np.abs(error).max())
    )


@pytest.mark.parametrize("offset_px", [0.0, 0.4])
def test_a_common_disparity_offset_is_estimated_only_if_present(
    rng: np.random.Generator, offset_px: float
) -> None:
    dfn, calibration, variance = make_node(), np.zeros(1), np.array([[0.25]])
    for _ in range(20):
        reference, current = stereo_observations(rng, scene(rng, 300, 0.8), 0.1, offset_px)
        basis = np.ones((len(reference), 1))
        outputs = dfn.process(
            StereoMotionEstimationInputs(
                reference=reference,
                current=current,
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
                guess=np.eye(4),
                reference_basis=basis,
                current_basis=basis,
                calibration=calibration,
                calibration_covariance=variance,
            )
        )
        calibration, variance = outputs.calibration, outputs.calibration_covariance
    assert variance[0, 0] < 0.05**2
    assert abs(calibration[0] - offset_px) < 4.0 * np.sqrt(variance[0, 0])


def test_too_few_points_and_points_on_a_single_ray_are_refused(rng: np.random.Generator) -> None:
    points = scene(rng, 100, 1e5, 2e5)
    reference, current = stereo_observations(rng, points, 0.0)
    dfn = ReprojectionLm()
    dfn.configure({"max_conditioning": 1e3})
    reference[:, 2], current[:, 2] = 0.1, 0.1
    with pytest.raises((DegenerateGeometryError, RefusedError)):
        dfn.process(
            StereoMotionEstimationInputs(
                reference=reference[:3],
                current=current[:3],
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
                guess=np.eye(4),
            )
        )
    single_ray = np.repeat(reference[:1], 50, axis=0)
    with pytest.raises(DegenerateGeometryError, match="do not constrain"):
        dfn.process(
            StereoMotionEstimationInputs(
                reference=single_ray,
                current=single_ray,
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
                guess=np.eye(4),
            )
        )


def test_inconsistent_shapes_are_refused() -> None:
    with pytest.raises(InputError, match="n=5 of reference"):
        make_node().process(
            StereoMotionEstimationInputs(
                reference=np.ones((5, 3)),
                current=np.ones((4, 3)),
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
                guess=np.eye(4),
            )
        )


def right_camera_rotated(points: np.ndarray, rotation: list[float]) -> np.ndarray:
    """Return columns, rows and disparities (n, 3) of points seen with a rotated (rad) right camera."""
    left = points / points[:, 2:] @ CAMERA.T
    right = (points - [BASELINE_M, 0.0, 0.0]) @ se3.exp_so3(np.array(rotation)).T
    return np.column_stack([left[:, :2], left[:, 0] - (right / right[:, 2:] @ CAMERA.T)[:, 0]])


@pytest.mark.parametrize(("mode", "rotation"), [(4, [0.0, 0.0, 1e-4]), (5, [1e-4, 0.0, 0.0])])
def test_a_rotation_of_the_right_camera_shifts_disparities_as_stated(
    rng: np.random.Generator, mode: int, rotation: list[float]
) -> None:
    points = scene(rng)
    exact, rotated = (right_camera_rotated(points, r) for r in ([0.0, 0.0, 0.0], rotation))
    camera = RectifiedCamera.from_matrix(CAMERA, BASELINE_M)
    stated_shift = 1e-4 * measurement_errors(camera, exact, corner_radius_px(camera))[:, :, mode]
    scale_px = float(np.abs(rotated - exact).max())
    np.testing.assert_allclose(rotated - exact, stated_shift, atol=0.02 * scale_px)


@pytest.mark.parametrize("mode", range(8))
def test_an_error_of_each_calibration_parameter_changes_the_motion_by_its_stated_response(
    rng: np.random.Generator, mode: int
) -> None:
    """An equal error in both pairs, for example of the focal length, adds its response to the motion."""
    reference, current = stereo_observations(rng, scene(rng), 0.0)
    camera, sigma = RectifiedCamera.from_matrix(CAMERA, BASELINE_M), CalibrationUncertainty().sigmas()[mode]
    corner_px = corner_radius_px(camera, reference, current)
    wrong = [
        uvd + 0.1 * sigma * measurement_errors(camera, uvd, corner_px)[:, :, mode]
        for uvd in (reference, current)
    ]
    nominal, perturbed = (
        make_node().process(
            StereoMotionEstimationInputs(
                reference=r, current=c, camera_matrix=CAMERA, baseline=BASELINE_M, guess=np.eye(4)
            )
        )
        for r, c in ((reference, current), wrong)
    )
    error = cov.pose_error(perturbed.motion, nominal.motion)
    expected = 0.1 * nominal.common_response[:, 6 + mode]
    np.testing.assert_allclose(error, expected, atol=0.05 * float(np.abs(expected).max()) + 1e-7)


def test_a_principal_point_in_the_first_pixel_has_finite_calibration_errors(rng: np.random.Generator) -> None:
    camera = RectifiedCamera(fx=500.0, fy=500.0, cx=0.0, cy=0.0, baseline_m=BASELINE_M)
    uvd = np.column_stack([rng.uniform(0.0, 640.0, 20), rng.uniform(0.0, 480.0, 20), np.full(20, 10.0)])
    corner_px = corner_radius_px(camera, uvd)
    assert corner_px == pytest.approx(np.hypot(uvd[:, 0], uvd[:, 1]).max())
    shift_px = np.abs(measurement_errors(camera, uvd, corner_px)[:, :2, 6])
    assert 0.0 < shift_px.max() <= 1.0
    assert corner_radius_px(camera, np.zeros((1, 3))) == 1.0
