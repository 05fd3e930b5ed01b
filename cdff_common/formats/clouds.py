# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of point clouds in any supported format."""

from __future__ import annotations

import numpy as np

from cdff_common.errors import InputError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.file_source import Source
from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.formats.las import read_las
from cdff_common.formats.npz import read_npy, read_npz
from cdff_common.formats.pcd import read_pcd
from cdff_common.formats.ply import read_ply


def read_cloud(s: Source, fmt: str) -> CloudArrays:
    """Read a cloud in a format of ``CLOUD_FORMATS``, which ``detect`` has returned."""
    return _READERS[fmt](s)


def _from_npz(s: Source) -> CloudArrays:
    """Return the cloud of an NPZ file: the array ``points_m``, or the only array of shape (n, 3)."""
    arrays = read_npz(s)
    points = next((arrays[name] for name in ("points_m", "points") if name in arrays), None)
    if points is None:
        candidates = [a for a in arrays.values() if a.ndim == 2 and a.shape[1] == 3 and a.dtype.kind == "f"]
        if len(candidates) != 1:
            raise InputError(
                f"{s.name}: holds {', '.join(arrays)}, expected an array points_m of shape (n, 3)"
            )
        points = candidates[0]
    intensity, colors = arrays.get("intensity"), arrays.get("colors")
    return CloudArrays.of(points, intensity, None if colors is None else np.asarray(colors))


def _from_npy(s: Source) -> CloudArrays:
    array = read_npy(s)
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu":
        raise s.error(f"array {array.dtype} {array.shape}, expected numbers of shape (n, 3) or (n, 4)")
    return CloudArrays.of(array[:, :3], array[:, 3] if array.shape[1] == 4 else None)


_READERS = {
    "npy": _from_npy,
    "ply": read_ply,
    "pcd": read_pcd,
    "las": read_las,
    "bin": read_kitti_bin,
    "npz": _from_npz,
}
CLOUD_FORMATS = tuple(_READERS)
