# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of input files as values of the types of ports."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.json_form import from_json
from cdff_common.errors import CodecError, InputError
from cdff_common.formats.bal import read_bal
from cdff_common.formats.clouds import CLOUD_FORMATS, read_cloud
from cdff_common.formats.file_source import Source, load
from cdff_common.formats.format_detection import detect
from cdff_common.formats.geotiff import read_bands, read_map
from cdff_common.formats.image import read_image
from cdff_common.formats.libmv import read_libmv
from cdff_common.formats.meshes import MESH_FORMATS, detect_mesh, read_mesh
from cdff_common.formats.npz import read_npz
from cdff_common.formats.pose import PoseValue, read_pose
from cdff_common.formats.pose_graph import read_pose_graph
from cdff_common.formats.tum import read_tum
from cdff_common.formats.visual_map import read_visual_map
from cdff_common.interfaces.description import Port
from cdff_common.types import (
    Frame,
    LidarScan,
    Mesh,
    Pointcloud,
    Pose,
    PoseTrajectory,
    RigidBodyState,
    TransformWithCovariance,
)
from cdff_dev.logs import open_log
from cdff_dev.logs.file_stamps import PERIOD_NS, natural_order
from cdff_dev.logs.formats import LogLocation
from cdff_dev.run.arrays import grey, read_array

ROBOT = "robot"
_MAP_FRAME, _BODY_FRAME = "site", f"{ROBOT}/base"
#: Largest number of points of the ASN.1 type Pointcloud.
_MAX_POINTS = 400_000
#: Types of sensor data, and types of poses.
_SENSOR_TYPES = ("Pointcloud", "LidarScan", "Frame", "FramePair")
_POSE_TYPES = ("TransformWithCovariance", "RigidBodyState", "Pose")


@dataclass(frozen=True, slots=True)
class _Metadata:
    """Properties that files do not contain: frame and stamp of the data of a port."""

    frame: str
    stamp_ns: int


def read_sequence(ports: Sequence[Port], files: Mapping[str, str | Sequence[str]]) -> list[dict[str, Any]]:
    """Return the values of the ports at successive times, for sensors of which several files are given.

    The files of a port are in the order of time, 100 ms apart, unless its poses have later stamps. Patterns
    of files are expanded in the order of the numbers in the names. A port of poses with one file has this
    pose at all times, another port with one file only has a value at the first time.

    Raises
    ------
    InputError
        As ``read_inputs``, or if the numbers of files differ.
    """
    port_by_name = {name: port for port in ports for name in _names(port)}
    lists = {name: _expand_patterns(port_by_name.get(name), texts) for name, texts in files.items()}
    single = {n: t for n, t in lists.items() if not getattr(port_by_name.get(n), "repeated", False)}
    counts = {name: len(texts) for name, texts in single.items() if len(texts) > 1}
    if len(set(counts.values())) > 1:
        counts_by_port = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(f"numbers of files: {counts_by_port}; expected equal ones, or one")
    batches = []
    for k in range(next(iter(counts.values()), 1)):
        chosen: dict[str, str | Sequence[str]] = {}
        for name, texts in lists.items():
            port = port_by_name.get(name)
            if name in counts:
                chosen[name] = texts[k]
            elif k == 0 or (port is not None and port.type_name in _POSE_TYPES):
                chosen[name] = texts
        first_files = {name: texts[0] for name, texts in lists.items() if texts}
        batches.append(
            read_inputs(ports, chosen, k * PERIOD_NS, _are_named_by_port(port_by_name, first_files))
        )
    return batches


def _names(port: Port) -> tuple[str, ...]:
    """Return the accepted names of a port."""
    return port.name, port.attribute, *getattr(port, "aliases", ())


def _expand_patterns(port: Port | None, texts: str | Sequence[str]) -> list[str]:
    """Return the files of a port; patterns of a port of sensor data are replaced by the files."""
    expanded: list[str] = []
    for text in [texts] if isinstance(texts, str) else texts:
        is_pattern = port is not None and port.type_name in _SENSOR_TYPES and not Path(text).exists()
        paths = LogLocation.of(text).files if is_pattern else ()
        expanded += [str(path) for path in sorted(paths, key=natural_order)] or [text]
    return expanded


def _are_named_by_port(port_by_name: Mapping[str, Port], files: Mapping[str, Any]) -> bool:
    """Return whether the frames of data have the names of their ports: of several sensors, or with a mesh."""
    types = [port_by_name[name].type_name for name in files if name in port_by_name]
    return sum(name in _SENSOR_TYPES for name in types) > 1 or "Mesh" in types


