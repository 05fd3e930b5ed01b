# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo motion and its covariance agree with weighted least squares by numeric derivatives.

The prediction, its noise and the sums are written from their definition, one point at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.stereo_motion_estimation.interface import (
    StereoMotionEstimationInputs,
    StereoMotionEstimationOutputs,
)
from cdff_core.dfns.stereo_motion_estimation.reprojection_lm import ReprojectionLm
from cdff_core.imaging.calibration_errors import (
    CalibrationUncertainty,
    corner_radius_px,
    measurement_errors,
)
from cdff_core.imaging.rectified_camera import RectifiedCamera

Array = np.ndarray
K = np.array([[250.0, 0.0, 160.0], [0.0, 240.0, 110.0], [0.0, 0.0, 1.0]])
BASELINE_M = 0.3
MOTION = se3.transform(se3.exp_so3([0.02, -0.03, 0.01]), [0.05, -0.02, 0.2])  # T_reference_current
SIGMAS_PX = {"sigma_track_px": 0.3, "sigma_disparity_px": 0.5}


def predicted(uvd: Array, T: Array) -> Array:
    """Return the measurement in the current pair of a measurement in the reference pair."""
    z = K[0, 0] * BASELINE_M / uvd[2]
    x, y, z = T[:3, :3] @ [(uvd[0] - 160.0) * z / 250.0, (uvd[1] - 110.0) * z / 240.0, z] + T[:3, 3]
    return np.array([250.0 * x / z + 160.0, 240.0 * y / z + 110.0, 250.0 * BASELINE_M / z])


def derivative(function: Callable[[Array], Array], at: Array) -> Array:
    """Return central differences, one column for each variable."""
    h = 1e-6
    return np.column_stack([(function(at + h * e) - function(at - h * e)) / (2 * h) for e in np.eye(len(at))])


@dataclass
class Sums:
    """Sums over all points at an estimate, and each point's residual, squared distance and weight."""

    residuals: Array
    squared: Array
    weights: Array
    normal: Array
    gradient: Array
    projections: list[Array]
    by_reference: list[Array]
    cost: float


def sums(inputs: StereoMotionEstimationInputs, T: Array, theta: Array) -> Sums:
    """Linearise at T_current_reference and calibration parameters, with the noise of ``SIGMAS_PX``."""
    k = len(theta)
    rows, normal, gradient = [], np.zeros((6 + k, 6 + k)), np.zeros(6 + k)
    noise = np.diag([0.3**2, 0.3**2, 0.5**2])
    for i, (reference, current) in enumerate(zip(inputs.reference, inputs.current, strict=True)):
        b_reference = np.zeros(k) if inputs.reference_basis is None else inputs.reference_basis[i]
        b_current = np.zeros(k) if inputs.current_basis is None else inputs.current_basis[i]

        def difference(
            x: Array, reference=reference, current=current, b_r=b_reference, b_c=b_current
        ) -> Array:
            T_moved = se3.transform(se3.exp_so3(x[3:6]) @ T[:3, :3], T[:3, 3] + x[:3])
            shifted = reference + np.array([0.0, 0.0, b_r @ (theta + x[6:])])
            return predicted(shifted, T_moved) - current - [0.0, 0.0, b_c @ (theta + x[6:])]

        x0 = np.zeros(6 + k)
        residual, J = -difference(x0), derivative(difference, x0)
        at_reference = reference + np.array([0.0, 0.0, b_reference @ theta])
        by_reference = derivative(lambda uvd: predicted(uvd, T), at_reference)
        W = np.linalg.inv(noise + 0.5**2 * np.outer(by_reference[:, 2], by_reference[:, 2]))
        squared = residual @ W @ residual
        weight = 1.0 / (1.0 + squared / 9.0)
        normal += weight * J.T @ W @ J
        gradient -= weight * J.T @ W @ residual
        rows.append((residual, squared, weight, weight * J.T @ W, by_reference))
    residuals, squared, weights, projections, by_references = zip(*rows, strict=True)
    cost = 9.0 * float(np.sum(np.log(1.0 + np.array(squared) / 9.0)))
    if k:
        information = np.linalg.inv(inputs.calibration_covariance)
        error = theta - inputs.calibration
        normal[6:, 6:] += information
        gradient[6:] += information @ error
        cost += float(error @ information @ error)
    return Sums(
        np.array(residuals), np.array(squared), np.array(weights), normal, gradient, list(projections),
        list(by_references), cost,
    )  # fmt: skip


