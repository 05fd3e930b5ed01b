# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of ROS for images, stereo pairs and depth images: ``Image`` with its ``CameraInfo``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.contract.foreign_names import name_of
from cdff_common.errors import InputError
from cdff_common.types import DistanceImage, Frame, FrameModeT, FramePair
from services.ros_messages.depth import DEPTH_UNIT_M, distance_image
from services.ros_messages.encoding import Encoded, Outgoing, Target, read_back
from services.ros_messages.message_types import RosTypes

IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
#: Encodings by mode and element type.
_ENCODINGS = {
    ("MODE_GRAY", "|u1"): "mono8",
    ("MODE_GRAY", "<u2"): "mono16",
    ("MODE_GRAY", "<f4"): "32FC1",
    ("MODE_RGB", "|u1"): "rgb8",
    ("MODE_BGR", "|u1"): "bgr8",
}
#: Number of parameters of the distortion model plumb_bob.
_PLUMB_BOB = 5


def frame_images(value: Frame, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return an image, on ``image_rect`` if it states no distortion, and its calibration if it has one."""
    is_raw = len(value.intrinsic.dist_coeffs) or not value.camera_matrix.any()
    name = "image_raw" if is_raw else "image_rect"
    frame_id = target.new_frame(value.frame)
    out = _image(f"{target.topic}/{name}", value, frame_id, types, stamp_ns)
    messages, camera = [out], None
    if value.camera_matrix.any():
        info = _camera_info(value, frame_id, types, stamp_ns)
        camera = target.cameras.setdefault("", info)
        messages.append(Outgoing(f"{target.topic}/camera_info", CAMERA_INFO, info))
    return Encoded(messages, *read_back(out, target, stamp_ns, camera))


def pair_images(value: FramePair, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return the two rectified images, and calibrations whose projections state the baseline."""
    messages = []
    for side, image, baseline_m in (("left", value.left, 0.0), ("right", value.right, value.baseline)):
        topic, frame_id = f"{target.topic}/{side}", target.new_frame(image.frame)
        info = _camera_info(image, frame_id, types, stamp_ns, baseline_m)
        target.cameras.setdefault(side, (image.camera_matrix, value.baseline))
        messages += [
            _image(f"{topic}/image_rect", image, frame_id, types, stamp_ns),
            Outgoing(f"{topic}/camera_info", CAMERA_INFO, info),
        ]
    camera_matrix, baseline_m = target.cameras["left"]
    held = FramePair.from_images(
        value.left.image,
        value.right.image,
        baseline_m=baseline_m,
        camera_matrix=camera_matrix,
        stamp_ns=stamp_ns,
        sensor=value.left.frame,
    )
    return Encoded(messages, held, f"{name_of(target.topic, 'stereo')}.pair")


def depth_images(value: DistanceImage, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return a depth image with its calibration.

    It has 16 bits in millimetres if the depths are multiples of a millimetre (REP 118), otherwise 32 bits in
    metres.
    """
    depths = value.data.reshape(value.height, value.width)
    camera_matrix = np.array(
        [
            [1.0 / value.scale_x, 0.0, -value.center_x / value.scale_x],
            [0.0, 1.0 / value.scale_y, -value.center_y / value.scale_y],
            [0.0, 0.0, 1.0],
        ]
    )
    frame = Frame.from_image(
        _depth_pixels(depths), stamp_ns=stamp_ns, camera_matrix=camera_matrix, sensor=target.frame
    )
    encoded = frame_images(frame, target, types, stamp_ns)
    return Encoded(encoded.messages, distance_image(encoded.held), encoded.read_as)


def _depth_pixels(depths: NDArray[np.float64]) -> NDArray[Any]:
    millimetres = np.rint(depths / DEPTH_UNIT_M)
    is_exact = np.array_equal(millimetres * DEPTH_UNIT_M, depths)
    if is_exact and millimetres.min(initial=0.0) >= 0.0 and millimetres.max(initial=0.0) < 2**16:
        return millimetres.astype(np.uint16)
    return depths.astype(np.float32)


def _image(topic: str, value: Frame, frame_id: str, types: RosTypes, stamp_ns: int) -> Outgoing:
    """Return an image; raises InputError if ROS has no encoding for its pixels."""
    image = value.image
    mode = FrameModeT(value.metadata.mode).name
    encoding = _ENCODINGS.get((mode, image.dtype.str))
    if encoding is None:
        known = ", ".join(f"{m} {d}" for m, d in _ENCODINGS)
        raise InputError(f"no image encoding of ROS for {mode} {image.dtype.str}; expected one of {known}")
    pixels = np.ascontiguousarray(image)
    message = types.make(
        "sensor_msgs/Image",
        header=types.header(stamp_ns, frame_id),
        height=image.shape[0],
        width=image.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels.strides[0] if len(pixels) else 0,
        data=pixels.reshape(-1).view(np.uint8),
    )
    return Outgoing(topic, IMAGE, message)


def _camera_info(value: Frame, frame_id: str, types: RosTypes, stamp_ns: int, baseline_m: float = 0.0) -> Any:
    """Return the calibration of a camera at ``baseline_m`` to the right of the left camera, or alone."""
    K, distortion = value.camera_matrix, value.intrinsic.dist_coeffs
    projection = np.zeros((3, 4))
    projection[:, :3] = K
    projection[0, 3] = -K[0, 0] * baseline_m
    return types.make(
        "sensor_msgs/CameraInfo",
        header=types.header(stamp_ns, frame_id),
        height=value.data.rows,
        width=value.data.cols,
        distortion_model="plumb_bob" if len(distortion) <= _PLUMB_BOB else "rational_polynomial",
        d=np.array(distortion, np.float64),
        k=np.ravel(K).astype(np.float64),
        r=np.ravel(np.eye(3)),
        p=np.ravel(projection),
        binning_x=0,
        binning_y=0,
        roi=types.make(
            "sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )
