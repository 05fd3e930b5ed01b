# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration files of OpenCV (YAML), Kalibr (camchain) and KITTI, detected by their content."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from cdff_common.camera.model import CameraModel
from cdff_common.camera.stereo import StereoCalibration
from cdff_common.errors import InputError
from cdff_common.geometry import se3

_MAX_BYTES = 1 << 20
_MAX_ELEMENTS = 10_000
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
_SIZE_NAMES = (("image_width", "image_height"), ("imageWidth", "imageHeight"), ("width", "height"))
_FISHEYE = ("fisheye", "equidistant", "kannala_brandt")


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
    cameras, _ = _read(path)
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
    cameras, poses = _read(path)
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


Cameras = dict[str, CameraModel]
#: ``T_camera_body`` of each camera; the body frame is arbitrary.
Poses = dict[str, NDArray[np.float64]]


def _read(path: Path) -> tuple[Cameras, Poses]:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(
                f"{path}: {path.stat().st_size} bytes, expected a calibration of at most {_MAX_BYTES}"
            )
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error}") from error
    try:
        kitti = _kitti_lines(text)
        if kitti:
            return _of_kitti(kitti)
        document = _yaml(text)
        if any(re.fullmatch(r"cam\d+", str(key)) for key in document):
            return _of_kalibr(document)
        return _of_opencv(document)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise InputError(
            f"{path}: {type(error).__name__} {error}; expected OpenCV, Kalibr or KITTI calibration"
        ) from error


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
    size = next(
        ((int(document[w]), int(document[h])) for w, h in _SIZE_NAMES if w in document and h in document),
        (0, 0),
    )
    fisheye = str(document.get("camera_model", document.get("distortion_model", ""))).lower() in _FISHEYE

    def camera(matrix: str, distortion: str) -> CameraModel:
        coefficients = _numbers(document.get(distortion, ()))
        return CameraModel.from_matrix(
            _square(document[matrix]), coefficients, cols=size[0], rows=size[1], fisheye=fisheye
        )

    for m1, d1, m2, d2, rotation, translation in _STEREO_NAMES:
        if m1 in document and m2 in document:
            cameras = {"1": camera(m1, d1), "2": camera(m2, d2)}
            if rotation not in document or translation not in document:
                return cameras, {}
            T_2_1 = se3.transform(_square(document[rotation]), _numbers(document[translation]))
            return cameras, {"1": np.eye(4), "2": T_2_1}
    for matrix, distortion in _SINGLE_NAMES:
        if matrix in document:
            model = camera(matrix, distortion)
            if "baseline_m" not in document:
                return {"camera": model}, {}
            # Short form of a rectified pair: two equal cameras, displaced along x by the baseline.
            (baseline_m,) = _numbers(document["baseline_m"])
            if baseline_m <= 0.0:
                raise InputError(f"baseline_m {baseline_m}: expected above 0 m")
            T_right_left = se3.transform(np.eye(3), [-baseline_m, 0.0, 0.0])
            return {"left": model, "right": model}, {"left": np.eye(4), "right": T_right_left}
    names = ", ".join(n[0] for n in (*_STEREO_NAMES, *_SINGLE_NAMES))
    raise InputError(f"none of {names}; it has {', '.join(map(str, list(document)[:8]))}")


# -- Kalibr
# -----------------------------------------------------------------------------------------------------------


def _of_kalibr(document: Mapping[str, Any]) -> tuple[Cameras, Poses]:
    cameras: Cameras = {}
    poses: Poses = {}
    # T_camera_first; None after a missing link of the chain.
    T: NDArray[np.float64] | None = np.eye(4)
    previous: int | None = None
    for name in sorted((k for k in document if re.fullmatch(r"cam\d+", str(k))), key=lambda k: int(k[3:])):
        entry = document[name]
        lens, distortion = entry["camera_model"], entry.get("distortion_model", "none")
        if lens != "pinhole" or distortion not in ("radtan", "equidistant", "none"):
            raise InputError(
                f"{name}: {lens} with {distortion}, expected pinhole with radtan, equidistant or none"
            )
        fx, fy, cx, cy = _numbers(entry["intrinsics"])
        cols, rows = (int(v) for v in entry["resolution"])
        coefficients = [] if distortion == "none" else _numbers(entry["distortion_coeffs"])
        fisheye = distortion == "equidistant"
        K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
        cameras[name] = CameraModel.from_matrix(K, coefficients, rows=rows, cols=cols, fisheye=fisheye)
        number = int(name[3:])
        if previous is not None:
            is_consecutive = previous == number - 1 and "T_cn_cnm1" in entry
            T = _square(entry["T_cn_cnm1"], 4) @ T if T is not None and is_consecutive else None
        previous = number
        if T is not None:
            poses[name] = T
    return cameras, poses


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


def _square(value: Any, n: int = 3) -> NDArray[np.float64]:
    return np.asarray(value, dtype=np.float64).reshape(n, n)


def _numbers(value: Any) -> Sequence[float]:
    flat = np.asarray(value, dtype=np.float64).reshape(-1)
    if len(flat) > _MAX_ELEMENTS or not np.isfinite(flat).all():
        raise InputError(f"{len(flat)} numbers, expected finite ones and at most {_MAX_ELEMENTS}")
    return [float(v) for v in flat]
