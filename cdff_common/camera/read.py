# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration files, detected by their content.

OpenCV, ROS, Kalibr (camchain), KITTI, COLMAP, camodocal, and cameras of data sets.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from cdff_common.camera.camodocal import camodocal_camera
from cdff_common.camera.colmap import colmap_binary_cameras, colmap_text_cameras
from cdff_common.camera.data_set_cameras import data_set_camera, depth_unit_m, xml_camera
from cdff_common.camera.elements import Cameras, Poses, numbers, square
from cdff_common.camera.kalibr import kalibr_cameras
from cdff_common.camera.lens_names import lens_of_document
from cdff_common.camera.model import CameraModel
from cdff_common.camera.stereo import StereoCalibration
from cdff_common.errors import InputError
from cdff_common.geometry import se3

#: Largest calibration file.
_MAX_BYTES = 1 << 20
#: Names used by OpenCV programs for two cameras: matrix and coefficients of each, rotation, translation.
_STEREO_NAMES = (
    (
        "camera_matrix_1",
        "distortion_coefficients_1",
        "camera_matrix_2",
        "distortion_coefficients_2",
        "rotation_matrix",
        "translation_coefficients",
    ),
    ("M1", "D1", "M2", "D2", "R", "T"),
    ("K1", "D1", "K2", "D2", "R", "T"),
    ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2", "R", "T"),
)
_SINGLE_NAMES = (
    ("camera_matrix", "distortion_coefficients"),
    ("cameraMatrix", "distCoeffs"),
    ("K", "D"),
)
_SIZE_NAMES = (
    ("image_width", "image_height"),
    ("imageWidth", "imageHeight"),
    ("width", "height"),
    ("Nu", "Nv"),
)


def read_camera(path: Path, name: str = "") -> CameraModel:
    """Read one camera.

    Parameters
    ----------
    path : Path
    name : str
        Camera of a file with several: ``cam0`` (Kalibr), ``P0``, ``00`` or ``rect_00`` (KITTI),
        ``1`` (OpenCV stereo); by default the first.

    Raises
    ------
    InputError
        If the file is not a supported calibration, or has no such camera.
    """
    cameras, _ = read_cameras(path)
    if name and name not in cameras:
        raise InputError(f"{path}: no camera {name!r}; it has {', '.join(cameras)}")
    return cameras[name] if name else next(iter(cameras.values()))


def read_stereo(path: Path, left: str = "", right: str = "") -> StereoCalibration:
    """Read two cameras, by default the file's first and second.

    Raises
    ------
    InputError
        If ``read_camera`` refuses the file, or the file does not contain the relative pose.
    """
    cameras, poses = read_cameras(path)
    names = list(cameras)
    if len(names) < 2:
        raise InputError(
            f"{path}: contains camera {names[0]} only, expected two cameras, or one and baseline_m"
        )
    left, right = left or names[0], right or names[1]
    for name in (left, right):
        if name not in poses:
            raise InputError(
                f"{path}: no pose of camera {name!r}; it contains those of {', '.join(poses) or 'none'}"
            )
    T = poses[right] @ np.linalg.inv(poses[left])
    return StereoCalibration.from_parts(cameras[left], cameras[right], T[:3, :3], T[:3, 3])


def read_cameras(path: Path) -> tuple[Cameras, Poses]:
    """Read all cameras, and the poses of the body in their frames if the file has them.

    Raises
    ------
    InputError
        If the file is not a supported calibration.
    """
    try:
        if path.name == "cameras.bin":
            return colmap_binary_cameras(_bytes(path)), {}
        text = _text(path)
        if kitti := _kitti_lines(text):
            return _of_kitti(kitti)
        if colmap := colmap_text_cameras(text):
            return colmap, {}
        document = _document(text)
        if "projection_parameters" in document:
            return {"camera": camodocal_camera(document)}, {}
        if any(re.fullmatch(r"cam\d+", str(key)) for key in document):
            return kalibr_cameras(document)
        if camera := data_set_camera(document):
            return {"camera": camera}, _body_pose(document)
        return _of_opencv(document)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise InputError(
            f"{path}: {type(error).__name__} {error}; expected a calibration of OpenCV, ROS, Kalibr, KITTI, "
            "COLMAP, camodocal or EuRoC"
        ) from error


def read_depth_unit(path: Path) -> float | None:
    """Return the metres of a depth value of 1; None if the file does not state them.

    Raises InputError if the file cannot be read, or the unit is not above 0.
    """
    text = _text(path)
    try:
        unit_m = None if _kitti_lines(text) else depth_unit_m(_document(text))
    except (InputError, TypeError, ValueError) as error:
        raise InputError(f"{path}: {error}") from error
    if unit_m is not None and not (np.isfinite(unit_m) and unit_m > 0):
        raise InputError(f"{path}: depth unit of {unit_m} m, expected above 0 m")
    return unit_m


def _text(path: Path) -> str:
    """Return the text of a file; raises InputError if it is too large or unreadable."""
    try:
        return _bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: {error}") from error


def _bytes(path: Path) -> bytes:
    """Return the bytes of a file; raises InputError if it is too large or unreadable."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(
                f"{path}: {path.stat().st_size} bytes, expected a calibration of at most {_MAX_BYTES}"
            )
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error}") from error


def _document(text: str) -> Mapping[str, Any]:
    """Return the fields of YAML, JSON or a ViSP configuration."""
    return xml_camera(text) if text.lstrip().startswith("<?xml") else _yaml(text)


def _body_pose(document: Mapping[str, Any]) -> Poses:
    """Return the pose of the body in the frame of the camera, of EuRoC's ``T_BS``."""
    if "T_BS" not in document:
        return {}
    return {"camera": se3.inverse(square(document["T_BS"], 4))}


