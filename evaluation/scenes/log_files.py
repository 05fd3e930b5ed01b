# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small recordings in each format of logs, written by the libraries of the formats."""

from __future__ import annotations

import io
import json
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.pcd import write_pcd
from cdff_common.formats.ply import write_ply
from cdff_common.geometry import UncertainTransform
from cdff_common.types import Frame, LidarScan, TransformWithCovariance
from cdff_dev.logs.formats.infuse.writer import LogWriter
from evaluation.scenes import data_set_files, ouster_captures
from evaluation.scenes.data_set_files import Files, encoded_png

#: Format whose recordings are measured.
POCOLOG = "pocolog (measured)"
_START_NS = 1_600_000_000_000_000_000
_POINTS_M = np.array([[5.0, 1.0, -1.7], [3.0, 4.0, 0.5], [2.0, -3.0, 0.1]])
_IMAGE = np.arange(48, dtype=np.uint8).reshape(6, 8)
_IMU_TABLE = b"time,ax [g],ay [g],az [g],gx,gy,gz,t\n0.1,0,0,1,0.1,0,0,20\n0.2,0,0,1,0.1,0,0,20\n"
_P0, _P1 = "7 0 4.5 0 0 7 2.8 0 0 0 1 0", "7 0 4.5 -3.5 0 7 2.8 0 0 0 1 0"


def recordings(data: Path | None, name: str = "all") -> dict[str, list[Files]]:
    """Return the recordings of one format or all; those of pocolog are measured, absent without ``data``."""
    files_by_format = {known: build() for known, build in _BUILDERS.items() if name in (known, "all")}
    if data is not None and name in (POCOLOG, "all"):
        small = [path for path in sorted((data / "pocolog").glob("*.0.log")) if path.stat().st_size < 20_000]
        files_by_format[POCOLOG] = [{path.name: path.read_bytes()} for path in small]
    return files_by_format


def _content(write: Callable[[Path], Path]) -> Files:
    """Return the files of the file or folder that ``write`` makes in a folder and returns."""
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder))
        if path.is_file():
            return {path.name: path.read_bytes()}
        return {str(f.relative_to(path)): f.read_bytes() for f in path.rglob("*") if f.is_file()}


def _infuse() -> bytes:
    def write(folder: Path) -> Path:
        with LogWriter(folder / "log.msg") as writer:
            for k in range(2):
                stamp_ns = _START_NS + k * 10**8
                frame = Frame.from_image(_IMAGE, stamp_ns=stamp_ns, sensor="robot/cam")
                writer.write("/robot/cam.frame", frame, stamp_ns)
                times = np.zeros(3, np.uint32)
                scan = LidarScan.from_arrays(
                    _POINTS_M, times, frame="robot/lidar", t0_ns=stamp_ns, t1_ns=stamp_ns
                )
                writer.write("/robot/lidar.scan", scan, stamp_ns)
                pose = TransformWithCovariance.from_transform(
                    UncertainTransform(np.eye(4)), parent="a", child="b", stamp_ns=stamp_ns, producer="robot"
                )
                writer.write("/robot/odom.pose", pose, stamp_ns)
        return folder / "log.msg"

    return _content(write)["log.msg"]


