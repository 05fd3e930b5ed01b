# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of a sweep on planes in voxels."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.scan_to_map_registration._interface import (
    ScanToMapRegistrationInputs,
    ScanToMapRegistrationInterface,
    ScanToMapRegistrationOutputs,
)

Float = NDArray[np.float64]

_FIRST_CAPACITY = 1 << 15
_FULLEST = 0.6
_LEAST_PAIRS = 50
_DAMPING = 1e-9
_ANNEALING = 0.5


class VoxelPlanesConfig(DfnConfig):
    """Scales of map and sweep, noise, and the end of the iteration."""

    voxel_m: float = Field(0.5, gt=0.0, le=10.0, description="Edge of the voxels of the map, metres")
    radius_m: float = Field(60.0, gt=0.0, le=1000.0, description="What is farther from the sensor is forgotten, metres")
    full_count: int = Field(60, ge=6, le=10_000, description="Points after which a voxel takes no more")
    surface_voxel_m: float = Field(0.12, gt=0.0, le=10.0, description="One point in this is added to the map, metres")
    points_voxel_m: float = Field(0.2, gt=0.0, le=10.0, description="One point in this is registered, metres")
    noise_m: float = Field(0.02, gt=0.0, le=1.0, description="Least sigma of a distance to a plane, metres")
    points_per_measurement: float = Field(10.0, ge=1.0, le=1000.0, description="Points that count as one measurement")
    first_kernel_m: float = Field(
        0.5, gt=0.0, le=10.0, description="Width of the kernel at the first iteration, metres"
    )
    last_kernel_m: float = Field(0.15, gt=0.0, le=10.0, description="Width of the kernel at the end, metres")
    known_count: int = Field(12, ge=6, le=10_000, description="Points of a voxel from which its plane tells directions")
    held_sigma_m: float = Field(
        0.09, gt=0.0, le=100.0, description="Sigma left by the map above which a direction stays as guessed, metres"
    )
    max_iterations: int = Field(30, ge=1, le=500, description="Iterations at most")
    tolerance_m: float = Field(5e-4, gt=0.0, le=1.0, description="Step that has converged, metres")


