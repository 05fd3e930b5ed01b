# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alignment of dense stereo pixels to the grey levels of both current images, coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, Float32Array, FloatArray
from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.photometric_motion_estimation._levels import (
    SelectedPixels,
    calibration_basis,
    normalised_pyramid,
    usable_pixels,
)
from cdff_core.dfns.photometric_motion_estimation._normal_equations import NormalEquations, Warped
from cdff_core.dfns.photometric_motion_estimation._warped_pixels import warp_pixels
from cdff_core.dfns.photometric_motion_estimation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.calibration_errors import (
    CalibrationUncertainty,
    corner_radius_px,
    measurement_errors,
    tracking_errors,
)
from cdff_core.imaging.rectified_camera import RectifiedCamera

_DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
#: Number of selected pixels below which an alignment is not attempted.
_MIN_PIXELS = 100
#: Fraction of the selected pixels that must be in view.
_MIN_OVERLAP = 0.15
#: Change of the normalised cost by a step that ends the iteration, on the finest and on other levels.
_TOLERANCE, _COARSE_TOLERANCE = 1e-5, 1e-4
#: Edge of the blocks whose residuals are assumed to be independent, pixels.
_BLOCK_PX = 48
#: Information of a parameter of the calibration that is not estimated, per square pixel.
_EXACT = 1e12


class NormalisedPyramidConfig(DfnConfig):
    """Parameters of NormalisedPyramid."""

    levels: int = Field(
        5, ge=1, le=8, description="Levels of the image pyramid; each additional one doubles the search range"
    )
    pixels: int = Field(6000, ge=200, le=200_000, description="Largest number of aligned pixels per level")
    iterations: int = Field(15, ge=1, le=100, description="Largest number of steps per level")
    sigma_disparity_px: float = Field(
        0.3, gt=0, le=10, description="Standard deviation of the noise of a reference disparity"
    )
    sigma_common_px: float = Field(
        0.02,
        ge=0,
        le=5,
        description="Standard deviation of an error of columns and rows common to all pixels, for example by "
        "interpolation; use 0.003 for simulated images",
    )
    sigma_common_disparity_px: float = Field(
        0.015, ge=0, le=5, description="Standard deviation of an error common to all reference disparities"
    )
    calibration: CalibrationUncertainty = Field(
        CalibrationUncertainty(), description="Uncertainty of the calibration of the camera"
    )
    max_conditioning: float = Field(1e7, gt=1, description="Largest condition number of an observable motion")


@dataclass(frozen=True, slots=True, eq=False)
class _Images:
    """Current pair: normalised pyramids of the left and the right image with their usable pixels."""

    camera: RectifiedCamera
    left: list[Float32Array]
    right: list[Float32Array]
    masks: tuple[BoolArray | None, BoolArray | None]

    def warp(self, selected: SelectedPixels, level: int, estimate: _Estimate) -> Warped:
        """Return the pixels of a level warped by an estimate."""
        c, scale = self.camera, 2.0**level
        disparities = selected.corrected(estimate.calibration_px, estimate.disparity_errors)
        points = c.triangulate(np.column_stack([selected.pixels, disparities]))
        parts = [
            warp_pixels(
                images[level],
                usable_pixels(mask, images[level], level),
                selected.values,
                points,
                disparities,
                estimate.T,
                np.array([c.fx, c.fy, c.cx, c.cy]) / scale,
                offset_m,
                field_px / scale,
            )
            for images, mask, offset_m, field_px in zip(
                (self.left, self.right),
                self.masks,
                (0.0, c.baseline_m),
                (np.zeros(2), estimate.calibration_px),
                strict=True,
            )
        ]
        residuals, by_pose, by_disparity, gradients, positions, visible = (
            np.stack(pair, axis=1) for pair in zip(*parts, strict=True)
        )
        by_calibration = by_disparity[:, :, None] * selected.basis[:, None, :]
        current_basis = calibration_basis(scale * positions[:, 1], c)
        by_calibration[:, 1] += gradients[:, 1, :1] * current_basis / scale
        by_parameters = np.concatenate([by_pose, by_calibration], axis=2)
        errors = estimate.disparity_errors
        return Warped(residuals, errors, by_parameters, by_disparity, gradients, positions, visible)