def _messages(store: Any) -> list[tuple[str, str, Any]]:
    """An image, its calibration, a cloud, an IMU sample and a frame tree."""
    types = store.types
    sequence = {"seq": 0} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    time = types["builtin_interfaces/msg/Time"](*divmod(_START_NS, 10**9))
    header = types["std_msgs/msg/Header"](stamp=time, frame_id="left", **sequence)
    vector = types["geometry_msgs/msg/Vector3"](0.1, 0.2, 9.8)
    rotation = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    imu = (header, rotation, np.zeros(9), vector, np.zeros(9), vector, np.zeros(9))
    fields = [types["sensor_msgs/msg/PointField"](axis, 4 * i, 7, 1) for i, axis in enumerate("xyz")]
    points = _POINTS_M.astype("<f4").tobytes()
    cloud = (header, 1, 3, fields, False, 12, 36, np.frombuffer(points, np.uint8), True)
    transform = types["geometry_msgs/msg/Transform"](vector, rotation)
    tree = ("/tf", "geometry_msgs/msg/TransformStamped", (header, "base", transform))
    if "tf2_msgs/msg/TFMessage" in types:
        tree = ("/tf", "tf2_msgs/msg/TFMessage", ([types[tree[1]](*tree[2])],))
    image = (header, 6, 8, "mono8", 0, 8, _IMAGE.ravel())
    jpeg = (header, "png", np.frombuffer(encoded_png(), np.uint8))
    topic_messages = [
        ("/imu", "sensor_msgs/msg/Imu", imu),
        ("/points", "sensor_msgs/msg/PointCloud2", cloud),
        tree,
        ("/left/image_rect", "sensor_msgs/msg/Image", image),
        ("/right/image_rect", "sensor_msgs/msg/Image", image),
        ("/rear/image_raw/compressed", "sensor_msgs/msg/CompressedImage", jpeg),
    ]
    roi = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    for side, row in (("left", _P0), ("right", _P1)):
        P = np.array(row.split(), np.float64)
        K = P.reshape(3, 4)[:, :3].ravel()
        info = (header, 6, 8, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), P, 0, 0, roi)
        topic_messages.append((f"/{side}/camera_info", "sensor_msgs/msg/CameraInfo", info))
    return [(topic, kind, types[kind](*values)) for topic, kind, values in topic_messages]


def _write(writer: Any, store: Any, serialize: Any, **options: Any) -> None:
    for k in range(2):
        for topic, kind, message in _messages(store):
            known = [c for c in writer.connections if c.topic == topic]
            connection = known[0] if known else writer.add_connection(topic, kind, typestore=store, **options)
            writer.write(connection, _START_NS + k * 10**8, serialize(message, kind))


def _ros1(compression: str | None) -> bytes:
    store = get_typestore(Stores.ROS1_NOETIC)

    def write(folder: Path) -> Path:
        bag = Writer1(folder / "log.bag")
        if compression:
            bag.set_compression(Writer1.CompressionFormat[compression])
        with bag as writer:
            _write(writer, store, store.serialize_ros1)
        return folder / "log.bag"

    return _content(write)["log.bag"]


def _ros2(plugin: StoragePlugin) -> Files:
    store = get_typestore(Stores.ROS2_HUMBLE)

    def write(folder: Path) -> Path:
        with Writer2(folder / "log", version=9, storage_plugin=plugin) as writer:
            _write(writer, store, store.serialize_cdr)
        return folder / "log"

    files = _content(write)
    return {"log.mcap": files["log.mcap"]} if plugin is StoragePlugin.MCAP else files


