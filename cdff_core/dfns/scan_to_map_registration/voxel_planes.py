# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of a sweep with a local map of planes in voxels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.scan_to_map_registration import _kernels, _voxel_table
from cdff_core.dfns.scan_to_map_registration._guesses import best_guesses
from cdff_core.dfns.scan_to_map_registration._observability import observability
from cdff_core.dfns.scan_to_map_registration._optimisation import Estimate, Schedule, estimate
from cdff_core.dfns.scan_to_map_registration._priors import Prior, fraction_of_motion, fuse_with_guess
from cdff_core.dfns.scan_to_map_registration._shared_errors import (
    CalibrationErrors,
    shared_error_covariances,
    shared_gradients,
)
from cdff_core.dfns.scan_to_map_registration._voxel_map import VoxelMap
from cdff_core.dfns.scan_to_map_registration.interface import Inputs, Interface, Outputs

#: Width of the first robust kernel, in standard deviations of the translation of the guess.
_FIRST_KERNEL_SIGMAS = 2.0
#: Approximate number of points with which alternative guesses are registered.
_SEARCH_POINTS = 8000


class VoxelPlanesConfig(DfnConfig):
    """Parameters of VoxelPlanes."""

    voxel_m: float = Field(0.5, gt=0, le=10, description="Edge of the smallest voxels of the map")
    levels: int = Field(
        3,
        ge=1,
        le=6,
        description="Number of voxel sizes, each twice the previous one; larger voxels supply the planes "
        "where the smaller ones have too few points or the guess is too uncertain",
    )
    radius_m: float = Field(60.0, gt=0, le=1000, description="Distance beyond which the map is removed")
    surface_voxel_m: float = Field(
        0.12, gt=0, le=10, description="Edge of the voxels of the points added to the map"
    )
    points_voxel_m: float = Field(0.2, gt=0, le=10, description="Edge of the voxels of the registered points")
    noise_m: float = Field(
        0.02, gt=0, le=1, description="Minimum standard deviation of a distance to a plane"
    )
    first_kernel_m: float = Field(0.5, gt=0, le=10, description="Initial width of the robust kernel")
    last_kernel_m: float = Field(0.15, gt=0, le=10, description="Final width of the robust kernel")
    known_count: int = Field(
        12,
        ge=6,
        le=10_000,
        description="Minimum number of points of a plane that counts for the observability",
    )
    max_constrained_sigma_m: float = Field(
        0.09,
        gt=0,
        le=100,
        description="Largest standard deviation of a constrained direction; equal to "
        "gates.degenerate_sigma_m of lidar_slam",
    )
    range_sigma_m: float = Field(
        0.005, ge=0, le=1, description="Calibration error of all ranges in common, standard deviation"
    )
    ring_range_sigma_m: float = Field(
        0.01, ge=0, le=1, description="Calibration error of the ranges of a ring, standard deviation"
    )
    ring_elevation_sigma_deg: float = Field(
        0.03, ge=0, le=5, description="Calibration error of the elevation of a ring, standard deviation"
    )
    max_iterations: int = Field(30, ge=1, le=500, description="Maximum number of iterations")
    tolerance_m: float = Field(
        5e-4, gt=0, le=1, description="Step at convergence, translation plus rotation times radius"
    )


