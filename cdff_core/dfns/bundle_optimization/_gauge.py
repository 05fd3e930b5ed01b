# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gauge of a bundle: the motions of the whole problem that its observations do not constrain.

Observations do not constrain the position and rotation of the whole problem nor, for single images, its
scale. Fixed cameras, fixed points and the prior reduce the number of unconstrained motions: with one fixed
camera the scale remains, with one fixed point scale and rotation, with two fixed points the rotation about
the line through them. The minimisation ignores the gauge. Afterwards all cameras and points that are not
fixed are moved together by an unconstrained motion, so that the first camera keeps its initial pose and the
camera farthest from it its initial distance. Covariances are relative to this gauge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_core.dfns.bundle_optimization._kernels import POSE
from cdff_core.dfns.bundle_optimization._motions import (
    ROUNDING,
    exp_similarity,
    null_motions,
    position_derivatives,
    rotation_of,
    transform_offsets,
)
from cdff_core.dfns.bundle_optimization._system import Estimate, System

#: Limits of the Gauss-Newton iteration: number of steps, and step at convergence.
_MAX_STEPS, _CONVERGED_STEP = 30, 1e-14
#: Quantities that the gauge can fix: rotation of the first camera, logarithm of its distance from the distant
#: camera, position of the first camera.
_ROTATION, _SCALE, _POSITION = slice(0, 3), slice(3, 4), slice(4, 7)


@dataclass(frozen=True, slots=True, eq=False)
class Gauge:
    """Unconstrained motions of the whole problem and the cameras that fix them.

    Attributes
    ----------
    camera : int or None
        Row of the first camera, which keeps the unconstrained components of its pose; None without
        unconstrained motions.
    distant : int or None
        Row of the camera that keeps its distance from the first; None if the scale is constrained.
    free : ndarray, shape (k, 7)
        Basis of the unconstrained motions about ``centre``.
    fixed_combinations : ndarray, shape (k, 7)
        Linear combinations of the first camera's rotation, the logarithm of the distance and the first
        camera's position that the gauge fixes, one for each unconstrained motion.
    centre : ndarray, shape (3,)
        Initial position of the first camera.
    """

    camera: int | None
    distant: int | None
    free: FloatArray
    fixed_combinations: FloatArray
    centre: FloatArray

    @classmethod
    def of(cls, system: System, initial: Estimate) -> Gauge:
        """Return the gauge of a problem at its initial estimate."""
        constrained_cameras = np.union1d(system.cam, system.prior.cameras)
        adjusted = constrained_cameras[system.pose_column[constrained_cameras] >= 0]
        fixed = np.setdiff1d(constrained_cameras, adjusted)
        camera = int(fixed[0] if len(fixed) else constrained_cameras[0])
        centre = initial.c[camera].copy()
        others = adjusted[adjusted != camera]
        distances = np.linalg.norm(initial.c[others] - centre, axis=1)
        distant = int(others[np.argmax(distances)]) if len(others) and distances.max() > 0.0 else None
        unconstrained = _unconstrained_motions(system, initial, fixed, centre)
        derivatives = _quantity_derivatives(np.zeros(3), has_distance=distant is not None)
        remaining_motions, fixed_combinations = unconstrained.T, np.zeros((0, 7))
        for quantity in (_ROTATION, _SCALE, _POSITION):
            U, values, V = np.linalg.svd(derivatives[quantity] @ remaining_motions)
            rank = int((values > ROUNDING * np.abs(remaining_motions).max(initial=1.0)).sum())
            rows = np.zeros((rank, 7))
            rows[:, quantity] = U[:, :rank].T
            fixed_combinations = np.concatenate([fixed_combinations, rows])
            remaining_motions = remaining_motions @ V[rank:].T
        fixes_scale = bool(fixed_combinations[:, _SCALE].any())
        return cls(
            camera=camera if len(fixed_combinations) else None,
            distant=distant if fixes_scale else None,
            free=unconstrained,
            fixed_combinations=fixed_combinations,
            centre=centre,
        )

    @property
    def fixes_pose(self) -> bool:
        """Return whether the gauge fixes all six components of the first camera's pose."""
        return int((self.fixed_combinations[:, _SCALE] == 0.0).sum()) == POSE

    def restore(self, system: System, initial: Estimate, estimate: Estimate) -> Estimate:
        """Return the estimate after the motion that restores the initial values of the fixed quantities."""
        if self.camera is None:
            return estimate
        rows = [self.camera, self.camera if self.distant is None else self.distant]
        (R0, c0), (R, c) = ((e.R[rows[0]], e.c[rows]) for e in (initial, estimate))
        similarity = np.eye(4)
        for _ in range(_MAX_STEPS):
            positions = self._transform(similarity, c)
            distances = [float(np.linalg.norm(np.diff(x, axis=0))) for x in (c0, positions)]
            log_ratio = np.log(distances[1] / distances[0]) if min(distances) > 0.0 else 0.0
            rotation = se3.log_so3(rotation_of(similarity) @ R.T @ R0)
            deviation = np.concatenate([rotation, [log_ratio], positions[0] - c0[0]])
            derivatives = _quantity_derivatives(positions[0] - self.centre, self.distant is not None)
            J = self.fixed_combinations @ derivatives @ self.free.T
            motion = -self.free.T @ np.linalg.lstsq(J, self.fixed_combinations @ deviation)[0]
            similarity = exp_similarity(motion) @ similarity
            if np.abs(motion).max() < _CONVERGED_STEP:
                break
        is_adjusted, is_point_adjusted = system.pose_column >= 0, system.point_fixed == 0
        R_all, c_all, X = estimate.R.copy(), estimate.c.copy(), estimate.X.copy()
        R_all[is_adjusted] = R_all[is_adjusted] @ rotation_of(similarity).T
        c_all[is_adjusted] = self._transform(similarity, c_all[is_adjusted])
        X[is_point_adjusted] = self._transform(similarity, X[is_point_adjusted])
        return replace(estimate, R=R_all, c=c_all, X=X)

    def zero_variance_directions(self, system: System, estimate: Estimate) -> FloatArray:
        """Return the directions ``(k, size)`` of steps in which the variance relative to the gauge is 0."""
        rows = np.zeros((len(self.fixed_combinations), system.size))
        if self.camera is None:
            return rows
        camera_column = int(system.pose_column[self.camera])
        if camera_column >= 0:
            rows[:, camera_column + 3 : camera_column + 6] = self.fixed_combinations[:, _ROTATION]
            rows[:, camera_column : camera_column + 3] = self.fixed_combinations[:, _POSITION]
        if self.distant is not None:
            offset = estimate.c[self.distant] - estimate.c[self.camera]
            along = self.fixed_combinations[:, _SCALE] * offset / (offset @ offset)
            distant_column = int(system.pose_column[self.distant])
            rows[:, distant_column : distant_column + 3] += along
            if camera_column >= 0:
                rows[:, camera_column : camera_column + 3] -= along
        return rows

    def _transform(self, similarity: FloatArray, positions: FloatArray) -> FloatArray:
        return self.centre + transform_offsets(similarity, positions - self.centre)


