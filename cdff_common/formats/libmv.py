# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bundle problems of the libmv tracker, as read by Ceres: one lens for all images, binary, single precision.

Ceres Solver, examples/libmv_bundle_adjuster.cc: ``v`` or ``V`` (little, big endian), ``P`` or ``N`` (markers
in pixels, or on the plane z = 1), eight intrinsics, then counted cameras (image, R by columns, t), points
(track, X) and markers.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.formats.bundle_problem import looks_like_libmv
from cdff_common.formats.file_source import Readable, Source, load
from cdff_common.geometry import se3
from cdff_common.types import BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2

#: Columns of fx fy cx cy k1 k2 p1 p2 k3 for libmv's f cx cy k1 k2 k3 p1 p2.
_COLUMNS = (0, 2, 3, 4, 5, 8, 6, 7)


def read_libmv(source: Readable, *, frame: str) -> BundleProblem:
    """Read a problem; with markers in pixels focal length, k1 and k2 are adjusted, as in the Ceres example.

    Markers of missing images or tracks are ignored, as in Ceres.

    Raises
    ------
    CodecError
        With the file name, for other files, non-finite numbers and invalid rotations.
    """
    s = load(source)
    if not looks_like_libmv(s.data):
        raise s.error("expected a libmv problem: v or V, P or N, intrinsics, cameras, points and markers")
    order = "<" if s.data[:1] == b"v" else ">"
    intrinsics = np.frombuffer(s.data, f"{order}f4", 8, 2).astype(np.float64)
    at, tables = 34, []
    for layout in (
        [("image", f"{order}i4"), ("R", f"{order}f4", 9), ("t", f"{order}f4", 3)],
        [("track", f"{order}i4"), ("X", f"{order}f4", 3)],
        [("image", f"{order}i4"), ("track", f"{order}i4"), ("xy", f"{order}f4", 2)],
    ):
        kind = np.dtype(layout)
        (count,) = struct.unpack_from(f"{order}i", s.data, at)
        tables.append(np.frombuffer(s.data, kind, count, at + 4))
        at += 4 + kind.itemsize * count
    cameras, points, markers = tables
    rows, tracks = _rows(cameras["image"], s, "image"), _rows(points["track"], s, "track")
    known = np.array([int(m) in rows for m in markers["image"]], bool)
    known &= np.array([int(m) in tracks for m in markers["track"]], bool)
    markers = markers[known]
    R = cameras["R"].astype(np.float64).reshape(-1, 3, 3).swapaxes(1, 2)
    if not np.isfinite(R).all() or (len(R) and np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max() > 1e-3):
        raise s.error("a camera's matrix is not a rotation")
    T_camera_frame = se3.transform(se3.normalise_rotation(R), cameras["t"].astype(np.float64))
    lens = np.zeros(9)
    lens[list(_COLUMNS)] = intrinsics
    lens[1] = lens[0]
    try:
        return BundleProblem.from_arrays(
            se3.inverse(T_camera_frame),
            lens,
            points["X"].astype(np.float64),
            ([rows[int(m)] for m in markers["image"]], [tracks[int(m)] for m in markers["track"]]),
            markers["xy"].astype(np.float64).reshape(-1, 2),
            frame=frame,
            ids=cameras["image"],
            point_ids=points["track"],
            free=FOCAL | K1 | K2 if s.data[1:2] == b"P" else 0,
        )
    except InputError as error:
        raise s.error(str(error)) from error


def write_libmv(problem: BundleProblem) -> bytes:
    """Return a problem in single precision; raises InputError if the format cannot represent it."""
    v, o = problem.lenses.values, problem.observations
    stereo = bool(np.isfinite(o.pixels[:, 2]).any())
    if len(v) != 1 or v[0, 0] != v[0, 1] or v[0, 9] or stereo or len(problem.prior.cameras):
        raise InputError(
            "BundleProblem as libmv: expected one lens with fx = fy for all, no stereo pairs, no prior"
        )
    ids = (problem.cameras.ids, problem.points.ids)
    if any(len(i) and (int(i.max()) >= 2**31 or int(i.min()) < 0) for i in ids):
        raise InputError("BundleProblem as libmv: expected ids from 0 to 2147483647")
    T = se3.inverse(problem.cameras.matrices)
    cameras = np.zeros(len(T), [("image", "<i4"), ("R", "<f4", 9), ("t", "<f4", 3)])
    cameras["image"], cameras["R"] = ids[0], T[:, :3, :3].swapaxes(1, 2).reshape(-1, 9)
    cameras["t"] = T[:, :3, 3]
    points = np.zeros(len(ids[1]), [("track", "<i4"), ("X", "<f4", 3)])
    points["track"], points["X"] = ids[1], problem.points.positions
    markers = np.zeros(len(o.cameras), [("image", "<i4"), ("track", "<i4"), ("xy", "<f4", 2)])
    markers["image"], markers["track"], markers["xy"] = ids[0][o.cameras], ids[1][o.points], o.pixels[:, :2]
    head = b"v" + (b"P" if problem.lenses.free[0] else b"N") + v[0, list(_COLUMNS)].astype("<f4").tobytes()
    return head + b"".join(
        struct.pack("<i", len(table)) + table.tobytes() for table in (cameras, points, markers)
    )


def _rows(ids: NDArray[np.int32], s: Source, subject: str) -> dict[int, int]:
    rows = {int(i): row for row, i in enumerate(ids)}
    if len(rows) != len(ids) or min(rows, default=0) < 0:
        raise s.error(f"{subject} numbers: expected unique numbers from 0")
    return rows
