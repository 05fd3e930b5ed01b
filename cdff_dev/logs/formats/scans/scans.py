# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files with one lidar scan each as a log."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from cdff_common.errors import CodecError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.clouds import CLOUD_FORMATS, read_cloud
from cdff_common.formats.file_source import Source, load
from cdff_common.formats.format_detection import detect
from cdff_common.formats.kitti_bin import ROW_BYTES, looks_like_scan
from cdff_common.formats.xyz import read_xyz
from cdff_common.types import LidarScan
from cdff_dev.logs.file_stamps import file_stamps
from cdff_dev.logs.formats.scans.e57 import MAGIC, read_e57
from cdff_dev.logs.indexed import IndexedLog, IndexedStream, headers
from cdff_dev.logs.other_files import other_files

logger = logging.getLogger(__name__)

ROBOT = "robot"
SCAN = f"/{ROBOT}/lidar.scan"
_FRAME = f"{ROBOT}/lidar"
#: Factors of intensities for 16 bits: KITTI's are at most 1, those of LAS have 16 bits, of others 8 bits.
_INTENSITY_FACTORS = {"bin": 65535.0, "las": 1.0}
#: Factor from intensities of 8 bits to 16 bits.
_OF_8_BITS = 257.0
#: Suffixes of clouds as text.
TEXT_SUFFIXES = (".xyz", ".txt", ".asc", ".pts")


def scans_log(files: list[Path], folder: Path | None = None) -> IndexedLog:
    """Open scans as the stream ``/robot/lidar.scan`` in the frame ``robot/lidar``.

    The points of a scan have one stamp: that of ``times.txt`` in their folder, else of their name. Other
    files of ``folder``, if it is given, are listed as not converted.
    Raises InputError if the stamps do not ascend.
    """
    times = files[0].parent / "times.txt"
    stamps_ns = file_stamps(files, times if times.is_file() else None)

    def read(i: int) -> LidarScan:
        return _scan(files[i], int(stamps_ns[i]))

    header = headers(SCAN, stamps_ns, frame=_FRAME, producer=_FRAME)
    reason = f"not one of the {files[0].suffix} scans of the folder, nor times.txt"
    used_files = {*files, times}
    others = {} if folder is None else other_files(folder, used_files.__contains__, reason)
    return IndexedLog({SCAN: IndexedStream("LidarScan", stamps_ns, read, header)}, others)


def _scan(path: Path, stamp_ns: int) -> LidarScan:
    """Return the finite points of a file; raises CodecError if it is not a cloud."""
    cloud, format_name = _read(path)
    finite = np.isfinite(cloud.points_m).all(axis=1)
    points_m, intensity = cloud.points_m[finite], None
    if cloud.intensity is not None:
        scaled = np.nan_to_num(cloud.intensity[finite]) * _INTENSITY_FACTORS.get(format_name, _OF_8_BITS)
        intensity = np.round(np.clip(scaled, 0.0, 65535.0)).astype(np.uint16)
    offsets_us = np.zeros(len(points_m), np.uint32)
    return LidarScan.from_arrays(
        points_m, offsets_us, frame=_FRAME, t0_ns=stamp_ns, t1_ns=stamp_ns, intensity=intensity
    )


def _read(path: Path) -> tuple[CloudArrays, str]:
    """Return a cloud and its format."""
    if path.suffix.lower() in TEXT_SUFFIXES:
        return read_xyz(path), "xyz"
    with path.open("rb") as file:
        if file.read(len(MAGIC)) == MAGIC:
            return read_e57(path), "e57"
    source = replace(load(path), on_truncation=logger.warning)
    if path.suffix.lower() == ".bin":
        source = _whole_points(source)
    format_name = detect(source)
    if format_name not in CLOUD_FORMATS:
        expected = ", ".join((*CLOUD_FORMATS, "e57"))
        raise CodecError(f"{path}: format {format_name}, expected a point cloud: {expected}")
    return read_cloud(source, format_name), format_name


def _whole_points(source: Source) -> Source:
    """Return a file of KITTI without the point in which it ends, with a warning."""
    excess = len(source.data) % ROW_BYTES
    whole_points = Source(source.data[: len(source.data) - excess], source.name)
    if not excess or not looks_like_scan(whole_points.data):
        return source
    points = len(whole_points.data) // ROW_BYTES
    logger.warning(
        "%s: ends at byte %d within a point; %d points are read", source.name, len(source.data), points
    )
    return whole_points