@dataclass(frozen=True, slots=True, eq=False)
class _Estimate:
    """Motion ``T_current_reference``, errors of the disparities, parameters of the calibration."""

    T: FloatArray  # (4, 4)
    calibration_px: FloatArray  # (2,)
    prior_px: FloatArray  # (2,)
    prior_information: FloatArray  # (2, 2)
    disparity_errors: FloatArray  # (n,), of the selected pixels, pixels of the full resolution

    @classmethod
    def of_inputs(cls, inputs: Inputs) -> _Estimate:
        """Return the estimate at the guess; without a prior the calibration is exact."""
        T = se3.inverse(inputs.guess)
        T[:3, :3] = se3.normalise_rotation(T[:3, :3])
        if inputs.calibration is None or inputs.calibration_covariance is None:
            return cls(T, np.zeros(2), np.zeros(2), _EXACT * np.eye(2), np.zeros(0))
        if inputs.calibration.shape != (2,) or inputs.calibration_covariance.shape != (2, 2):
            raise InputError(
                f"calibration {inputs.calibration.shape}, covariance {inputs.calibration_covariance.shape}: "
                "expected (2,) and (2, 2), offset and decentring of the disparities"
            )
        mean = np.array(inputs.calibration, np.float64)
        information = np.asarray(np.linalg.inv(inputs.calibration_covariance), np.float64)
        return cls(T, mean, mean, information, np.zeros(0))

    def stepped(
        self, warped: Warped, equations: NormalEquations, damping: float, *, is_finest: bool
    ) -> _Estimate:
        """Return the result of a damped Gauss-Newton step; only the finest level changes the calibration."""
        information = np.zeros((8, 8))
        information[6:, 6:] = self.prior_information if is_finest else _EXACT * np.eye(2)
        gradient = equations.scores.sum(axis=0)
        gradient[6:] += information[6:, 6:] @ (self.calibration_px - self.prior_px)
        normal = equations.normal + information
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-9), gradient)
        T = se3.transform(se3.exp_so3(step[3:6]) @ self.T[:3, :3], self.T[:3, 3] + step[:3])
        predicted = equations.reduced + warped.by_parameters @ step
        change = -np.einsum("ni,ni->n", equations.disparity_gain, predicted) - self.disparity_errors
        errors = self.disparity_errors + change / (1.0 + damping)
        return replace(self, T=T, calibration_px=self.calibration_px + step[6:], disparity_errors=errors)


