# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of ``tf2_msgs`` and requests of a DEM for a ROS 2 without their packages, encoded in CDR here.

The DEM is requested by the topics of the gateway on DDS.
"""

import array
import math
import struct
import threading
import uuid

from std_msgs.msg import UInt8MultiArray

NAME, ID_BYTES = b"/cdff/get_dem", 16


class Cdr:
    """Reader of little-endian CDR."""

    def __init__(self, data):
        assert data[:2] == b"\x00\x01", data[:4]
        self._data, self._at = data[4:], 0

    def numbers(self, kind, count):
        """Return numbers of a kind of ``struct``."""
        size = struct.calcsize(kind)
        self._at += -self._at % size
        values = struct.unpack_from(f"<{count}{kind}", self._data, self._at)
        self._at += size * count
        return list(values)

    def number(self, kind):
        """Return a number."""
        return self.numbers(kind, 1)[0]

    def text(self):
        """Return a string."""
        length = self.number("I")
        self._at += length
        return self._data[self._at - length : self._at - 1].decode()


def decode_transforms(data):
    """Return frame, child frame, and stamp in nanoseconds, position and quaternion x y z w of transforms."""
    cdr, transforms = Cdr(data), []
    for _ in range(cdr.number("I")):
        seconds, nanoseconds = cdr.number("i"), cdr.number("I")
        frames = cdr.text(), cdr.text()
        transforms.append((*frames, [seconds * 10**9 + nanoseconds, *cdr.numbers("d", 7)]))
    return transforms


def encode_request(frame_id, position, lengths, layers):
    """Return the request for some layers of a map."""
    data = b""
    for text in (frame_id,):
        data += struct.pack("<I", len(text) + 1) + text.encode() + b"\0"
    data += bytes(-len(data) % 8) + struct.pack("<4d", *position, *lengths) + struct.pack("<I", len(layers))
    for text in layers:
        data += bytes(-len(data) % 4) + struct.pack("<I", len(text) + 1) + text.encode() + b"\0"
    return b"\x00\x01\x00\x00" + data


def decode_response(data):
    """Return frame, resolution, lengths, position and values of the first layer; None without cells."""
    cdr = Cdr(data)
    cdr.numbers("i", 2)
    frame_id = cdr.text()
    resolution, length_x, length_y, x, y, *_ = cdr.numbers("d", 10)
    for _ in range(2):
        [cdr.text() for _ in range(cdr.number("I"))]
    if not cdr.number("I"):
        return None
    for _ in range(cdr.number("I")):
        cdr.text()
        cdr.numbers("I", 2)
    cdr.number("I")
    values = cdr.numbers("f", cdr.number("I"))
    return {
        "frame_id": frame_id,
        "resolution": resolution,
        "lengths": [length_x, length_y],
        "position": [x, y],
        "values": [v if math.isfinite(v) else None for v in values],
    }


class DemClient:
    """Client of the topics of requests and responses."""

    def __init__(self, node, gateway):
        self._identifier, self._arrived, self._content = b"", threading.Event(), b""
        self._requests = node.create_publisher(UInt8MultiArray, f"/{gateway}/requests", 16)
        node.create_subscription(UInt8MultiArray, f"/{gateway}/responses", self._on_response, 16)

    def heights(self, timeout_s):
        """Return the heights of 4 m x 4 m; None without an answer or without cells."""
        self._identifier = uuid.uuid4().bytes
        self._arrived.clear()
        request = encode_request("map", (2.0, 0.0), (4.0, 4.0), ["mean"])
        head = self._identifier + len(NAME).to_bytes(2, "little") + NAME
        self._requests.publish(UInt8MultiArray(data=array.array("B", head + request)))
        return decode_response(self._content) if self._arrived.wait(timeout_s) else None

    def _on_response(self, message):
        data = message.data.tobytes()
        if data.startswith(self._identifier + len(NAME).to_bytes(2, "little") + NAME):
            self._content = data[ID_BYTES + 2 + len(NAME) :]
            self._arrived.set()
