# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples of a stream as files: poses as TUM, clouds as PLY or PCD, images as PNG, numbers as CSV."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.image import write_png
from cdff_common.formats.pcd import write_pcd
from cdff_common.formats.ply import write_ply
from cdff_common.formats.tum import write_tum
from cdff_common.output import make_folder, removed_after_error, storage_errors, write_file
from cdff_common.types import DistanceImage, Frame, FramePair, LidarScan, Pointcloud
from cdff_common.types.message import Message
from cdff_dev.logs.source import LogSource

_POSES = ("TransformWithCovariance", "RigidBodyState")
_CLOUDS = ("LidarScan", "Pointcloud")
_IMAGES = ("Frame", "FramePair", "DistanceImage")
#: Largest number of elements of an array that is written to a table, each in a column of its own.
_MAX_COLUMNS = 64
#: Depth images of 16 bits contain millimetres.
_MILLIMETRES = 1000.0
_NS_PER_S = 1_000_000_000
#: Intensities of 16 bits are written as 0 to 255, which drivers and viewers expect.
_INTENSITY_FACTOR = 257.0


def export_stream(log: LogSource, stream: str, out: Path) -> int:
    """Write the samples of a stream; returns their number.

    Parameters
    ----------
    log : LogSource
    stream : str
    out : Path
        ``NAME.tum`` for poses, ``NAME.csv`` for numbers of any type. A folder for clouds (``FOLDER.ply`` or
        ``FOLDER.pcd`` by its suffix, PLY by default) and images, one file per sample with its number as name,
        and ``times.txt`` with their stamps in seconds.

    Raises
    ------
    InputError
        If the stream is not in the log, or its type cannot be written in this format.
    StorageError
        If a file cannot be written.
    """
    if stream not in log.streams:
        raise InputError(f"stream {stream!r}: expected one of {', '.join(log.streams)}")
    type_name = log.streams[stream].type_name
    suffix = out.suffix.lower()
    if suffix == ".csv":
        return _write_table(log, stream, out)
    if suffix == ".tum" and type_name in _POSES:
        return _write_trajectory(log, stream, out)
    if suffix in ("", ".ply", ".pcd") and type_name in _CLOUDS:
        return _write_files(log, stream, out, suffix or ".ply", _cloud_files)
    if suffix in ("", ".png") and type_name in _IMAGES:
        return _write_files(log, stream, out, ".png", _image_files)
    raise InputError(
        f"--out {out}: not a format of {type_name}; expected .tum for poses, a folder or folder name with "
        ".ply or .pcd for clouds, a folder for images, .csv for numbers"
    )


def _write_trajectory(log: LogSource, stream: str, out: Path) -> int:
    samples = [(s.stamp_ns, s.value.transform.matrix) for s in log.samples([stream])]
    stamps_ns, matrices = [stamp for stamp, _ in samples], [T for _, T in samples]
    write_file(out, write_tum(np.array(stamps_ns, np.int64), np.array(matrices).reshape(-1, 4, 4)))
    return len(samples)


def _write_table(log: LogSource, stream: str, out: Path) -> int:
    """Write the numbers of each sample as a row; the columns are those of the first sample."""
    count = 0
    columns: list[str] = []
    with (
        storage_errors(out),
        out.open("w", encoding="utf-8", newline="") as file,
        removed_after_error(out),
    ):
        writer = csv.writer(file)
        for sample in log.samples([stream]):
            row = dict(_numbers(sample.value, ""))
            if not columns:
                columns = list(row)
                if not columns:
                    raise InputError(f"stream {stream}: a {sample.type_name} has no numbers for a table")
                writer.writerow(["stamp_ns", *columns])
            if list(row) != columns:
                raise InputError(f"stream {stream}: sample {sample.seq} has other columns than the first one")
            writer.writerow([sample.stamp_ns, *row.values()])
            count += 1
        file.flush()
    return count


def _numbers(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield path and value of the numbers of a message; arrays of more than 64 numbers are not in a table."""
    if isinstance(value, Message):
        for item in fields(value):  # type: ignore[arg-type]
            yield from _numbers(getattr(value, item.name), f"{path}.{item.name}" if path else item.name)
    elif isinstance(value, np.ndarray):
        if value.size <= _MAX_COLUMNS:
            yield from ((f"{path}.{i}", number) for i, number in enumerate(value.ravel().tolist()))
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _numbers(item, f"{path}.{i}")
    elif isinstance(value, bool | int | float):
        yield path, value


_Files = Callable[[Any, str], Iterator[tuple[str, bytes]]]


def _write_files(log: LogSource, stream: str, out: Path, suffix: str, contents: _Files) -> int:
    """Write a file per sample and ``times.txt``; return the number of samples."""
    folder = make_folder(out)
    times = []
    for number, sample in enumerate(log.samples([stream])):
        for side, data in contents(sample.value, suffix):
            write_file(make_folder(folder / side) / f"{number:06d}{suffix}", data)
        times.append(f"{sample.stamp_ns // _NS_PER_S}.{sample.stamp_ns % _NS_PER_S // 1000:06d}\n")
    write_file(folder / "times.txt", "".join(times).encode())
    return len(times)


def _cloud_files(value: LidarScan | Pointcloud, suffix: str) -> Iterator[tuple[str, bytes]]:
    """Yield the file of a scan or cloud as PLY or PCD."""
    if isinstance(value, LidarScan):
        intensity = None if value.intensity is None else value.intensity / _INTENSITY_FACTOR
        cloud = CloudArrays.of(value.points_m, intensity=intensity)
    else:
        cloud = CloudArrays.of(
            value.data.points, intensity=value.data.intensity if len(value.data.intensity) else None
        )
    yield "", write_ply(cloud) if suffix == ".ply" else write_pcd(cloud)


def _image_files(value: Frame | FramePair | DistanceImage, _: str) -> Iterator[tuple[str, bytes]]:
    """Yield images; depths are in millimetres with 16 bits."""
    if isinstance(value, DistanceImage):
        depths = np.rint(np.nan_to_num(value.data) * _MILLIMETRES).clip(0, 65535).astype(np.uint16)
        yield "", write_png(depths.reshape(value.height, value.width))
    elif isinstance(value, FramePair):
        yield from (("left", _png(value.left)), ("right", _png(value.right)))
    else:
        yield "", _png(value)


def _png(frame: Frame) -> bytes:
    """Return an image as PNG in the order of colours that its mode states."""
    image = frame.image
    is_bgr = image.ndim == 3 and frame.metadata.mode.name == "MODE_BGR"
    return write_png(np.ascontiguousarray(image[..., ::-1]) if is_bgr else image)
