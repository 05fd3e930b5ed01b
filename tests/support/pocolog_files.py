# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writer of pocolog files: types with the layout of C++ on 64 bits, their definitions, and samples."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.sax.saxutils import quoteattr

_CATEGORIES = {"b": "sint", "h": "sint", "i": "sint", "q": "sint", "f": "float", "d": "float"}


@dataclass(frozen=True)
class Number:
    name: str
    code: str

    @property
    def size(self) -> int:
        return struct.calcsize(self.code)

    @property
    def align(self) -> int:
        return self.size

    def encode(self, value: Any, order: str) -> bytes:
        return struct.pack(order + self.code, value)

    def define(self, nodes: dict[str, str]) -> None:
        category = _CATEGORIES.get(self.code, "uint")
        nodes[self.name] = f'<numeric name="{self.name}" category="{category}" size="{self.size}"/>'


@dataclass(frozen=True)
class Enum:
    name: str
    symbols: Mapping[str, int]
    size: int = 4
    align: int = 4

    def encode(self, value: str, order: str) -> bytes:
        return struct.pack(order + "i", self.symbols[value])

    def define(self, nodes: dict[str, str]) -> None:
        values = "".join(f'<value symbol="{s}" value="{v}"/>' for s, v in self.symbols.items())
        nodes[self.name] = f'<enum name="{self.name}">{values}</enum>'


@dataclass(frozen=True)
class Array:
    element: Any
    count: int

    @property
    def name(self) -> str:
        return f"{self.element.name}[{self.count}]"

    @property
    def size(self) -> int:
        return int(self.element.size) * self.count

    @property
    def align(self) -> int:
        return int(self.element.align)

    def encode(self, value: Sequence[Any], order: str) -> bytes:
        assert len(value) == self.count
        return b"".join(self.element.encode(v, order) for v in value)

    def define(self, nodes: dict[str, str]) -> None:
        self.element.define(nodes)


@dataclass(frozen=True)
class Vector:
    element: Any
    size: int = 24
    align: int = 8

    @property
    def name(self) -> str:
        return f"/std/vector<{self.element.name}>"

    def encode(self, value: Sequence[Any], order: str) -> bytes:
        head = struct.pack(order + "Q", len(value))
        return head + b"".join(self.element.encode(v, order) for v in value)

    def define(self, nodes: dict[str, str]) -> None:
        self.element.define(nodes)
        of = quoteattr(self.element.name)
        nodes[self.name] = f'<container name={quoteattr(self.name)} of={of} size="24" kind="/std/vector"/>'


@dataclass(frozen=True)
class String:
    name: str = "/std/string"
    size: int = 32
    align: int = 8

    def encode(self, value: str, order: str) -> bytes:
        return struct.pack(order + "Q", len(value.encode())) + value.encode()

    def define(self, nodes: dict[str, str]) -> None:
        Number("/int8_t", "b").define(nodes)
        nodes[self.name] = '<container name="/std/string" of="/int8_t" size="32" kind="/std/string"/>'


