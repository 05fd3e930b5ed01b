# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files as values of the types of ports."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.detect import detect
from cdff_common.formats.pose import PoseValue, read_pose
from cdff_common.formats.source import Source, load
from cdff_common.interfaces.description import ARRAY_TYPE, Port
from cdff_dev.run.arrays import grey, read_array
from cdff_dev.run.clouds import CLOUD_FORMATS, read_cloud

ROBOT = "robot"
_MAP_FRAME, _BODY_FRAME = "site", f"{ROBOT}/base"
#: Size constraint of the ASN.1 type.
_MOST_POINTS = 400_000
_SENSED = ("Pointcloud", "LidarScan", "Frame", "FramePair")
_POSES = ("TransformWithCovariance", "RigidBodyState", "Pose")


@dataclass(frozen=True, slots=True)
class _Setting:
    """What files do not say: the frame a port's data are taken in, and the common stamp."""

    frame: str
    stamp_ns: int


def read_inputs(ports: Sequence[Port], files: Mapping[str, str]) -> dict[str, Any]:
    """Read each port's file as its type says.

    Files have no frames: with one sensor input they are in the child frame of the pose input, or in ``site`` without
    one; with several each is in a frame named like its port. All stamps are those of the pose inputs, else 0.

    Raises
    ------
    InputError
        On an unknown or missing port, or a file that does not fit the port's type.
    """
    by_name = {name: p for p in ports for name in (p.name, p.attribute)}
    unknown = next((name for name in files if name not in by_name), None)
    if unknown is not None:
        raise InputError(f"no input port {unknown!r}; there are {', '.join(p.attribute for p in ports)}")
    given = {by_name[name].attribute: (by_name[name], text) for name, text in files.items()}
    missing = next((p for p in ports if not p.optional and p.attribute not in given), None)
    if missing is not None:
        raise InputError(
            f"input port {missing.attribute} ({missing.type_name}) is missing: give {missing.attribute}=FILE"
        )
    poses = {a: read_pose(t) for a, (p, t) in given.items() if p.type_name in _POSES and _is_pose_file(t)}
    stamp_ns = max((pose.stamp_ns for pose in poses.values()), default=0)
    sensed = [a for a, (p, _) in given.items() if p.type_name in _SENSED]
    values: dict[str, Any] = {}
    for attribute, (port, text) in given.items():
        if attribute in poses:
            values[attribute] = _pose_as(port.type_name, poses[attribute], stamp_ns)
        elif ARRAY_TYPE.match(port.type):
            values[attribute] = read_array(port, text)
        else:
            frame = attribute if len(sensed) > 1 else _frame_of_only_sensor(list(poses.values()))
            values[attribute] = _typed(port, text, _Setting(frame, stamp_ns))
    return values


def _frame_of_only_sensor(poses: list[PoseValue]) -> str:
    if not poses:
        return _MAP_FRAME
    return poses[0].child or _BODY_FRAME


def _is_pose_file(text: str) -> bool:
    if Path(text).is_dir():
        return False
    s = load(text)
    fmt = detect(s)
    if fmt == "json":
        data = json.loads(s.data)
        return isinstance(data, dict) and ("T" in data or "T" in (data.get("value") or {}))
    return fmt in ("pose_txt", "tum")


def _pose_as(type_name: str, pose: PoseValue, stamp_ns: int) -> Any:
    from cdff_common.types import Pose, RigidBodyState, TransformWithCovariance

    if type_name == "Pose":
        return Pose.from_matrix(pose.T.matrix)
    parent, child = pose.parent or _MAP_FRAME, pose.child or _BODY_FRAME
    make = RigidBodyState if type_name == "RigidBodyState" else TransformWithCovariance
    return make.from_transform(pose.T, parent=parent, child=child, stamp_ns=stamp_ns)


