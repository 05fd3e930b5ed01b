# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of frames on both sides of a gateway, and the trees that they form."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from cdff_common.clock import monotonic_s
from cdff_common.contract.foreign_names import frame_name
from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance
from services.ros_messages.fixes import EARTH, LocalFrame

#: Most frames of a tree, and time for which a transform that is not static counts, seconds.
_MAX_FRAMES, _EXPIRY_S = 1000, 10.0


@dataclass(frozen=True, slots=True)
class FrameNames:
    """Frames of CDFF by their ``frame_id`` of the robot.

    Without an entry ``lidar`` is ``{robot}/lidar``, and back. ``origins`` are the longitude and latitude
    (degrees) and the height above the ellipsoid of WGS 84 (metres) of frames of CDFF with x east and y north.
    """

    robot: str
    frames: Mapping[str, str] = field(default_factory=dict)
    origins: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def local_frame(self, frame: str) -> LocalFrame | None:
        """Return a frame of CDFF with its location; None if that is not stated."""
        origin = self.origins.get(frame)
        return None if origin is None else LocalFrame(frame, Anchor(body(EARTH), *origin))

    def of_robot(self, frame: str) -> str:
        """Return the ``frame_id`` of a frame of CDFF."""
        for frame_id, name in self.frames.items():
            if name == frame:
                return frame_id
        return frame.removeprefix(f"{self.robot}/")

    def of_cdff(self, frame_id: str) -> str:
        """Return the frame of CDFF of a ``frame_id``."""
        return self.frames.get(frame_id) or frame_name(self.robot, frame_id)


class FixedFrame(NamedTuple):
    """A fixed frame of the DPM: its parent, and ``T_parent_frame``."""

    parent: str
    T_parent_frame: UncertainTransform


class FrameTree:
    """Frames of transforms: each has one parent, and none is below itself.

    It holds the transforms of the robot and those that the gateway publishes, by their names in CDFF, and the
    fixed frames of the DPM, such as the mounts of sensors. A transform that is not static and that was not
    stated for 10 s no longer counts: a robot that starts again may have other frames.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._parents: dict[str, str] = {}
        self._until_s: dict[str, float] = {}
        self._dpm: dict[str, FixedFrame] = {}

    def update_dpm(self, frames: Mapping[str, FixedFrame]) -> None:
        """Replace the fixed frames of the DPM, by name."""
        with self._lock:
            self._dpm = dict(frames)

    def of_carrier(self, pose: TransformWithCovariance) -> TransformWithCovariance:
        """Return the pose of the frame that carries the child frame of a pose.

        A frame has one parent in the tree of the robot. The pose of a camera that is fixed to the base in the
        DPM is therefore stated as that of the base, ``T_parent_base = T_parent_camera T_camera_base``. A pose
        of a frame without fixed parent, or relative to it, is returned as it is.
        """
        with self._lock:
            fixed = self._dpm
        parent, child, T = pose.parent_frame, pose.child_frame, pose.transform
        passed: set[str] = set()
        while child in fixed and child not in passed and fixed[child].parent != parent:
            passed.add(child)
            T, child = T @ fixed[child].T_parent_frame.inverse(), fixed[child].parent
        if not passed:
            return pose
        return TransformWithCovariance.from_transform(T, parent=parent, child=child, stamp_ns=pose.stamp_ns)

    def add(
        self,
        parent: str,
        child: str,
        *,
        with_dpm: bool = False,
        is_static: bool = False,
        now_s: float | None = None,
    ) -> None:
        """Add an edge, and with ``with_dpm`` compare it with the frames of the DPM, too.

        ``now_s`` is a monotonic time, by default now.

        Raises
        ------
        InputError
            If its child has another parent or is above its parent.
        """
        now_s = monotonic_s() if now_s is None else now_s
        with self._lock:
            known, where = self._parent(child, now_s), ""
            if known is None and with_dpm:
                known, where = self._fixed_parent(child), " in the DPM"
            if known not in (None, parent):
                raise InputError(f"frame {child} below {parent}: it is already below {known}{where}")
            above: str | None = parent
            visited: set[str] = set()
            while above is not None and above not in visited:
                if above == child:
                    raise InputError(f"frame {child} below {parent}: {parent} is below {child}, a loop")
                visited.add(above)
                above = self._parent(above, now_s) or (self._fixed_parent(above) if with_dpm else None)
            if child not in self._parents and len(self._parents) >= _MAX_FRAMES:
                self._remove_expired(now_s)
            if child not in self._parents and len(self._parents) >= _MAX_FRAMES:
                raise InputError(f"frame {child}: expected at most {_MAX_FRAMES} frames")
            was_static = known == parent and self._until_s.get(child) == math.inf
            self._parents[child] = parent
            self._until_s[child] = math.inf if is_static or was_static else now_s + _EXPIRY_S

    def _fixed_parent(self, child: str) -> str | None:
        """Return the parent of a fixed frame of the DPM, or None."""
        return self._dpm[child].parent if child in self._dpm else None

    def _parent(self, child: str, now_s: float) -> str | None:
        """Return the parent of a frame, or None if its edge no longer counts."""
        return self._parents.get(child) if now_s < self._until_s.get(child, -math.inf) else None

    def _remove_expired(self, now_s: float) -> None:
        for child in [child for child, until_s in self._until_s.items() if until_s <= now_s]:
            del self._parents[child], self._until_s[child]

    def to_map(self) -> dict[str, Any]:
        """Return the parents by child, and the number of the fixed frames of the DPM."""
        now_s = monotonic_s()
        with self._lock:
            parents = {child: parent for child in self._parents if (parent := self._parent(child, now_s))}
            return {"parents": parents, "dpm_frames": len(self._dpm)}