class VoxelPlanes(ScanToMapRegistrationInterface):
    """Distances of a thinned sweep to the planes through the points of each voxel, Gauss-Newton on one thread.

    Notes
    -----
    Map and adaptive use of a motion model after Vizzo et al. (2023), "KISS-ICP", doi:10.1109/LRA.2023.3236571, with
    planes in the voxels as in Yuan et al. (2022), "VoxelMap", doi:10.1109/LRA.2022.3187250. Pose and motion during the
    sweep are estimated together (Dellenbach et al. 2022, "CT-ICP", doi:10.1109/ICRA46639.2022.9811849), with the
    guesses as prior information. Where the pose before is known, the motion during the sweep is expected to be its
    share of that since then, so that speeding up and slowing down do not skew the sweep. Rings of a sweep that fall on
    the rings of the one before do not hold it: a voxel without two dimensions of points has no plane.
    """

    Config: ClassVar[type[DfnConfig]] = VoxelPlanesConfig

    def setup(self) -> None:
        """Empty the map; compile the kernels."""
        from cdff_core.dfns.scan_to_map_registration import _kernels, _voxel_table

        self._kernels, self._tables = _kernels, _voxel_table
        self._table = _voxel_table.empty_table(_FIRST_CAPACITY)
        self._compile()

    @property
    def voxels(self) -> int:
        """Voxels of the map."""
        return int(self._table.used[0])

    @property
    def map_bytes(self) -> int:
        """Memory of the map."""
        return sum(column.nbytes for column in self._table)

    def process(self, inputs: ScanToMapRegistrationInputs) -> ScanToMapRegistrationOutputs:
        """Return pose and motion; raises InputError, or RefusedError (no_overlap) when hardly a point is on the map."""
        T = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
        if inputs.surface is not None:
            self._grow(checked_points(inputs.surface, "surface", least=0), T[:3, 3])
        sweep = checked_transform(np.eye(4) if inputs.sweep_guess is None else inputs.sweep_guess, "sweep_guess")
        points = np.zeros((0, 3)) if inputs.points is None else checked_points(inputs.points, "points", least=0)
        fraction = np.zeros(len(points)) if inputs.fraction is None else np.asarray(inputs.fraction, dtype=np.float64)
        if fraction.shape != (len(points),):
            raise InputError(f"fraction {fraction.shape}: expected one for each of {len(points)} points")
        if not len(points):
            return _unmoved(T, sweep)
        kept = self._tables.thinned(points, self.config.points_voxel_m)
        return self._registered(points[kept], fraction[kept], T, sweep, inputs)

    def _registered(
        self, points: Float, fraction: Float, T: Float, sweep: Float, inputs: ScanToMapRegistrationInputs
    ) -> ScanToMapRegistrationOutputs:
        cfg: Any = self.config
        T_first, T = T, T.copy()
        motion = np.concatenate([-sweep[:3, 3], -se3.log_so3(sweep[:3, :3])])
        motion_first = motion.copy()
        prior = _information(inputs.guess_covariance, "guess_covariance")
        prior_sweep = _information(inputs.sweep_covariance, "sweep_covariance")
        prior_sweep += 1e6 * np.eye(6) * (inputs.sweep_covariance is None)
        before, share = _motion_before(inputs)
        kernel, iterations, converged = cfg.first_kernel_m, 0, False
        for _ in range(cfg.max_iterations):
            H, b, sums = self._kernels.normal_equations(
                self._table, cfg.voxel_m, points, fraction, np.ascontiguousarray(T[:3, :3]), T[:3, 3].copy(),
                motion[3:].copy(), motion[:3].copy(), kernel, cfg.noise_m,
            )  # fmt: skip
            if sums[1] < _LEAST_PAIRS:
                raise RefusedError(f"{sums[1]:.0f} of {len(points)} points lie on the map", ["no_overlap"])
            iterations += 1
            rms_m, radius_m = float(np.sqrt(sums[2] / sums[0])), max(float(np.sqrt(sums[3] / sums[0])), 1e-6)
            variance = max(rms_m, cfg.noise_m) ** 2 * cfg.points_per_measurement
            A, g = H / variance, b / variance
            A[:6, :6] += prior
            g[:6] += prior @ _left_error(T_first, T)
            expected, J = (motion_first, np.zeros((6, 6))) if before is None else _share_of_motion(before, T, share)
            to_sweep = np.hstack([-J, np.eye(6)])
            A += to_sweep.T @ prior_sweep @ to_sweep
            g += to_sweep.T @ prior_sweep @ (motion - expected)
            A += _DAMPING * np.trace(A) * np.diag(np.concatenate([np.ones(3), np.full(3, radius_m**2)] * 2)) / 12.0
            x = -np.linalg.solve(A, g)
            T[:3, :3] = se3.normalise_rotation(se3.exp_so3(x[3:6]) @ T[:3, :3])
            T[:3, 3] += x[:3]
            motion += x[6:]
            step_m = float(np.linalg.norm(x[:3]) + radius_m * np.linalg.norm(x[3:6]))
            converged = kernel <= cfg.last_kernel_m and step_m < cfg.tolerance_m
            if converged:
                break
            kernel = max(cfg.last_kernel_m, _ANNEALING * kernel)
        covariance = np.linalg.inv(A)[:6, :6]
        directions, agreement, sigma_m = self._judged(points, fraction, T, motion, radius_m, variance)
        free = directions[sigma_m > cfg.held_sigma_m]
        if len(free):
            T, covariance = _held(T_first, T, free, radius_m, covariance, inputs.guess_covariance)
            motion = motion_first
        sweep = se3.transform(se3.exp_so3(-motion[3:]), -motion[:3])
        return ScanToMapRegistrationOutputs(
            transform=T,
            sweep=sweep,
            covariance=0.5 * (covariance + covariance.T),
            directions=directions,
            agreement=agreement,
            sigma_m=sigma_m,
            radius_m=np.array(radius_m),
            inlier_ratio=np.array(sums[1] / len(points)),
            rms_m=np.array(rms_m),
            iterations=np.array(iterations),
            converged=np.array(converged),
        )

    def _judged(
        self, points: Float, fraction: Float, T: Float, motion: Float, radius_m: float, variance: float
    ) -> tuple[Float, Float, Float]:
        """Directions of the information, what both halves of the map agree on, and the sigma this leaves.

        Of one point a voxel: those that share a plane share its noise, and would count it as ground once more each.
        Of planes that are known: normals through a few points far away, where a map is new, are noise with a long
        lever, which hides what the near ground says of a turn.
        """
        cfg: Any = self.config
        kept = self._tables.thinned(points, cfg.voxel_m)
        points, fraction = points[kept], fraction[kept]
        R = se3.exp_so3(fraction[:, None] * motion[None, 3:])
        still = np.einsum("nij,nj->ni", R, points) + fraction[:, None] * motion[:3]
        H, X, total = self._kernels.shared_information(
            self._table, cfg.voxel_m, still, np.ascontiguousarray(T[:3, :3]), T[:3, 3].copy(), cfg.last_kernel_m,
            cfg.noise_m, radius_m, cfg.known_count,
        )  # fmt: skip
        values, vectors = np.linalg.eigh(H)
        shared = np.einsum("ij,ik,kj->j", vectors, X, vectors)
        agreement = shared / np.maximum(values, 1e-12)
        sigma_m = np.sqrt(variance / np.maximum(shared * total, 1e-12))
        return np.ascontiguousarray(vectors.T), agreement, sigma_m

    def _grow(self, surface: Float, centre: Float) -> None:
        """Add a thinned surface; forget what is far when the table fills, and enlarge it when that is not enough."""
        cfg: Any = self.config
        points = surface[self._tables.thinned(surface, cfg.surface_voxel_m)]
        points = points[np.sum((points - centre) ** 2, axis=1) < cfg.radius_m**2]
        capacity = len(self._table.keys)
        # Each point may open a voxel: room for all is made first, never within the loop.
        if self._table.used[0] + len(points) > _FULLEST * capacity:
            self._rebuilt(capacity, centre)
            if self._table.used[0] + len(points) > _FULLEST * capacity:
                self._rebuilt(2 * capacity, centre)
        self._tables.add(self._table, points, cfg.voxel_m, cfg.full_count)

    def _rebuilt(self, capacity: int, centre: Float) -> None:
        table = self._tables.empty_table(capacity)
        self._tables.moved_over(self._table, table, centre, self.config.radius_m, self.config.voxel_m)
        self._table = table

    def _compile(self) -> None:
        table, one = self._tables.empty_table(16), np.zeros((1, 3))
        self._tables.thinned(one, 1.0)
        self._tables.add(table, one, 1.0, 6)
        self._tables.moved_over(table, self._tables.empty_table(16), np.zeros(3), 1.0, 1.0)
        eye, zero = np.eye(3), np.zeros(3)
        self._kernels.normal_equations(table, 1.0, one, np.zeros(1), eye, zero, zero, zero, 1.0, 1.0)
        self._kernels.shared_information(table, 1.0, one, eye, zero, 1.0, 1.0, 1.0, 12)


