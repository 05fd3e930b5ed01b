# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rectification by maps from the pixels of the ideal pair to those of the input images."""

from __future__ import annotations

import numpy as np

from cdff_common.camera import CameraModel, StereoCalibration
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Frame, FramePair
from cdff_core.dfns.stereo_rectification.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import with_image
from cdff_core.imaging.rectification import LensMapConfig, Rectified, rectified


class LensMap(Interface[LensMapConfig]):
    """Resample both images by maps that are computed once per calibration."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the rectified pair; raises InputError if cameras or extrinsics are missing."""
        left, right = inputs.pair.left, inputs.pair.right
        ideal_left, ideal_right, baseline_m = rectified(
            _calibration(left, right), self.config.keep, self.config.max_angle_deg
        )
        pair = FramePair(
            baseline=baseline_m,
            left=self._resample(left, ideal_left),
            right=self._resample(right, ideal_right),
        )
        return Outputs(pair=pair)

    def _resample(self, frame: Frame, ideal: Rectified) -> Frame:
        """Return the image of the ideal camera, with the name and pose of its frame."""
        image = ideal.apply(frame.image, self.config.interpolation)
        T_robot_sensor = frame.T_robot_sensor
        assert T_robot_sensor is not None  # checked by _calibration
        T_sensor_rectified = UncertainTransform.exact(se3.transform(ideal.R.T, np.zeros(3)))
        # The orientation of the ideal camera differs, so its frame has another name.
        name_and_pose = (f"{frame.frame}_rectified", T_robot_sensor @ T_sensor_rectified)
        return with_image(frame, image, camera=ideal.camera, place=name_and_pose)


def _calibration(left: Frame, right: Frame) -> StereoCalibration:
    """Return the calibration of both images; raises InputError if a camera or extrinsic is missing."""
    T_robot_left, T_robot_right = left.T_robot_sensor, right.T_robot_sensor
    if T_robot_left is None or T_robot_right is None:
        raise InputError("stereo pair: left and right image need an extrinsic, the pose on the robot")
    T_right_left = se3.inverse(T_robot_right.matrix) @ T_robot_left.matrix
    cameras = (CameraModel.of_frame(left), CameraModel.of_frame(right))
    return StereoCalibration.from_parts(*cameras, T_right_left[:3, :3], T_right_left[:3, 3])
