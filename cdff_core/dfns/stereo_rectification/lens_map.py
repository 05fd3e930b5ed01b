# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rectification by maps from pixels of the ideal pair to pixels of the inputs."""

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
    """Rectification with maps of both lenses that are computed once per calibration."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the rectified pair; raises InputError if cameras or extrinsics are missing."""
        left, right = inputs.pair.left, inputs.pair.right
        ideal_left, ideal_right, baseline_m = rectified(_calibration(left, right), self.config.keep)
        pair = FramePair(
            baseline=baseline_m, left=self._made(left, ideal_left), right=self._made(right, ideal_right)
        )
        return Outputs(pair=pair)

    def _made(self, frame: Frame, ideal: Rectified) -> Frame:
        image = ideal.apply(frame.image, self.config.interpolation)
        T_robot_sensor = frame.T_robot_sensor
        assert T_robot_sensor is not None  # the calibration was made of it
        turned = UncertainTransform.exact(se3.transform(ideal.R.T, np.zeros(3)))
        # The ideal camera has another orientation, so its frame has another name.
        place = (f"{frame.frame}_rectified", T_robot_sensor @ turned)
        return with_image(frame, image, camera=ideal.camera, place=place)


def _calibration(left: Frame, right: Frame) -> StereoCalibration:
    places = (left.T_robot_sensor, right.T_robot_sensor)
    if places[0] is None or places[1] is None:
        raise InputError("stereo pair: left and right image need an extrinsic, the pose on the robot")
    T = se3.inverse(places[1].matrix) @ places[0].matrix
    cameras = (CameraModel.of_frame(left), CameraModel.of_frame(right))
    return StereoCalibration.from_parts(*cameras, T[:3, :3], T[:3, 3])
