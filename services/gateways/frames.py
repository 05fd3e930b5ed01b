# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of frames on both sides of a gateway, and the trees that they form."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field

from cdff_common.contract.foreign_names import frame_name
from cdff_common.errors import InputError

#: Most frames of a tree.
_MAX_FRAMES = 1000


@dataclass(frozen=True, slots=True)
class FrameNames:
    """Frames of CDFF by their ``frame_id`` of the robot.

    Without an entry ``lidar`` is ``{robot}/lidar``, and back.
    """

    robot: str
    frames: Mapping[str, str] = field(default_factory=dict)

    def of_robot(self, frame: str) -> str:
        """Return the ``frame_id`` of a frame of CDFF."""
        for frame_id, name in self.frames.items():
            if name == frame:
                return frame_id
        return frame.removeprefix(f"{self.robot}/")

    def of_cdff(self, frame_id: str) -> str:
        """Return the frame of CDFF of a ``frame_id``."""
        return self.frames.get(frame_id) or frame_name(self.robot, frame_id)


class FrameTree:
    """Frames of transforms: each has one parent, and none is below itself."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._parents: dict[str, str] = {}

    def add(self, parent: str, child: str) -> None:
        """Add an edge; raises InputError if its child has another parent or is above its parent."""
        with self._lock:
            known = self._parents.get(child, parent)
            if known != parent:
                raise InputError(f"frame {child} below {parent}: it is already below {known}")
            above: str | None = parent
            while above is not None:
                if above == child:
                    raise InputError(f"frame {child} below {parent}: {parent} is below {child}, a loop")
                above = self._parents.get(above)
            if child not in self._parents and len(self._parents) >= _MAX_FRAMES:
                raise InputError(f"frame {child}: expected at most {_MAX_FRAMES} frames")
            self._parents[child] = parent