def scenario(
    seed: int, noise_px: float, parameters: int, n: int = 25, spread: float = 1.0, **changes: Any
) -> StereoMotionEstimationInputs:
    rng = np.random.default_rng(seed)
    z = rng.uniform(1.5, 9.0, n)
    points = np.column_stack(
        [spread * rng.uniform(-0.5, 0.5, n) * z, spread * rng.uniform(-0.4, 0.4, n) * z, z]
    )
    camera = RectifiedCamera.from_matrix(K, BASELINE_M)
    reference, current = (
        camera.project(p) for p in (points, se3.transform_points(se3.inverse(MOTION), points))
    )
    inputs: dict[str, Any] = {
        "reference": reference + rng.normal(0.0, noise_px, reference.shape),
        "current": current + rng.normal(0.0, noise_px, current.shape),
        "camera_matrix": K,
        "baseline": BASELINE_M,
        "guess": MOTION @ se3.exp_se3([0.004, -0.003, 0.006, 0.001, -0.001, 0.002]),
    }
    if parameters:
        inputs |= {
            "reference_basis": rng.normal(1.0, 0.5, (n, parameters)),
            "current_basis": rng.normal(1.0, 0.5, (n, parameters)),
            "calibration": rng.normal(0.0, 0.1, parameters),
            "calibration_covariance": np.diag([0.04, 0.09][:parameters]) + 0.01,
        }
    return StereoMotionEstimationInputs(**(inputs | changes))


def solved(inputs: StereoMotionEstimationInputs, **config: Any) -> StereoMotionEstimationOutputs:
    node = ReprojectionLm()
    node.configure(SIGMAS_PX | config)
    return node.process(inputs)


@pytest.mark.parametrize(("seed", "parameters"), [(1, 0), (2, 1), (3, 2)])
def test_each_step_is_that_of_damped_weighted_least_squares(seed: int, parameters: int) -> None:
    inputs = scenario(seed, 0.2, parameters)
    T = se3.inverse(inputs.guess)
    theta = np.zeros(0) if inputs.calibration is None else inputs.calibration
    for steps, damping in ((1, 1e-6), (2, 1e-7)):
        at = sums(inputs, T, theta)
        step = np.linalg.solve(at.normal + damping * np.diag(np.diag(at.normal)), -at.gradient)
        T = se3.transform(se3.exp_so3(step[3:6]) @ T[:3, :3], T[:3, 3] + step[:3])
        theta = theta + step[6:]
        out = solved(inputs, max_iterations=steps)
        np.testing.assert_allclose(out.motion, se3.inverse(T), atol=2e-8)
        np.testing.assert_allclose(out.calibration, theta, atol=2e-7)


@pytest.mark.parametrize("noise_px", [0.05, 0.4])
@pytest.mark.parametrize("parameters", [0, 2])
def test_the_outputs_follow_their_definitions_at_the_estimate(noise_px: float, parameters: int) -> None:
    inputs = scenario(4, noise_px, parameters)
    out = solved(inputs, gate=2.0, noise_factor=1.7, sigma_common_px=0.04, sigma_common_disparity_px=0.03)
    T = se3.inverse(out.motion)
    at = sums(inputs, T, out.calibration)
    assert np.sqrt(at.gradient @ np.linalg.solve(at.normal, at.gradient)) < 0.01  # standard deviations
    np.testing.assert_allclose(out.residuals, at.residuals, atol=1e-9)
    np.testing.assert_array_equal(out.inliers, at.squared < 4.0)
    unit_variance = np.sum(at.weights * at.squared) / (3.0 * at.weights.sum() - 6 - parameters)
    assert out.unit_variance == pytest.approx(unit_variance, rel=1e-6)

    scale = max(unit_variance, 0.25)
    information = at.normal / scale
    if parameters:
        prior = np.linalg.inv(inputs.calibration_covariance)
        information[6:, 6:] = (at.normal[6:, 6:] - prior) / scale + prior
    covariance = np.linalg.inv(information)
    # Error of T_reference_current due to one of T_current_reference, t + dt and Exp(phi) R, by differences.
    to_motion = derivative(lambda x: moved_error(T, x), np.zeros(6))
    noise = 1.7 * to_motion @ np.linalg.inv(information[:6, :6]) @ to_motion.T
    np.testing.assert_allclose(out.noise_covariance, noise, rtol=1e-4, atol=1e-6 * noise.max())
    np.testing.assert_allclose(out.calibration_covariance, covariance[6:, 6:], rtol=1e-5)
    response = -to_motion @ np.linalg.inv(information[:6, :6]) @ information[:6, 6:]
    np.testing.assert_allclose(out.calibration_response, response, rtol=1e-4, atol=1e-7)

    common = expected_common_response(inputs, out, at, to_motion @ (covariance / scale)[:6])
    np.testing.assert_allclose(out.common_response, common, rtol=1e-4, atol=1e-6 * np.abs(common).max())
    expected = noise + response @ covariance[6:, 6:] @ response.T + common @ common.T
    np.testing.assert_allclose(out.covariance, expected, rtol=1e-4, atol=1e-6 * expected.max())
    np.testing.assert_array_equal(out.covariance, out.covariance.T)
    np.testing.assert_array_equal(out.noise_covariance, out.noise_covariance.T)


