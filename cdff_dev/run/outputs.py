# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outputs as files, and ``outputs.json`` (contract §2)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.json_form import json_safe
from cdff_common.errors import StorageError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.payload import FORMATS, pose_value, to_file
from cdff_common.formats.pose import PoseValue
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.description import ARRAY_TYPE, Port
from cdff_common.interfaces.product import Status
from cdff_common.types import Frame
from cdff_dev.run.cameras import camera_document
from cdff_dev.run.execute import Emitted, Result

_INLINE_ELEMENTS = 64


def write_outputs(result: Result, folder: Path) -> dict[str, Any]:
    """Write each output and ``outputs.json`` into ``folder``, and return what the latter holds.

    A port that gave several values has the last in ``<port>.<ext>``, the earlier ones in ``<port>.<index>.<ext>``.
    A graph or a bundle, which is a file only, has the metrics of the run as its value.
    Where the run FAILED no value is written.

    Raises
    ------
    StorageError
        If the folder cannot be written.
    """
    failed = result.quality.status is Status.FAILED
    outputs: dict[str, Any] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for port in result.ports:
            entry: dict[str, Any] = {"type": port.type_name}
            values = [e for e in result.outputs.get(port.attribute, []) if e.value is not None]
            for index, emitted in enumerate([] if failed else values):
                stem = port.attribute if index == len(values) - 1 else f"{port.attribute}.{index}"
                entry |= _write(port, emitted, folder, stem)
                if port.type_name in ("PoseGraph", "BundleProblem"):
                    entry["value"] = dict(result.quality.metrics)
            if len(values) > 1 and not failed:
                entry["count"] = len(values)
            outputs[port.attribute] = entry
        report = {
            "outputs": outputs,
            "quality": result.quality.to_dict(),
            "wall_s": round(result.wall_s, 6),
            "cpu_s": round(result.cpu_s, 6),
        }
        plain: dict[str, Any] = json_safe(report)
        (folder / "outputs.json").write_text(json.dumps(plain, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise StorageError(f"{folder}: cannot be written: {error.strerror or error}") from error
    return plain


def _write(port: Port, emitted: Emitted, folder: Path, stem: str) -> dict[str, Any]:
    """Write one value; return its ``file`` and, where it is small, its ``value``."""
    if ARRAY_TYPE.match(port.type):
        return _write_array(port, np.asarray(emitted.value), folder, stem)
    value = emitted.value
    name = type(value).__name__
    if name == "TransformWithCovariance":
        return _write_pose(pose_value(value, str(emitted.covariance_kind)), folder, stem)
    if name in FORMATS:
        fmt = FORMATS[name][0]
        if name == "Frame" and value.image.dtype.kind == "f":
            fmt = "tif"
        if name == "BundleProblem" and len(value.lenses.values) == 1 < len(value.cameras.ids):
            fmt = "libmv"
        camera = _write_camera(value, folder, stem) if name == "Frame" else {}
        return _put(folder, f"{stem}.{fmt}", to_file(value, fmt)) | camera
    from cdff_common.codecs.plain import to_plain

    plain = json_safe(to_plain(value))
    return _put(folder, f"{stem}.json", (json.dumps(plain, indent=1, allow_nan=False) + "\n").encode())


def _write_array(port: Port, array: NDArray[Any], folder: Path, stem: str) -> dict[str, Any]:
    if array.shape == (4, 4) and se3.is_transform(array):
        return _write_pose(PoseValue(UncertainTransform(array)), folder, stem)
    if array.size <= _INLINE_ELEMENTS and "n" not in port.type.partition("[")[2]:
        return {"value": array.tolist()}
    if array.ndim == 2 and array.shape[1] == 3 and "points" in port.attribute:
        from cdff_common.formats.ply import write_ply

        return _put(folder, f"{stem}.ply", write_ply(CloudArrays.of(array)))
    if array.ndim == 2 and "[r,c" in port.type:
        from cdff_common.formats.geotiff import write_bands
        from cdff_common.formats.image import write_png

        if array.dtype in (np.uint8, np.uint16):
            return _put(folder, f"{stem}.png", write_png(array))
        return _put(folder, f"{stem}.tif", write_bands({port.attribute: array}))
    from cdff_common.formats.npz import write_npz

    return _put(folder, f"{stem}.npz", write_npz({port.attribute: array}))


def _write_camera(image: Frame, folder: Path, stem: str) -> dict[str, Any]:
    """The camera of an image, which pictures do not hold, as the calibration file of ``PORT=IMAGE,CAMERA``."""
    document = camera_document(image)
    if document is None:
        return {}
    return {"camera": _put(folder, f"{stem}.camera.json", (json.dumps(document, indent=1) + "\n").encode())["file"]}


def _write_pose(pose: PoseValue, folder: Path, stem: str) -> dict[str, Any]:
    value = pose.to_json()
    return {**_put(folder, f"{stem}.json", (json.dumps(value, indent=1) + "\n").encode()), "value": value}


def _put(folder: Path, name: str, data: bytes) -> dict[str, Any]:
    (folder / name).write_bytes(data)
    return {"file": name}
