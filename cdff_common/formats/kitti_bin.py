# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""KITTI's Velodyne scans: rows of four float32 x, y, z, reflectance, little-endian, without a header.

Geiger et al. (2013), doi:10.1177/0278364913491297.
"""

from __future__ import annotations

import numpy as np

from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.file_source import Readable, load

#: Size of a point.
ROW_BYTES = 16
#: Coordinates and intensities of at least this value show that the file has another format.
_FARTHEST_M = 1e5


def read_kitti_bin(source: Readable) -> CloudArrays:
    """Read a scan, coordinates in metres in the lidar frame; raises CodecError if the content is
    implausible.
    """
    s = load(source)
    if not s.data or len(s.data) % ROW_BYTES:
        raise s.error(
            f"{len(s.data)} bytes, expected a multiple of {ROW_BYTES} above 0 (float32 x, y, z, reflectance)"
        )
    rows = np.frombuffer(s.data, "<f4").reshape(-1, 4)
    if not looks_like_scan(s.data):
        raise s.error("its float32 rows are not lidar points (values that are not finite or beyond 100 km)")
    return CloudArrays(points_m=rows[:, :3].astype(np.float64), intensity=rows[:, 3].astype(np.float64))


def looks_like_scan(data: bytes) -> bool:
    """Return whether the rows contain plausible finite coordinates and reflectances."""
    if not data or len(data) % ROW_BYTES:
        return False
    rows = np.frombuffer(data, "<f4").reshape(-1, 4)
    with np.errstate(invalid="ignore"):
        plausible = np.all(np.isfinite(rows)) and np.all(np.abs(rows[:, :3]) < _FARTHEST_M)
        # Text or other binary data read as float32 are mostly tiny or huge.
        large_fraction = np.mean(np.max(np.abs(rows[:, :3]), axis=1) > 1e-3) if plausible else 0.0
    return bool(
        plausible and large_fraction > 0.9 and np.all(rows[:, 3] > -1e-3) and np.all(rows[:, 3] < _FARTHEST_M)
    )
