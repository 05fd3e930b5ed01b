# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writing of the outputs of a run as files, with ``outputs.json``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.dict_form import to_dict_form
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.geotiff import write_bands
from cdff_common.formats.image import write_png
from cdff_common.formats.npz import write_npz
from cdff_common.formats.payload import FORMATS, pose_value, to_file
from cdff_common.formats.ply import write_ply
from cdff_common.formats.pose import PoseValue
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.description import Port
from cdff_common.interfaces.product import Status
from cdff_common.json_form import jsonable
from cdff_common.output import storage_errors
from cdff_common.types import Frame, ObjectDetections
from cdff_common.types.message import Message
from cdff_common.types.summary import array_text
from cdff_common.value_text import value_lines
from cdff_dev.run.cameras import camera_document
from cdff_dev.run.execution import PortValue, Result

#: Largest number of elements of an array that is stored in ``outputs.json``.
_INLINE_ELEMENTS = 64


def write_outputs(result: Result, folder: Path) -> dict[str, Any]:
    """Write each output and ``outputs.json`` to ``folder``; return the content of ``outputs.json``.

    If a port has several values, the last is in ``<port>.<ext>`` and the previous ones are in
    ``<port>.<index>.<ext>``. A pose graph or a bundle problem is written to a file only; its ``value``
    contains the metrics of the run. If the run has FAILED, no value is written.

    Raises
    ------
    StorageError
        If the folder cannot be written.
    """
    failed = result.quality.status is Status.FAILED
    outputs: dict[str, Any] = {}
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for port in result.ports:
            entry: dict[str, Any] = {"type": port.type_name}
            values = [e for e in result.outputs.get(port.attribute, []) if e.value is not None]
            for index, output in enumerate([] if failed else values):
                stem = port.attribute if index == len(values) - 1 else f"{port.attribute}.{index}"
                entry |= _write(port, output, folder, stem)
                shift = [result.quality.metrics.get(f"shift_{axis}") for axis in ("columns", "rows")]
                if port.type_name == "TransformWithCovariance" and None not in shift:
                    entry["value"]["shift_cells"] = shift
                if port.type_name in ("PoseGraph", "BundleProblem"):
                    entry["value"] = dict(result.quality.metrics)
            if len(values) > 1 and not failed:
                entry["count"] = len(values)
            outputs[port.attribute] = entry
        plain: dict[str, Any] = jsonable({"outputs": outputs, **_quality_and_cost(result)})
        _write_json(folder, "outputs.json", plain)
    return plain


def output_document(result: Result) -> dict[str, Any]:
    """Return outputs, quality and cost as plain data with the last value of each port in full."""
    failed = result.quality.status is Status.FAILED
    outputs: dict[str, Any] = {}
    for port in result.ports:
        value = None if failed else _last_value(result, port.attribute)
        plain_value = to_dict_form(value) if port.is_message and value is not None else value
        outputs[port.attribute] = {"type": port.type_name} | ({} if value is None else {"value": plain_value})
    document: dict[str, Any] = jsonable({"outputs": outputs, **_quality_and_cost(result)})
    return document


def drawn_values(result: Result) -> dict[str, Any]:
    """Return the last value of each port, by port."""
    values = {port.attribute: _last_value(result, port.attribute) for port in result.ports}
    return {port: value for port, value in values.items() if value is not None}


def value_text(result: Result, port: str) -> list[str]:
    """Return the last value of a port in words and units; arrays as dtype, shape and range."""
    value = None if result.quality.status is Status.FAILED else _last_value(result, port)
    if value is None:
        return []
    if isinstance(value, np.ndarray):
        return [] if value.size <= _INLINE_ELEMENTS else [array_text(value)]
    return (
        [line for line in value_lines(value) if line != type(value).__name__]
        if isinstance(value, Message)
        else []
    )


def _last_value(result: Result, port: str) -> Any:
    values = [output.value for output in result.outputs.get(port, []) if output.value is not None]
    return values[-1] if values else None


