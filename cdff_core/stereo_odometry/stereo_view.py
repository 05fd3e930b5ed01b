# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rectified stereo pair as grey images with its calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import BoolArray
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import FramePair
from cdff_core.imaging.frames import check_principal_point, check_simultaneous, check_undistorted
from cdff_core.imaging.grey import grey_image
from cdff_core.imaging.masks import at_pixels
from cdff_core.imaging.rectified_camera import RectifiedCamera
from cdff_core.stereo_odometry.robot_masks import RobotMasks

#: Relative tolerance of camera matrices and baselines of one camera: a thousandth of a pixel and less.
_SAME_CAMERA = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class StereoView:
    """Grey images of a stereo pair with the calibration of the camera."""

    pair: FramePair
    stamp_ns: int
    sample_id: str
    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    camera_matrix: FloatArray
    baseline: float
    left_mask: BoolArray | None = None  # True for pixels that do not show the robot
    right_mask: BoolArray | None = None

    @classmethod
    def from_sample(cls, sample: Sample, masks: RobotMasks | None = None) -> StereoView:
        """Return the view of a sample.

        Raises InputError on lens distortion, an invalid or implausible calibration, images that are not
        simultaneous, or masks whose size differs from that of the images.
        """
        pair: FramePair = sample.value
        check_undistorted(pair.left, pair.right)
        check_simultaneous(pair.left, pair.right)
        check_principal_point(pair.left)
        RectifiedCamera.from_matrix(pair.left.camera_matrix, pair.baseline)
        left_mask, right_mask = (None, None) if masks is None else masks.of_pair(pair)
        return cls(
            pair=pair,
            stamp_ns=sample.stamp_ns,
            sample_id=sample.id,
            left=grey_image(pair.left),
            right=grey_image(pair.right),
            camera_matrix=np.array(pair.left.camera_matrix, np.float64),
            baseline=pair.baseline,
            left_mask=left_mask,
            right_mask=right_mask,
        )

    def as_pair(self) -> FramePair:
        """Return the grey images as a pair with the calibration."""
        return FramePair.from_images(
            self.left,
            self.right,
            baseline_m=self.baseline,
            camera_matrix=self.camera_matrix,
            stamp_ns=self.stamp_ns,
        )

    def is_on_scene(self, features: FloatArray, disparities: FloatArray | None = None) -> BoolArray:
        """Return a mask (n,) of the points that do not lie on the robot in the left image.

        ``features`` (n, 2) are columns and rows, ``disparities`` (n,) pixels; with disparities, the points
        must not lie on the robot in the right image either.
        """
        is_usable = at_pixels(self.left_mask, features)
        if disparities is None:
            return is_usable
        right = features - np.column_stack([np.nan_to_num(disparities), np.zeros(len(features))])
        return is_usable & at_pixels(self.right_mask, right)

    def has_same_camera(self, other: StereoView) -> bool:
        """Return whether image size, camera matrix and baseline agree."""
        return self.left.shape == other.left.shape and all(
            np.allclose(a, b, rtol=_SAME_CAMERA, atol=0.0)
            for a, b in ((self.camera_matrix, other.camera_matrix), (self.baseline, other.baseline))
        )