def _typed(port: Port, text: str, setting: _Setting) -> Any:
    name = port.type_name
    if name in ("Frame", "FramePair") and "," in text and not Path(text).exists():
        return _with_calibration(port, text.split(","), setting)
    if Path(text).is_dir():
        return _from_log(name, Path(text))
    s = load(text)
    fmt = detect(s)
    readers: dict[str, Callable[[Source, str, _Setting], Any]] = {
        "Pointcloud": _pointcloud,
        "LidarScan": _lidar_scan,
        "Frame": _frame,
        "ElevationMap": _map,
        "NavigationMap": _map,
        "PoseTrajectory": _trajectory,
        "PoseGraph": _pose_graph,
        "BundleProblem": _bundle,
    }
    if fmt == "json":
        return _from_json(name, s)
    if fmt == "msg":
        return _from_log(name, Path(text))
    if name not in readers:
        raise InputError(f"{port.attribute}={s.name}: a {fmt} file, expected a {name} as json or msg")
    try:
        return readers[name](s, name if fmt == "tif" else fmt, setting)
    except InputError as error:
        raise InputError(f"{port.attribute}={error}") from error


def _pointcloud(s: Source, fmt: str, setting: _Setting) -> Any:
    from cdff_common.types import Pointcloud

    cloud = _cloud(s, fmt, "a point cloud")
    if len(cloud.points_m) > _MOST_POINTS:
        raise InputError(
            f"{s.name}: {len(cloud.points_m)} points, a Pointcloud holds at most {_MOST_POINTS}; thin it first: "
            f"cdff run point_cloud_downsampling points={s.name} --set max_points={_MOST_POINTS // 2} --out DIR"
        )
    intensity = cloud.intensity
    if intensity is not None:
        # The wire has whole numbers; reflectances in 0 to 1 become thousandths.
        fractional = bool(len(intensity)) and float(np.nanmax(intensity)) <= 1.0
        scaled = np.nan_to_num(intensity * (1000.0 if fractional else 1.0))
        intensity = np.rint(np.clip(scaled, -(2**31), 2**31 - 1)).astype(np.int32)
    return Pointcloud.from_points(
        cloud.points_m, frame=setting.frame, stamp_ns=setting.stamp_ns, intensity=intensity, colors=cloud.colors
    )


def _lidar_scan(s: Source, fmt: str, setting: _Setting) -> Any:
    from cdff_common.types import LidarScan

    points = _cloud(s, fmt, "a lidar scan").points_m
    at_once = np.zeros(len(points), np.uint32)
    return LidarScan.from_arrays(points, at_once, frame=setting.frame, t0_ns=setting.stamp_ns, t1_ns=setting.stamp_ns)


def _cloud(s: Source, fmt: str, what: str) -> CloudArrays:
    if fmt not in CLOUD_FORMATS:
        raise InputError(f"{s.name}: a {fmt} file, expected {what} as {', '.join(CLOUD_FORMATS)}, json or msg")
    return read_cloud(s, fmt)


def _frame(s: Source, fmt: str, setting: _Setting) -> Any:
    from cdff_common.types import Frame

    image, camera_matrix = _picture(s, fmt)
    mode = {3: "RGB", 4: "RGBA"}.get(image.shape[2] if image.ndim == 3 else 1, "GRAY")
    return Frame.from_image(
        image, stamp_ns=setting.stamp_ns, mode=mode, sensor=setting.frame, camera_matrix=camera_matrix
    )


def _picture(s: Source, fmt: str) -> tuple[NDArray[Any], NDArray[np.float64] | None]:
    """Pixels, and the camera matrix where the file (npz) has one."""
    if fmt in ("png", "pgm", "ppm"):
        from cdff_common.formats.image import read_image

        return read_image(s), None
    if fmt == "Frame":  # a tif
        from cdff_common.formats.geotiff import read_bands

        bands = list(read_bands(s)[0].values())
        return (bands[0] if len(bands) == 1 else np.stack(bands, axis=-1)), None
    if fmt == "npz":
        from cdff_common.formats.npz import read_npz

        arrays = read_npz(s)
        if "image" in arrays:
            return arrays["image"], arrays.get("camera_matrix")
    raise InputError(f"{s.name}: a {fmt} file, expected png, pgm, ppm, tif, json, msg, or npz with an array image")


