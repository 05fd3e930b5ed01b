# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Constant poses between the frames of a log: places of sensors on the robot."""

from __future__ import annotations

from contextlib import suppress

from cdff_common.errors import CdffError, ConflictError, InputError
from cdff_common.geometry import FrameGraph
from cdff_common.types import Frame, FramePair, TransformWithCovariance
from cdff_dev.logs.source import LogSource


def mounts(log: LogSource) -> FrameGraph:
    """Return the constant poses that a log states.

    They are those of sensors on the robot in images, and of streams with one pose that is no true one, such
    as static transforms. Of several places of a frame the first is used.
    """
    names = [
        name
        for name, info in log.streams.items()
        if info.type_name in ("Frame", "FramePair")
        or (info.type_name == "TransformWithCovariance" and info.count == 1 and "/truth." not in name)
    ]
    graph = FrameGraph()
    for name in names:
        with suppress(CdffError):  # of a sample that cannot be read
            value = log.first_samples([name])[name].value
            image = value.left if isinstance(value, FramePair) else value
            pose = image.extrinsic.pose_robot_frame_sensor_frame if isinstance(image, Frame) else value
            if isinstance(pose, TransformWithCovariance) and pose.is_set:
                with suppress(ConflictError, InputError):
                    graph.set_static(pose.parent_frame, pose.child_frame, pose.transform)
    return graph