def _quality_and_cost(result: Result) -> dict[str, Any]:
    return {
        "quality": result.quality.to_dict(),
        "wall_s": round(result.wall_s, 6),
        "cpu_s": round(result.cpu_s, 6),
    }


def _write(port: Port, output: PortValue, folder: Path, stem: str) -> dict[str, Any]:
    """Write one value; return its ``file`` and, if it is small, its ``value``."""
    if not port.is_message:
        return _write_array(port, np.asarray(output.value), folder, stem)
    value = output.value
    name = type(value).__name__
    if name == "TransformWithCovariance":
        return _write_pose(pose_value(value, str(output.covariance_kind)), folder, stem)
    if name == "ObjectDetections":
        detections = detections_value(value, str(output.covariance_kind))
        return {**_write_json(folder, f"{stem}.json", detections), "value": detections}
    if name in FORMATS:
        fmt = FORMATS[name][0]
        if name == "Frame" and value.image.dtype.kind == "f":
            fmt = "tif"
        if name == "BundleProblem" and len(value.lenses.values) == 1 < len(value.cameras.ids):
            fmt = "libmv"
        camera = _write_camera(value, folder, stem) if name == "Frame" else {}
        return _write_bytes(folder, f"{stem}.{fmt}", to_file(value, fmt)) | camera
    return _write_json(folder, f"{stem}.json", jsonable(to_dict_form(value)))


def detections_value(value: ObjectDetections, covariance_kind: str) -> list[dict[str, Any]]:
    """Return detections as ``{model, pose, score, symmetric_poses}``, best first; poses as in pose files."""
    rows = []
    for detection in value.detections:
        pose = pose_value(detection.pose, covariance_kind)
        symmetric = [
            PoseValue(UncertainTransform(T), pose.parent, pose.child, pose.stamp_ns).to_json()
            for T in detection.symmetric_matrices
        ]
        rows.append(
            {
                "model": detection.label,
                "pose": pose.to_json(),
                "score": detection.score,
                "symmetric_poses": symmetric,
            }
        )
    return rows


def _write_array(port: Port, array: NDArray[Any], folder: Path, stem: str) -> dict[str, Any]:
    """Write an array as a pose, image, cloud or NPZ file, or return it as a value if it is small."""
    if array.shape == (4, 4) and se3.is_transform(array):
        return _write_pose(PoseValue(UncertainTransform(array)), folder, stem)
    if array.size <= _INLINE_ELEMENTS and "n" not in port.type.partition("[")[2]:
        return {"value": array.tolist()}
    if array.ndim == 2 and array.shape[1] == 3 and "points" in port.attribute:
        return _write_bytes(folder, f"{stem}.ply", write_ply(CloudArrays.of(array)))
    if array.ndim == 2 and "[r,c" in port.type:
        if array.dtype in (np.uint8, np.uint16):
            return _write_bytes(folder, f"{stem}.png", write_png(array))
        return _write_bytes(folder, f"{stem}.tif", write_bands({port.attribute: array}))
    return _write_bytes(folder, f"{stem}.npz", write_npz({port.attribute: array}))


def _write_camera(image: Frame, folder: Path, stem: str) -> dict[str, Any]:
    """Write the camera of an image as a calibration file for ``PORT=IMAGE,CAMERA``; return its name.

    Image files do not contain the camera. Nothing is written for an image without a camera.
    """
    document = camera_document(image)
    if document is None:
        return {}
    return {"camera": _write_json(folder, f"{stem}.camera.json", document)["file"]}


def _write_pose(pose: PoseValue, folder: Path, stem: str) -> dict[str, Any]:
    value = pose.to_json()
    return {**_write_json(folder, f"{stem}.json", value), "value": value}


def _write_bytes(folder: Path, name: str, data: bytes) -> dict[str, Any]:
    (folder / name).write_bytes(data)
    return {"file": name}


def _write_json(folder: Path, name: str, value: Any) -> dict[str, Any]:
    return _write_bytes(folder, name, (json.dumps(value, indent=1) + "\n").encode())
