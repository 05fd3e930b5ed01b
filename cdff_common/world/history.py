# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses and items of a recording, from which the world at a mission time is assembled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cdff_common import types
from cdff_common.errors import ExtrapolationError, InputError
from cdff_common.geometry import PoseTrack, UncertainTransform, checked_frame
from cdff_common.geometry.frame_graph import EXTRAPOLATION_LIMIT_NS
from cdff_common.interfaces.product import Header
from cdff_common.world.world import World, WorldEdge, WorldItem

#: Types that state the pose of one frame in another.
POSE_TYPES = ("TransformWithCovariance", "RigidBodyState")


class WorldHistory:
    """Poses of all times and the newest items, by stream.

    Poses are interpolated, and used up to ``EXTRAPOLATION_LIMIT_NS`` outside their track, as the DPM does. Of
    several streams with the pose of one frame, the one whose poses are nearest in time is used; true poses
    only if no other stream has one. Poses of static streams hold at all times (see ``is_static``).
    """

    def __init__(self) -> None:
        self._fixed: dict[str, WorldEdge] = {}
        self._tracks: dict[tuple[str, str, str], PoseTrack] = {}
        self._items: dict[str, WorldItem] = {}
        self._omitted: dict[str, str] = {}

    def add_fixed(self, parent: str, child: str, transform: UncertainTransform) -> None:
        """Add a fixed frame, such as the mount of a sensor."""
        self._fixed[child] = WorldEdge(parent, child, transform)

    def add_pose(self, name: str, value: Any, header: Header | None = None) -> None:
        """Add a pose of a stream to the track of its frame; a pose without valid frames is omitted."""
        parent, child = frames_of_pose(value, header)
        try:
            checked_frame(parent, "parent")
            checked_frame(child, "child")
            if parent == child:
                raise InputError(f"motion of {parent} between two times")
            transform = value.transform
        except InputError as error:
            self._omitted[name] = str(error)
            return
        if is_static(name):
            self._fixed[child] = WorldEdge(parent, child, transform, name)
            return
        track = self._tracks.setdefault((child, parent, name), PoseTrack(EXTRAPOLATION_LIMIT_NS))
        track.insert(value.stamp_ns, transform)

    def add_item(
        self, name: str, type_name: str, stamp_ns: int, value: Any, header: Header | None = None
    ) -> None:
        """Set the newest value of a stream, and the mount that it states."""
        frame = frame_of(value, header)
        self._items[name] = WorldItem(name, type_name, frame, stamp_ns, value, header)
        for mount in mounts_of(value):
            try:
                checked_frame(mount.parent_frame, "parent")
                checked_frame(mount.child_frame, "child")
                self._fixed.setdefault(
                    mount.child_frame,
                    WorldEdge(mount.parent_frame, mount.child_frame, mount.transform, name),
                )
            except InputError as error:
                self._omitted[f"mount in {name}"] = str(error)

    def at(self, stamp_ns: int) -> World:
        """Return the world at a mission time; the items are those added last."""
        omitted = dict(self._omitted)
        moving: list[tuple[bool, int, str, WorldEdge]] = []
        for (child, parent, name), track in self._tracks.items():
            try:
                pose = track.at(stamp_ns, f"{parent} to {child} by {name}")
            except ExtrapolationError as error:
                omitted[f"{parent} to {child} by {name}"] = str(error)
                continue
            moving.append(
                (is_truth(name), track.gap_ns(stamp_ns), name, WorldEdge(parent, child, pose, name))
            )
        # Measured poses precede true ones, and small gaps precede large ones.
        moving.sort(key=lambda entry: entry[:3])
        edges = (*self._fixed.values(), *(edge for *_, edge in moving))
        return World.of(stamp_ns, edges, self._items.values(), omitted)


def is_truth(name: str) -> bool:
    """Return whether a stream holds true values of a data set or a simulation."""
    return "/truth." in name


def is_static(name: str) -> bool:
    """Return whether a stream is of the topic ``tf_static`` of ROS, whose poses hold at all times."""
    sensor, _, _ = name.rpartition("/")[2].partition(".")
    return sensor.endswith("tf_static")


def frames_of_pose(value: Any, header: Header | None) -> tuple[str, str]:
    """Return parent and child of a pose: those of its header, otherwise those in the message."""
    if header is not None and header.child:
        return header.frame, header.child
    return value.parent_frame, value.child_frame


def frame_of(value: Any, header: Header | None) -> str:
    """Return the frame of a value, empty if it has none."""
    if header is not None:
        return header.frame
    for attribute in ("frame", "parent_frame"):
        if isinstance(frame := getattr(value, attribute, None), str):
            return frame
    return ""


def mounts_of(value: Any) -> Iterator[types.TransformWithCovariance]:
    """Yield the stated poses of the sensor of an image, a pair or a cloud on its robot."""
    parts = (value.left, value.right) if isinstance(value, types.FramePair) else (value,)
    for part in parts:
        holder = part.extrinsic if isinstance(part, types.Frame) else getattr(part, "metadata", None)
        mount = getattr(holder, "pose_robot_frame_sensor_frame", None)
        if mount is not None and mount.is_set:
            yield mount
