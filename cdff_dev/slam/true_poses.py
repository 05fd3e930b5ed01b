# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""True poses of a log, as those of the frame whose poses are estimated."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from cdff_common.errors import CdffError, ConflictError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph
from cdff_common.types import Frame, FramePair, TransformWithCovariance
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.logs.source import LogSource

_POSE = "TransformWithCovariance"


@dataclass(frozen=True, slots=True, eq=False)
class TruePoses:
    """True poses, or the reason without them.

    Attributes
    ----------
    track : Track or None
        Poses of the estimated frame if the log states its pose in the frame of the true poses, otherwise of
        the latter.
    fault : str
        Reason without a track.
    frame : str
        Frame whose poses these are.
    """

    track: Track | None = None
    fault: str = ""
    frame: str = ""


def true_poses(log: LogSource, child: str) -> TruePoses:
    """Return the only stream of true poses of a log.

    Parameters
    ----------
    child : str
        Frame whose poses are estimated. Its pose in the frame of the true poses is that of the images (pose
        of the sensor on the robot), or of streams with one pose, such as static transforms.
    """
    names = [name for name, info in log.streams.items() if "/truth.pose" in name and info.type_name == _POSE]
    if len(names) != 1:
        reason = f"several streams of true poses: {', '.join(names)}" if names else "no true poses in the log"
        return TruePoses(fault=reason)
    samples = list(log.samples(names))
    stamps_ns = np.array([sample.stamp_ns for sample in samples], dtype=np.int64)
    matrices = np.array([sample.value.transform.matrix for sample in samples])
    frame = samples[0].value.child_frame
    if frame != child:
        with suppress(FrameNotFoundError):
            matrices = matrices @ _mounts(log).lookup(frame, child, int(stamps_ns[0])).matrix
            frame = child
    return TruePoses(Track("truth", stamps_ns, matrices), frame=frame)


def _mounts(log: LogSource) -> FrameGraph:
    """Return the constant poses between frames of a log."""
    names = [
        name
        for name, info in log.streams.items()
        if info.type_name in ("Frame", "FramePair") or (info.type_name == _POSE and info.count == 1)
    ]
    graph = FrameGraph()
    for name in names:
        with suppress(CdffError):  # of a sample that cannot be read
            value = log.first_samples([name])[name].value
            image = value.left if isinstance(value, FramePair) else value
            pose = image.extrinsic.pose_robot_frame_sensor_frame if isinstance(image, Frame) else value
            if isinstance(pose, TransformWithCovariance) and pose.is_set:
                with suppress(ConflictError, InputError):  # of a second place of a frame
                    graph.set_static(pose.parent_frame, pose.child_frame, pose.transform)
    return graph