def moved_error(T: Array, x: Array) -> Array:
    T_moved = se3.inverse(se3.transform(se3.exp_so3(x[3:]) @ T[:3, :3], T[:3, 3] + x[:3]))
    original = se3.inverse(T)
    return np.concatenate(
        [T_moved[:3, 3] - original[:3, 3], se3.log_so3(T_moved[:3, :3] @ original[:3, :3].T)]
    )


def expected_common_response(
    inputs: StereoMotionEstimationInputs, out: StereoMotionEstimationOutputs, at: Sums, gain: Array
) -> Array:
    """Return the effect of one standard deviation of each common error (6, 14)."""
    basis = [
        0.0 if b is None else b @ out.calibration for b in (inputs.reference_basis, inputs.current_basis)
    ]
    reference, current = inputs.reference.copy(), inputs.current.copy()
    reference[:, 2] += basis[0]
    current[:, 2] += basis[1]
    u, v = ((c - c.mean()) / c.std() for c in reference[:, :2].T)
    one, none = np.ones(len(u)), np.zeros(len(u))
    tracking = [
        (one, none, none),
        (none, one, none),
        (none, none, one),
        (u, v, none),
        (none, v, none),
        (-v, u, none),
    ]
    camera = RectifiedCamera.from_matrix(K, BASELINE_M)
    corner_px = corner_radius_px(camera, reference, current)
    of_reference, of_current = (measurement_errors(camera, m, corner_px) for m in (reference, current))
    sigmas = [0.04, 0.04, 0.03, 0.04, 0.04, 0.04, *CalibrationUncertainty().sigmas()]
    total = np.zeros((len(gain.T), 14))
    for i, projection in enumerate(at.projections):
        modes = np.column_stack([np.array(mode)[:, i] for mode in tracking])
        calibration = of_current[i] - at.by_reference[i] @ of_reference[i]
        total += projection @ np.column_stack([modes, calibration])
    # The derivatives of ``sums`` are those of prediction minus measurement, an error adds to the measurement.
    return gain @ total * sigmas


@pytest.mark.parametrize(("parameters", "spread"), [(0, 1.0), (2, 1.0), (0, 0.1), (0, 0.01)])
def test_the_condition_number_is_that_of_the_motion_with_scaled_rotations(
    parameters: int, spread: float
) -> None:
    """The direction that is constrained least is named, also in a narrow field of view."""
    inputs = scenario(5, 0.05, parameters, spread=spread)
    out = solved(inputs, max_conditioning=1e15)
    H = np.linalg.inv(np.linalg.inv(sums(inputs, se3.inverse(out.motion), out.calibration).normal)[:6, :6])
    distance = np.sqrt(np.trace(H[3:, 3:]) / np.trace(H[:3, :3]))
    scale = np.diag([1.0, 1.0, 1.0, *[1.0 / distance] * 3])
    values, vectors = np.linalg.eigh(scale @ H @ scale)
    assert out.conditioning == pytest.approx(values[-1] / values[0], rel=1e-3)
    assert solved(inputs, max_conditioning=out.conditioning).conditioning == out.conditioning
    with pytest.raises(DegenerateGeometryError, match="do not constrain") as error:
        solved(inputs, max_conditioning=out.conditioning * (1.0 - 1e-9))
    assert error.value.directions == (["x", "y", "z", "rx", "ry", "rz"][np.argmax(np.abs(vectors[:, 0]))],)