def read_inputs(
    ports: Sequence[Port],
    files: Mapping[str, str | Sequence[str]],
    earliest_ns: int = 0,
    named_by_port: bool | None = None,
) -> dict[str, Any]:
    """Return the value of each port, read from its file according to its type; a list for repeated ports.

    Files do not contain frames. If there is one sensor input, its frame is the child frame of the pose input,
    or ``site`` without a pose input. If there are several sensor inputs, or a mesh, the frame of each has the
    name of its port. The frame of a mesh is ``{name of the file}/body``. All stamps are the latest stamp of
    the pose inputs, or ``earliest_ns``; a later time than 0 needs no required port.

    Parameters
    ----------
    named_by_port : bool, optional
        Whether frames have the names of the ports, if other ports have values at other times.

    Raises
    ------
    InputError
        If a port is unknown or missing, or a file does not have the type of its port.
    """
    port_by_name = {name: p for p in ports for name in _names(p)}
    unknown = next((name for name in files if name not in port_by_name), None)
    if unknown is not None:
        raise InputError(f"no input port {unknown!r}; there are {', '.join(p.attribute for p in ports)}")
    lists = {name: [text] if isinstance(text, str) else list(text) for name, text in files.items()}
    for name, texts in lists.items():
        if len(texts) > 1 and not getattr(port_by_name[name], "repeated", False):
            raise InputError(f"input {name} is given twice; several files are for the sensors of a DFPC")
    file_by_attribute = {
        port_by_name[name].attribute: (port_by_name[name], texts[0]) for name, texts in lists.items()
    }
    if len(file_by_attribute) < len(files):
        raise InputError(f"inputs {', '.join(files)}: a port is given by two of its names")
    missing = next((p for p in ports if not p.optional and p.attribute not in file_by_attribute), None)
    if missing is not None and not earliest_ns:
        raise InputError(
            f"input port {missing.attribute} ({missing.type_name}) is missing: give {missing.attribute}=FILE"
        )
    poses = {
        a: read_pose(t)
        for a, (p, t) in file_by_attribute.items()
        if p.type_name in _POSE_TYPES and _is_pose_file(t)
    }
    stamp_ns = max((pose.stamp_ns for pose in poses.values()), default=0)
    stamp_ns = max(stamp_ns, earliest_ns)
    names_by_port = (
        _are_named_by_port(port_by_name, file_by_attribute) if named_by_port is None else named_by_port
    )
    values: dict[str, Any] = {}
    for attribute, (port, text) in file_by_attribute.items():
        if getattr(port, "repeated", False):
            texts = next(texts for name, texts in lists.items() if port_by_name[name] is port)
            values[attribute] = [_read_message(port, each, _Metadata(attribute, stamp_ns)) for each in texts]
            continue
        if attribute in poses:
            values[attribute] = _pose_message(port.type_name, poses[attribute], stamp_ns)
        elif not port.is_message:
            values[attribute] = read_array(port, text)
        else:
            frame = attribute if names_by_port else _frame_of_only_sensor(list(poses.values()))
            values[attribute] = _read_message(port, text, _Metadata(frame, stamp_ns))
    return values


def _frame_of_only_sensor(poses: list[PoseValue]) -> str:
    if not poses:
        return _MAP_FRAME
    return poses[0].child or _BODY_FRAME


def _is_pose_file(text: str) -> bool:
    """Return whether a file has a pose: a matrix ``T`` in JSON, or a table of poses."""
    if Path(text).is_dir():
        return False
    source = load(text)
    fmt = detect(source)
    if fmt == "json":
        data = json.loads(source.data)
        value = data.get("value") if isinstance(data, dict) else None
        return isinstance(data, dict) and ("T" in data or (isinstance(value, dict) and "T" in value))
    return fmt in ("pose_txt", "tum")


def _pose_message(type_name: str, pose: PoseValue, stamp_ns: int) -> Any:
    if type_name == "Pose":
        return Pose.from_matrix(pose.T.matrix)
    parent, child = pose.parent or _MAP_FRAME, pose.child or _BODY_FRAME
    message_type = RigidBodyState if type_name == "RigidBodyState" else TransformWithCovariance
    return message_type.from_transform(pose.T, parent=parent, child=child, stamp_ns=stamp_ns)


