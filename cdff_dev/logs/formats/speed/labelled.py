# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Folders of SPEED and SPEED+ as logs: single images with the true pose of the spacecraft.

Park, T. H., Maertens, M., Lecuyer, G., Izzo, D., D'Amico, S. (2022). SPEED+: next-generation dataset for
spacecraft pose estimation across domain gap. IEEE Aerospace Conference. doi:10.1109/AERO53065.2022.9843439
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.camera import read_camera
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_dev.logs.file_stamps import file_stamps
from cdff_dev.logs.formats.speed import label_files
from cdff_dev.logs.image_streams import frame_stream, pose_stream
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted

ROBOT = "speed"
_IMAGE, _TRUTH = f"/{ROBOT}/camera.frame", f"/{ROBOT}/truth.target"
_MAX_BYTES = 1 << 26
#: Names of the true quaternion (w, x, y, z) and position, metres, in SPEED+ and in SPEED.
_QUATERNIONS = ("q_vbs2tango_true", "q_vbs2tango")
_POSITION = "r_Vo2To_vbs_true"


def labelled_log(folder: Path, calibration: Path | None = None) -> IndexedLog:
    """Open the labelled images of a folder as ``/speed/camera.frame`` and ``/speed/truth.target``.

    The pose is that of the target ``speed/target`` in the camera ``speed/camera``. The images are not a
    sequence: the number in a name times 100 ms is its stamp. Of images that are in several files of labels,
    or of which a file is missing, none is left out in silence.

    Raises
    ------
    InputError
        If a file of labels or the camera cannot be read.
    """
    labels: dict[str, dict[str, Any]] = {}
    for path in label_files(folder):
        labels |= {entry["filename"]: entry for entry in _read(path)}
    files = {name: _image(folder, name) for name in sorted(labels)}
    present = [name for name, path in files.items() if path is not None]
    missing = len(files) - len(present)
    unconverted = {"labels": Unconverted("label", missing, "the image is missing")} if missing else {}
    if not present:
        raise InputError(f"{folder}: none of {len(files)} labelled images exists, expected them in images/")
    images = [path for path in files.values() if path is not None]
    stamps_ns = file_stamps(images)
    default = next(
        p / "camera.json" for p in (folder, folder.resolve().parent) if (p / "camera.json").is_file()
    )
    camera = read_camera(calibration or default)
    streams: dict[str, IndexedStream] = {_IMAGE: frame_stream(_IMAGE, images, stamps_ns, camera)}
    posed = [i for i, name in enumerate(present) if _quaternion(labels[name]) is not None]
    if posed:
        chosen = [labels[present[i]] for i in posed]
        wxyz = np.array([_quaternion(entry) for entry in chosen])
        t_m = np.array([entry[_POSITION] for entry in chosen])
        # The quaternions rotate the axes of the camera to those of the target: p_camera = R(q) p_target + t.
        T = se3.transform_from_quaternion_xyzw(t_m, wxyz[:, [1, 2, 3, 0]])
        streams[_TRUTH] = pose_stream(
            _TRUTH, T, stamps_ns[posed], parent=f"{ROBOT}/camera", child=f"{ROBOT}/target"
        )
    used_files = {*images, *label_files(folder), default, calibration or default}
    others = other_files(folder, used_files.__contains__, "not a label or a labelled image")
    return IndexedLog(streams, others | unconverted)


def _read(path: Path) -> list[dict[str, Any]]:
    """Return the checked labels of a file; raises InputError."""
    if path.stat().st_size > _MAX_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes, expected at most {_MAX_BYTES}")
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
        for entry in entries:
            if not isinstance(entry["filename"], str) or "/" in entry["filename"]:
                raise ValueError(f"file name {entry['filename']!r}")
            if (q := _quaternion(entry)) is not None:
                values = np.array([*q, *entry[_POSITION]], dtype=np.float64)
                if values.shape != (7,) or not np.isfinite(values).all() or not values[:4].any():
                    raise ValueError(f"pose of {entry['filename']}")
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: {type(error).__name__} {error}; expected labels of SPEED") from error
    return list(entries)


def _quaternion(entry: dict[str, Any]) -> Any | None:
    return next((entry[name] for name in _QUATERNIONS if name in entry), None)


def _image(folder: Path, name: str) -> Path | None:
    candidates = (folder / "images" / name, folder / name)
    return next((path for path in candidates if path.is_file()), None)
