# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Topics of a recording, and the data that the conversion of their messages needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cdff_common.contract.foreign_names import frame_name, name_of, stream_name

if TYPE_CHECKING:
    from services.ros_messages.conversions import Conversion
    from services.ros_messages.fixes import LocalFrame

#: Last names of topics that ``image_transport`` adds to those of images.
_TRANSPORTS = ("compressed", "compressedDepth")


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic that is converted.

    Attributes
    ----------
    name : str
        Name in the recording.
    robot : str
        Robot id of its streams and frames.
    conversion : Conversion
    camera : Any
        ``CameraInfo`` of the same namespace; None without one.
    local_frame : LocalFrame, optional
        Frame of the positions of satellite navigation; None for other topics.
    """

    name: str
    robot: str
    conversion: Conversion
    camera: Any = None
    local_frame: LocalFrame | None = None

    @property
    def type_name(self) -> str:
        """ASN.1 type of the samples."""
        return self.conversion.type_name

    @property
    def stream(self) -> str:
        """Stream of its messages, if each has one sample."""
        return stream_name(self.robot, self.name, self.conversion.port)

    @property
    def is_rectified(self) -> bool:
        """True if the topic is that of rectified images: its last name contains ``rect``."""
        return "rect" in image_name(self.name)

    @property
    def is_compressed(self) -> bool:
        """True if the topic has the name of a transport, such as ``image_raw/compressed``."""
        return _without_transport(self.name) != self.name

    def stream_of(self, transform: Any) -> str:
        """Return the stream of a transform of a frame tree, which has the name of its child frame."""
        return f"/{self.robot}/{name_of(self.name, 'tf')}.{name_of(transform.child_frame_id, 'frame')}"

    def frame(self, frame_id: str) -> str:
        """Return the CDFF name of a frame."""
        return frame_name(self.robot, frame_id)


def namespace(topic: str) -> str:
    """Return the part of a topic before its last name: of a camera, that of its images and calibration."""
    return _without_transport(topic).rpartition("/")[0]


def image_name(topic: str) -> str:
    """Return the last name of a topic of images, such as ``image_rect``, without that of a transport."""
    return _without_transport(topic).rpartition("/")[2]


def _without_transport(topic: str) -> str:
    start, _, last = topic.rpartition("/")
    return start if last in _TRANSPORTS and start else topic
