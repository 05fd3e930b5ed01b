# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of YARP and types of CDFF, by the content that the settings state for a port."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.bitstream import wrap
from cdff_common.errors import CodecError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import (
    Asn1Bitstream,
    Frame,
    FrameModeT,
    IMUSensors,
    LidarScan,
    Time,
    TransformWithCovariance,
)
from services.gateway_yarp.settings import InputPort
from services.yarp.bottle import decode_bottle, encode_bottle, parse_text
from services.yarp.carriers import Received
from services.yarp.images import decode_yarp_image, encode_yarp_image

#: ASN.1 type of the samples by the content of a port.
TYPES = {
    "image": "Frame",
    "imu": "IMUSensors",
    "pose": "TransformWithCovariance",
    "cloud": "LidarScan",
    "bitstream": "Asn1Bitstream",
}
_UNALIGNED_PER = 0


def _numbers(values: Any, count: int, what: str) -> NDArray[np.float64]:
    """Return the numbers of a list; raises InputError if it does not have so many finite numbers."""
    try:
        numbers = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: {error}; expected numbers") from error
    if numbers.ndim != 1 or (count and len(numbers) != count) or not np.isfinite(numbers).all():
        expected = f"{count} finite numbers" if count else "finite numbers"
        raise InputError(f"{what} of the shape {numbers.shape}: expected {expected}")
    return numbers


def _image(received: Received, entry: InputPort, stamp_ns: int) -> Frame:
    if received.is_text:
        raise InputError("an image as text: expected the carrier tcp")
    pixels, mode = decode_yarp_image(received.data)
    matrix = None
    if entry.camera is not None:
        fx, fy, cx, cy = entry.camera
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Frame.from_image(pixels, stamp_ns=stamp_ns, mode=mode, sensor=entry.frame, camera_matrix=matrix)


def _imu(values: Any, _: InputPort, stamp_ns: int) -> IMUSensors:
    """Return acceleration and angular velocity (stated in degrees per second) of an inertial unit."""
    numbers = _numbers(values, 12, "sample of an IMU")
    return IMUSensors(Time.from_ns(stamp_ns), numbers[3:6], np.deg2rad(numbers[6:9]), np.zeros(3))


def _pose(values: Any, entry: InputPort, stamp_ns: int) -> TransformWithCovariance:
    numbers = _numbers(values, 7, "pose")
    norm = float(np.linalg.norm(numbers[3:]))
    if not 0.99 < norm < 1.01:
        raise InputError(f"pose with a quaternion of the length {norm:g}: expected 1")
    T = se3.transform_from_quaternion_xyzw(numbers[:3], numbers[3:] / norm)
    assert entry.child is not None
    return TransformWithCovariance.from_transform(
        UncertainTransform(T), parent=entry.frame, child=entry.child, stamp_ns=stamp_ns
    )


def _cloud(values: Any, entry: InputPort, stamp_ns: int) -> LidarScan:
    numbers = _numbers(values, 0, "cloud")
    if len(numbers) % 3:
        raise InputError(f"cloud of {len(numbers)} numbers: expected x, y, z of each point")
    points_m = numbers.reshape(-1, 3).astype(np.float32)
    offsets_us = np.zeros(len(points_m), np.uint32)
    return LidarScan.from_arrays(points_m, offsets_us, frame=entry.frame, t0_ns=stamp_ns, t1_ns=stamp_ns)


def _bitstream(values: Any, _: InputPort, __: int) -> Asn1Bitstream:
    if len(values) != 2 or not isinstance(values[0], str) or not isinstance(values[1], bytes):
        raise InputError(f"bitstream of {len(values)} values: expected the name of a type, and a blob")
    return Asn1Bitstream(values[0], _UNALIGNED_PER, np.frombuffer(values[1], np.uint8))


_OF_LISTS: dict[str, Callable[[Any, InputPort, int], Any]] = {
    "imu": _imu,
    "pose": _pose,
    "cloud": _cloud,
    "bitstream": _bitstream,
}


def to_cdff(received: Received, entry: InputPort, stamp_ns: int) -> Any:
    """Return the value of a message.

    Raises
    ------
    CodecError
        If the message is malformed.
    InputError
        If its content is not that of the settings.
    """
    if entry.content == "image":
        return _image(received, entry, stamp_ns)
    values = parse_text(received.data.decode()) if received.is_text else decode_bottle(received.data)
    return _OF_LISTS[entry.content](values, entry, stamp_ns)


def to_yarp(value: Any, content: str) -> bytes:
    """Return a value as a message.

    Raises
    ------
    InputError
        If the value does not have this content.
    """
    if content == "bitstream":
        wrapped = wrap(value)
        return encode_bottle([wrapped.type, bytes(wrapped.data)])
    if content == "pose" and isinstance(value, TransformWithCovariance):
        return encode_bottle(np.concatenate([value.data.translation, value.data.orientation]).astype("<f8"))
    if content == "image" and isinstance(value, Frame):
        mode = FrameModeT(value.metadata.mode).name.removeprefix("MODE_")
        try:
            return encode_yarp_image(value.image, mode)
        except CodecError as error:
            raise InputError(str(error)) from error
    raise InputError(f"a {type(value).ASN1_NAME} as {content}: expected bitstream")
