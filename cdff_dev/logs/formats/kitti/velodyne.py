# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Velodyne scans of KITTI odometry folders: ``velodyne/000000.bin``, …"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.types import LidarScan

_FOLDER = "velodyne"


def scan_files(folder: Path) -> dict[int, Path]:
    """Return the scans by the number in their name, which is that of the image; ascending."""
    files = (folder / _FOLDER).glob("*.bin")
    return dict(sorted((int(path.stem), path) for path in files if path.stem.isdigit()))


def read_scan(path: Path, frame: str, stamp_ns: int) -> LidarScan:
    """Return a scan; its points have one stamp, since KITTI has removed the motion within the scan.

    The reflectance is scaled to 16 bits. Raises CodecError if the file is not a scan.
    """
    cloud = read_kitti_bin(path)
    assert cloud.intensity is not None  # a scan of KITTI has reflectances
    reflectance = np.round(np.clip(cloud.intensity, 0.0, 1.0) * 65535.0).astype(np.uint16)
    offsets_us = np.zeros(len(cloud.points_m), np.uint32)
    return LidarScan.from_arrays(
        cloud.points_m, offsets_us, frame=frame, t0_ns=stamp_ns, t1_ns=stamp_ns, intensity=reflectance
    )
