# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes: stereo pairs with triangulated points, and a window of the last keyframes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from cdff_common.errors import RefusedError
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.stereo_triangulation.interface import StereoTriangulationInputs
from cdff_core.dfpcs.visual_odometry_sparse import quality
from cdff_core.imaging.disparity_calibration import DisparityCalibration
from cdff_core.stereo_odometry.consider_state import ConsiderState
from cdff_core.stereo_odometry.rectification_monitor import RectificationMonitor
from cdff_core.stereo_odometry.stereo_points import StereoPointMatcher
from cdff_core.stereo_odometry.stereo_view import StereoView


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """Stereo pair whose points are tracked in later images."""

    view: StereoView
    pose: ConsiderState  # ``T_vo_keyframe``
    features: FloatArray  # (n, 2), pixels
    disparities: FloatArray  # (n,)
    slopes: FloatArray  # (n, 2), derivatives of the disparity by column and row
    basis: FloatArray  # (n, k), undetermined disparity field at the points
    points: FloatArray  # (n, 3), metres, in the left camera
    sharpness: float
    row_offset_px: float  # rows of the right image relative to the left at the centre, from all keyframes
    rectification: list[str]  # deficiencies of the rectification in the newest keyframes


class KeyframeBuilder:
    """Makes keyframes by the DFNs extraction, stereo_matching, refinement and triangulation."""

    def __init__(self, dfn: Callable[[str], Dfn[Any, Any, Any]], calibration: DisparityCalibration) -> None:
        self._points, self._triangulation = StereoPointMatcher(dfn), dfn("triangulation")
        self._calibration = calibration
        self._monitor = RectificationMonitor()

    def build(self, view: StereoView, pose: ConsiderState, sharpness: float) -> tuple[Keyframe, list[str]]:
        """Return a keyframe and its deficiencies; raises RefusedError if its two images do not match."""
        points = self._points.match(view)
        features, disparities = points.features, points.disparities
        reasons = quality.stereo_reasons(disparities, points.detected)
        field = self._points.refine(points, view)
        self._calibration.update(field.open_covariance)
        disparities = disparities + field.corrections
        corrected = disparities + field.basis @ self._calibration.mean_px
        usable = corrected >= quality.MIN_DISPARITY_PX
        triangulated = self._triangulation.process(
            StereoTriangulationInputs(
                features=features[usable],
                disparities=corrected[usable],
                camera_matrix=view.camera_matrix,
                baseline=view.baseline,
            )
        )
        keyframe = Keyframe(
            view=view,
            pose=pose,
            features=features[usable],
            disparities=disparities[usable],
            slopes=points.slopes[usable],
            basis=field.basis[usable],
            points=triangulated.points,
            sharpness=sharpness,
            row_offset_px=float(field.coefficients[0]),
            rectification=self._monitor.update(points, field.coefficients, view.camera_matrix),
        )
        return keyframe, reasons + keyframe.rectification


class KeyframeWindow:
    """The newest keyframe, and older keyframes with the motion from each to the next."""

    def __init__(self, size: int) -> None:
        self._size = size
        self.newest: Keyframe | None = None
        self._older: list[tuple[Keyframe, ConsiderState]] = []

    def restart(self, keyframe: Keyframe | None) -> None:
        """Replace all keyframes by one, or by none."""
        self.newest, self._older = keyframe, []

    def advance(self, keyframe: Keyframe, motion: ConsiderState) -> None:
        """Add a keyframe and the motion to it from the previous keyframe."""
        if self.newest is not None and self._size > 1:
            self._older = [*self._older, (self.newest, motion)][1 - self._size :]
        self.newest = keyframe

    def locate(
        self,
        motion: ConsiderState,
        calibration_change: FloatArray,
        locate: Callable[[Keyframe, FloatArray], ConsiderState | None],
    ) -> ConsiderState | None:
        """Return ``T_vo_current`` relative to the older keyframes in view; None without older keyframes.

        From the newest to the oldest, the chained motion is fused with a direct measurement:
        ``locate(keyframe, T_keyframe_current)`` returns the motion measured near the given one, or None if it
        is unusable.
        """
        if not self._older:
            return None
        self._older = [
            (
                replace(old, pose=old.pose.with_calibration_change(calibration_change)),
                T_old_next.with_calibration_change(calibration_change),
            )
            for old, T_old_next in self._older
        ]
        estimate = motion
        for old, T_old_next in reversed(self._older):
            estimate = T_old_next @ estimate
            try:
                measured_state = locate(old, estimate.matrix)
            except RefusedError:
                continue
            if measured_state is not None:
                estimate = estimate.fused(measured_state)
        oldest, _ = self._older[0]
        return oldest.pose @ estimate
