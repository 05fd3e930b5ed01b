# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth images of ROS (REP 118) as DistanceImage."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.types import DistanceImage, Frame, Time
from services.ros_messages.images import frame
from services.ros_messages.topics import Topic

#: Metres of the value 1 of a depth image of 16 bits in ROS (REP 118).
DEPTH_UNIT_M = 0.001


#: Encodings of depth images, in millimetres and metres.
_ENCODINGS = ("16UC1", "mono16", "32FC1")
#: Part of the format of compressed depth images in millimetres.
_COMPRESSED = "16UC1; compressedDepth"


def is_depth(message: Any) -> bool:
    """Return whether an ``Image`` or ``CompressedImage`` has an encoding of depth images."""
    if hasattr(message, "encoding"):
        return message.encoding in _ENCODINGS
    return str(message.format).startswith(_COMPRESSED)


def depth_image(message: Any, topic: Topic, stamp_ns: int) -> tuple[DistanceImage, str, None]:
    """Return a depth image; pixels without a distance are 0. Raises InputError if it is not supported."""
    image, name, _ = frame(message, topic, stamp_ns)
    value = distance_image(image)
    known = np.where(np.isfinite(value.data), value.data, 0.0)
    return replace(value, data=known), name, None


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
