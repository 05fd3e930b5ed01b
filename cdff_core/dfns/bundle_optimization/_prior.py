# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What cameras that are gone say of how those that are there lie to one another.

A prior of which nothing was fixed knows neither where everything is nor, of single images, how large. A window that
slides must not learn that from nothing, as it does where the prior's directions are those of earlier poses: G. Huang,
A. Mourikis, S. Roumeliotis (2010), Observability-based rules for designing consistent EKF SLAM estimators,
doi:10.1177/0278364909353640. So the poses are moved onto the prior's as one before they are compared with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import BundleProblem
from cdff_core.dfns.bundle_optimization._motions import ROUNDING, moved_poses, placed, similarity, turn, unheld

Float = NDArray[np.float64]
Int = NDArray[np.int64]
_MOST_STEPS, _LEAST_STEP = 30, 1e-13
#: Share of the largest of a prior's diagonal, of places and of turns, below which columns are not scaled up: rounding
#: in those of poses of which it says nothing would become knowledge.
_LEAST_SHARE = 1e-6
#: In units of the prior's own extent; beyond there is nothing to compare.
_FARTHEST = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Residuals ``root (scale d) + offset``, d the changes x y z rx ry rz of the poses, lengths in units.

    Attributes
    ----------
    cameras : ndarray, shape (k,)
        Their rows.
    T : ndarray, shape (k, 4, 4)
        From which d is counted: ``T_frame_camera`` relative to the centre, in units.
    root, offset, scale : ndarray, shape (r, 6k), (r,), (6k,)
        As many residuals as the prior's matrix has rank; scales of its columns.
    unknown : ndarray, shape (f, 7)
        Motions of everything of which the prior says nothing.
    centre, unit : ndarray, shape (3,), and float
    """

    cameras: Int
    T: Float
    root: Float
    offset: Float
    scale: Float
    unknown: Float
    centre: Float
    unit: float

    @classmethod
    def of(cls, problem: BundleProblem) -> Prior:
        """The problem's prior, of no residuals where there is none.

        Raises InputError where its cameras are in another order or the problem's poses far from its own.
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
        motions = scale[:, None] * moved_poses(T[:, :3, 3])
        unknown = unheld(root.T @ (root @ motions) / np.linalg.norm(motions))
        made = cls(cameras, T, root, offset, scale, unknown, centre, unit)
        if made._torn((problem.cameras.matrices[cameras, :3, 3] - centre) / unit):
            raise InputError("problem: the poses are not near enough to those of its prior")
        return made

    def residuals(self, R: Float, c: Float) -> tuple[Float, Float]:
        """At rotations frame to camera ``(n, 3, 3)``, positions ``(n, 3)``; their slopes ``(r, 6k)`` by poses."""
        if not len(self.cameras):
            return self.offset, self.root
        turns, offsets = np.swapaxes(R[self.cameras], 1, 2), (c[self.cameras] - self.centre) / self.unit
        whole = np.eye(4)
        if self._torn(offsets):  # a step that is tried and left
            return np.full(len(self.root), np.inf), self.root
        before = np.linalg.qr(self.scale[:, None] * moved_poses(self.T[:, :3, 3]) @ self.unknown.T)[0]
        for _ in range(_MOST_STEPS):
            at = placed(whole, offsets)
            turned = se3.log_so3(turn(whole) @ turns @ np.swapaxes(self.T[:, :3, :3], 1, 2))
            d = self.scale * np.column_stack([at - self.T[:, :3, 3], turned]).reshape(-1)
            now = self.scale[:, None] * moved_poses(at) @ self.unknown.T
            to_motion = np.linalg.pinv(before.T @ now) @ before.T
            motion = -self.unknown.T @ to_motion @ d
            if np.abs(motion).max() < _LEAST_STEP:
                break
            whole = similarity(motion) @ whole
        slopes = (self.root - self.root @ now @ to_motion) * self.scale
        slopes = slopes.reshape(len(slopes), -1, 2, 3)
        by_place, by_turn = slopes[:, :, 0] @ whole[:3, :3] / self.unit, slopes[:, :, 1] @ turn(whole)
        return self.root @ d + self.offset, np.stack([by_place, by_turn], axis=2).reshape(len(slopes), -1)

    @staticmethod
    def _torn(offsets: Float) -> bool:
        return not np.abs(offsets - offsets.mean(axis=0)).max() < _FARTHEST

    def holds(self, R: Float, c: Float, centre: Float, unit: float) -> Float:
        """Rows ``(r, 7)`` that are 0 for motions of everything, lengths in units, of which the prior says nothing."""
        motions = moved_poses((c[self.cameras] - centre) / unit) * np.tile([unit] * 3 + [1.0] * 3, len(self.T))[:, None]
        weights = self.scale / np.tile([self.unit] * 3 + [1.0] * 3, len(self.T))
        return np.asarray(self.residuals(R, c)[1] @ motions / np.linalg.norm(weights[:, None] * motions))


def scales(H: Float) -> Float:
    """Roots ``(6k,)`` of a prior's diagonal; of poses of which it says next to nothing a share of the largest."""
    diagonal = np.diag(H).reshape(-1, 2, 3)
    least = _LEAST_SHARE * diagonal.max(axis=(0, 2), keepdims=True)
    return np.sqrt(np.where(least > 0.0, np.maximum(diagonal, least), 1.0)).reshape(-1)
