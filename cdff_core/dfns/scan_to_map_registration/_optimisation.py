# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gauss-Newton estimation of pose and motion during the sweep, from a wide to a narrow robust kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.scan_to_map_registration import _kernels
from cdff_core.dfns.scan_to_map_registration._priors import Prior
from cdff_core.dfns.scan_to_map_registration._voxel_map import VoxelMap

#: Number of matched points below which a sweep is not registered.
_MIN_MATCHED_POINTS = 50
#: Damping of the normal equations relative to their mean diagonal.
_DAMPING = 1e-9
#: Factor on the width of the robust kernel per iteration.
_ANNEALING = 0.5
#: Number of points per independent measurement.
_POINTS_PER_MEASUREMENT = 10.0


@dataclass(frozen=True, slots=True)
class Schedule:
    """Widths of the robust kernel and limits of the iteration."""

    first_kernel_m: float
    last_kernel_m: float
    noise_m: float  # minimum standard deviation of a distance to a plane
    max_iterations: int
    tolerance_m: float  # step at convergence, translation plus rotation times radius


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Result of the iteration.

    Attributes
    ----------
    T : ndarray, shape (4, 4)
        T_map_sensor at the end of the sweep.
    motion : ndarray, shape (6,)
        Translation and rotation during the sweep, in axes of the sensor.
    information : ndarray, shape (12, 12)
        Of pose and motion, with the prior.
    noise_m : ndarray, shape (levels,)
        Standard deviation of the distances to the planes of each level, metres.
    variance : float
        Variance of the distance of a point with weight 1, m^2.
    radius_m, rms_m : float
        RMS distance of the matched points from the sensor, and to their planes.
    matched_points, iterations : int
    converged : bool
    """

    T: FloatArray
    motion: FloatArray
    information: FloatArray
    noise_m: FloatArray
    variance: float
    radius_m: float
    rms_m: float
    matched_points: int
    iterations: int
    converged: bool


def estimate(
    local_map: VoxelMap,
    points: FloatArray,
    point_times: FloatArray,
    prior: Prior,
    schedule: Schedule,
    start: Estimate | None = None,
) -> Estimate:
    """Estimate pose and motion of a sweep, starting at the guesses of the prior or at another estimate.

    Raises RefusedError ``no_overlap`` if too few points lie on the map.
    """
    T, motion = (prior.T_guess, prior.motion_guess) if start is None else (start.T, start.motion)
    T, motion = T.copy(), motion.copy()
    kernel, iterations, converged = schedule.first_kernel_m, 0, False
    noise_m = np.full(len(local_map.tables), schedule.noise_m)
    for _ in range(schedule.max_iterations):
        H, b, sums, level_sums = _kernels.normal_equations(
            local_map.tables,
            local_map.voxel_m,
            finest_level(local_map, kernel),
            points,
            point_times,
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
        variance = max(rms_m, schedule.noise_m) ** 2 * _POINTS_PER_MEASUREMENT
        A, g = H / variance, b / variance
        prior.add_to(A, g, T, motion)
        scale = np.concatenate([np.ones(3), np.full(3, radius_m**2)] * 2)
        A += _DAMPING * np.trace(A) * np.diag(scale) / 12.0
        x = -np.linalg.solve(A, g)
        T[:3, :3] = se3.normalise_rotation(se3.exp_so3(x[3:6]) @ T[:3, :3])
        T[:3, 3] += x[:3]
        motion += x[6:]
        step_m = float(np.linalg.norm(x[:3]) + radius_m * np.linalg.norm(x[3:6]))
        converged = kernel <= schedule.last_kernel_m and step_m < schedule.tolerance_m
        if converged:
            break
        noise_m = _noise_of_levels(level_sums, schedule.noise_m)
        if step_m < kernel:
            kernel = max(schedule.last_kernel_m, _ANNEALING * kernel)
    return Estimate(T, motion, A, noise_m, variance, radius_m, rms_m, int(sums[1]), iterations, converged)


def finest_level(local_map: VoxelMap, kernel_m: float) -> int:
    """Return the finest level whose voxels have at least the width of the kernel.

    A point within the kernel of a plane then finds that plane in its own voxel or a neighbour.
    """
    level = int(np.ceil(np.log2(max(kernel_m / local_map.voxel_m, 1.0)) - 1e-9))
    return min(level, len(local_map.tables) - 1)


def _noise_of_levels(level_sums: FloatArray, least_m: float) -> FloatArray:
    """Return the standard deviation of the distances at each level (levels,), metres, from the residuals.

    Large voxels also have planes on rough ground, with the relief as noise (variance component estimation).
    """
    variance = level_sums[:, 1] / np.maximum(level_sums[:, 0], 1e-12)
    return np.asarray(np.maximum.accumulate(np.sqrt(np.maximum(variance, least_m**2))))