class VoxelPlanes(Interface[VoxelPlanesConfig]):
    """Point-to-plane registration of a downsampled sweep with one plane for each voxel of the map.

    Gauss-Newton iterations on one thread.

    Notes
    -----
    Map and adaptive use of a motion model after Vizzo et al. (2023), "KISS-ICP",
    doi:10.1109/LRA.2023.3236571, with planes in the voxels as in Yuan et al. (2022), "VoxelMap",
    doi:10.1109/LRA.2022.3187250. Pose and motion during the sweep are estimated together (Dellenbach et al.
    2022, "CT-ICP", doi:10.1109/ICRA46639.2022.9811849), with the guesses as prior information. If the
    previous pose is given, the prior of the motion during the sweep is a fraction of the motion since that
    pose, so that acceleration does not distort the sweep. A ring that coincides with one of the previous
    sweep does not constrain the pose, since a voxel with points along a line has no plane.
    """

    def setup(self) -> None:
        """Clear the map; compile the kernels."""
        self._map = VoxelMap(self.config.voxel_m, self.config.levels, self.config.radius_m)
        self._compile()

    @property
    def voxels(self) -> int:
        """Number of the smallest voxels of the map."""
        return self._map.voxels

    @property
    def map_bytes(self) -> int:
        """Memory of the map, bytes."""
        return self._map.memory_bytes

    def process(self, inputs: Inputs) -> Outputs:
        """Add new points to the map, then return pose and motion of the sweep.

        Raises
        ------
        InputError
            If an array is malformed.
        RefusedError
            ``no_overlap`` if too few points lie on the map.
        """
        T = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
        if inputs.new_map_points is not None:
            new_points = checked_points(inputs.new_map_points, "new_map_points", least=0)
            rows = _voxel_table.first_in_voxels(new_points, self.config.surface_voxel_m)
            self._map.add(new_points[rows], T[:3, 3])
        sweep = checked_transform(
            np.eye(4) if inputs.sweep_guess is None else inputs.sweep_guess, "sweep_guess"
        )
        points = (
            np.zeros((0, 3)) if inputs.points is None else checked_points(inputs.points, "points", least=0)
        )
        point_times = (
            np.zeros(len(points))
            if inputs.point_times is None
            else np.asarray(inputs.point_times, dtype=np.float64)
        )
        if not len(points):
            return _outputs_without_points(T, sweep)
        sampled_rows = _voxel_table.first_in_voxels(points, self.config.points_voxel_m)
        motion = np.concatenate([-sweep[:3, 3], -se3.log_so3(sweep[:3, :3])])
        points, point_times = points[sampled_rows], point_times[sampled_rows]
        prior = Prior.from_inputs(inputs, T, motion)
        if inputs.alternative_guesses is None:
            return self._register(points, point_times, prior, inputs.guess_covariance)
        return self._register_best_guess(points, point_times, prior, inputs)

    def _register_best_guess(
        self, points: FloatArray, point_times: FloatArray, prior: Prior, inputs: Inputs
    ) -> Outputs:
        """Register some points from the guesses with the largest support, and all points from the result with
        the largest support.
        """
        assert inputs.alternative_guesses is not None  # checked by the caller
        poses = np.concatenate([prior.T_guess[None], inputs.alternative_guesses])
        T_previous, ratio = prior.T_previous, prior.sweep_fraction
        motions = np.array(
            [
                prior.motion_guess if T_previous is None else fraction_of_motion(T_previous, T, ratio)[0]
                for T in poses
            ]
        )
        step = 1 + len(points) // _SEARCH_POINTS
        # Contiguous copies: for a strided array the kernels would be compiled a second time.
        sampled_points, sampled_times = points[::step].copy(), point_times[::step].copy()
        schedule, results = self._schedule(inputs.guess_covariance), []
        for i in best_guesses(self._map, points, point_times, poses, motions):
            prior_of_guess = replace(prior, T_guess=poses[i], motion_guess=motions[i])
            try:
                pose_estimate = estimate(self._map, sampled_points, sampled_times, prior_of_guess, schedule)
            except RefusedError as error:
                refusal = error
            else:
                results.append(
                    (
                        self._support(sampled_points, sampled_times, pose_estimate),
                        prior_of_guess,
                        pose_estimate,
                    )
                )
        if not results:
            raise refusal
        _, prior_of_guess, pose_estimate = max(results, key=lambda result: result[0])
        return self._register(points, point_times, prior_of_guess, None, pose_estimate)

    def _register(
        self,
        points: FloatArray,
        point_times: FloatArray,
        prior: Prior,
        guess_covariance: FloatArray | None,
        start: Estimate | None = None,
    ) -> Outputs:
        """Register the points; ``guess_covariance`` sets the width of the first kernel."""
        cfg = self.config
        pose_estimate = estimate(
            self._map, points, point_times, prior, self._schedule(guess_covariance), start
        )
        T, motion = pose_estimate.T, pose_estimate.motion
        covariance = np.asarray(np.linalg.inv(pose_estimate.information)[:6, :6], np.float64)
        directions, agreement, sigma_m = observability(
            self._map, points, point_times, pose_estimate, cfg.last_kernel_m, cfg.known_count
        )
        by_residuals, by_calibration = self._shared_error_covariances(points, point_times, pose_estimate)
        support_ratio = self._support(points, point_times, pose_estimate)
        is_weak, gains = sigma_m > cfg.max_constrained_sigma_m, np.ones(6)
        if np.any(is_weak):
            fusion = fuse_with_guess(
                prior, T, covariance, directions[is_weak], sigma_m[is_weak], pose_estimate.radius_m
            )
            T, covariance, gains[is_weak] = fusion.T, fusion.covariance, fusion.gains
            motion = prior.motion_guess
        return Outputs(
            transform=T,
            sweep=se3.transform(se3.exp_so3(-motion[3:]), -motion[:3]),
            covariance=0.5 * (covariance + covariance.T),
            residual_covariance=by_residuals,
            calibration_covariance=by_calibration,
            directions=directions,
            agreement=agreement,
            sigma_m=sigma_m,
            gains=gains,
            radius_m=pose_estimate.radius_m,
            inlier_ratio=pose_estimate.matched_points / len(points),
            support_ratio=support_ratio,
            rms_m=pose_estimate.rms_m,
            iterations=pose_estimate.iterations,
            converged=pose_estimate.converged,
        )

    def _schedule(self, guess_covariance: FloatArray | None) -> Schedule:
        """Return the schedule; the first kernel covers the uncertainty of the guess, up to the largest
        voxel.
        """
        cfg = self.config
        largest_m = cfg.voxel_m * (1 << (cfg.levels - 1))
        sigma_m = (
            0.0 if guess_covariance is None else float(np.sqrt(np.trace(guess_covariance[:3, :3]) / 3.0))
        )
        first_kernel_m = max(cfg.first_kernel_m, min(_FIRST_KERNEL_SIGMAS * sigma_m, largest_m))
        return Schedule(first_kernel_m, cfg.last_kernel_m, cfg.noise_m, cfg.max_iterations, cfg.tolerance_m)

    def _shared_error_covariances(
        self, points: FloatArray, point_times: FloatArray, pose_estimate: Estimate
    ) -> tuple[FloatArray, FloatArray]:
        """Return the covariances (6, 6) due to errors shared on planes, and due to the calibration."""
        cfg = self.config
        errors = CalibrationErrors(
            cfg.range_sigma_m, cfg.ring_range_sigma_m, np.radians(cfg.ring_elevation_sigma_deg)
        )
        return shared_error_covariances(
            self._map, points, point_times, pose_estimate, cfg.last_kernel_m, errors
        )

    def _support(self, points: FloatArray, point_times: FloatArray, pose_estimate: Estimate) -> float:
        """Return the mean weight of the last kernel over all points at the estimated pose.

        The kernel is the same for every registration, so that results of all guesses are comparable, also if
        the iteration ended at its limit.
        """
        cfg = self.config
        (support,) = _kernels.supports(
            self._map.tables,
            cfg.voxel_m,
            0,
            points,
            point_times,
            pose_estimate.T[None],
            pose_estimate.motion[None],
            cfg.last_kernel_m,
        )
        return float(support)

    def _compile(self) -> None:
        """Compile the kernels before the first sweep: call each one with small arrays."""
        one, eye, zero, noise = np.zeros((1, 3)), np.eye(3), np.zeros(3), np.ones(self.config.levels)
        maps = tuple(_voxel_table.empty_table(16) for _ in range(self.config.levels))
        _voxel_table.first_in_voxels(one, 1.0)
        _voxel_table.add(maps[0], one, 1.0, 6)
        _voxel_table.copy_near(maps[0], _voxel_table.empty_table(16), zero, 1.0, 1.0)
        _kernels.normal_equations(maps, 1.0, 0, one, np.zeros(1), eye, zero, zero, zero, 1.0, noise)
        shared_gradients(maps, 1.0, one, np.zeros(1), eye, zero, zero, zero, 1.0, noise)
        _kernels.common_information(maps, 1.0, one, eye, zero, 1.0, noise, 1.0, 12)
        _kernels.supports(maps, 1.0, 0, one, np.zeros(1), np.eye(4)[None], np.zeros((1, 6)), 1.0)


def _outputs_without_points(T_map_sensor: FloatArray, sweep: FloatArray) -> Outputs:
    """Return the guess as the pose of a sweep without points, with unknown covariance."""
    return Outputs(
        transform=T_map_sensor,
        sweep=sweep,
        covariance=np.full((6, 6), np.nan),
        residual_covariance=np.zeros((6, 6)),
        calibration_covariance=np.zeros((6, 6)),
        directions=np.eye(6),
        agreement=np.zeros(6),
        sigma_m=np.full(6, np.inf),
        gains=np.zeros(6),
        radius_m=0.0,
        inlier_ratio=0.0,
        support_ratio=0.0,
        rms_m=0.0,
        iterations=0,
        converged=False,
    )
