# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Each pixel of the ideal pair is fetched from where the lenses put it."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from cdff_common.camera import CameraModel, StereoCalibration
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import Frame, FramePair
from cdff_core.dfns.stereo_rectification._interface import (
    StereoRectificationInputs,
    StereoRectificationInterface,
    StereoRectificationOutputs,
)
from cdff_core.imaging.frames import INTERPOLATIONS, with_image
from cdff_core.imaging.rectification import Rectified, rectified


class LensMapConfig(DfnConfig):
    """What part of the view is kept."""

    keep: float = Field(0.0, ge=0.0, le=1.0, description="0: every pixel is seen, 1: nothing is lost")
    interpolation: Literal["nearest", "linear", "cubic"] = Field("linear", description="Between pixels")


class LensMap(StereoRectificationInterface):
    """Maps of both lenses, made once per calibration and kept."""

    Config: ClassVar[type[DfnConfig]] = LensMapConfig

    def process(self, inputs: StereoRectificationInputs) -> StereoRectificationOutputs:
        """Return the rectified pair; raises InputError where the images do not say cameras and places."""
        left, right = inputs.pair.left, inputs.pair.right
        ideal_left, ideal_right, baseline_m = rectified(_calibration(left, right), self.config.keep)
        pair = FramePair(
            baseline=baseline_m, left=self._made(left, ideal_left), right=self._made(right, ideal_right)
        )  # fmt: skip
        return StereoRectificationOutputs(pair=pair)

    def _made(self, frame: Frame, ideal: Rectified) -> Frame:
        image = ideal.apply(frame.image, INTERPOLATIONS[self.config.interpolation])
        T_robot_sensor = frame.T_robot_sensor
        assert T_robot_sensor is not None  # the calibration was made of it
        turned = UncertainTransform(se3.transform(ideal.R.T, np.zeros(3)), np.zeros((6, 6)))
        # The ideal camera looks another way: its frame is another one.
        place = (f"{frame.frame}_rectified", T_robot_sensor @ turned)
        return with_image(frame, image, camera=ideal.camera, place=place)


def _calibration(left: Frame, right: Frame) -> StereoCalibration:
    places = (left.T_robot_sensor, right.T_robot_sensor)
    if places[0] is None or places[1] is None:
        raise InputError("stereo pair: left and right image have to say where they sit on the robot (extrinsic)")
    T = se3.inverse(places[1].matrix) @ places[0].matrix
    cameras = (CameraModel.of_frame(left), CameraModel.of_frame(right))
    return StereoCalibration.from_parts(*cameras, T[:3, :3], T[:3, 3])
