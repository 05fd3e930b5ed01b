# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo cameras of a recording: two topics of images with the calibrations of a left and a right camera.

The relative pose of the cameras follows from the matrices R and P of ``CameraInfo``, as ``image_geometry`` of
ROS defines them; without a baseline in P, it is that of the frame tree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.camera import StereoCalibration, check_image_size
from cdff_common.contract.foreign_names import stream_name
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import FramePair
from cdff_core.imaging.pair_rectifier import PairRectifier
from cdff_dev.logs.stereo_pairs import counterpart
from services.ros_messages.images import camera_model, grey_pixels, pixels
from services.ros_messages.stereo_cameras import pose_of_calibrations
from services.ros_messages.topics import Topic, namespace

#: Poses of child frames in their parents: child -> (parent, T_parent_child).
FrameTree = Mapping[str, tuple[str, FloatArray]]


@dataclass(frozen=True, slots=True, eq=False)
class StereoTopics:
    """Two topics whose images are pairs.

    Attributes
    ----------
    stream : str
        Stream of the pairs.
    left, right : Topic
    rectifier : PairRectifier
    frame : str
        Frame of the left camera.
    is_lossless : bool
        True if the images of a pair are those of the topics: grey and rectified.
    """

    stream: str
    left: Topic
    right: Topic
    rectifier: PairRectifier
    frame: str
    is_lossless: bool

    @property
    def type_name(self) -> str:
        """ASN.1 type of the samples."""
        return "FramePair"

    def with_stream(self, stream: str) -> StereoTopics:
        """Return the same camera with another name of the stream."""
        return replace(self, stream=stream)

    def convert(self, left: Any, right: Any, stamp_ns: int) -> tuple[FramePair, str, None]:
        """Return the rectified grey pair of two images; raises InputError if they do not fit the cameras."""
        return self.rectifier.pair(grey_pixels(left), grey_pixels(right), stamp_ns), self.frame, None


def stereo_candidates(topics: Mapping[str, Topic]) -> list[tuple[Topic, Topic]]:
    """Return left and right topics of images by their names, one pair per pair of cameras.

    Of several topics of a camera, rectified images are preferred, then those without compression.
    """
    images = {name: t for name, t in topics.items() if t.conversion.port == "frame"}
    best: dict[str, tuple[Topic, Topic]] = {}
    for left in sorted(images.values(), key=_preference):
        names = counterpart(left.name)
        if names is not None and names[0] in images:
            best.setdefault(namespace(left.name), (left, images[names[0]]))
    return [pair for _, pair in sorted(best.items())]


def _preference(topic: Topic) -> tuple[bool, bool, str]:
    return not topic.is_rectified, topic.is_compressed, topic.name


def stereo_topics(
    left: Topic,
    right: Topic,
    first: tuple[Any, Any],
    tree: Callable[[], FrameTree],
    named: StereoCalibration | None = None,
) -> StereoTopics:
    """Return the stereo camera of two topics.

    Parameters
    ----------
    left, right : Topic
    first : tuple
        The first message of each topic.
    tree : callable
        Returns the frame tree; it is only called if the calibrations have no baseline.
    named : StereoCalibration, optional
        Calibration that the user names.

    Raises
    ------
    InputError
        If a calibration is missing or does not fit the images, or no source states the baseline.
    """
    names = counterpart(left.name)
    assert names is not None
    stream = stream_name(left.robot, namespace(names[1]).strip("/") or "stereo", "pair")
    frame_ids = [message.header.frame_id.lstrip("/") for message in first]
    left_camera, right_camera = camera_model(left), camera_model(right)
    image, mode = pixels(first[0])
    rows, cols = image.shape[:2]
    check_image_size(left_camera, rows, cols, left.name)
    T_right_left = pose_of_calibrations(left, right) if named is None else named.T_right_left
    if T_right_left is None:
        T_right_left = _pose_of_tree(tree(), *frame_ids)
    if T_right_left is None:
        raise InputError(
            f"{right.name}: its CameraInfo has no baseline (P[3] is 0) and the frame tree does not connect "
            f"{frame_ids[0]!r} and {frame_ids[1]!r}; expected one of both"
        )
    stereo = StereoCalibration.from_parts(
        left_camera, right_camera, T_right_left[:3, :3], T_right_left[:3, 3]
    )
    frame = left.frame(frame_ids[0])
    rectifier = PairRectifier(stereo, frame)
    is_lossless = rectifier.is_identity and mode == "GRAY"
    return StereoTopics(stream, left, right, rectifier, frame, is_lossless)


def _pose_of_tree(tree: FrameTree, left: str, right: str) -> FloatArray | None:
    """Return T_right_left of the frame tree; None if it does not connect the frames."""
    ancestors = dict(_chain(tree, left))
    for frame, T_frame_right in _chain(tree, right):
        if frame in ancestors and left != right:
            return np.asarray(se3.inverse(T_frame_right) @ ancestors[frame])
    return None


def _chain(tree: FrameTree, frame: str) -> list[tuple[str, FloatArray]]:
    """Return a frame and its ancestors with the pose of the frame in each; ends where the tree has a loop."""
    chain = [(frame, np.eye(4))]
    while frame in tree and len(chain) <= len(tree):
        frame, T_parent_child = tree[frame]
        chain.append((frame, np.asarray(T_parent_child @ chain[-1][1])))
    return chain
