# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Types whose arrays have one row per element: their columns, and the check of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cdff_common.errors import InputError


class Columns(NamedTuple):
    """Columns of a type.

    Attributes
    ----------
    required : tuple of str
        Columns of every message; the first one defines the number of rows.
    optional : tuple of str
        Columns that may be empty.
    unique, ascending : str
        Column of unique ids, and of ascending numbers; empty for none.
    """

    required: tuple[str, ...]
    optional: tuple[str, ...] = ()
    unique: str = ""
    ascending: str = ""


COLUMNS = {
    "BundleCameras": Columns(("ids", "stamps", "poses", "lenses", "fixed"), unique="ids"),
    "BundleLenses": Columns(("values", "free")),
    "BundleObservations": Columns(("cameras", "points", "pixels")),
    "BundlePoints": Columns(("ids", "positions", "fixed"), unique="ids"),
    "BundlePrior": Columns(("cameras", "poses"), unique="cameras"),
    "GroundAreasData": Columns(("kinds", "areas", "ring_counts")),
    "ImuSpanData": Columns(("stamps", "acc", "gyro", "mag"), ascending="stamps"),
    "KeyFrameData": Columns(("keypoints",), ("scales", "landmarks", "descriptors")),
    "LandmarkMapData": Columns(
        ("ids", "positions"), ("covariances", "observations", "descriptors"), unique="ids"
    ),
    "LidarScanData": Columns(("points", "time_offsets"), ("intensity", "ring")),
    "MeshData": Columns(("vertices",), ("normals", "colors")),
    "ObjectTrackData": Columns(("stamps", "poses"), ("velocities", "covariances"), ascending="stamps"),
    "PointCloudData": Columns(("points",), ("colors", "intensity")),
    "PoseGraphEdges": Columns(("ends", "poses", "information", "kinds")),
    "PoseGraphVertices": Columns(("ids", "stamps", "poses"), ("fixed",), unique="ids"),
    "PoseTrajectoryData": Columns(("stamps", "poses"), ("covariances",), ascending="stamps"),
}


def check_message(message: Any) -> None:
    """Check the numbers of rows of a type in ``COLUMNS``, and that ids are unique or stamps ascend."""
    name = type(message).__name__
    if name not in COLUMNS:
        return
    required, optional, unique, ascending = COLUMNS[name]
    rows = len(getattr(message, required[0]))
    check_columns(name, rows, {column: getattr(message, column) for column in required})
    for column in optional:
        if (count := _rows(getattr(message, column))) not in (0, rows):
            raise InputError(f"{name}.{column}: {count} rows, expected {rows}, or none")
    if unique and len(np.unique(getattr(message, unique))) != rows:
        raise InputError(f"{name}.{unique}: repeated id, expected unique ids")
    if ascending and not (np.diff(getattr(message, ascending)) > 0).all():
        raise InputError(f"{name}.{ascending}: expected ascending {ascending}")


def check_columns(where: str, rows: int, columns: Mapping[str, Any]) -> None:
    """Check that columns have ``rows`` rows."""
    for name, column in columns.items():
        if _rows(column) != rows:
            raise InputError(f"{where}.{name}: {_rows(column)} rows, expected {rows}")


def _rows(column: Any) -> int:
    """Return the number of rows of an array or of an ``Array3D``."""
    return len(column) if isinstance(column, np.ndarray) else int(column.rows)
