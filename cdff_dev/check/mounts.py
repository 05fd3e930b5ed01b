# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Places of sensors that a log states against those of a profile."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cdff_common.errors import FrameNotFoundError
from cdff_common.geometry import se3
from cdff_common.interfaces.profile import Robot
from cdff_dev.check.log import StreamFinding
from cdff_dev.logs import LogSource
from cdff_dev.logs.mounts import mounts

#: Largest differences between the mount in a profile and that in the log without a finding: a mount that was
#: measured by hand can be this inaccurate.
_MAX_M, _MAX_DEG = 0.05, 2.0


def mount_findings(log: LogSource, robot: Robot) -> Iterator[StreamFinding]:
    """Yield the frames of a robot whose place in a profile differs from that in a log."""
    log_mounts, profile = mounts(log), robot.frame_graph()
    for child in log_mounts.frames:
        parent = log_mounts.parent_of(child)
        if parent is None:
            continue
        try:
            T_profile = profile.lookup(parent, child, 0).matrix
        except FrameNotFoundError:  # the profile does not have this frame
            continue
        D = se3.inverse(T_profile) @ log_mounts.lookup(parent, child, 0).matrix
        distance_m = float(np.linalg.norm(D[:3, 3]))
        angle_deg = float(np.degrees(se3.rotation_angle(D[:3, :3])))
        if distance_m > _MAX_M or angle_deg > _MAX_DEG:
            problem = (
                f"its place in {parent} differs from that of the log by {distance_m:.3f} m and "
                f"{angle_deg:.1f} degrees; cdff new profile LOG writes the one of the log"
            )
            yield StreamFinding(f"/{child}", problem, "warning")
