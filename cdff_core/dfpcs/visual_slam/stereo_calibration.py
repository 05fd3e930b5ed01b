# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of a rectification, estimated from row offsets and from the motion between keyframes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.stereo_motion_estimation.interface import (
    StereoMotionEstimationInputs,
    StereoMotionEstimationOutputs,
)
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframe, VisualKeyframeMap
from cdff_core.imaging.disparity_calibration import DisparityCalibration
from cdff_core.visual_map.keyframe_points import StereoMeasurement

MotionDfn = Dfn[Any, StereoMotionEstimationInputs, StereoMotionEstimationOutputs]
#: Number of points that a motion must agree with.
_MIN_INLIERS = 40
#: Change of a disparity above which the points of all keyframes are computed again, pixels.
_CHANGE_PX = 0.01
#: Derivatives of a disparity far from the centre of the image.
_BASIS = np.array([1.0, 0.3])
#: Smallest error that is corrected: smaller ones are not distinguished from errors common to all features.
_SIGNIFICANT_PX = 0.1


class StereoCalibration:
    """Correction of the disparities of a stereo camera."""

    def __init__(self, motion: MotionDfn) -> None:
        self._motion, self._estimate = motion, DisparityCalibration()
        self.clear()

    def clear(self) -> None:
        """Reset the estimate."""
        self._estimate.reset()
        self._applied_px: FloatArray = np.zeros(2)

    def keyframe(self, keyframe: VisualKeyframe, keyframes: VisualKeyframeMap) -> VisualKeyframe:
        """Return a new keyframe with corrected points; after a change also correct the existing ones."""
        stereo = keyframe.stereo
        if stereo is None:
            return keyframe
        self._estimate.update(stereo.open_covariance)
        mean_px = self._estimate.mean_px
        if np.abs(mean_px * _BASIS).max() < _SIGNIFICANT_PX:
            mean_px = np.zeros(2)
        if np.abs((mean_px - self._applied_px) * _BASIS).max() > _CHANGE_PX:
            self._applied_px = mean_px
            for key, existing in keyframes.keyframes.items():
                keyframes.keyframes[key] = _correct(existing, mean_px)
        return _correct(keyframe, self._applied_px)

    def motion(
        self,
        keyframes: VisualKeyframeMap,
        reference: int,
        key: int,
        guess: FloatArray,
        *,
        is_estimated: bool,
    ) -> UncertainTransform | None:
        """Return the motion ``T_reference_key`` between two linked keyframes; None if it is unusable.

        If ``is_estimated``, the errors of the rectification are estimated too; the result corrects the next
        keyframe.
        """
        a, b = keyframes.keyframes[reference].stereo, keyframes.keyframes[key].stereo
        if a is None or b is None or not a.has_same_camera(b) or not keyframes.has_link(reference, key):
            return None
        rows = keyframes.links[min(reference, key), max(reference, key)]
        rows_a, rows_b = rows.T if reference < key else rows[:, ::-1].T
        if len(rows_a) < _MIN_INLIERS:
            return None
        try:
            refined_motion = self._motion.process(
                StereoMotionEstimationInputs(
                    reference=a.measurements[rows_a],
                    current=b.measurements[rows_b],
                    camera_matrix=a.camera_matrix,
                    baseline=a.baseline_m,
                    guess=guess,
                    reference_basis=a.basis[rows_a],
                    current_basis=b.basis[rows_b],
                    calibration=self._estimate.mean_px,
                    calibration_covariance=self._estimate.covariance_px2,
                )
            )
        except (
            RefusedError
        ):  # the matches do not determine the motion; the caller keeps the motion of the locator
            return None
        if int(refined_motion.inliers.sum()) < _MIN_INLIERS:
            return None
        if is_estimated:
            self._estimate.store(refined_motion.calibration, refined_motion.calibration_covariance)
        return UncertainTransform(refined_motion.motion, refined_motion.covariance)

    def metrics(self) -> dict[str, float]:
        """Return the estimate by name."""
        return self._estimate.metrics()


def _correct(keyframe: VisualKeyframe, mean_px: FloatArray) -> VisualKeyframe:
    """Return the keyframe with its stereo points computed again for a corrected disparity offset."""
    stereo: StereoMeasurement | None = keyframe.stereo
    if stereo is None:
        return keyframe
    positions, sigmas = stereo.positions(mean_px)
    return replace(keyframe, points=replace(keyframe.points, positions_m=positions, depth_sigmas_m=sigmas))