def _quantity_derivatives(offset: FloatArray, has_distance: bool) -> FloatArray:
    """Return the derivative ``(7, 7)`` of rotation, log distance and position with respect to a motion.

    ``offset`` is that of the first camera from the centre.
    """
    derivatives = np.zeros((7, 7))
    derivatives[_ROTATION, 3:6] = np.eye(3)
    derivatives[_SCALE, 6] = float(has_distance)
    derivatives[_POSITION] = position_derivatives(offset[None])[0]
    return derivatives


def _unconstrained_motions(
    system: System, initial: Estimate, fixed: IntArray, centre: FloatArray
) -> FloatArray:
    """Return a basis ``(k, 7)`` of the unconstrained motions.

    Constraints are fixed cameras and points, the prior and the baselines of rectified pairs.
    """
    is_fixed_point = (system.point_fixed != 0) & (np.diff(system.start) > 0)
    fixed_positions = np.concatenate([initial.c[fixed], initial.X[is_fixed_point]]) - centre
    unit = float(np.linalg.norm(np.concatenate([fixed_positions, initial.c - centre]), axis=1).max()) or 1.0
    constraints = [position_derivatives(fixed_positions / unit).reshape(-1, 7)]
    if len(fixed):
        constraints.append(np.eye(7)[3:6])
    if not np.isnan(system.pixels[:, 2]).all():
        constraints.append(np.eye(7)[6:])
    if len(system.prior.cameras):
        constraints.append(system.prior.constraint_rows(initial.R, initial.c, centre, unit))
    free = null_motions(np.concatenate(constraints))
    free[:, :3] *= unit
    return free
