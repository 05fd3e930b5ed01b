# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo cameras of ROS: two topics of images whose calibrations state the relative pose of the cameras."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from services.ros_messages.images import camera_matrix
from services.ros_messages.topics import Topic


def pose_of_calibrations(left: Topic, right: Topic) -> FloatArray | None:
    """Return T_right_left ``(4, 4)``, metres, of the matrices R and P; None if P has no baseline.

    P of a rectified camera is ``[K | K t]`` with the position ``-t`` of its centre in the frame of the
    rectified left camera. R rotates from the camera to the rectified camera. For topics of rectified images
    the result is that of the rectified cameras.
    """
    projections = [camera_matrix(topic.camera, "p") for topic in (left, right)]
    offsets_m = [0.0 if P is None or not P[0, 0] else float(P[0, 3] / P[0, 0]) for P in projections]
    offset_m = offsets_m[1] - offsets_m[0]
    if offset_m == 0.0 or not np.isfinite(offset_m):
        return None
    T_rectified = se3.transform(np.eye(3), np.array([offset_m, 0.0, 0.0]))
    if left.is_rectified:
        return T_rectified
    rotations = [_rotation(topic) for topic in (left, right)]
    return np.asarray(se3.inverse(rotations[1]) @ T_rectified @ rotations[0])


def _rotation(topic: Topic) -> FloatArray:
    R = camera_matrix(topic.camera, "r")
    if R is None or not R.any():
        return np.eye(4)
    return se3.transform(R, np.zeros(3))