def _read_message(port: Port, text: str, metadata: _Metadata) -> Any:
    """Return the message of a port from a file or folder; raises InputError."""
    name = port.type_name
    if name in ("Frame", "FramePair", "DistanceImage") and "," in text and not Path(text).exists():
        return _with_calibration(port, text.split(","), metadata)
    if Path(text).is_dir():
        return _from_log(name, Path(text))
    source = load(text)
    fmt = (detect_mesh(source) if name == "Mesh" else None) or detect(source)
    if fmt == "json":
        try:
            return from_json(name, json.loads(source.data))
        except (CodecError, ValueError) as error:
            raise InputError(f"{port.attribute}={source.name}: {error}; expected a {name} as JSON") from error
    if fmt == "msg":
        return _from_log(name, Path(text))
    try:
        return _from_file(name, source, fmt, metadata)
    except InputError as error:
        raise InputError(f"{port.attribute}={error}") from error


def _from_file(type_name: str, source: Source, fmt: str, metadata: _Metadata) -> Any:
    formats, read = _READERS.get(type_name, ((), None))
    if read is None or fmt not in formats:
        expected = ", ".join((*formats, "json"))
        raise InputError(f"{source.name}: a {fmt} file, expected a {type_name} as {expected} or msg")
    return read(source, fmt, metadata)


def _pointcloud(source: Source, fmt: str, metadata: _Metadata) -> Any:
    """Return the cloud of a file; raises InputError if it has too many points."""
    cloud = read_cloud(source, fmt)
    if len(cloud.points_m) > _MAX_POINTS:
        raise InputError(
            f"{source.name}: {len(cloud.points_m)} points, a Pointcloud has at most {_MAX_POINTS}; "
            f"downsample it first: cdff run point_cloud_downsampling points={source.name} --set "
            f"max_points={_MAX_POINTS // 2} --out DIR"
        )
    intensity = cloud.intensity
    if intensity is not None:
        # The ASN.1 type has integers; reflectances from 0 to 1 are stored as thousandths.
        is_fraction = bool(len(intensity)) and float(np.nanmax(intensity)) <= 1.0
        scaled = np.nan_to_num(intensity * (1000.0 if is_fraction else 1.0))
        intensity = np.rint(np.clip(scaled, -(2**31), 2**31 - 1)).astype(np.int32)
    return Pointcloud.from_points(
        cloud.points_m,
        frame=metadata.frame,
        stamp_ns=metadata.stamp_ns,
        intensity=intensity,
        colors=cloud.colors,
    )


def _mesh(source: Source, _fmt: str, metadata: _Metadata) -> Any:
    mesh = read_mesh(source)
    return Mesh.from_arrays(
        mesh.vertices, mesh.triangles, frame=mesh_frame(source.name), stamp_ns=metadata.stamp_ns
    )


def mesh_frame(file: str) -> str:
    """Return the frame of the mesh in a file: its name in lower case, with ``_`` for other characters."""
    name = re.sub(r"[^a-z0-9]+", "_", Path(file).stem.lower()).strip("_")
    return f"{name or 'model'}/body"


def _lidar_scan(s: Source, fmt: str, metadata: _Metadata) -> Any:
    points = read_cloud(s, fmt).points_m
    time_offset_us = np.zeros(len(points), np.uint32)
    return LidarScan.from_arrays(
        points, time_offset_us, frame=metadata.frame, t0_ns=metadata.stamp_ns, t1_ns=metadata.stamp_ns
    )


def _frame(source: Source, fmt: str, metadata: _Metadata) -> Any:
    """Return the image of a file."""
    camera_matrix = None
    if fmt == "tif":
        bands = list(read_bands(source)[0].values())
        image: NDArray[Any] = bands[0] if len(bands) == 1 else np.stack(bands, axis=-1)
    elif fmt == "npz":
        arrays = read_npz(source)
        if "image" not in arrays:
            raise InputError(f"{source.name}: holds {', '.join(arrays)}, expected an array image")
        image, camera_matrix = arrays["image"], arrays.get("camera_matrix")
    else:
        image = read_image(source)
    mode = {3: "RGB", 4: "RGBA"}.get(image.shape[2] if image.ndim == 3 else 1, "GRAY")
    return Frame.from_image(
        image, stamp_ns=metadata.stamp_ns, mode=mode, sensor=metadata.frame, camera_matrix=camera_matrix
    )


def _trajectory(s: Source, _fmt: str, metadata: _Metadata) -> Any:
    stamps_ns, T = read_tum(s)
    return PoseTrajectory.from_arrays(stamps_ns, T, None, parent=_MAP_FRAME, child=metadata.frame)


