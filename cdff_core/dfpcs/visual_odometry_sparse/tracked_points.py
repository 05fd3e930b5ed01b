# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points of a keyframe that were tracked to an image, and the area of those that were lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_core.dfns.features_prediction_2d.interface import FeaturesPrediction2DOutputs
from cdff_core.dfpcs.visual_odometry_sparse.keyframe import Keyframe
from cdff_core.stereo_odometry.motion_hypotheses import SelectedMotion, cells_of

#: Change of the position, pixels, and of the disparity, relative to it, below which a point has the same
#: appearance.
_STILL_PX, _STILL_RATIO = 10.0, 0.1
#: Number of cells with found points below which the ratio of lost cells is not meaningful.
_MIN_CELLS = 10


@dataclass(frozen=True, slots=True, eq=False)
class TrackedPoints:
    """Points of a keyframe that were tracked to an image; a point can have several positions."""

    points: IntArray  # (n,), rows of the keyframe
    matches: FloatArray  # (n, 2), columns and rows in the image, pixels
    visible: int  # number of points predicted inside the image

    @classmethod
    def merged(cls, parts: Sequence[TrackedPoints]) -> TrackedPoints:
        """Return the union of several results; positions of a point that agree to 0.5 px are merged."""
        points = np.concatenate([part.points for part in parts])
        matches = np.concatenate([part.matches for part in parts])
        rows = np.column_stack([points, np.rint(2.0 * matches)])
        first = np.sort(np.unique(rows, axis=0, return_index=True)[1])
        return cls(points[first], matches[first], max(part.visible for part in parts))

    def first_of_each(self, selected: BoolArray) -> IntArray:
        """Return the rows (k,) that a mask (n,) selects; of several rows with the same keyframe point only
        the first.
        """
        rows = np.flatnonzero(selected)
        return rows[np.sort(np.unique(self.points[rows], return_index=True)[1])]

    @property
    def count(self) -> int:
        """Number of points of the keyframe that were tracked."""
        return len(np.unique(self.points))

    def count_others(self, motion: SelectedMotion) -> int:
        """Return the number of points that agree with competing motions only."""
        return len(np.setdiff1d(self.points[motion.other_inliers], self.points[motion.scene.inliers]))

    def count_scene(self, motion: SelectedMotion) -> int:
        """Return the number of tracked points that may belong to the scene."""
        return self.count - self.count_others(motion)


@dataclass(frozen=True, slots=True, eq=False)
class LostPoints:
    """Points of a keyframe that a motion predicts in the image, and which of them were not found there."""

    pixels: FloatArray  # (n, 2), predicted pixels of all points
    is_found: BoolArray  # (n,), agree with the motion of the scene or a competing one
    is_lost: BoolArray  # (n,), predicted inside the image and not found
    is_still: BoolArray  # (n,), have almost the same pixel and distance as in the keyframe

    @classmethod
    def of_motion(
        cls,
        keyframe: Keyframe,
        prediction: FeaturesPrediction2DOutputs,
        tracked: TrackedPoints,
        motion: SelectedMotion,
    ) -> LostPoints:
        """Return the points given their prediction by the motion of the scene."""
        is_found = np.zeros(len(keyframe.points), bool)
        is_found[tracked.points[motion.scene.inliers | motion.other_inliers]] = True
        moved_px = np.hypot(*(prediction.features - keyframe.features).T)
        change = np.abs(prediction.disparities - keyframe.disparities)
        is_still = (moved_px < _STILL_PX) & (change < _STILL_RATIO * keyframe.disparities)
        return cls(
            prediction.features, is_found & prediction.visible, prediction.visible & ~is_found, is_still
        )

    def ratio(self, shape: tuple[int, ...], *, only_still: bool = False) -> float:
        """Return the number of cells of the image with lost points only, divided by that with found points.

        With ``only_still``, only of the points that hardly move: they are lost only if they are hidden, or if
        the motion is wrong. 0 if there are too few of them.
        """
        is_counted = self.is_still if only_still else np.ones_like(self.is_still)
        cells_with_matches = cells_of(self.pixels[self.is_found & is_counted], shape)
        cells_with_losses_only = np.setdiff1d(
            cells_of(self.pixels[self.is_lost & is_counted], shape), cells_with_matches
        )
        return (
            len(cells_with_losses_only) / len(cells_with_matches)
            if len(cells_with_matches) >= _MIN_CELLS
            else 0.0
        )