def _mcap(compression: CompressionType) -> bytes:
    """Return a file with ROS 1 messages and Foxglove's schemas in JSON."""
    store = get_typestore(Stores.ROS1_NOETIC)
    file = io.BytesIO()
    writer = Writer(file, chunk_size=1500, compression=compression)
    writer.start()
    sec, nsec = divmod(_START_NS, 10**9)
    pose = {
        "position": {"x": 1.0, "y": 2.0, "z": 3.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }
    scan = {"frame_id": "laser", "pose": pose, "start_angle": 0.0, "end_angle": 1.0, "ranges": [1.0, 2.0]}
    for name, fields in (
        ("PoseInFrame", {"frame_id": "map", "pose": pose}),
        ("LaserScan", scan | {"intensities": [3.0, 4.0]}),
    ):
        schema = writer.register_schema(f"foxglove.{name}", "jsonschema", b"{}")
        channel = writer.register_channel(f"/{name}", "json", schema)
        message = json.dumps({"timestamp": {"sec": sec, "nsec": nsec}, **fields}).encode()
        writer.add_message(channel, _START_NS, message, _START_NS)
    for topic, kind, message in _messages(store):
        definition = store.generate_msgdef(kind)[0].encode()
        schema = writer.register_schema(kind.replace("/msg/", "/"), "ros1msg", definition)
        channel = writer.register_channel(topic, "ros1", schema)
        raw = bytes(store.serialize_ros1(message, kind))
        writer.add_message(channel, _START_NS, raw, _START_NS)
    writer.finish()
    return file.getvalue()


def _clouds() -> dict[str, bytes]:
    cloud = CloudArrays.of(_POINTS_M, [10.0, 20.0, 30.0])
    npy, npz, las = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.save(npy, np.column_stack([_POINTS_M, [1.0, 2.0, 3.0]]))
    np.savez_compressed(npz, points_m=_POINTS_M)
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.full(3, 0.001)
    points = laspy.LasData(header)
    points.x, points.y, points.z = _POINTS_M.T
    points.write(las)
    laz = io.BytesIO()
    points.write(laz, do_compress=True)
    return {
        "bin": np.column_stack([_POINTS_M, [0.1, 0.5, 1.0]]).astype("<f4").tobytes(),
        "ply": write_ply(cloud),
        "pcd": write_pcd(cloud),
        "las": las.getvalue(),
        "laz": laz.getvalue(),
        "npz": npz.getvalue(),
        "npy": npy.getvalue(),
        "xyz": b"x y z i\n5 1 -1.7 10\n3 4 0.5 20\n2 -3 0.1 30\n",
        "e57": _e57(),
    }


def _sweeps() -> Files:
    """A folder of scans with their times."""
    scan = np.column_stack([_POINTS_M, [0.1, 0.5, 1.0]]).astype("<f4").tobytes()
    return {"0.bin": scan, "1.bin": scan, "times.txt": b"0.1\n0.2\n"}


def _e57() -> bytes:
    import pye57

    def write(folder: Path) -> Path:
        with pye57.E57(str(folder / "1.e57"), mode="w") as file:
            file.write_scan_raw({f"cartesian{a}": _POINTS_M[:, i].copy() for i, a in enumerate("XYZ")})
        return folder / "1.e57"

    return _content(write)["1.e57"]


def _pcap() -> bytes:
    """Return a capture of a part of a rotation of a VLP-16: 10 packets of 12 blocks of 0.4 degrees."""
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    for k in range(10):
        blocks = b"".join(
            struct.pack("<HH", 0xEEFF, (k * 12 + block) * 40 % 36000) + 32 * struct.pack("<HB", 5000, 100)
            for block in range(12)
        )
        packet = blocks + struct.pack("<IBB", k * 1327, 0x37, 0x22)
        udp = struct.pack(">HHHH", 2368, 2368, 8 + len(packet), 0) + packet
        ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, bytes(4), bytes(4)) + udp
        frame = bytes(12) + b"\x08\x00" + ip
        data += struct.pack("<IIII", 1_600_000_000, k * 1327, len(frame), len(frame)) + frame
    return data


_BUILDERS: dict[str, Callable[[], list[Files]]] = {
    "InFuse": lambda: [{"log.msg": _infuse()}],
    "ROS 1 bag": lambda: [{"log.bag": _ros1(c)} for c in (None, "BZ2", "LZ4")],
    "ROS 2 bag": lambda: [_ros2(StoragePlugin.SQLITE3)],
    "MCAP": lambda: [*({"log.mcap": _mcap(c)} for c in CompressionType), _ros2(StoragePlugin.MCAP)],
    "KITTI odometry": lambda: [data_set_files.kitti()],
    "KITTI raw": lambda: [data_set_files.kitti_raw()],
    "EuRoC": lambda: [data_set_files.euroc(), data_set_files.euroc_pairs()],
    "TUM RGB-D": lambda: [data_set_files.tum()],
    "image folder": lambda: [data_set_files.images()],
    "scans": lambda: [*({f"1.{suffix}": content} for suffix, content in _clouds().items()), _sweeps()],
    "pcap": lambda: [{"log.pcap": _pcap()}],
    "Ouster": lambda: [ouster_captures.recording(profile) for profile in ouster_captures.CHANNELS],
    "7-Scenes": lambda: [data_set_files.seven_scenes(), data_set_files.seven_scenes_extract()],
    "BOP": lambda: [data_set_files.bop_scene(), data_set_files.bop_frame()],
    "SPEED": lambda: [data_set_files.speed()],
    "poses": data_set_files.poses,
    "IMU table": lambda: [{"imu.csv": _IMU_TABLE}],
}
#: Formats with simulated recordings.
SIMULATED = tuple(_BUILDERS)
