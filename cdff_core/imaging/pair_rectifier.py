# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rectified grey stereo pairs of the images of two calibrated cameras."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.camera import StereoCalibration
from cdff_common.geometry import UncertainTransform
from cdff_common.types import FramePair

#: Largest difference of the stamps of a pair. At 5 ms, a camera that yaws at 0.2 rad/s turns by 1 mrad, one
#: pixel at a focal length of 1000 px.
PAIR_TOLERANCE_NS = 5_000_000


class PairRectifier:
    """Makes rectified grey pairs of the images of two cameras.

    Parameters
    ----------
    stereo : StereoCalibration
        Images of a calibration that is not that of a rectified pair are rectified; the frame of the sensor is
        then that of the rectified left camera.
    sensor : str
        Frame of the left camera.
    T_robot_left : UncertainTransform, optional
        Pose of the left camera in the frame of the robot.

    Raises
    ------
    InputError
        If the calibration cannot be rectified.
    """

    def __init__(
        self, stereo: StereoCalibration, sensor: str, T_robot_left: UncertainTransform | None = None
    ) -> None:
        self.is_identity = stereo.is_rectified
        self._sensor = sensor
        self._camera, self._baseline_m, self._T_robot_left = stereo.left, stereo.baseline_m, T_robot_left
        self._sides: tuple[Any, Any] | None = None
        if not self.is_identity:
            from cdff_core.imaging.rectification import rectified

            left, right, self._baseline_m = rectified(stereo)
            self._camera, self._sides = left.camera, (left, right)
            if T_robot_left is not None:
                T_left_rectified = np.eye(4)
                T_left_rectified[:3, :3] = left.R.T
                self._T_robot_left = T_robot_left @ UncertainTransform.exact(T_left_rectified)

    def pair(self, left: NDArray[Any], right: NDArray[Any], stamp_ns: int) -> FramePair:
        """Return the pair of two grey images ``(rows, cols)``.

        Raises
        ------
        InputError
            If images that must be rectified do not have the size of their camera, or others differ in size.
        """
        if self._sides is not None:
            left, right = self._sides[0].apply(left), self._sides[1].apply(right)
        return FramePair.from_images(
            left,
            right,
            baseline_m=self._baseline_m,
            camera_matrix=self._camera.matrix,
            stamp_ns=stamp_ns,
            sensor=self._sensor,
            T_robot_sensor=self._T_robot_left,
        )
