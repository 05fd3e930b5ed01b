# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""True poses of a log, as those of the frame whose poses are estimated."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from cdff_common.errors import FrameNotFoundError
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.logs.mounts import mounts
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
        Frame whose poses are estimated; its place in the frame of the true poses is that of ``mounts``.
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
            matrices = matrices @ mounts(log).lookup(frame, child, int(stamps_ns[0])).matrix
            frame = child
    return TruePoses(Track("truth", stamps_ns, matrices), frame=frame)
