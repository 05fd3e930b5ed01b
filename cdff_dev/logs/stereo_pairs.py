# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo pairs of two cameras: their names, stamps, and the rectification of their images."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.camera import StereoCalibration
from cdff_common.geometry import UncertainTransform
from cdff_common.types import FramePair

#: Largest difference of the stamps of a pair. At 5 ms, a camera that yaws at 0.2 rad/s turns by 1 mrad, one
#: pixel at a focal length of 1000 px.
PAIR_TOLERANCE_NS = 5_000_000
#: Words in the names of left cameras, and those in the names of the right ones.
_SIDES = (("left", "right"), ("cam0", "cam1"), ("camera0", "camera1"), ("infra1", "infra2"), ("l", "r"))


def counterpart(left: str) -> tuple[str, str] | None:
    """Return the name of the right camera and the common part of both names; None if it is no left camera.

    Those of ``/front/left/image`` are ``/front/right/image`` and ``/front//image``.
    """
    for left_word, right_word in _SIDES:
        pattern = re.compile(rf"(?<![a-z0-9]){left_word}(?![a-z0-9])", re.IGNORECASE)
        if pattern.search(left):

            def with_case(match: re.Match[str], word: str = right_word) -> str:
                return word.capitalize() if match[0][0].isupper() else word

            return pattern.sub(with_case, left), pattern.sub("", left)
    return None


def matched_stamps(left_ns: NDArray[np.int64], right_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the numbers of the left and right images of each pair, shape (n, 2), in the order of left ones.

    Two images are a pair if each is the nearest of its camera to the other, within ``PAIR_TOLERANCE_NS``.
    """
    if not len(left_ns) or not len(right_ns):
        return np.zeros((0, 2), np.int64)
    right_of_left, left_of_right = _nearest(left_ns, right_ns), _nearest(right_ns, left_ns)
    left = np.arange(len(left_ns))
    is_mutual = left_of_right[right_of_left] == left
    is_near = np.abs(left_ns - right_ns[right_of_left]) <= PAIR_TOLERANCE_NS
    chosen = left[is_mutual & is_near]
    return np.stack([chosen, right_of_left[chosen]], axis=1)


def _nearest(stamps_ns: NDArray[np.int64], others_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return, for each stamp, the index of the nearest of the other stamps; of equally near ones the
    first.
    """
    order = np.argsort(others_ns, kind="stable")
    ascending = others_ns[order]
    after = np.searchsorted(ascending, stamps_ns).clip(0, len(ascending) - 1)
    before = (after - 1).clip(0)
    is_before = np.abs(stamps_ns - ascending[before]) <= np.abs(ascending[after] - stamps_ns)
    nearest = np.where(is_before, before, after)
    return np.asarray(order[np.searchsorted(ascending, ascending[nearest])], np.int64)


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
        """Return the pair of two grey images; raises InputError if their size is not that of the cameras."""
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