def test_the_residuals_of_points_near_infinity_and_behind_the_camera_use_limits() -> None:
    """Disparities are at least 0.05 px, depths at least 0.05 m; a point behind is never an inlier."""
    inputs = scenario(7, 0.0, 0)
    z = 0.1  # behind the camera after 0.2 m
    inputs.reference[0] = [170.0, 100.0, 250.0 * BASELINE_M / z]
    inputs.reference[1, 2] = -3.0
    inputs.reference[2, 2] = 0.01
    out = solved(inputs)
    T = se3.inverse(out.motion)
    assert out.inliers.tolist() == [False] * 3 + [True] * 22 or not out.inliers[0]
    for i in (1, 2):
        limited = predicted(np.array([*inputs.reference[i, :2], 0.05]), T)
        np.testing.assert_allclose(out.residuals[i], inputs.current[i] - limited, atol=1e-8)
    x, y, _ = T[:3, :3] @ [10.0 * z / 250.0, -10.0 * z / 240.0, z] + T[:3, 3]
    at_limit = np.array([250.0 * x / 0.05 + 160.0, 240.0 * y / 0.05 + 110.0, 250.0 * BASELINE_M / 0.05])
    np.testing.assert_allclose(out.residuals[0], inputs.current[0] - at_limit, rtol=1e-9)
    assert not solved(inputs, gate=100.0).inliers[0]
    np.testing.assert_allclose(out.motion, MOTION, atol=2e-3)


def test_four_points_are_enough_and_three_are_refused() -> None:
    inputs = scenario(8, 0.0, 0, n=4)
    np.testing.assert_allclose(solved(inputs).motion, MOTION, atol=1e-6)
    with pytest.raises(RefusedError) as error:
        solved(scenario(8, 0.0, 0, n=3))
    assert error.value.reasons == ("few_inliers:3<4",)
    inputs.current[0, :2] += 60.0
    with pytest.raises(RefusedError, match="3 points agree") as error:
        solved(inputs)
    assert error.value.reasons == ("few_inliers:3<4",)


def test_a_guess_with_all_points_behind_the_camera_diverges() -> None:
    with pytest.raises(RefusedError) as error:
        solved(scenario(9, 0.0, 0, guess=se3.transform(np.eye(3), [0.0, 0.0, 50.0])))
    assert error.value.reasons == ("diverged",)


def test_the_rotation_of_the_guess_is_normalised() -> None:
    guess = scenario(10, 0.1, 0).guess
    guess[:3, :3] *= 1.0 + 1e-5
    R = solved(scenario(10, 0.1, 0, guess=guess), max_iterations=1).motion[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


def test_a_step_that_increases_the_cost_is_not_taken() -> None:
    """Near the minimum the step is not zero: it does not include the derivative of the noise."""
    inputs = scenario(4, 0.4, 0)
    estimate = solved(inputs).motion
    T, none = se3.inverse(estimate), np.zeros(0)
    at = sums(inputs, T, none)
    step = np.linalg.solve(at.normal, -at.gradient)
    beyond = se3.transform(se3.exp_so3(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])
    assert sums(inputs, beyond, none).cost > at.cost * (1.0 + 1e-8)
    again = solved(replace(inputs, guess=estimate), max_iterations=1)
    np.testing.assert_allclose(again.motion, estimate, atol=1e-12)


@pytest.mark.parametrize(
    "changes",
    [
        {"reference_basis": np.ones((25, 1))},
        {"current_basis": np.ones((25, 3))},
        {"calibration": np.zeros(1)},
        {"calibration_covariance": np.eye(3)},
    ],
)
def test_bases_and_calibration_of_different_sizes_are_refused(changes: dict[str, Array]) -> None:
    with pytest.raises(InputError, match="expected"):
        solved(scenario(12, 0.1, 2, **changes))