# -- OpenCV
# -----------------------------------------------------------------------------------------------------------


class _Loader(yaml.SafeLoader):
    """YAML with OpenCV matrices; aliases are refused, since they can expand a small file."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise InputError("YAML with aliases, expected a file without")
        return super().compose_node(parent, index)


def _matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> NDArray[np.float64]:
    fields = loader.construct_mapping(node, deep=True)
    return np.array(fields["data"], dtype=np.float64).reshape(int(fields["rows"]), int(fields["cols"]))


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def _yaml(text: str) -> Mapping[str, Any]:
    """Return the mapping in a YAML text, which OpenCV may have written; raises InputError."""
    # OpenCV writes "%YAML:1.0", which is not valid YAML.
    body = re.sub(r"\A%YAML[:\s]1\.\d[^\n]*\n", "", text)
    try:
        document = yaml.load(body, Loader=_Loader)  # a subclass of SafeLoader
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"not YAML:  {str(error)[:200]}") from error
    if not isinstance(document, Mapping):
        raise InputError(f"contains a {type(document).__name__}, expected a mapping")
    return document


def _of_opencv(document: Mapping[str, Any]) -> tuple[Cameras, Poses]:
    """Return the cameras and relative poses of a calibration file of OpenCV."""
    size = next(
        ((int(document[w]), int(document[h])) for w, h in _SIZE_NAMES if w in document and h in document),
        (0, 0),
    )
    # OpenCV writes the mirror parameter of an omnidirectional camera separately.
    mirror = numbers(document["xi"]) if "xi" in document else []

    def camera(matrix: str, distortion: str) -> CameraModel:
        coefficients = [*mirror, *numbers(document.get(distortion, ()))]
        lens = lens_of_document(document)
        return CameraModel.from_matrix(
            square(document[matrix]), coefficients, cols=size[0], rows=size[1], lens=lens
        )

    for m1, d1, m2, d2, rotation, translation in _STEREO_NAMES:
        if m1 in document and m2 in document:
            cameras = {"1": camera(m1, d1), "2": camera(m2, d2)}
            if rotation not in document or translation not in document:
                return cameras, {}
            T_2_1 = se3.transform(square(document[rotation]), numbers(document[translation]))
            return cameras, {"1": np.eye(4), "2": T_2_1}
    for matrix, distortion in _SINGLE_NAMES:
        if matrix in document:
            model = camera(matrix, distortion)
            if "baseline_m" not in document:
                return {"camera": model}, {}
            # Short form of a rectified pair: two equal cameras, displaced along x by the baseline.
            (baseline_m,) = numbers(document["baseline_m"])
            if baseline_m <= 0.0:
                raise InputError(f"baseline_m {baseline_m}: expected above 0 m")
            T_right_left = se3.transform(np.eye(3), [-baseline_m, 0.0, 0.0])
            return {"left": model, "right": model}, {"left": np.eye(4), "right": T_right_left}
    names = ", ".join(n[0] for n in (*_STEREO_NAMES, *_SINGLE_NAMES))
    raise InputError(f"none of {names}; it has {', '.join(map(str, list(document)[:8]))}")


# -- KITTI
# ------------------------------------------------------------------------------------------------------------


def _kitti_lines(text: str) -> dict[str, NDArray[np.float64]]:
    """Return the named rows: ``P0: …``, ``K_00: …``, or unnamed rows of 12 (P0, P1, …); empty for other
    files.
    """
    rows: dict[str, NDArray[np.float64]] = {}
    for line in text.splitlines():
        name, colon, rest = line.partition(":")
        values = rest if colon else line
        if not values.strip() or name.strip() in ("calib_time", "corner_dist"):
            continue
        try:
            numbers = np.array(values.split(), dtype=np.float64)
        except ValueError:
            return {}
        if not colon and len(numbers) != 12:
            return {}
        rows[name.strip() if colon else f"P{len(rows)}"] = numbers
    camera_rows = [n for n in rows if re.fullmatch(r"P\d|P_rect_\d\d|K_\d\d", n)]
    return rows if camera_rows else {}


def _of_kitti(rows: Mapping[str, NDArray[np.float64]]) -> tuple[Cameras, Poses]:
    """Return the cameras and their poses from the rows of a calibration file of KITTI."""
    cameras: Cameras = {}
    poses: Poses = {}
    projections = {n: n for n in rows if re.fullmatch(r"P\d", n)}
    rectified = {n[2:]: n for n in rows if re.fullmatch(r"P_rect_\d\d", n)}
    for name in sorted(n[2:] for n in rows if re.fullmatch(r"K_\d\d", n)):
        cols, rows_px = (int(v) for v in rows[f"S_{name}"])
        distortion = rows.get(f"D_{name}", np.zeros(0))
        cameras[name] = CameraModel.from_matrix(
            rows[f"K_{name}"].reshape(3, 3), distortion, rows=rows_px, cols=cols
        )
        poses[name] = se3.transform(rows[f"R_{name}"].reshape(3, 3), rows[f"T_{name}"])
    for name, row in sorted((projections | rectified).items()):
        P = rows[row].reshape(3, 4)
        cols, rows_px = (int(v) for v in rows.get(f"S_{name}", (0, 0)))
        cameras[name] = CameraModel.from_matrix(P[:, :3], rows=rows_px, cols=cols)
        poses[name] = se3.transform(np.eye(3), np.linalg.solve(P[:, :3], P[:, 3]))
    return cameras, poses