class NormalisedPyramid(Interface[NormalisedPyramidConfig]):
    """Minimise the differences of locally normalised grey levels over a pyramid by robust Gauss-Newton.

    Each selected pixel of the reference is projected into the left and the right current image [1]_, [2]_.
    The local mean and contrast of all images are removed, which replaces the affine brightness model by a
    local one. The right image determines the scale together with the disparities of the reference; the error
    of a disparity is common to both residuals of a pixel and is estimated with the motion. Residuals are
    weighted by Cauchy's function with a scale from their median. Two errors of the stereo calibration that
    row offsets do not determine are estimated on the finest level, if their prior is given (see
    RectificationRefinement).

    The covariance of the noise follows from the scatter of the gradient between blocks of the image [3]_.
    Errors common to all pixels (interpolation, offset of the disparities, calibration) are propagated to
    first order and included.

    References
    ----------
    .. [1] A. I. Comport, E. Malis, P. Rives, Real-time quadrifocal visual odometry, IJRR 29(2-3), 2010,
      doi:10.1177/0278364909356601
    .. [2] R. Wang, M. Schwoerer, D. Cremers, Stereo DSO, ICCV 2017, doi:10.1109/ICCV.2017.421
    .. [3] H. White, Maximum likelihood estimation of misspecified models, Econometrica 50(1), 1982,
      doi:10.2307/1912526
    """

    def setup(self) -> None:
        """Compile the kernel."""
        warp_pixels(
            np.zeros((8, 8), np.float32),
            np.ones((8, 8), bool),
            np.zeros(1),
            np.ones((1, 3)),
            np.ones(1),
            np.eye(4),
            np.ones(4),
            0.0,
            np.zeros(2),
        )

    def process(self, inputs: Inputs) -> Outputs:
        """Return the motion; raises InputError, RefusedError or DegenerateGeometryError."""
        camera = RectifiedCamera.from_matrix(inputs.camera_matrix, inputs.baseline)
        if not se3.is_transform(inputs.guess, tolerance=1e-3):
            raise InputError("guess: expected a rigid 4x4 transform T_reference_current")
        pyramids = [
            normalised_pyramid(image, self.config.levels)
            for image in (inputs.reference, inputs.left, inputs.right)
        ]
        images = _Images(camera, pyramids[1], pyramids[2], (inputs.left_mask, inputs.right_mask))
        estimate = _Estimate.of_inputs(inputs)
        disparity = np.asarray(inputs.disparity, np.float32)
        select = partial(
            SelectedPixels.of_level, disparity=disparity, camera=camera, limit=self.config.pixels
        )
        for level in range(len(pyramids[0]) - 1, -1, -1):
            selected = select(pyramids[0][level], level)
            if len(selected.values) < _MIN_PIXELS and level > 0:
                continue
            estimate, warped, equations = self._align(selected, images, level, estimate)
        return self._outputs(selected, images.camera, estimate, warped, equations)

    def _align(
        self, selected: SelectedPixels, images: _Images, level: int, estimate: _Estimate
    ) -> tuple[_Estimate, Warped, NormalEquations]:
        """Return the estimate that minimises the cost on a level, and the linearisation there.

        A level above the finest on which too few pixels are in view does not change the motion.
        """
        estimate = replace(estimate, disparity_errors=np.zeros(len(selected.values)))
        warped = images.warp(selected, level, estimate)
        if level == 0:
            _require_view(warped)
        elif warped.visible[:, 0].sum() < _MIN_PIXELS:
            return estimate, warped, NormalEquations.of_pixels(warped, 1.0, self.config.sigma_disparity_px)
        sigma, damping = warped.sigma(), 1e-4
        tolerance = _COARSE_TOLERANCE if level else _TOLERANCE
        equations = NormalEquations.of_pixels(warped, sigma, self.config.sigma_disparity_px)
        for _ in range(self.config.iterations):
            candidate = estimate.stepped(warped, equations, damping, is_finest=level == 0)
            trial = images.warp(selected, level, candidate)
            trial_equations = NormalEquations.of_pixels(trial, sigma, self.config.sigma_disparity_px)
            is_lost = trial.visible.sum() < 0.5 * warped.visible.sum()
            gained = equations.cost - trial_equations.cost
            if not is_lost and -tolerance * (1.0 + equations.cost) < gained < 0.0:
                break
            if is_lost or gained < 0.0:
                damping = max(10.0 * damping, 0.3)
                if damping > 1e3:
                    break
                continue
            end = gained < tolerance * (1.0 + equations.cost)
            estimate, warped, equations = candidate, trial, trial_equations
            damping = max(0.1 * damping, 1e-7)
            if end:
                break
            sigma = min(sigma, warped.sigma())
            equations = NormalEquations.of_pixels(warped, sigma, self.config.sigma_disparity_px)
        return estimate, warped, equations

    def _outputs(
        self,
        selected: SelectedPixels,
        camera: RectifiedCamera,
        estimate: _Estimate,
        warped: Warped,
        equations: NormalEquations,
    ) -> Outputs:
        """Return motion, covariances and measures of agreement of a solution on the finest level."""
        _require_view(warped)
        T, normal = estimate.T, equations.normal[:6, :6]
        conditioning, direction = _weakest_direction(normal)
        if conditioning > self.config.max_conditioning:
            text = f"the pixels do not constrain {direction} (condition number {conditioning:.3g})"
            raise DegenerateGeometryError(text, [direction])
        inverse = cov.symmetrised(np.linalg.inv(normal))
        J = cov.inverse_jacobian(T)  # from the estimated T_current_reference to the motion
        scatter = equations.scatter(selected.pixels, _BLOCK_PX)
        noise = cov.symmetrised(J @ inverse @ scatter[:6, :6] @ inverse @ J.T)
        errors = self._common_errors(selected, camera, T, warped)
        common = -J @ inverse @ np.einsum("nij,njk->ik", equations.weighted[:, :6], errors)
        by_calibration = -J @ inverse @ equations.normal[:6, 6:]
        calibration_covariance = _calibration_covariance(equations.normal, scatter, estimate)
        systematic = common @ common.T + by_calibration @ calibration_covariance @ by_calibration.T
        left, right = warped.visible.T
        shift = np.hypot(*(warped.positions[left, 0] - selected.pixels[left]).T)
        return Outputs(
            motion=se3.inverse(T),
            covariance=noise + cov.symmetrised(systematic),
            noise_covariance=noise,
            common_response=common,
            calibration=estimate.calibration_px,
            calibration_covariance=calibration_covariance,
            calibration_response=by_calibration,
            pixels=len(selected.values),
            overlap=float(left.mean()),
            correlation=_correlation(selected.values[left], warped.residuals[left, 0]),
            correlation_right=_correlation(selected.values[right], warped.residuals[right, 1]),
            inlier_fraction=float((equations.weights[left] > 0.5).mean()),
            moved=float(np.median(shift)),
            conditioning=conditioning,
        )

    def _common_errors(
        self, selected: SelectedPixels, camera: RectifiedCamera, T: FloatArray, warped: Warped
    ) -> FloatArray:
        """Return the changes (n, 2, 14) of the residuals by one standard deviation of each common error."""
        c = self.config
        reference = np.column_stack([selected.pixels, selected.disparities])
        points = se3.transform_points(T, camera.triangulate(reference))
        points = np.maximum(points, [-np.inf, -np.inf, 0.05])
        current = camera.project(points)
        J = camera.projection_jacobian(points) @ T[:3, :3] @ camera.triangulation_jacobian(reference)
        corner_px = corner_radius_px(camera, reference)
        calibration = J @ measurement_errors(camera, reference, corner_px)
        calibration -= measurement_errors(camera, current, corner_px)
        tracking = tracking_errors(reference)
        tracking[:, :, 2] = J[:, :, 2]  # the disparities of the current pair are not measured
        errors = np.concatenate([tracking, calibration], axis=2)
        errors *= np.concatenate(
            [
                [c.sigma_common_px, c.sigma_common_px, c.sigma_common_disparity_px],
                [c.sigma_common_px] * 3,
                c.calibration.sigmas(),
            ]
        )
        left, right = errors[:, :2], errors[:, :2].copy()
        right[:, 0] -= errors[:, 2]
        pixel_errors = np.stack([left, right], axis=1)
        return np.asarray(np.einsum("nsa,nsak->nsk", warped.gradients, pixel_errors))


