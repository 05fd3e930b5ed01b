# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gauge of a bundle: the motions of the whole problem that its observations do not constrain.

Observations leave the position and rotation of the whole problem unconstrained and, for single images, its
scale. Fixed cameras, fixed points and the prior reduce this freedom: one fixed camera leaves the scale, one
fixed point scale and rotation, two fixed points the rotation about their line. The minimisation is free;
afterwards all movable parts are moved together along the unconstrained motions, so that the first camera
keeps its pose and the camera farthest from it its distance. Covariances are relative to this gauge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_core.dfns.bundle_optimization._kernels import POSE
from cdff_core.dfns.bundle_optimization._motions import (
    ROUNDING,
    null_motions,
    position_derivatives,
    rotation_of,
    similarity,
    transformed,
)
from cdff_core.dfns.bundle_optimization._system import Estimate, System

_MOST_STEPS, _LEAST_STEP = 30, 1e-14
#: Fixable quantities: rotation of the first camera, logarithm of the largest distance, position.
_ROTATION, _SCALE, _POSITION = slice(0, 3), slice(3, 4), slice(4, 7)


@dataclass(frozen=True, slots=True, eq=False)
class Gauge:
    """Unconstrained motions of the whole problem and the cameras that fix them.

    Attributes
    ----------
    camera, distant : int or None
        Rows of the camera that keeps the unconstrained part of its pose, and of the one that keeps its
        distance.
    free : ndarray, shape (k, 7)
        Unconstrained motions x y z rx ry rz and logarithm of the scale, about ``centre``.
    fixed_combinations : ndarray, shape (k, 7)
        Fixed combinations of the first camera's rotation, the logarithm of the distance, the camera's
        position.
    """

    camera: int | None
    distant: int | None
    free: FloatArray
    fixed_combinations: FloatArray
    centre: FloatArray

    @classmethod
    def of(cls, system: System, first: Estimate) -> Gauge:
        """Return the gauge of a problem."""
        part = np.union1d(system.cam, system.prior.cameras)
        moving = part[system.pose_column[part] >= 0]
        fixed = np.setdiff1d(part, moving)
        camera = int(fixed[0] if len(fixed) else part[0])
        centre = first.c[camera].copy()
        others = moving[moving != camera]
        distances = np.linalg.norm(first.c[others] - centre, axis=1)
        distant = int(others[np.argmax(distances)]) if len(others) and distances.max() > 0.0 else None
        free = _free(system, first, fixed, centre)
        changes, left, fixed_combinations = (
            _changes(np.zeros(3), distant is not None),
            free.T,
            np.zeros((0, 7)),
        )
        for what in (_ROTATION, _SCALE, _POSITION):
            U, values, V = np.linalg.svd(changes[what] @ left)
            rank = int((values > ROUNDING * np.abs(left).max(initial=1.0)).sum())
            rows = np.zeros((rank, 7))
            rows[:, what] = U[:, :rank].T
            fixed_combinations, left = np.concatenate([fixed_combinations, rows]), left @ V[rank:].T
        sized = bool(fixed_combinations[:, _SCALE].any())
        return cls(
            camera if len(fixed_combinations) else None,
            distant if sized else None,
            free,
            fixed_combinations,
            centre,
        )

    @property
    def fixes_pose(self) -> bool:
        """Return whether the first camera keeps its whole pose."""
        return int((self.fixed_combinations[:, _SCALE] == 0.0).sum()) == POSE

    def restored(self, system: System, first: Estimate, found: Estimate) -> Estimate:
        """Return the estimate with all parts that are not fixed moved together into the gauge."""
        if self.camera is None:
            return found
        rows = [self.camera, self.camera if self.distant is None else self.distant]
        (R0, c0), (R, c) = ((e.R[rows[0]], e.c[rows]) for e in (first, found))
        whole = np.eye(4)
        for _ in range(_MOST_STEPS):
            at = self._moved(whole, c)
            gaps = [float(np.linalg.norm(np.diff(x, axis=0))) for x in (c0, at)]
            size = np.log(gaps[1] / gaps[0]) if min(gaps) > 0.0 else 0.0
            off = np.concatenate([se3.log_so3(rotation_of(whole) @ R.T @ R0), [size], at[0] - c0[0]])
            changes = _changes(at[0] - self.centre, self.distant is not None)
            motion = (
                -self.free.T
                @ np.linalg.lstsq(
                    self.fixed_combinations @ changes @ self.free.T, self.fixed_combinations @ off
                )[0]
            )
            whole = similarity(motion) @ whole
            if np.abs(motion).max() < _LEAST_STEP:
                break
        loose, points = system.pose_column >= 0, system.held == 0
        rotations, positions, X = found.R.copy(), found.c.copy(), found.X.copy()
        rotations[loose] = rotations[loose] @ rotation_of(whole).T
        positions[loose], X[points] = self._moved(whole, positions[loose]), self._moved(whole, X[points])
        return replace(found, R=rotations, c=positions, X=X)

    def fixed_directions(self, system: System, estimate: Estimate) -> FloatArray:
        """Return the directions ``(k, size)`` along which covariances relative to the gauge are 0."""
        rows = np.zeros((len(self.fixed_combinations), system.size))
        if self.camera is None:
            return rows
        own = int(system.pose_column[self.camera])
        if own >= 0:
            rows[:, own + 3 : own + 6] = self.fixed_combinations[:, _ROTATION]
            rows[:, own : own + 3] = self.fixed_combinations[:, _POSITION]
        if self.distant is not None:
            offset = estimate.c[self.distant] - estimate.c[self.camera]
            along = self.fixed_combinations[:, _SCALE] * offset / (offset @ offset)
            far = int(system.pose_column[self.distant])
            rows[:, far : far + 3] += along
            if own >= 0:
                rows[:, own : own + 3] -= along
        return rows

    def _moved(self, whole: FloatArray, positions: FloatArray) -> FloatArray:
        return self.centre + transformed(whole, positions - self.centre)


def _changes(offset: FloatArray, sized: bool) -> FloatArray:
    """Return the derivative ``(7, 7)`` of fixable quantities by motions, for a first camera at an offset."""
    changes = np.zeros((7, 7))
    changes[_ROTATION, 3:6] = np.eye(3)
    changes[_SCALE, 6] = float(sized)
    changes[_POSITION] = position_derivatives(offset[None])[0]
    return changes


def _free(system: System, first: Estimate, fixed: IntArray, centre: FloatArray) -> FloatArray:
    """Return the motions ``(k, 7)`` not constrained by fixed cameras and points, prior or baselines."""
    places = (
        np.concatenate([first.c[fixed], first.X[(system.held != 0) & (np.diff(system.start) > 0)]]) - centre
    )
    unit = float(np.linalg.norm(np.concatenate([places, first.c - centre]), axis=1).max()) or 1.0
    rows = [position_derivatives(places / unit).reshape(-1, 7)]
    if len(fixed):
        rows.append(np.eye(7)[3:6])
    if not np.isnan(system.pixels[:, 2]).all():
        rows.append(np.eye(7)[6:])
    if len(system.prior.cameras):
        rows.append(system.prior.holds(first.R, first.c, centre, unit))
    free = null_motions(np.concatenate(rows))
    free[:, :3] *= unit
    return free