def _with_calibration(port: Port, files: list[str], setting: _Setting) -> Any:
    """``IMAGE,CAMERA[,NAME]`` or, for a pair, ``LEFT,RIGHT,CAMERA[,NAME,NAME]``; CAMERA is a calibration file."""
    from cdff_common.formats.image import read_image
    from cdff_dev.run.cameras import stereo_pair, with_camera

    pictures, form = 1, "IMAGE,CAMERA[,NAME]"
    if port.type_name == "FramePair":
        pictures, form = 2, "LEFT,RIGHT,CAMERA[,NAME,NAME]"
    if len(files) not in (pictures + 1, 2 * pictures + 1):
        raise InputError(f"{port.attribute}={','.join(files)}: expected {form}")
    calibration, names = files[pictures], files[pictures + 1 :]
    try:
        if pictures == 1:
            s = load(files[0])
            fmt = detect(s)
            return with_camera(_frame(s, "Frame" if fmt == "tif" else fmt, setting), calibration, *names)
        left, right = (grey(read_image(f)) for f in files[:2])
        left_name, right_name = names or ("", "")
        return stereo_pair(
            left, right, calibration, (left_name, right_name), frame=setting.frame, stamp_ns=setting.stamp_ns
        )
    except InputError as error:
        raise InputError(f"{port.attribute}={error}") from error


def _map(s: Source, fmt: str, setting: _Setting) -> Any:
    from cdff_common.formats.geotiff import read_map

    if fmt not in ("ElevationMap", "NavigationMap"):
        raise InputError(f"{s.name}: a {fmt} file, expected a GeoTIFF, json or msg")
    return read_map(s, fmt, frame=setting.frame)


def _trajectory(s: Source, fmt: str, setting: _Setting) -> Any:
    from cdff_common.formats.tum import read_tum
    from cdff_common.types import PoseTrajectory

    if fmt != "tum":
        raise InputError(f"{s.name}: a {fmt} file, expected a TUM trajectory, json or msg")
    stamps_ns, T = read_tum(s)
    return PoseTrajectory.from_arrays(stamps_ns, T, None, parent=_MAP_FRAME, child=setting.frame)


def _pose_graph(s: Source, fmt: str, setting: _Setting) -> Any:
    from cdff_common.formats.pose_graph import read_pose_graph

    if fmt != "g2o":
        raise InputError(f"{s.name}: a {fmt} file, expected g2o, json or msg")
    return read_pose_graph(s, frame=setting.frame)


def _bundle(s: Source, fmt: str, setting: _Setting) -> Any:
    from cdff_common.formats.bal import read_bal
    from cdff_common.formats.libmv import read_libmv

    if fmt not in ("bal", "libmv"):
        raise InputError(f"{s.name}: a {fmt} file, expected bal, libmv, json or msg")
    return (read_bal if fmt == "bal" else read_libmv)(s, frame=setting.frame)


def _from_json(type_name: str, s: Source) -> Any:
    from cdff_common.codecs.json_form import from_json

    return from_json(type_name, json.loads(s.data))


def _from_log(type_name: str, path: Path) -> Any:
    """The first sample of the type in a log."""
    from cdff_dev.logs import open_log

    log = open_log(path)
    streams = [name for name, info in log.streams.items() if info.type_name == type_name]
    if not streams:
        found = ", ".join(f"{name} {info.type_name}" for name, info in log.streams.items())
        raise InputError(f"{path}: has the streams {found or 'none'}, expected one of {type_name}")
    return next(iter(log.samples(streams))).value
