# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_core.dfns.stereo_motion_estimation._interface import StereoMotionEstimationInputs
from cdff_core.dfns.stereo_motion_estimation.reprojection_lm import ReprojectionLm
from cdff_core.imaging.rectified_camera import RectifiedCamera
from tests.corridor import BASELINE_M, CAMERA

T_REFERENCE_CURRENT = se3.transform(se3.exp_so3([0.01, -0.02, 0.005]), [0.03, -0.01, 0.12])
BASELINE = np.array([BASELINE_M])
Measured = tuple[NDArray[np.float64], NDArray[np.float64]]


def scene(rng: np.random.Generator, n: int = 200, near_m: float = 1.5, far_m: float = 12.0) -> NDArray[np.float64]:
    z = rng.uniform(near_m, far_m, n)
    return np.column_stack([rng.uniform(-0.5, 0.5, n) * z, rng.uniform(-0.4, 0.4, n) * z, z])


def measured(
    rng: np.random.Generator, points: NDArray[np.float64], sigma_px: float, offset_px: float = 0.0
) -> Measured:
    """What a stereo camera at both ends sees; every disparity lacks ``offset_px``."""
    camera = RectifiedCamera.from_matrix(CAMERA, BASELINE_M)
    reference = camera.project(points)
    current = camera.project(se3.transform_points(se3.inverse(T_REFERENCE_CURRENT), points))
    reference[:, 2] += rng.normal(0.0, sigma_px, len(points)) - offset_px
    current += rng.normal(0.0, sigma_px, current.shape) - [0.0, 0.0, offset_px]
    return reference, current


def estimator(**config: float) -> ReprojectionLm:
    dfn = ReprojectionLm()
    dfn.configure(dict(config))
    return dfn


def test_exact_measurements_give_the_exact_motion_from_afar(rng: np.random.Generator) -> None:
    reference, current = measured(rng, scene(rng), 0.0)
    out = estimator().process(StereoMotionEstimationInputs(reference, current, CAMERA, BASELINE, np.eye(4)))
    np.testing.assert_allclose(out.motion, T_REFERENCE_CURRENT, atol=1e-7)
    assert out.inliers.all()


def test_outliers_are_found_and_do_not_move_the_result(rng: np.random.Generator) -> None:
    reference, current = measured(rng, scene(rng), 0.1)
    current[:40, :2] += rng.uniform(5.0, 30.0, (40, 2))
    out = estimator().process(StereoMotionEstimationInputs(reference, current, CAMERA, BASELINE, np.eye(4)))
    assert not out.inliers[:40].any()
    assert out.inliers[40:].mean() > 0.97
    assert np.linalg.norm(cov.pose_error(T_REFERENCE_CURRENT, out.motion)[:3]) < 0.005


def test_errors_are_as_large_as_the_covariance_says(rng: np.random.Generator) -> None:
    """Mean NEES over 150 trials in six dimensions: its 99.9 % band is 5.1 to 6.9; Cauchy weights cost a little."""
    dfn, nees = estimator(sigma_common_px=0.0, sigma_common_disparity_px=0.0, noise_factor=1.0), []
    for _ in range(150):
        reference, current = measured(rng, scene(rng), 0.2)
        out = dfn.process(StereoMotionEstimationInputs(reference, current, CAMERA, BASELINE, np.eye(4)))
        error = cov.pose_error(T_REFERENCE_CURRENT, out.motion)
        nees.append(float(error @ np.linalg.solve(out.covariance, error)))
    assert 4.6 < np.mean(nees) < 7.0


