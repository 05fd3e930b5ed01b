# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of a sweep with a local map of planes in voxels."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.scan_to_map_registration import _kernels, _voxel_table
from cdff_core.dfns.scan_to_map_registration._priors import (
    fraction_of_motion,
    information,
    previous_pose,
    remapped,
)
from cdff_core.dfns.scan_to_map_registration.interface import Inputs, Interface, Outputs

#: Initial number of rows of the voxel table, and the fraction of used rows above which it is rebuilt.
_INITIAL_CAPACITY, _MAX_LOAD = 1 << 15, 0.6
_MIN_MATCHED_POINTS = 50
#: Damping of the normal equations relative to their mean diagonal.
_DAMPING = 1e-9
#: Factor on the width of the robust kernel per iteration.
_ANNEALING = 0.5
#: Information on the motion during the sweep if its covariance is not given: fixed at its initial value.
_FIXED_MOTION_INFORMATION = 1e6
#: Maximum number of points of a voxel: more would hardly change its plane.
_MAX_VOXEL_POINTS = 60
#: Number of points per independent measurement.
_POINTS_PER_MEASUREMENT = 10.0
#: Width of the first kernel in standard deviations of the guess's translation.
_FIRST_KERNEL_SIGMAS = 2.0
#: Maximum number of points with which candidates are compared.
_SUPPORT_POINTS = 2000
#: Maximum number of candidates that are registered, their minimum support relative to the best one, and the
#: minimum distance between them, metres or radians.
_REGISTERED_CANDIDATES, _CANDIDATE_SUPPORT_RATIO = 3, 0.7
_CANDIDATE_STEP_M, _CANDIDATE_STEP_RAD = 1.0, 0.25


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
        self._kernels, self._tables = _kernels, _voxel_table
        capacity = _INITIAL_CAPACITY
        self._maps = tuple(_voxel_table.empty_table(capacity) for _ in range(self.config.levels))
        self._compile()

    @property
    def voxels(self) -> int:
        """Number of the smallest voxels of the map."""
        return int(self._maps[0].used[0])

    @property
    def map_bytes(self) -> int:
        """Memory of the map, bytes."""
        return sum(column.nbytes for table in self._maps for column in table)

    def process(self, inputs: Inputs) -> Outputs:
        """Add the surface to the map, and return pose and motion of the sweep.

        Raises
        ------
        InputError
            If an array is malformed.
        RefusedError
            ``no_overlap`` if too few points lie on the map.
        """
        T = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
        if inputs.surface is not None:
            self._grow(checked_points(inputs.surface, "surface", least=0), T[:3, 3])
        sweep = checked_transform(
            np.eye(4) if inputs.sweep_guess is None else inputs.sweep_guess, "sweep_guess"
        )
        points = (
            np.zeros((0, 3)) if inputs.points is None else checked_points(inputs.points, "points", least=0)
        )
        fraction = (
            np.zeros(len(points))
            if inputs.fraction is None
            else np.asarray(inputs.fraction, dtype=np.float64)
        )
        if not len(points):
            return _outputs_without_points(T, sweep)
        selected = self._tables.first_in_voxels(points, self.config.points_voxel_m)
        motion = np.concatenate([-sweep[:3, 3], -se3.log_so3(sweep[:3, :3])])
        if inputs.candidates is None:
            return self._register(points[selected], fraction[selected], T, motion, inputs)
        return self._register_candidates(points[selected], fraction[selected], T, motion, inputs)

    def _register_candidates(
        self, points: FloatArray, fraction: FloatArray, T: FloatArray, motion: FloatArray, inputs: Inputs
    ) -> Outputs:
        """Register from the guesses with the largest support, and return the result with the largest support.

        The support of the guesses is computed with large voxels and a wide kernel.
        """
        assert inputs.candidates is not None  # checked by the caller
        cfg, finest = self.config, min(1, self.config.levels - 1)
        poses = np.concatenate([T[None], inputs.candidates])
        T_previous, ratio = previous_pose(inputs.before, inputs.sweep_fraction)
        motions = np.array(
            [motion if T_previous is None else fraction_of_motion(T_previous, P, ratio)[0] for P in poses]
        )
        edge_m = cfg.voxel_m * (1 << finest)
        sampled = self._tables.first_in_voxels(points, edge_m)
        sampled = sampled[:: 1 + len(sampled) // _SUPPORT_POINTS]
        support = self._kernels.supports(
            self._maps, cfg.voxel_m, finest, points[sampled], fraction[sampled], poses, motions, edge_m
        )
        results = []
        for i in _best_distinct(poses, support):
            try:
                results.append(self._register(points, fraction, poses[i], motions[i], inputs))
            except RefusedError as error:
                refusal = error
        if not results:
            raise refusal
        return max(results, key=lambda result: result.support_ratio)

    def _register(
        self, points: FloatArray, fraction: FloatArray, T: FloatArray, motion: FloatArray, inputs: Inputs
    ) -> Outputs:
        cfg = self.config
        T_guess, T = T, T.copy()
        motion_guess, motion = motion, motion.copy()
        prior = information(inputs.guess_covariance)
        prior_sweep = information(inputs.sweep_covariance)
        prior_sweep += _FIXED_MOTION_INFORMATION * np.eye(6) * (inputs.sweep_covariance is None)
        T_previous, sweep_fraction = previous_pose(inputs.before, inputs.sweep_fraction)
        kernel, iterations, converged = self._first_kernel_m(inputs.guess_covariance), 0, False
        noise_m = np.full(cfg.levels, cfg.noise_m)
        for _ in range(cfg.max_iterations):
            H, b, sums, level_sums = self._kernels.normal_equations(
                self._maps,
                cfg.voxel_m,
                self._finest_level(kernel),
                points,
                fraction,
                np.ascontiguousarray(T[:3, :3]),
                T[:3, 3].copy(),
                motion[3:].copy(),
                motion[:3].copy(),
                kernel,
                noise_m,
            )
            if sums[1] < _MIN_MATCHED_POINTS:
                raise RefusedError(f"{sums[1]:.0f} of {len(points)} points lie on the map", ["no_overlap"])
            iterations += 1
            rms_m, radius_m = float(np.sqrt(sums[2] / sums[0])), max(float(np.sqrt(sums[3] / sums[0])), 1e-6)
            variance = max(rms_m, cfg.noise_m) ** 2 * _POINTS_PER_MEASUREMENT
            A, g = H / variance, b / variance
            A[:6, :6] += prior
            g[:6] += prior @ pose_error(T, T_guess)
            expected, J = (
                (motion_guess, np.zeros((6, 6)))
                if T_previous is None
                else fraction_of_motion(T_previous, T, sweep_fraction)
            )
            J_prior = np.hstack([-J, np.eye(6)])
            A += J_prior.T @ prior_sweep @ J_prior
            g += J_prior.T @ prior_sweep @ (motion - expected)
            A += (
                _DAMPING
                * np.trace(A)
                * np.diag(np.concatenate([np.ones(3), np.full(3, radius_m**2)] * 2))
                / 12.0
            )
            x = -np.linalg.solve(A, g)
            T[:3, :3] = se3.normalise_rotation(se3.exp_so3(x[3:6]) @ T[:3, :3])
            T[:3, 3] += x[:3]
            motion += x[6:]
            step_m = float(np.linalg.norm(x[:3]) + radius_m * np.linalg.norm(x[3:6]))
            converged = kernel <= cfg.last_kernel_m and step_m < cfg.tolerance_m
            if converged:
                break
            noise_m = _noise_of_levels(level_sums, cfg.noise_m)
            if step_m < kernel:
                kernel = max(cfg.last_kernel_m, _ANNEALING * kernel)
        covariance = np.asarray(np.linalg.inv(A)[:6, :6], np.float64)
        directions, agreement, sigma_m = self._observability(
            points, fraction, T, motion, radius_m, variance, noise_m
        )
        unconstrained = directions[sigma_m > cfg.max_constrained_sigma_m]
        if len(unconstrained):
            T, covariance = remapped(T_guess, T, unconstrained, radius_m, covariance, inputs.guess_covariance)
            motion = motion_guess
        sweep = se3.transform(se3.exp_so3(-motion[3:]), -motion[:3])
        return Outputs(
            transform=T,
            sweep=sweep,
            covariance=0.5 * (covariance + covariance.T),
            directions=directions,
            agreement=agreement,
            sigma_m=sigma_m,
            radius_m=radius_m,
            inlier_ratio=float(sums[1] / len(points)),
            support_ratio=float(sums[4] / len(points)),
            rms_m=rms_m,
            iterations=iterations,
            converged=converged,
        )

    def _first_kernel_m(self, guess_covariance: FloatArray | None) -> float:
        """Return the first kernel width by the uncertainty of the guess, at most the largest voxel."""
        cfg = self.config
        largest_m = cfg.voxel_m * (1 << (cfg.levels - 1))
        sigma_m = (
            0.0 if guess_covariance is None else float(np.sqrt(np.trace(guess_covariance[:3, :3]) / 3.0))
        )
        return max(cfg.first_kernel_m, min(_FIRST_KERNEL_SIGMAS * sigma_m, largest_m))

    def _finest_level(self, kernel_m: float) -> int:
        """Return the first level whose voxels are as large as the kernel, so that they contain the plane."""
        level = int(np.ceil(np.log2(max(kernel_m / self.config.voxel_m, 1.0)) - 1e-9))
        return min(level, self.config.levels - 1)

    def _observability(
        self,
        points: FloatArray,
        fraction: FloatArray,
        T: FloatArray,
        motion: FloatArray,
        radius_m: float,
        variance: float,
        noise_m: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the directions of the information, the agreement of both halves of the map along them, and
        the standard deviations along them.

        One point per voxel is used, since points on the same plane share its noise, and only planes of enough
        points: the normals of planes through a few distant points of a new map are noisy, and their long
        lever arm would hide the information of the near ground on rotations.
        """
        cfg = self.config
        selected = self._tables.first_in_voxels(points, cfg.voxel_m)
        points, fraction = points[selected], fraction[selected]
        R = se3.exp_so3(fraction[:, None] * motion[None, 3:])
        deskewed = np.einsum("nij,nj->ni", R, points) + fraction[:, None] * motion[:3]
        H, cross_information, total_weight = self._kernels.common_information(
            self._maps,
            cfg.voxel_m,
            deskewed,
            np.ascontiguousarray(T[:3, :3]),
            T[:3, 3].copy(),
            cfg.last_kernel_m,
            noise_m,
            radius_m,
            cfg.known_count,
        )
        values, vectors = np.linalg.eigh(H)
        common = np.einsum("ij,ik,kj->j", vectors, cross_information, vectors)
        agreement = common / np.maximum(values, 1e-12)
        sigma_m = np.sqrt(variance / np.maximum(common * total_weight, 1e-12))
        return np.ascontiguousarray(vectors.T, np.float64), agreement, sigma_m

    def _grow(self, surface: FloatArray, centre: FloatArray) -> None:
        """Add a surface, downsampled, to the map.

        Voxels beyond the radius are removed when the table is full; if it is still full, its capacity is
        doubled.
        """
        cfg = self.config
        points = surface[self._tables.first_in_voxels(surface, cfg.surface_voxel_m)]
        points = points[np.sum((points - centre) ** 2, axis=1) < cfg.radius_m**2]
        self._maps = tuple(
            self._with_points(table, points, cfg.voxel_m * (1 << level), centre)
            for level, table in enumerate(self._maps)
        )

    def _with_points(
        self, table: _voxel_table.VoxelTable, points: FloatArray, voxel_m: float, centre: FloatArray
    ) -> _voxel_table.VoxelTable:
        """Return the table with points added; it is a new table if they did not fit."""
        capacity = len(table.keys)
        # Each point may create a voxel, and the compiled loop cannot enlarge the table.
        if table.used[0] + len(points) > _MAX_LOAD * capacity:
            table = self._rebuilt_table(table, capacity, voxel_m, centre)
            if table.used[0] + len(points) > _MAX_LOAD * capacity:
                table = self._rebuilt_table(table, 2 * capacity, voxel_m, centre)
        self._tables.add(table, points, voxel_m, _MAX_VOXEL_POINTS)
        return table

    def _rebuilt_table(
        self, table: _voxel_table.VoxelTable, capacity: int, voxel_m: float, centre: FloatArray
    ) -> _voxel_table.VoxelTable:
        target = self._tables.empty_table(capacity)
        self._tables.copy_near(table, target, centre, self.config.radius_m, voxel_m)
        return target

    def _compile(self) -> None:
        one, eye, zero, noise = np.zeros((1, 3)), np.eye(3), np.zeros(3), np.ones(self.config.levels)
        maps = tuple(self._tables.empty_table(16) for _ in range(self.config.levels))
        self._tables.first_in_voxels(one, 1.0)
        self._tables.add(maps[0], one, 1.0, 6)
        self._tables.copy_near(maps[0], self._tables.empty_table(16), zero, 1.0, 1.0)
        self._kernels.normal_equations(maps, 1.0, 0, one, np.zeros(1), eye, zero, zero, zero, 1.0, noise)
        self._kernels.common_information(maps, 1.0, one, eye, zero, 1.0, noise, 1.0, 12)
        poses, motions = np.eye(4)[None], np.zeros((1, 6))
        self._kernels.supports(maps, 1.0, 0, one, np.zeros(1), poses, motions, 1.0)


def _noise_of_levels(level_sums: FloatArray, least_m: float) -> FloatArray:
    """Return the standard deviation of the distances at each level (levels,), metres, from the residuals.

    Large voxels also have planes on rough ground, with the relief as noise (variance component estimation).
    """
    variance = level_sums[:, 1] / np.maximum(level_sums[:, 0], 1e-12)
    return np.asarray(np.maximum.accumulate(np.sqrt(np.maximum(variance, least_m**2))))


def _best_distinct(poses: FloatArray, support: FloatArray) -> list[int]:
    """Return the indices of the poses with the largest support that are not close to a better one."""
    selected: list[int] = []
    for i in np.argsort(-support, kind="stable"):
        if support[i] < _CANDIDATE_SUPPORT_RATIO * support.max():
            break
        E = se3.inverse(poses[i]) @ poses[selected]
        distance_m = np.linalg.norm(E[:, :3, 3], axis=1)
        angle_rad = np.linalg.norm(se3.log_so3(E[:, :3, :3]), axis=1)
        if np.all((distance_m > _CANDIDATE_STEP_M) | (angle_rad > _CANDIDATE_STEP_RAD)):
            selected.append(int(i))
        if len(selected) == _REGISTERED_CANDIDATES:
            break
    return selected


def _outputs_without_points(T: FloatArray, sweep: FloatArray) -> Outputs:
    """Return the guess as the pose of a sweep without points, with unknown covariance."""
    return Outputs(
        transform=T,
        sweep=sweep,
        covariance=np.full((6, 6), np.nan),
        directions=np.eye(6),
        agreement=np.zeros(6),
        sigma_m=np.full(6, np.inf),
        radius_m=0.0,
        inlier_ratio=0.0,
        support_ratio=0.0,
        rms_m=0.0,
        iterations=0,
        converged=False,
    )
