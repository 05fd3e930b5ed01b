# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cameras of a COLMAP reconstruction: ``cameras.txt`` and ``cameras.bin``.

In COLMAP the centre of the first pixel is (0.5, 0.5), here (0, 0): half a pixel is subtracted from the
principal point.

References
----------
.. [1] Schönberger, J. L., Frahm, J.-M. (2016). Structure-from-motion revisited. CVPR.
   doi:10.1109/CVPR.2016.445
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence

from cdff_common.camera.elements import Cameras
from cdff_common.camera.lenses import LensName
from cdff_common.camera.model import CameraModel
from cdff_common.errors import InputError

#: Lens, number of focal lengths and number of coefficients of the models, by name; the number is that of the
#: binary file.
_MODELS: dict[str, tuple[int, LensName, int, int]] = {
    "SIMPLE_PINHOLE": (0, "pinhole", 1, 0),
    "PINHOLE": (1, "pinhole", 2, 0),
    "SIMPLE_RADIAL": (2, "pinhole", 1, 1),
    "RADIAL": (3, "pinhole", 1, 2),
    "OPENCV": (4, "pinhole", 2, 4),
    "OPENCV_FISHEYE": (5, "fisheye", 2, 4),
    "FULL_OPENCV": (6, "pinhole", 2, 8),
    "FOV": (7, "fov", 2, 1),
    "SIMPLE_RADIAL_FISHEYE": (8, "fisheye", 1, 1),
    "RADIAL_FISHEYE": (9, "fisheye", 1, 2),
    "SIMPLE_DIVISION": (12, "division", 1, 1),
    "DIVISION": (13, "division", 2, 1),
    "SIMPLE_FISHEYE": (14, "fisheye", 1, 0),
    "FISHEYE": (15, "fisheye", 2, 0),
}
_NAMES_BY_NUMBER = {number: name for name, (number, *_) in _MODELS.items()}
#: Largest number of cameras of a file.
_MAX_CAMERAS = 100_000
_LINE = re.compile(r"(\d+)\s+([A-Z_]+)\s+(\d+)\s+(\d+)((?:\s+\S+)+)")


def colmap_text_cameras(text: str) -> Cameras:
    """Return the cameras of ``cameras.txt`` by their numbers; empty if the text has another form.

    Raises
    ------
    InputError
        If the model of a camera is not supported, or its numbers are not those of the model.
    """
    cameras: Cameras = {}
    for line in text.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        match = _LINE.fullmatch(line.strip())
        if match is None:
            return {}
        number, model, width, height, parameters = match.groups()
        values = [float(v) for v in parameters.split()]
        cameras[number] = _camera(model, int(width), int(height), values)
    return cameras


def colmap_binary_cameras(data: bytes) -> Cameras:
    """Return the cameras of ``cameras.bin`` by their numbers.

    Raises
    ------
    InputError
        As ``colmap_text_cameras``, or if the bytes are not such a file.
    """
    try:
        (count,) = struct.unpack_from("<Q", data)
        if not 0 < count <= _MAX_CAMERAS:
            raise InputError(f"cameras.bin of {count} cameras: expected 1 to {_MAX_CAMERAS}")
        offset, cameras = 8, {}
        for _ in range(count):
            number, model, width, height = struct.unpack_from("<IiQQ", data, offset)
            if model not in _NAMES_BY_NUMBER:
                raise InputError(
                    f"COLMAP camera model number {model}: expected one of {sorted(_NAMES_BY_NUMBER)}"
                )
            name = _NAMES_BY_NUMBER[model]
            _, _, focal_lengths, coefficients = _MODELS[name]
            values = struct.unpack_from(f"<{focal_lengths + 2 + coefficients}d", data, offset + 24)
            cameras[str(number)] = _camera(name, width, height, values)
            offset += 24 + 8 * len(values)
    except struct.error as error:
        raise InputError(f"cameras.bin of {len(data)} bytes ends within a camera: {error}") from error
    if offset != len(data):
        raise InputError(f"cameras.bin of {len(data)} bytes: expected {offset} for its {count} cameras")
    return cameras


def _camera(name: str, width: int, height: int, values: Sequence[float]) -> CameraModel:
    """Return one camera; raises InputError."""
    if name not in _MODELS:
        raise InputError(f"COLMAP camera model {name}: expected one of {', '.join(_MODELS)}")
    _, lens, focal_lengths, coefficients = _MODELS[name]
    if len(values) != focal_lengths + 2 + coefficients:
        raise InputError(
            f"COLMAP camera {name} with {len(values)} parameters: expected {focal_lengths + 2 + coefficients}"
        )
    fx, fy = values[0], values[focal_lengths - 1]
    cx, cy = values[focal_lengths], values[focal_lengths + 1]
    distortion = list(values[focal_lengths + 2 :])
    if lens != "fov" and lens != "division" and 0 < len(distortion) < 4:
        distortion += [0.0] * (4 - len(distortion))
    K = [[fx, 0.0, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]]
    return CameraModel.from_matrix(K, distortion, rows=height, cols=width, lens=lens)
