# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What observations leave free: where everything is, and for single images how large it is.

The descent is free; afterwards the whole is moved as one so that the first camera has the pose it had, and for single
images the camera farthest from it the distance it had. Covariances are relative to that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cdff_core.dfns.bundle_optimization._kernels import POSE
from cdff_core.dfns.bundle_optimization._system import Estimate, System

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Gauge:
    """Rows of the camera that keeps its pose and of the one that keeps its distance; None where nothing is free."""

    camera: int | None
    distant: int | None

    @classmethod
    def of(cls, system: System, first: Estimate) -> Gauge:
        """What this problem leaves free."""
        fixed = np.flatnonzero(system.pose_column < 0)
        if len(system.prior_columns) or len(fixed) >= 2 or system.held.sum() >= 3:
            return cls(None, None)
        camera = int(fixed[0]) if len(fixed) else int(system.cam[0])
        moving = np.flatnonzero(system.pose_column >= 0)
        moving = moving[moving != camera]
        is_mono = bool(np.isnan(system.pixels[:, 2]).all())
        if not is_mono or not len(moving):
            return cls(None if len(fixed) else camera, None)
        distances = np.linalg.norm(first.c[moving] - first.c[camera], axis=1)
        return cls(camera, int(moving[np.argmax(distances)]) if distances.max() > 0.0 else None)

    def restored(self, first: Estimate, found: Estimate) -> Estimate:
        """The estimate moved, turned and scaled as a whole so that it keeps what the gauge says."""
        if self.camera is None:
            return found
        i, scale = self.camera, 1.0
        if self.distant is not None:
            before, after = (float(np.linalg.norm(e.c[self.distant] - e.c[i])) for e in (first, found))
            scale = before / after if after > 0.0 else 1.0
        turn = first.R[i].T @ found.R[i]

        def moved(points: Float) -> Float:
            return np.asarray(first.c[i] + scale * (points - found.c[i]) @ turn.T)

        return replace(found, R=found.R @ turn.T, c=moved(found.c), X=moved(found.X))

    def held_directions(self, system: System, estimate: Estimate) -> Float:
        """Directions ``(k, size)`` in which nothing may move for covariances to be relative to this gauge."""
        rows = []
        if self.camera is not None and system.pose_column[self.camera] >= 0:
            rows += [_unit(system.size, int(system.pose_column[self.camera]) + j) for j in range(POSE)]
        if self.camera is not None and self.distant is not None:
            along = np.zeros(system.size)
            offset = estimate.c[self.distant] - estimate.c[self.camera]
            column = int(system.pose_column[self.distant])
            along[column : column + 3] = offset / np.linalg.norm(offset)
            rows.append(along)
        return np.array(rows).reshape(-1, system.size)


def _unit(size: int, column: int) -> Float:
    e = np.zeros(size)
    e[column] = 1.0
    return e
