# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What observations leave free: where everything is, and for single images how large it is.

Whatever is fixed takes from that what it holds, and so does a prior. A fixed camera leaves a size, a fixed point a size
and a turn about it, two fixed points a turn about their line. The descent is free; afterwards all that may move is
moved as one along what is left, so that the first camera keeps of its pose what it can and the camera farthest from it
its distance. Covariances are relative to that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_core.dfns.bundle_optimization._kernels import POSE
from cdff_core.dfns.bundle_optimization._motions import ROUNDING, moved_places, placed, similarity, turn, unheld
from cdff_core.dfns.bundle_optimization._system import Estimate, System

Float = NDArray[np.float64]
_MOST_STEPS, _LEAST_STEP = 30, 1e-14
#: What can be held of the first camera: its turn, the logarithm of the farthest one's distance, its place.
_TURN, _SIZE, _PLACE = slice(0, 3), slice(3, 4), slice(4, 7)


@dataclass(frozen=True, slots=True, eq=False)
class Gauge:
    """Motions of everything that cost nothing, and by which cameras they are held.

    Attributes
    ----------
    camera, distant : int or None
        Rows of the camera that keeps of its pose what is free, and of the one that keeps its distance from it.
    free : ndarray, shape (k, 7)
        Motions x y z rx ry rz and logarithm of size, about ``centre``, that move nothing that is held otherwise.
    kept : ndarray, shape (k, 7)
        What is held: combinations of the first camera's turn, the logarithm of the distance, the camera's place.
    """

    camera: int | None
    distant: int | None
    free: Float
    kept: Float
    centre: Float

    @classmethod
    def of(cls, system: System, first: Estimate) -> Gauge:
        """What this problem leaves free."""
        part = np.union1d(system.cam, system.prior.cameras)
        moving = part[system.pose_column[part] >= 0]
        fixed = np.setdiff1d(part, moving)
        camera = int(fixed[0] if len(fixed) else part[0])
        centre = first.c[camera].copy()
        others = moving[moving != camera]
        distances = np.linalg.norm(first.c[others] - centre, axis=1)
        distant = int(others[np.argmax(distances)]) if len(others) and distances.max() > 0.0 else None
        free = _free(system, first, fixed, centre)
        changes, left, kept = _changes(np.zeros(3), distant is not None), free.T, np.zeros((0, 7))
        for what in (_TURN, _SIZE, _PLACE):
            U, values, V = np.linalg.svd(changes[what] @ left)
            rank = int((values > ROUNDING * np.abs(left).max(initial=1.0)).sum())
            rows = np.zeros((rank, 7))
            rows[:, what] = U[:, :rank].T
            kept, left = np.concatenate([kept, rows]), left @ V[rank:].T
        sized = bool(kept[:, _SIZE].any())
        return cls(camera if len(kept) else None, distant if sized else None, free, kept, centre)

    @property
    def holds_pose(self) -> bool:
        """Whether the first camera keeps its whole pose."""
        return int((self.kept[:, _SIZE] == 0.0).sum()) == POSE

    def restored(self, system: System, first: Estimate, found: Estimate) -> Estimate:
        """The estimate, all of it that is not fixed moved as one so that it keeps what the gauge says."""
        if self.camera is None:
            return found
        rows = [self.camera, self.camera if self.distant is None else self.distant]
        (R0, c0), (R, c) = ((e.R[rows[0]], e.c[rows]) for e in (first, found))
        whole = np.eye(4)
        for _ in range(_MOST_STEPS):
            at = self._moved(whole, c)
            gaps = [float(np.linalg.norm(np.diff(x, axis=0))) for x in (c0, at)]
            size = np.log(gaps[1] / gaps[0]) if min(gaps) > 0.0 else 0.0
            off = np.concatenate([se3.log_so3(turn(whole) @ R.T @ R0), [size], at[0] - c0[0]])
            changes = _changes(at[0] - self.centre, self.distant is not None)
            motion = -self.free.T @ np.linalg.lstsq(self.kept @ changes @ self.free.T, self.kept @ off)[0]
            whole = similarity(motion) @ whole
            if np.abs(motion).max() < _LEAST_STEP:
                break
        loose, points = system.pose_column >= 0, system.held == 0
        rotations, positions, X = found.R.copy(), found.c.copy(), found.X.copy()
        rotations[loose] = rotations[loose] @ turn(whole).T
        positions[loose], X[points] = self._moved(whole, positions[loose]), self._moved(whole, X[points])
        return replace(found, R=rotations, c=positions, X=X)

    def held_directions(self, system: System, estimate: Estimate) -> Float:
        """Directions ``(k, size)`` in which nothing may move for covariances to be relative to this gauge."""
        rows = np.zeros((len(self.kept), system.size))
        if self.camera is None:
            return rows
        own = int(system.pose_column[self.camera])
        if own >= 0:
            rows[:, own + 3 : own + 6] = self.kept[:, _TURN]
            rows[:, own : own + 3] = self.kept[:, _PLACE]
        if self.distant is not None:
            offset = estimate.c[self.distant] - estimate.c[self.camera]
            along = self.kept[:, _SIZE] * offset / (offset @ offset)
            far = int(system.pose_column[self.distant])
            rows[:, far : far + 3] += along
            if own >= 0:
                rows[:, own : own + 3] -= along
        return rows

    def _moved(self, whole: Float, positions: Float) -> Float:
        return self.centre + placed(whole, positions - self.centre)


def _changes(offset: Float, sized: bool) -> Float:
    """How what can be held changes ``(7, 7)`` with each motion, the first camera lying at an offset from the centre."""
    changes = np.zeros((7, 7))
    changes[_TURN, 3:6] = np.eye(3)
    changes[_SIZE, 6] = float(sized)
    changes[_PLACE] = moved_places(offset[None])[0]
    return changes


def _free(system: System, first: Estimate, fixed: NDArray[np.int64], centre: Float) -> Float:
    """Motions ``(k, 7)`` that move no fixed camera, no fixed point, and nothing that the prior or a baseline holds."""
    places = np.concatenate([first.c[fixed], first.X[(system.held != 0) & (np.diff(system.start) > 0)]]) - centre
    unit = float(np.linalg.norm(np.concatenate([places, first.c - centre]), axis=1).max()) or 1.0
    rows = [moved_places(places / unit).reshape(-1, 7)]
    if len(fixed):
        rows.append(np.eye(7)[3:6])
    if not np.isnan(system.pixels[:, 2]).all():
        rows.append(np.eye(7)[6:])
    if len(system.prior.cameras):
        rows.append(system.prior.holds(first.R, first.c, centre, unit))
    free = unheld(np.concatenate(rows))
    free[:, :3] *= unit
    return free