def _information(covariance: Float | None, name: str) -> Float:
    if covariance is None:
        return np.zeros((6, 6))
    C = np.asarray(covariance, dtype=np.float64)
    if C.shape != (6, 6) or not np.all(np.isfinite(C)):
        raise InputError(f"{name} {C.shape}: expected 6 by 6 finite values")
    return np.linalg.inv(C)


def _motion_before(inputs: ScanToMapRegistrationInputs) -> tuple[Float | None, float]:
    """Pose before, None where unknown, and the share of the motion since then that is expected of the sweep's."""
    if inputs.before is None or inputs.sweep_share is None:
        return None, 0.0
    share = float(inputs.sweep_share)
    if not 0.0 <= share <= 1.0:
        raise InputError(f"sweep_share {share:g}: expected 0 to 1, a sweep ends before the next one begins")
    return checked_transform(inputs.before, "before"), share


def _share_of_motion(T_before: Float, T: Float, share: float) -> tuple[Float, Float]:
    """Share of the motion since a pose, in axes of the sensor; derivative by shift and turn in axes of the map."""
    R = T[:3, :3]
    J = np.zeros((6, 6))
    J[:3, :3] = J[3:, 3:] = share * R.T
    turn = se3.log_so3(T_before[:3, :3].T @ R)
    return share * np.concatenate([R.T @ (T[:3, 3] - T_before[:3, 3]), turn]), J


def _held(
    T_guess: Float, T: Float, free: Float, radius_m: float, covariance: Float, guess_covariance: Float | None
) -> tuple[Float, Float]:
    """Pose and covariance with what noise did along the free directions undone (Zhang et al. 2016, solution remapping).

    doi:10.1109/ICRA.2016.7487211. Along them the guess and its covariance hold.
    """
    scale = np.concatenate([np.ones(3), np.full(3, radius_m)])
    keep = np.eye(6) - free.T @ free
    off = keep @ (scale * _left_error(T_guess, T))
    R = se3.normalise_rotation(se3.exp_so3(off[3:] / radius_m) @ T_guess[:3, :3])
    held = se3.transform(R, T_guess[:3, 3] + off[:3])
    unsure = np.zeros((6, 6)) if guess_covariance is None else np.asarray(guess_covariance, dtype=np.float64)
    S = np.diag(scale)
    mixed = keep @ S @ covariance @ S @ keep + (np.eye(6) - keep) @ S @ unsure @ S @ (np.eye(6) - keep)
    return held, np.asarray(np.diag(1.0 / scale) @ mixed @ np.diag(1.0 / scale))


def _left_error(T_first: Float, T: Float) -> Float:
    """Shift and turn, in axes of the map, from the first pose to the second."""
    return np.concatenate([T[:3, 3] - T_first[:3, 3], se3.log_so3(T[:3, :3] @ T_first[:3, :3].T)])


def _unmoved(T: Float, sweep: Float) -> ScanToMapRegistrationOutputs:
    """What is said of a sweep without points: the guess, of which nothing is known."""
    zero = np.array(0.0)
    return ScanToMapRegistrationOutputs(
        transform=T, sweep=sweep, covariance=np.full((6, 6), np.nan), directions=np.eye(6), agreement=np.zeros(6),
        sigma_m=np.full(6, np.inf), radius_m=zero, inlier_ratio=zero, rms_m=zero, iterations=np.array(0),
        converged=np.array(False),
    )  # fmt: skip
