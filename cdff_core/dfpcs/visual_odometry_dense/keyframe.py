# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes: stereo pairs with dense disparities, and the alignment of later pairs to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, Float32Array, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs
from cdff_core.dfns.features_description_2d.interface import FeaturesDescription2DInputs
from cdff_core.dfns.features_extraction_2d.interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_matching_2d.interface import FeaturesMatching2DInputs
from cdff_core.dfns.perspective_n_point_solving.interface import PerspectiveNPointSolvingInputs
from cdff_core.dfns.photometric_motion_estimation.interface import (
    PhotometricMotionEstimationInputs,
    PhotometricMotionEstimationOutputs,
)
from cdff_core.dfpcs.visual_odometry_dense.quality import check_alignment, stereo_reasons
from cdff_core.imaging.disparity_calibration import DisparityCalibration
from cdff_core.imaging.rectified_camera import RectifiedCamera
from cdff_core.stereo_odometry.consider_state import ConsiderState
from cdff_core.stereo_odometry.right_image_correction import RightImageCorrection
from cdff_core.stereo_odometry.stereo_view import StereoView

#: Number of errors of the calibration that the alignment estimates: offset and decentring of the disparities.
CALIBRATION = 2


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """Stereo pair to which later pairs are aligned."""

    view: StereoView
    pose: ConsiderState  # ``T_vo_keyframe``
    disparity: Float32Array  # (rows, cols), pixels; NaN where none
    sharpness: float


class KeyframeAligner:
    """Makes keyframes and aligns pairs to them, by the DFNs of the compound."""

    def __init__(self, dfn: Callable[[str], Dfn[Any, Any, Any]], pnp: Dfn[Any, Any, Any]) -> None:
        self._disparity, self._alignment = dfn("disparity"), dfn("alignment")
        self._extraction, self._description = dfn("extraction"), dfn("description")
        self._matching, self._pnp = dfn("matching"), pnp
        self._correction = RightImageCorrection(dfn)
        self.calibration = DisparityCalibration()

    def build(self, view: StereoView, pose: ConsiderState, sharpness: float) -> tuple[Keyframe, list[str]]:
        """Return a keyframe and its deficiencies; raises RefusedError if its two images do not match."""
        self._correction.update(view)
        self.calibration.update(self._correction.open_covariance)
        pair = self._correction.apply(view).as_pair()
        frame = self._disparity.process(DisparityImageInputs(left=pair.left, right=pair.right)).disparity
        disparity = np.array(frame.image, np.float32).reshape(view.left.shape)
        if view.left_mask is not None:
            disparity[~view.left_mask] = np.nan
        reasons = stereo_reasons(float(np.isfinite(disparity).mean()))
        reasons += self._correction.deficiencies
        return Keyframe(view, pose, disparity, sharpness), reasons

    def align(
        self, view: StereoView, keyframe: Keyframe, T_keyframe_current: FloatArray
    ) -> PhotometricMotionEstimationOutputs:
        """Return the motion since a keyframe, searched near a prediction, and else by descriptors.

        Raises RefusedError if the images do not agree at any motion found.
        """
        view = self._correction.apply(view)
        try:
            return self._aligned(view, keyframe, T_keyframe_current)
        except RefusedError as refusal:
            try:
                return self._aligned(view, keyframe, self._search(view, keyframe))
            except RefusedError:
                raise refusal from None

    def _aligned(
        self, view: StereoView, keyframe: Keyframe, guess: FloatArray
    ) -> PhotometricMotionEstimationOutputs:
        aligned: PhotometricMotionEstimationOutputs = self._alignment.process(
            PhotometricMotionEstimationInputs(
                reference=keyframe.view.left,
                disparity=keyframe.disparity,
                left=view.left,
                right=view.right,
                camera_matrix=view.camera_matrix,
                baseline=view.baseline,
                guess=guess,
                calibration=self.calibration.mean_px,
                calibration_covariance=self.calibration.covariance_px2,
                left_mask=view.left_mask,
                right_mask=view.right_mask,
            )
        )
        check_alignment(aligned)
        return aligned

    def _search(self, view: StereoView, keyframe: Keyframe) -> FloatArray:
        """Return ``T_keyframe_current`` by matched descriptors, without a prediction."""
        corners, descriptors = self._described(view.left, view.left_mask)
        reference, reference_descriptors = self._described(
            keyframe.view.left, np.isfinite(keyframe.disparity) & (keyframe.disparity > 0.5)
        )
        pairs = self._matching.process(
            FeaturesMatching2DInputs(source=reference_descriptors, sink=descriptors)
        ).matches
        pixels = reference[pairs[:, 0]]
        column, row = np.rint(pixels).astype(int).T
        camera = RectifiedCamera.from_matrix(view.camera_matrix, view.baseline)
        uvd = np.column_stack([pixels, keyframe.disparity[row, column]])
        has_depth = np.isfinite(uvd[:, 2]) & (uvd[:, 2] > 0.0)
        solution = self._pnp.process(
            PerspectiveNPointSolvingInputs(
                points=camera.triangulate(uvd[has_depth]),
                projections=corners[pairs[has_depth, 1]],
                camera_matrix=view.camera_matrix,
            )
        )
        return se3.inverse(solution.camera)

    def _described(self, image: Any, mask: BoolArray | None) -> tuple[FloatArray, Any]:
        """Return the corners (n, 2) of an image that have a descriptor, and the descriptors."""
        corners = self._extraction.process(FeaturesExtraction2DInputs(image=image, mask=mask)).features
        described = self._description.process(FeaturesDescription2DInputs(image=image, features=corners))
        return corners[described.valid], described.descriptors[described.valid]