def _with_calibration(port: Port, files: list[str], metadata: _Metadata) -> Any:
    """Return an image or a stereo pair with its cameras.

    ``files`` is ``IMAGE,CAMERA[,NAME]`` or, for a pair, ``LEFT,RIGHT,CAMERA[,NAME,NAME]``, where CAMERA is a
    calibration file and NAME is the name of a camera in it; or ``FOLDER,CAMERA`` for a KITTI folder.
    """
    from cdff_dev.run.cameras import stereo_pair, with_camera

    images, form = 1, "IMAGE,CAMERA[,NAME]"
    if port.type_name == "FramePair":
        images, form = 2, "LEFT,RIGHT,CAMERA[,NAME,NAME]"
    if len(files) == 2 and Path(files[0]).is_dir():
        return _from_log(port.type_name, Path(files[0]), Path(files[1]))
    if len(files) not in (images + 1, 2 * images + 1):
        raise InputError(f"{port.attribute}={','.join(files)}: expected {form}")
    calibration, names = files[images], files[images + 1 :]
    try:
        if port.type_name == "DistanceImage":
            return _depth_image(Path(files[0]), Path(calibration), names[0] if names else "", metadata)
        if images == 1:
            s = load(files[0])
            return with_camera(_from_file("Frame", s, detect(s), metadata), calibration, *names)
        left, right = (grey(read_image(f)) for f in files[:2])
        left_name, right_name = names or ("", "")
        return stereo_pair(
            left,
            right,
            calibration,
            (left_name, right_name),
            frame=metadata.frame,
            stamp_ns=metadata.stamp_ns,
        )
    except InputError as error:
        raise InputError(f"{port.attribute}={error}") from error


def _depth_image(path: Path, calibration: Path, name: str, metadata: _Metadata) -> Any:
    """Return a depth image of 16 bits; the calibration states the unit of its values."""
    from cdff_common.camera import check_image_size, read_camera, read_depth_unit
    from cdff_dev.logs.image_streams import read_depth_image

    camera, unit_m = read_camera(calibration, name), read_depth_unit(calibration)
    if unit_m is None:
        raise InputError(f"{calibration}: no depthScale, expected the metres of a depth value of 1")
    image = read_depth_image(path, camera, unit_m, metadata.stamp_ns)
    check_image_size(camera, image.height, image.width, str(calibration))
    return image


_IMAGE_FORMATS = ("png", "jpg", "pgm", "ppm", "tif", "npz")
#: For each type of port, the formats of its files in addition to json and msg, and their reader.
_READERS: dict[str, tuple[tuple[str, ...], Callable[[Source, str, _Metadata], Any]]] = {
    "Pointcloud": (CLOUD_FORMATS, _pointcloud),
    "LidarScan": (CLOUD_FORMATS, _lidar_scan),
    "Mesh": (MESH_FORMATS, _mesh),
    "VisualMap": (("npz",), lambda s, _fmt, _metadata: read_visual_map(s)),
    "Frame": (_IMAGE_FORMATS, _frame),
    "ElevationMap": (("tif",), lambda s, _, metadata: read_map(s, "ElevationMap", frame=metadata.frame)),
    "NavigationMap": (("tif",), lambda s, _, metadata: read_map(s, "NavigationMap", frame=metadata.frame)),
    "PoseTrajectory": (("tum",), _trajectory),
    "PoseGraph": (("g2o",), lambda s, _, metadata: read_pose_graph(s, frame=metadata.frame)),
    "BundleProblem": (
        ("bal", "libmv"),
        lambda s, fmt, metadata: (read_bal if fmt == "bal" else read_libmv)(s, frame=metadata.frame),
    ),
}


def _from_log(type_name: str, path: Path, calibration: Path | None = None) -> Any:
    """Return the first sample of the type in a log."""
    with closing(open_log(path, calibration)) as log:
        streams = [name for name, info in log.streams.items() if info.type_name == type_name]
        scans = [name for name, info in log.streams.items() if info.type_name == "LidarScan"]
        sample = next(iter(log.samples(streams)), None) if streams else None
        if sample is None and type_name == "Pointcloud" and scans:
            scan = next(iter(log.samples(scans))).value
            return Pointcloud.from_points(scan.points_m, frame=scan.frame, stamp_ns=scan.stamp_ns)
        if sample is None:
            listed = ", ".join(f"{name} {info.type_name}" for name, info in log.streams.items()) or "none"
            raise InputError(f"{path}: has the streams {listed}, expected one of {type_name} with samples")
        return sample.value
