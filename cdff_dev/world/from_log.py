# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""World at a mission time from a log."""

from __future__ import annotations

from cdff_common.clock import parse_stamp
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile
from cdff_common.world import World, WorldHistory
from cdff_common.world.history import POSE_TYPES, is_static
from cdff_dev.logs.source import LogSource


def world_of_log(log: LogSource, stamp_ns: int, profile: Profile | None = None) -> World:
    """Return the frames and the newest value of each stream of a log at a mission time.

    The fixed frames are those of a profile, and the mounts that images and clouds state.
    """
    history = WorldHistory()
    for robot in profile.robots if profile else ():
        graph = robot.frame_graph()
        for frame in graph.frames:
            if (parent := graph.parent_of(frame)) is not None:
                history.add_fixed(parent, frame, graph.lookup(parent, frame, stamp_ns))
    poses = [name for name, info in log.streams.items() if info.type_name in POSE_TYPES]
    for sample in log.samples(poses) if poses else ():
        history.add_pose(sample.stream, sample.value, sample.header)
    for sample in log.samples():
        if sample.stamp_ns > stamp_ns:
            break
        history.add_item(sample.stream, sample.type_name, sample.stamp_ns, sample.value, sample.header)
    return history.at(stamp_ns)


def time_of(log: LogSource, text: str | None, name: str) -> int:
    """Return a mission time: nanoseconds, RFC 3339, ``+SECONDS`` from the start of the log, or by default the
    newest pose, without poses the newest sample.

    Raises
    ------
    InputError
        If the log has no samples, or the text is no time.
    """
    of_stream = {name: info for name, info in log.streams.items() if info.count}
    infos = [info for name, info in of_stream.items() if not is_static(name)] or list(of_stream.values())
    if not infos:
        raise InputError(f"{name}: no samples, so no world")
    if text is not None and text.startswith("+"):
        try:
            return min(info.t0_ns for info in infos) + round(float(text) * 1e9)
        except (ValueError, OverflowError) as error:
            raise InputError(f"--at {text!r}: expected +SECONDS from the start of the log") from error
    if text is not None:
        return parse_stamp(text, "--at")
    poses = [info for info in infos if info.type_name in POSE_TYPES]
    return max(info.t1_ns for info in poses or infos)