@dataclass(frozen=True)
class Compound:
    name: str
    fields: Mapping[str, Any]

    @property
    def align(self) -> int:
        return max(int(kind.align) for kind in self.fields.values())

    @property
    def offsets(self) -> dict[str, int]:
        offset_by_member, end = {}, 0
        for name, kind in self.fields.items():
            offset_by_member[name] = -(-end // kind.align) * kind.align
            end = offset_by_member[name] + kind.size
        return offset_by_member

    @property
    def end(self) -> int:
        name = list(self.fields)[-1]
        return self.offsets[name] + int(self.fields[name].size)

    @property
    def size(self) -> int:
        return -(-self.end // self.align) * self.align

    def encode(self, value: Mapping[str, Any], order: str) -> bytes:
        """Return the fields; padding has the value 0xAA, as of memory that was not initialised."""
        data, end = b"", 0
        for name, offset in self.offsets.items():
            kind = self.fields[name]
            data += b"\xaa" * (offset - end) + kind.encode(value[name], order)
            end = offset + kind.size
        return data + b"\xaa" * (self.size - end)

    def define(self, nodes: dict[str, str]) -> None:
        for kind in self.fields.values():
            kind.define(nodes)
        lines = "".join(
            f'<field name="{name}" type={quoteattr(self.fields[name].name)} offset="{offset}"/>'
            for name, offset in self.offsets.items()
        )
        nodes[self.name] = f'<compound name={quoteattr(self.name)} size="{self.size}">{lines}</compound>'


def trailing_padding(kind: Any) -> int:
    """Return the number of bytes at the end of a sample that Typelib leaves out."""
    if not isinstance(kind, Compound):
        return 0
    return kind.size - kind.end + trailing_padding(list(kind.fields.values())[-1])


def definitions(kind: Any, opening: str = "<typelib>") -> bytes:
    """Return the XML of a type and of those it needs."""
    nodes: dict[str, str] = {}
    kind.define(nodes)
    return f'<?xml version="1.0"?>\n{opening}{"".join(nodes.values())}</typelib>'.encode()


@dataclass
class PocologWriter:
    """Content of a file; ``order`` is the byte order of the samples."""

    order: str = "<"
    data: bytearray = field(default_factory=bytearray)

    def __post_init__(self) -> None:
        self.data += b"POCOSIM\0" + struct.pack("<II", 2, self.order == ">")

    def block(self, kind: int, stream: int, content: bytes) -> None:
        self.data += struct.pack("<BBHI", kind, 0xFF, stream, len(content)) + content

    def declare(self, stream: int, name: str, kind: Any, xml: bytes | None = None) -> None:
        texts = [name.encode(), kind.name.encode(), definitions(kind) if xml is None else xml]
        texts.append(b"rock_stream_type: port\n")
        self.block(1, stream, b"\x01" + b"".join(struct.pack("<I", len(t)) + t for t in texts))

    def sample(
        self,
        stream: int,
        kind: Any,
        value: Any,
        logical_us: int = 0,
        *,
        compress: bool = False,
        keep: bool = False,
    ) -> None:
        """Add a sample; ``keep`` keeps the padding at its end."""
        content = kind.encode(value, self.order)
        content = content if keep else content[: len(content) - trailing_padding(kind)]
        self.raw(stream, zlib.compress(content) if compress else content, logical_us, compress)

    def raw(self, stream: int, content: bytes, logical_us: int = 0, is_compressed: bool = False) -> None:
        times = divmod(logical_us + 5, 1_000_000) + divmod(logical_us, 1_000_000)
        self.block(2, stream, struct.pack("<IIIIIB", *times, len(content), is_compressed) + content)


DOUBLE, FLOAT = Number("/double", "d"), Number("/float", "f")
INT, UINT, USHORT, BYTE = (
    Number(f"/{n}_t", c) for n, c in (("int32", "i"), ("uint32", "I"), ("uint16", "H"), ("uint8", "B"))
)
TIME = Compound("/base/Time", {"microseconds": Number("/int64_t", "q")})


def matrix(rows: int, cols: int) -> Compound:
    """Return the type of a matrix of Eigen."""
    return Compound(f"/wrappers/Matrix</double,{rows},{cols}>", {"data": Array(DOUBLE, rows * cols)})


VECTOR3, MATRIX3, MATRIX6 = matrix(3, 1), matrix(3, 3), matrix(6, 6)
QUATERNION = Compound("/wrappers/Quaternion</double>", {"im": Array(DOUBLE, 3), "re": DOUBLE})
ANGLE_AXIS = Compound("/wrappers/AngleAxis</double>", {"angle": DOUBLE, "axis": Array(DOUBLE, 3)})
TRANSFORM = Compound(
    "/base/TransformWithCovariance_m", {"translation": VECTOR3, "orientation": QUATERNION, "cov": MATRIX6}
)
BODY = Compound(
    "/base/samples/BodyState_m",
    {
        "time": TIME,
        "pose": TRANSFORM,
        "velocity": Compound("/base/TwistWithCovariance_m", {"vel": VECTOR3, "rot": VECTOR3, "cov": MATRIX6}),
    },
)
JOINT_STATE = Compound(
    "/base/JointState",
    {"position": DOUBLE, "speed": FLOAT, "effort": FLOAT, "raw": FLOAT, "acceleration": FLOAT},
)
BODY_STATE = Compound(
    "/base/samples/RigidBodyState_m",
    {
        "time": TIME,
        "sourceFrame": String(),
        "targetFrame": String(),
        "position": VECTOR3,
        "cov_position": MATRIX3,
        "orientation": QUATERNION,
        "cov_orientation": MATRIX3,
        "velocity": VECTOR3,
        "cov_velocity": MATRIX3,
        "angular_velocity": VECTOR3,
        "cov_angular_velocity": MATRIX3,
    },
)
JOINTS = Compound(
    "/base/samples/Joints", {"names": Vector(String()), "elements": Vector(JOINT_STATE), "time": TIME}
)
LASER_SCAN = Compound(
    "/base/samples/LaserScan",
    {
        "time": TIME,
        "start_angle": DOUBLE,
        "angular_resolution": DOUBLE,
        "speed": DOUBLE,
        "ranges": Vector(UINT),
        "minRange": UINT,
        "maxRange": UINT,
        "remission": Vector(FLOAT),
    },
)
_PROJECTION = Enum("/base/samples/DepthMap/PROJECTION_TYPE", {"POLAR": 0, "PLANAR": 1})
DEPTH_MAP = Compound(
    "/base/samples/DepthMap",
    {
        "time": TIME,
        "timestamps": Vector(TIME),
        "vertical_projection": _PROJECTION,
        "horizontal_projection": _PROJECTION,
        "vertical_interval": Vector(DOUBLE),
        "horizontal_interval": Vector(DOUBLE),
        "vertical_size": UINT,
        "horizontal_size": UINT,
        "distances": Vector(FLOAT),
        "remissions": Vector(FLOAT),
    },
)
POINTCLOUD = Compound(
    "/base/samples/Pointcloud_m",
    {"time": TIME, "points": Vector(VECTOR3), "colors": Vector(matrix(4, 1))},
)
DISTANCE_IMAGE = Compound(
    "/base/samples/DistanceImage",
    {
        "time": TIME,
        "width": USHORT,
        "height": USHORT,
        "scale_x": FLOAT,
        "scale_y": FLOAT,
        "center_x": FLOAT,
        "center_y": FLOAT,
        "data": Vector(FLOAT),
    },
)
_MODES = {
    "MODE_UNDEFINED": 0,
    "MODE_GRAYSCALE": 1,
    "MODE_RGB": 2,
    "MODE_UYVY": 3,
    "MODE_BGR": 4,
    "MODE_RGB32": 5,
}
_MODES |= {"MODE_BAYER": 128, "MODE_BAYER_RGGB": 129, "MODE_BAYER_GRBG": 130, "MODE_BAYER_BGGR": 131}
_MODES |= {"MODE_BAYER_GBRG": 132, "MODE_PJPG": 257, "MODE_JPEG": 258, "MODE_PNG": 259}
FRAME = Compound(
    "/base/samples/frame/Frame",
    {
        "time": TIME,
        "received_time": TIME,
        "image": Vector(BYTE),
        "attributes": Vector(
            Compound("/base/samples/frame/frame_attrib_t", {"data_": String(), "name_": String()})
        ),
        "size": Compound("/base/samples/frame/frame_size_t", {"width": USHORT, "height": USHORT}),
        "data_depth": UINT,
        "pixel_size": UINT,
        "row_size": UINT,
        "frame_mode": Enum("/base/samples/frame/frame_mode_t", _MODES),
        "frame_status": Enum("/base/samples/frame/frame_status_t", {"STATUS_EMPTY": 0, "STATUS_VALID": 1}),
    },
)
FRAME_PAIR = Compound(
    "/base/samples/frame/FramePair", {"time": TIME, "first": FRAME, "second": FRAME, "id": UINT}
)

ANGLE, BOOL = Compound("/base/Angle", {"rad": DOUBLE}), Number("/bool", "B")
SONAR = Compound(
    "/base/samples/Sonar",
    {
        "time": TIME,
        "timestamps": Vector(TIME),
        "bin_duration": TIME,
        "beam_width": ANGLE,
        "beam_height": ANGLE,
        "bearings": Vector(ANGLE),
        "speed_of_sound": FLOAT,
        "bin_count": UINT,
        "beam_count": UINT,
        "bins": Vector(FLOAT),
    },
)
SONAR_BEAM = Compound(
    "/base/samples/SonarBeam",
    {
        "time": TIME,
        "bearing": ANGLE,
        "sampling_interval": DOUBLE,
        "speed_of_sound": FLOAT,
        "beamwidth_horizontal": FLOAT,
        "beamwidth_vertical": FLOAT,
        "beam": Vector(BYTE),
    },
)
SONAR_SCAN = Compound(
    "/base/samples/SonarScan",
    {
        "time": TIME,
        "data": Vector(BYTE),
        "time_beams": Vector(TIME),
        "number_of_beams": USHORT,
        "number_of_bins": USHORT,
        "start_bearing": ANGLE,
        "angular_resolution": ANGLE,
        "sampling_interval": DOUBLE,
        "speed_of_sound": FLOAT,
        "beamwidth_horizontal": ANGLE,
        "beamwidth_vertical": ANGLE,
        "memory_layout_column": BOOL,
        "polar_coordinates": BOOL,
    },
)
SPLINE = Compound(
    "/wrappers/geometry/Spline",
    {
        "geometric_resolution": DOUBLE,
        "dimension": INT,
        "curve_order": INT,
        "kind": Enum("/wrappers/geometry/SplineType", {"POLYNOMIAL_BSPLINE": 1, "DEGENERATE": 5}),
        "knots": Vector(DOUBLE),
        "vertices": Vector(DOUBLE),
    },
)
TRAJECTORY = Compound("/base/Trajectory_m", {"speed": DOUBLE, "spline": SPLINE})


def time(microseconds: int) -> dict[str, int]:
    """Return a time."""
    return {"microseconds": microseconds}


def frame_value(
    image: bytes, width: int, height: int, mode: str, microseconds: int = 0, depth: int = 8
) -> dict[str, Any]:
    """Return an image."""
    return {
        "time": time(microseconds),
        "received_time": time(microseconds + 1000),
        "image": image,
        "attributes": [{"name_": "gain", "data_": "2"}],
        "size": {"width": width, "height": height},
        "data_depth": depth,
        "pixel_size": 1,
        "row_size": 0,
        "frame_mode": mode,
        "frame_status": "STATUS_VALID",
    }


_HALF = {"rad": 0.5}
SONAR_VALUE = {
    "time": time(1_600_000_000_000_000),
    "timestamps": [time(1_600_000_000_000_001)],
    "bin_duration": time(20),
    "beam_width": _HALF,
    "beam_height": _HALF,
    "bearings": [_HALF, _HALF],
    "speed_of_sound": 1500.0,
    "bin_count": 50,
    "beam_count": 2,
    "bins": [0.5] * 99 + [float("nan")],
}
SONAR_BEAM_VALUE = {
    "time": time(1_600_000_000_000_000),
    "bearing": _HALF,
    "sampling_interval": 0.25,
    "speed_of_sound": 1500.0,
}
SONAR_BEAM_VALUE |= {"beamwidth_horizontal": 0.5, "beamwidth_vertical": 0.5, "beam": list(range(100))}
SONAR_SCAN_VALUE = {
    "time": time(1_600_000_000_000_000),
    "data": [7] * 100,
    "time_beams": [],
    "number_of_beams": 2,
}
SONAR_SCAN_VALUE |= {"number_of_bins": 50, "start_bearing": _HALF, "angular_resolution": _HALF}
SONAR_SCAN_VALUE |= {"sampling_interval": 0.25, "speed_of_sound": 1500.0, "beamwidth_horizontal": _HALF}
SONAR_SCAN_VALUE |= {"beamwidth_vertical": _HALF, "memory_layout_column": 1, "polar_coordinates": 0}
SPLINE_VALUE = {"geometric_resolution": 0.125, "dimension": 3, "curve_order": 4, "kind": "POLYNOMIAL_BSPLINE"}
SPLINE_VALUE |= {"knots": [0.0] * 4 + [1.0] * 4, "vertices": [float(v) for v in range(12)]}
TRAJECTORY_VALUE = {"speed": 0.5, "spline": SPLINE_VALUE}