def _require_view(warped: Warped) -> None:
    """Raise RefusedError if too few selected pixels are in view of the left camera."""
    count = len(warped.visible)
    if count < _MIN_PIXELS:
        raise RefusedError(
            f"{count} pixels with texture and disparity, expected at least {_MIN_PIXELS}",
            [f"few_pixels:{count}<{_MIN_PIXELS}"],
        )
    overlap = float(warped.visible[:, 0].mean())
    if overlap < _MIN_OVERLAP:
        raise RefusedError(
            f"{overlap:.0%} of the reference in view, expected at least {_MIN_OVERLAP:.0%}",
            [f"low_overlap:{overlap:.2f}<{_MIN_OVERLAP:.2f}"],
        )


def _calibration_covariance(normal: FloatArray, scatter: FloatArray, estimate: _Estimate) -> FloatArray:
    """Return the covariance (2, 2) of the parameters of the calibration by their prior and the gradient."""
    prior = np.zeros((8, 8))
    prior[6:, 6:] = estimate.prior_information
    inverse = np.linalg.inv(normal + prior)
    return cov.symmetrised((inverse @ (scatter + prior) @ inverse)[6:, 6:])


def _correlation(values: FloatArray, residuals: FloatArray) -> float:
    """Return the correlation of reference values and the current ones; 0 without values."""
    current = values + residuals
    product = float(np.sqrt((values @ values) * (current @ current)))
    return float(values @ current) / product if product > 0.0 else 0.0


def _weakest_direction(normal: FloatArray) -> tuple[float, str]:
    """Return the condition number with scaled rotations, and the direction that is constrained least."""
    distance = np.sqrt(np.trace(normal[3:, 3:]) / max(np.trace(normal[:3, :3]), 1e-300))
    scale = np.array([1.0, 1.0, 1.0, *[1.0 / max(distance, 1e-300)] * 3])
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    weakest = _DIRECTIONS[int(np.argmax(np.abs(vectors[:, 0])))]
    return float(values[-1] / max(values[0], 1e-300)), weakest
