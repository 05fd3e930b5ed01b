# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Topics of a bag, and what the conversion of their messages needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cdff_dev.logs.names import frame_name, name_of, stream_name

if TYPE_CHECKING:
    from cdff_dev.logs.formats.ros.conversions import Conversion


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic that is converted.

    Attributes
    ----------
    name : str
        Name in the bag.
    robot : str
        Robot id of its streams and frames.
    conversion : Conversion
    camera : Any
        ``CameraInfo`` of the same namespace; None without one.
    """

    name: str
    robot: str
    conversion: Conversion
    camera: Any = None

    @property
    def stream(self) -> str:
        """Stream of its messages, if each has one sample."""
        return stream_name(self.robot, self.name, self.conversion.port)

    def stream_of(self, transform: Any) -> str:
        """Return the stream of a transform of a frame tree, which has the name of its child frame."""
        return f"/{self.robot}/{name_of(self.name, 'tf')}.{name_of(transform.child_frame_id, 'frame')}"

    def frame(self, frame_id: str) -> str:
        """Return the CDFF name of a frame."""
        return frame_name(self.robot, frame_id)


def namespace(topic: str) -> str:
    """Return the part of a topic before its last name: of a camera, that of its images and calibration."""
    return topic.rpartition("/")[0]
