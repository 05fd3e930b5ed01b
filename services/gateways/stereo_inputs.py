# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two topics of images of the robot that become the stereo pairs of a sensor on the bus."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from cdff_common.bus import Bus
from cdff_common.camera import StereoCalibration
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, InputError
from cdff_core.imaging.pair_rectifier import PAIR_TOLERANCE_NS, PairRectifier
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.inputs import DECODER_ERRORS, FurtherTopic, InputLink, stamp_of
from services.gateways.settings import InputTopic
from services.ros_messages.conversions import CAMERA_INFO
from services.ros_messages.images import camera_model, grey_pixels
from services.ros_messages.message_types import RosTypes
from services.ros_messages.stereo_cameras import pose_of_calibrations
from services.ros_messages.topics import Topic

#: Images of a camera that wait for those of the other.
_MAX_WAITING = 4
_LEFT, _RIGHT = 0, 1


class StereoLink(InputLink):
    """The topics of a left and a right camera, and the stream of their rectified pairs in grey.

    Images of which both have stamps within 5 ms are a pair. Images that are not rectified are rectified with
    the matrices K, D, R and P of their ``CameraInfo``.

    Parameters
    ----------
    entry : InputTopic
        With ``right``, ``camera_info`` and ``right_camera_info``.
    names : FrameNames
    ros_types : RosTypes
    bus : Bus
    tree : FrameTree
    """

    def __init__(
        self, entry: InputTopic, names: FrameNames, ros_types: RosTypes, bus: Bus, tree: FrameTree
    ) -> None:
        super().__init__(entry, names, ros_types, bus, tree)
        self._lock = threading.Lock()
        self._cameras: list[Topic] = [self._topic, replace(self._topic, name=entry.topics[-1])]
        #: Images by stamp, of the left and the right camera.
        self._waiting: tuple[dict[int, Any], dict[int, Any]] = ({}, {})
        self._rectifier: PairRectifier | None = None
        self._size = (0, 0)

    @property
    def further_topics(self) -> list[FurtherTopic]:
        """The topic of the right images, and those of the calibrations."""
        entry = self.entry
        left_info, right_info = entry.calibrations
        return [
            FurtherTopic(
                entry.topics[-1], entry.type, lambda data: self._on_image(_RIGHT, data), entry.queue
            ),
            FurtherTopic(left_info, CAMERA_INFO, lambda data: self._on_calibration(_LEFT, data), 1),
            FurtherTopic(right_info, CAMERA_INFO, lambda data: self._on_calibration(_RIGHT, data), 1),
        ]

    def on_message(self, data: bytes) -> None:
        """Take a left image; with its right one it becomes a sample."""
        self._on_image(_LEFT, data)

    def _on_calibration(self, side: int, data: bytes) -> None:
        if not self.admits_further():
            return
        info = self._decoded(data, CAMERA_INFO)
        if info is None:
            return
        with self._lock:
            known = self._cameras[side].camera
            if known is None or _calibration_of(known) != _calibration_of(info):
                self._cameras[side] = replace(self._cameras[side], camera=info)
                self._rectifier = None

    def _on_image(self, side: int, data: bytes) -> None:
        start_s = monotonic_s()
        if side == _LEFT and not self.admits(len(data), start_s):
            return
        if side == _RIGHT:
            self.counters.receive(len(data))
            if not self.admits_further():
                return
        image = self._decoded(data, self.entry.type)
        if image is None:
            return
        with self._lock:  # pairs are sent in the order of their stamps
            stamp_ns = stamp_of(image)
            other = self._partner(side, stamp_ns, image)
            if other is None:
                return
            (left_ns, left), (_, right) = [(stamp_ns, image), other][:: 1 if side == _LEFT else -1]
            try:
                frame = self._topic.frame(left.header.frame_id)
                rectifier = self._rectified()
                left_pixels, right_pixels = (self._checked(grey_pixels(image)) for image in (left, right))
                value = rectifier.pair(left_pixels, right_pixels, left_ns)
                self.send(value, (frame, None), left_ns, start_s)
            except (CdffError, *DECODER_ERRORS) as error:
                self.drop("content", f"{type(error).__name__}: {error}")

    def _partner(self, side: int, stamp_ns: int, image: Any) -> tuple[int, Any] | None:
        """Return stamp and image of the other camera, or None; the image then waits for it."""
        own, others = self._waiting[side], self._waiting[1 - side]
        nearest_ns = min(others, key=lambda other_ns: abs(other_ns - stamp_ns), default=None)
        if nearest_ns is not None and abs(nearest_ns - stamp_ns) <= PAIR_TOLERANCE_NS:
            other = others.pop(nearest_ns)
            self._discard([(w, t) for w in (own, others) for t in w if t < max(stamp_ns, nearest_ns)])
            return nearest_ns, other
        own[stamp_ns] = image
        self._discard([(own, t) for t in list(own)[:-_MAX_WAITING]])  # the first that have arrived
        return None

    def _discard(self, images: list[tuple[dict[int, Any], int]]) -> None:
        for waiting, stamp_ns in images:
            del waiting[stamp_ns]
            self.drop("pair", f"no image of the other camera within {PAIR_TOLERANCE_NS / 1e6:g} ms")

    def _rectified(self) -> PairRectifier:
        """Return the rectification of the last calibrations; raises InputError if one is missing."""
        if self._rectifier is None:
            left, right = self._cameras
            models = camera_model(left), camera_model(right)
            T_right_left = pose_of_calibrations(left, right)
            if T_right_left is None:
                raise InputError(f"{self.entry.right_camera_info}: P[3] is 0, expected the baseline")
            stereo = StereoCalibration.from_parts(*models, T_right_left[:3, :3], T_right_left[:3, 3])
            self._size = models[0].rows, models[0].cols
            self._rectifier = PairRectifier(stereo, self.entry.frame)
        return self._rectifier

    def _checked(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return an image; raises InputError if it has another size than its calibration."""
        if image.shape != self._size:
            sizes = [f"{rows} x {columns} pixels" for rows, columns in (image.shape, self._size)]
            raise InputError(f"image of {sizes[0]}, its calibration is for {sizes[1]}")
        return image


def _calibration_of(info: Any) -> tuple[Any, ...]:
    """Return the fields of a calibration that the rectification uses."""
    matrices = (getattr(info, name, getattr(info, name.upper(), ())) for name in "kdrp")
    return (info.height, info.width, info.distortion_model, *(tuple(m) for m in matrices))
