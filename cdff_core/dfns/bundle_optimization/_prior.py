# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prior on the relative poses of the remaining cameras, from marginalised cameras.

A prior from cameras without a fixed one does not constrain position and rotation of the whole problem nor,
for single images, its scale. Linearisation at earlier poses must not introduce such spurious information
[1]_, so the current poses are first aligned with those of the prior and then compared with them.

References
----------
.. [1] G. Huang, A. Mourikis, S. Roumeliotis (2010), Observability-based rules for designing consistent EKF
   SLAM
   estimators, doi:10.1177/0278364909353640
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
    null_motions,
    pose_derivatives,
    rotation_of,
    similarity,
    transformed,
)

_MOST_STEPS, _LEAST_STEP = 30, 1e-13
#: Lower bound of column scales relative to the largest, for positions and rotations: rounding noise in
#: columns of
#: unconstrained poses must not be scaled up.
_LEAST_SHARE = 1e-6
#: Largest distance for a comparison of poses, in units of the extent of the prior.
_FARTHEST = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Residuals ``root (scale d) + offset``, d the changes x y z rx ry rz of the poses, lengths in units.

    Attributes
    ----------
    cameras : ndarray, shape (k,)
        Rows of the cameras.
    T : ndarray, shape (k, 4, 4)
        Linearisation point of d: ``T_frame_camera`` relative to the centre, in units.
    root, offset, scale : ndarray, shape (r, 6k), (r,), (6k,)
        As many residuals as the rank of the prior's matrix; scales of its columns.
    unknown : ndarray, shape (f, 7)
        Motions of the whole problem that the prior does not constrain.
    centre, unit : ndarray, shape (3,), and float
    """

    cameras: IntArray
    T: FloatArray
    root: FloatArray
    offset: FloatArray
    scale: FloatArray
    unknown: FloatArray
    centre: FloatArray
    unit: float

    @classmethod
    def of(cls, problem: BundleProblem) -> Prior:
        """Return the prior of a problem, with no residuals where it has none.

        Raises InputError if the cameras are in another order or the poses are far from those of the prior.
        """
        given, T = problem.prior, problem.prior.matrices.copy()
        rows = {int(identity): row for row, identity in enumerate(problem.cameras.ids)}
        cameras = np.array([rows[int(i)] for i in given.cameras], np.int64)
        if not len(cameras):
            nothing = np.zeros(0)
            return cls(cameras, T, np.zeros((0, 0)), nothing, nothing, np.zeros((0, 7)), np.zeros(3), 1.0)
        if (np.diff(cameras) < 0).any():
            raise InputError("problem: expected the prior's cameras in the order of the problem's")
        centre = T[:, :3, 3].mean(axis=0)
        unit = float(np.linalg.norm(T[:, :3, 3] - centre, axis=1).max()) or 1.0
        T[:, :3, 3] = (T[:, :3, 3] - centre) / unit
        lengths = np.tile([unit] * 3 + [1.0] * 3, len(T))
        H, b = given.matrix * np.outer(lengths, lengths), given.gradient * lengths
        scale = scales(H)
        values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
        known = values > ROUNDING * values.max()
        values, vectors = values[known], vectors[:, known]
        root, offset = np.sqrt(values)[:, None] * vectors.T, vectors.T @ (b / scale) / np.sqrt(values)
        motions = scale[:, None] * pose_derivatives(T[:, :3, 3])
        unknown = null_motions(root.T @ (root @ motions) / np.linalg.norm(motions))
        made = cls(cameras, T, root, offset, scale, unknown, centre, unit)
        if made._torn((problem.cameras.matrices[cameras, :3, 3] - centre) / unit):
            raise InputError("problem: the poses are too far from those of its prior")
        return made

    def residuals(self, R: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals and derivatives ``(r, 6k)`` by poses, at rotations and positions."""
        if not len(self.cameras):
            return self.offset, self.root
        turns, offsets = np.swapaxes(R[self.cameras], 1, 2), (c[self.cameras] - self.centre) / self.unit
        whole = np.eye(4)
        if self._torn(offsets):  # a rejected trial step
            return np.full(len(self.root), np.inf), self.root
        before = np.linalg.qr(self.scale[:, None] * pose_derivatives(self.T[:, :3, 3]) @ self.unknown.T)[0]
        for _ in range(_MOST_STEPS):
            at = transformed(whole, offsets)
            turned = se3.log_so3(rotation_of(whole) @ turns @ np.swapaxes(self.T[:, :3, :3], 1, 2))
            d = self.scale * np.column_stack([at - self.T[:, :3, 3], turned]).reshape(-1)
            now = self.scale[:, None] * pose_derivatives(at) @ self.unknown.T
            to_motion = np.linalg.pinv(before.T @ now) @ before.T
            motion = -self.unknown.T @ to_motion @ d
            if np.abs(motion).max() < _LEAST_STEP:
                break
            whole = similarity(motion) @ whole
        slopes = (self.root - self.root @ now @ to_motion) * self.scale
        slopes = slopes.reshape(len(slopes), -1, 2, 3)
        by_place, by_turn = slopes[:, :, 0] @ whole[:3, :3] / self.unit, slopes[:, :, 1] @ rotation_of(whole)
        return self.root @ d + self.offset, np.stack([by_place, by_turn], axis=2).reshape(len(slopes), -1)

    @staticmethod
    def _torn(offsets: FloatArray) -> bool:
        return not np.abs(offsets - offsets.mean(axis=0)).max() < _FARTHEST

    def holds(self, R: FloatArray, c: FloatArray, centre: FloatArray, unit: float) -> FloatArray:
        """Return rows ``(r, 7)`` that are 0 for motions that the prior does not constrain."""
        motions = (
            pose_derivatives((c[self.cameras] - centre) / unit)
            * np.tile([unit] * 3 + [1.0] * 3, len(self.T))[:, None]
        )
        weights = self.scale / np.tile([self.unit] * 3 + [1.0] * 3, len(self.T))
        return np.asarray(self.residuals(R, c)[1] @ motions / np.linalg.norm(weights[:, None] * motions))


def scales(H: FloatArray) -> FloatArray:
    """Return the roots ``(6k,)`` of a prior's diagonal, bounded for almost unconstrained poses."""
    diagonal = np.diag(H).reshape(-1, 2, 3)
    least = _LEAST_SHARE * diagonal.max(axis=(0, 2), keepdims=True)
    return np.sqrt(np.where(least > 0.0, np.maximum(diagonal, least), 1.0)).reshape(-1)
