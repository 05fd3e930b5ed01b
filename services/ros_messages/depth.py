# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth images of ROS (REP 118) as DistanceImage."""

from __future__ import annotations

from cdff_common.types import DistanceImage, Frame, Time

#: Metres of the value 1 of a depth image of 16 bits in ROS (REP 118).
DEPTH_UNIT_M = 0.001


def distance_image(frame: Frame) -> DistanceImage:
    """Return a depth image, metres; pixels of 16 bits are millimetres, other pixels are metres."""
    image, K = frame.image, frame.camera_matrix
    distances = image * DEPTH_UNIT_M if image.dtype.itemsize == 2 else image.astype(float)
    return DistanceImage(
        ref_time=Time.from_ns(frame.metadata.time_stamp.ns),
        width=image.shape[1],
        height=image.shape[0],
        scale_x=1.0 / K[0, 0],
        scale_y=1.0 / K[1, 1],
        center_x=-K[0, 2] / K[0, 0],
        center_y=-K[1, 2] / K[1, 1],
        data=distances.ravel(),
    )
