# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motions that competed with the selected one at the last view: prediction and doubt for the next view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cdff_common.arrays import BoolArray
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.stereo_odometry.motion_hypotheses import Hypothesis, SelectedMotion, extent_of

#: Ratio of the extent of the points that agree with a motion to the extent of all visible points, above
#: which the motion surrounds its competitors. The ratio is 1 for the scene around an object.
_SURROUNDING = 0.9


class CompetingMotions:
    """Competing motions of the last view; they are assumed to continue at constant velocity.

    Their points are not found near the pixels that the selected motion predicts: without their own prediction
    they would be lost at the next view. If the selection was ambiguous, it remains so until the selected
    motion surrounds the others, because an object that hides more and more of the image is not the scene.
    """

    def __init__(self) -> None:
        self._twists: list[FloatArray] = []
        self._ambiguity = 0.0

    def predict(self, elapsed_s: float) -> list[FloatArray]:
        """Return ``T_current_keyframe`` (4, 4) of each motion, a time after the keyframe."""
        return [se3.exp_se3(elapsed_s * twist) for twist in self._twists]

    def update(
        self,
        motion: SelectedMotion,
        pixels: FloatArray,
        visible: BoolArray,
        agreeing: BoolArray,
        elapsed_s: float,
    ) -> SelectedMotion:
        """Return the selection, uncertain also if that of the last view was; store it for the next view.

        Parameters
        ----------
        motion : SelectedMotion
            Selection at a view.
        pixels : array, shape (n, 2)
            Pixels of the points in the keyframe.
        visible, agreeing : array of bool, shape (n,)
            Points visible in the view, and those that agree with the selected motion.
        elapsed_s : float
            Time since the keyframe.
        """
        surrounds = extent_of(pixels[agreeing], (1, 1)) > _SURROUNDING * extent_of(pixels[visible], (1, 1))
        if self._ambiguity and not surrounds:
            nothing = np.zeros_like(motion.scene.inliers)
            hidden = (Hypothesis(pose, nothing, 0.0, 0.0, True) for pose in self.predict(elapsed_s))
            motion = replace(
                motion,
                others=motion.others or tuple(hidden),
                ambiguity=max(motion.ambiguity, self._ambiguity),
            )
        self._ambiguity = motion.ambiguity if motion.is_ambiguous else 0.0
        twists = [se3.log_se3(other.pose) / elapsed_s for other in motion.others if other.is_distinct]
        if twists or not self._ambiguity:
            self._twists = twists
        return motion
