# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of files for array ports, such as ``float64[n,3]``, and for scalar ports."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.formats.clouds import CLOUD_FORMATS, read_cloud
from cdff_common.formats.file_source import Source, load
from cdff_common.formats.format_detection import detect
from cdff_common.formats.geotiff import read_bands
from cdff_common.formats.image import read_image
from cdff_common.formats.npz import read_npz
from cdff_common.formats.pose import read_pose
from cdff_common.formats.tum import read_tum
from cdff_common.interfaces.array_ports import ARRAY_TYPE, SCALAR_TYPES
from cdff_common.interfaces.description import Port

#: Text that is a list of numbers or a truth value, not a file name.
_NUMBERS = re.compile(r"[\[\]\s0-9eE+.,-]+\Z|true\Z|false\Z")


def read_array(port: Port, text: str) -> Any:
    """Return the value of an array or scalar port from a file, or from the numbers in ``text``.

    Of a point cloud the points are read, or the normals or intensities if the name of the port contains these
    words; of an image the pixels, converted to grey if the port has two dimensions; of a pose the matrix; of
    an npz file the array with the name of the port, or the only array.

    Raises
    ------
    InputError
        If the content does not have the type and shape of the port; the message names port and file.
    """
    if port.type == "str":
        return text
    match = ARRAY_TYPE.match(port.type)
    dtype, dims = match.group("dtype", "shape") if match else (SCALAR_TYPES[port.type], "")
    shape = tuple(s.strip() for s in dims.split(",") if s.strip())
    values: Any
    if not Path(text).exists() and _NUMBERS.match(text.strip()):
        name = text
        try:
            values = json.loads(text if text.strip()[0] in "[tf" or not shape else f"[{text}]")
        except ValueError as error:
            raise InputError(f"{port.attribute}={text}: {error}; expected {port.type}") from error
    else:
        source = load(text)
        values, name = _content(port, shape, source), source.name
    try:
        array = np.asarray(values)
        converted = array.astype(dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{port.attribute}={name}: {error}; expected {port.type}") from error
    sizes = [int(s) if s.isdigit() else None for s in shape]  # None: any size
    fits = converted.ndim == len(sizes) and all(
        n in (None, m) for n, m in zip(sizes, converted.shape, strict=True)
    )
    if not fits:
        raise InputError(f"{port.attribute}={name}: shape {converted.shape}, expected {port.type}")
    return np.ascontiguousarray(converted) if sizes else converted.item()


def _content(port: Port, shape: tuple[str, ...], source: Source) -> Any:
    """Return the array in a file that corresponds to a port with a shape such as ``("n", "3")``."""
    fmt = detect(source)
    if fmt in CLOUD_FORMATS and not (fmt == "npz" and shape[-1:] != ("3",)):
        cloud = read_cloud(source, fmt)
        if "normal" in port.attribute:
            if cloud.normals is None:
                raise InputError(f"{port.attribute}={source.name}: the cloud has no normals")
            return cloud.normals
        if "intensity" in port.attribute and cloud.intensity is not None:
            return cloud.intensity
        return cloud.points_m
    if shape == ("4", "4") and fmt in ("json", "pose_txt", "tum"):
        return read_pose(source).T.matrix
    if fmt == "tum" and (shape[1:] == ("4", "4") or "stamps_ns" in port.attribute):
        stamps_ns, T = read_tum(source)
        return stamps_ns if "stamps_ns" in port.attribute else T
    if fmt in ("png", "jpg", "pgm", "ppm"):
        return grey(read_image(source)) if len(shape) == 2 else read_image(source)
    if fmt == "tif":
        bands = list(read_bands(source)[0].values())
        return bands[0] if len(shape) == 2 else np.stack(bands, axis=-1)
    if fmt == "npz":
        return _from_npz(port, source)
    if fmt == "json":
        data = json.loads(source.data)
        return data.get("value", data.get(port.attribute)) if isinstance(data, dict) else data
    if fmt in ("csv", "tum", "pose_txt"):
        return _from_text(source)
    raise InputError(f"{port.attribute}={source.name}: a {fmt} file, expected {port.type}")


def grey(image: NDArray[Any]) -> NDArray[Any]:
    """Return the luma of a colour image (ITU-R BT.601), or a grey image unchanged."""
    if image.ndim == 2:
        return image
    luma = image[:, :, :3].astype(np.float64) @ np.array([0.299, 0.587, 0.114])
    rounded: NDArray[Any] = np.rint(luma).astype(image.dtype)
    return rounded


def _from_npz(port: Port, source: Source) -> NDArray[Any]:
    """Return the array of a port in an NPZ file, or its only array; raises InputError."""
    arrays = read_npz(source)
    if port.attribute in arrays:
        return arrays[port.attribute]
    if len(arrays) == 1:
        return next(iter(arrays.values()))
    raise InputError(
        f"{port.attribute}={source.name}: holds {', '.join(arrays)}, expected an array {port.attribute}"
    )


def _from_text(source: Source) -> NDArray[np.float64]:
    """Return rows of numbers that are separated by commas or blanks; a first row of names is skipped."""
    lines = [line.split("#")[0] for line in source.data.decode("utf-8", "replace").splitlines()]
    rows = [line.replace(",", " ").split() for line in lines if line.strip()]
    try:
        float(rows[0][0])
    except (IndexError, ValueError):
        rows = rows[1:]
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{source.name}: {error}; expected rows with equal numbers of values") from error