@pytest.mark.parametrize("mode", range(5))
def test_an_error_that_all_points_share_moves_the_motion_as_the_response_says(
    rng: np.random.Generator, mode: int
) -> None:
    """Shifts of columns, rows and disparities, a magnification, a stretch of rows."""
    reference, current = measured(rng, scene(rng), 0.0)
    u, v = ((c - c.mean()) / c.std() for c in reference[:, :2].T)
    one, none = np.ones(len(u)), np.zeros(len(u))
    shared = [(one, none, none), (none, one, none), (none, none, one), (u, v, none), (none, v, none)][mode]
    sigma_px = 0.015 if mode == 2 else 0.003
    given = [current, current + sigma_px * np.column_stack(shared)]
    out, off = (
        estimator().process(StereoMotionEstimationInputs(reference, c, CAMERA, BASELINE, np.eye(4))) for c in given
    )
    error = cov.pose_error(off.motion, out.motion)
    np.testing.assert_allclose(error, out.common_response[:, mode], atol=0.05 * float(np.abs(error).max()))


def test_noise_counts_by_its_factor_and_what_is_shared_does_not(rng: np.random.Generator) -> None:
    given = StereoMotionEstimationInputs(*measured(rng, scene(rng), 0.2), CAMERA, BASELINE, np.eye(4))
    once, thrice = (estimator(noise_factor=factor).process(given) for factor in (1.0, 3.0))
    np.testing.assert_allclose(thrice.noise_covariance, 3.0 * once.noise_covariance, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(thrice.covariance - once.covariance, 2.0 * once.noise_covariance, rtol=1e-6, atol=1e-15)
    np.testing.assert_array_equal(thrice.common_response, once.common_response)


def test_another_calibration_moves_the_motion_as_the_response_says(rng: np.random.Generator) -> None:
    reference, current = measured(rng, scene(rng), 0.0)
    basis, sure = np.ones((len(reference), 1)), np.array([[1e-12]])
    out, off = (
        estimator().process(
            StereoMotionEstimationInputs(
                reference, current, CAMERA, BASELINE, np.eye(4), basis, basis, np.array([known_px]), sure
            )
        )
        for known_px in (0.0, 0.02)
    )
    error = cov.pose_error(off.motion, out.motion)
    np.testing.assert_allclose(error, 0.02 * out.calibration_response[:, 0], atol=0.05 * float(np.abs(error).max()))


@pytest.mark.parametrize("offset_px", [0.0, 0.4])
def test_an_offset_of_all_disparities_is_found_and_none_is_invented(rng: np.random.Generator, offset_px: float) -> None:
    dfn, known, variance = estimator(), np.zeros(1), np.array([[0.25]])
    for _ in range(20):
        reference, current = measured(rng, scene(rng, 300, 0.8), 0.1, offset_px)
        basis = np.ones((len(reference), 1))
        out = dfn.process(
            StereoMotionEstimationInputs(reference, current, CAMERA, BASELINE, np.eye(4), basis, basis, known, variance)
        )
        known, variance = out.calibration, out.calibration_covariance
    assert variance[0, 0] < 0.05**2
    assert abs(known[0] - offset_px) < 4.0 * np.sqrt(variance[0, 0])


def test_points_at_infinity_leave_the_translation_free(rng: np.random.Generator) -> None:
    points = scene(rng, 100, 1e5, 2e5)
    reference, current = measured(rng, points, 0.0)
    dfn = ReprojectionLm()
    dfn.configure({"max_conditioning": 1e3})
    reference[:, 2], current[:, 2] = 0.1, 0.1
    with pytest.raises((DegenerateGeometryError, RefusedError)):
        dfn.process(StereoMotionEstimationInputs(reference[:3], current[:3], CAMERA, BASELINE, np.eye(4)))
    line = np.repeat(reference[:1], 50, axis=0)
    with pytest.raises(DegenerateGeometryError, match="free"):
        dfn.process(StereoMotionEstimationInputs(line, line, CAMERA, BASELINE, np.eye(4)))


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match=r"\(5, 3\)"):
        estimator().process(StereoMotionEstimationInputs(np.ones((5, 3)), np.ones((4, 3)), CAMERA, BASELINE, np.eye(4)))
