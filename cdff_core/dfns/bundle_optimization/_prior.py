# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prior on the relative poses of the remaining cameras, from marginalised cameras.

Without fixed cameras or points, a prior does not constrain position and rotation of the whole problem nor,
for single images, its scale. A linearisation at earlier poses must not add spurious information about them
[1]_. Therefore the current poses are aligned with those of the prior before both are compared.

References
----------
.. [1] G. Huang, A. Mourikis, S. Roumeliotis (2010), Observability-based rules for designing consistent EKF
   SLAM estimators, doi:10.1177/0278364909353640
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import BundleProblem
from cdff_core.dfns.bundle_optimization._motions import (
    ROUNDING,
    exp_similarity,
    null_motions,
    pose_derivatives,
    rotation_of,
    transform_offsets,
)

#: Limits of the Gauss-Newton iteration: number of steps, and step at convergence.
_MAX_STEPS, _CONVERGED_STEP = 30, 1e-13
#: Lower bound of the diagonal of a prior relative to its largest element, for positions and for rotations:
#: rounding noise in the columns of almost unconstrained poses must not be scaled up.
_MIN_DIAGONAL_RATIO = 1e-6
#: Largest distance of a camera from the mean position at which poses are compared with the prior, in units.
_MAX_DISTANCE_UNITS = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Prior with the residuals ``root (scale d) + offset``.

    d ``(6k,)`` are the changes x y z rx ry rz of the poses since the linearisation. Lengths are divided by
    ``unit`` for numerical stability.

    Attributes
    ----------
    cameras : ndarray, shape (k,)
        Rows of the cameras in the problem.
    T : ndarray, shape (k, 4, 4)
        Linearisation point: ``T_frame_camera`` relative to the centre, in units.
    root, offset, scale : ndarray, shape (r, 6k), (r,), (6k,)
        The number of residuals r is the rank of the prior's matrix; ``scale`` holds the scales of its
        columns.
    unconstrained : ndarray, shape (f, 7)
        Motions of the whole problem that the prior does not constrain.
    centre, unit : ndarray, shape (3,), and float
        Mean position of the cameras at the linearisation, and the largest distance from it, metres.
    """

    cameras: IntArray
    T: FloatArray
    root: FloatArray
    offset: FloatArray
    scale: FloatArray
    unconstrained: FloatArray
    centre: FloatArray
    unit: float

    @classmethod
    def of(cls, problem: BundleProblem) -> Prior:
        """Return the prior of a problem; it has no residuals if the problem has no prior.

        Raises InputError if the cameras are in another order or the poses are far from those of the prior.
        """
        prior, T = problem.prior, problem.prior.matrices.copy()
        row_of_id = {int(camera_id): row for row, camera_id in enumerate(problem.cameras.ids)}
        cameras = np.array([row_of_id[int(i)] for i in prior.cameras], np.int64)
        if not len(cameras):
            empty = np.zeros(0)
            return cls(
                cameras=cameras,
                T=T,
                root=np.zeros((0, 0)),
                offset=empty,
                scale=empty,
                unconstrained=np.zeros((0, 7)),
                centre=np.zeros(3),
                unit=1.0,
            )
        if (np.diff(cameras) < 0).any():
            raise InputError("problem: expected the prior's cameras in the order of the problem's")
        centre = T[:, :3, 3].mean(axis=0)
        unit = float(np.linalg.norm(T[:, :3, 3] - centre, axis=1).max()) or 1.0
        T[:, :3, 3] = (T[:, :3, 3] - centre) / unit
        units = np.tile([unit] * 3 + [1.0] * 3, len(T))
        H, b = prior.matrix * np.outer(units, units), prior.gradient * units
        scale = scales(H)
        values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
        is_constrained = values > ROUNDING * values.max()
        values, vectors = values[is_constrained], vectors[:, is_constrained]
        root, offset = np.sqrt(values)[:, None] * vectors.T, vectors.T @ (b / scale) / np.sqrt(values)
        motions = scale[:, None] * pose_derivatives(T[:, :3, 3])
        unconstrained = null_motions(root.T @ (root @ motions) / np.linalg.norm(motions))
        result = cls(
            cameras=cameras,
            T=T,
            root=root,
            offset=offset,
            scale=scale,
            unconstrained=unconstrained,
            centre=centre,
            unit=unit,
        )
        if result._is_too_far((problem.cameras.matrices[cameras, :3, 3] - centre) / unit):
            raise InputError("problem: the poses are too far from those of its prior")
        return result

    def residuals(self, R_camera_frame: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals ``(r,)`` and their derivatives ``(r, 6k)`` with respect to the poses.

        ``R_camera_frame`` and ``c`` are the rotations and positions of all cameras of the problem, as in
        ``Estimate``. The residuals are infinite if a camera is too far from the others.
        """
        if not len(self.cameras):
            return self.offset, self.root
        rotations, offsets = (
            np.swapaxes(R_camera_frame[self.cameras], 1, 2),
            (c[self.cameras] - self.centre) / self.unit,
        )
        similarity = np.eye(4)
        if self._is_too_far(offsets):
            # An infinite cost makes the minimiser reject the step.
            return np.full(len(self.root), np.inf), self.root
        prior_basis = np.linalg.qr(
            self.scale[:, None] * pose_derivatives(self.T[:, :3, 3]) @ self.unconstrained.T
        )[0]
        for _ in range(_MAX_STEPS):
            positions = transform_offsets(similarity, offsets)
            rotation_changes = se3.log_so3(
                rotation_of(similarity) @ rotations @ np.swapaxes(self.T[:, :3, :3], 1, 2)
            )
            d = self.scale * np.column_stack([positions - self.T[:, :3, 3], rotation_changes]).reshape(-1)
            current_basis = self.scale[:, None] * pose_derivatives(positions) @ self.unconstrained.T
            to_motion = np.linalg.pinv(prior_basis.T @ current_basis) @ prior_basis.T
            motion = -self.unconstrained.T @ to_motion @ d
            if np.abs(motion).max() < _CONVERGED_STEP:
                break
            similarity = exp_similarity(motion) @ similarity
        derivatives = (self.root - self.root @ current_basis @ to_motion) * self.scale
        derivatives = derivatives.reshape(len(derivatives), -1, 2, 3)
        by_position = derivatives[:, :, 0] @ similarity[:3, :3] / self.unit
        by_rotation = derivatives[:, :, 1] @ rotation_of(similarity)
        by_pose = np.stack([by_position, by_rotation], axis=2).reshape(len(derivatives), -1)
        return self.root @ d + self.offset, by_pose

    @staticmethod
    def _is_too_far(offsets: FloatArray) -> bool:
        """Return whether offsets are too far from their mean, or NaN."""
        return not np.abs(offsets - offsets.mean(axis=0)).max() < _MAX_DISTANCE_UNITS

    def constraint_rows(
        self, R_camera_frame: FloatArray, c: FloatArray, centre: FloatArray, unit: float
    ) -> FloatArray:
        """Return rows ``(r, 7)`` whose product with a motion is 0 if the prior does not constrain the motion.

        The motions are about ``centre``, with lengths in units of ``unit``.
        """
        motions = (
            pose_derivatives((c[self.cameras] - centre) / unit)
            * np.tile([unit] * 3 + [1.0] * 3, len(self.T))[:, None]
        )
        weights = self.scale / np.tile([self.unit] * 3 + [1.0] * 3, len(self.T))
        return np.asarray(
            self.residuals(R_camera_frame, c)[1] @ motions / np.linalg.norm(weights[:, None] * motions)
        )


def scales(H: FloatArray) -> FloatArray:
    """Return the square roots ``(6k,)`` of the diagonal of a prior, bounded from below."""
    diagonal = np.diag(H).reshape(-1, 2, 3)
    minimum = _MIN_DIAGONAL_RATIO * diagonal.max(axis=(0, 2), keepdims=True)
    return np.sqrt(np.where(minimum > 0.0, np.maximum(diagonal, minimum), 1.0)).reshape(-1)
