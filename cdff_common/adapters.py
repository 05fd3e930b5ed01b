# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of messages to other libraries, files and plots; optional libraries are imported when used."""

from __future__ import annotations

import json
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common import clock
from cdff_common.errors import InputError
from cdff_common.extras import import_extra
from cdff_common.output import check_file, format_of_suffix, write_file

#: Properties that are arrays with units in their names, by which the arrays of a message are named.
_ARRAYS = (
    *("points_m", "intensity", "colors", "ring", "time_offset_us", "image", "camera_matrix"),
    *("stamps_ns", "matrices", "covariances", "sources_px", "sinks_px", "probabilities", "points_px"),
    *("sources_m", "sinks_m", "descriptors"),
)


def to_datetime(value: Any) -> datetime:
    """Return the stamp of a message in UTC; raises InputError if it has none."""
    stamp_ns = getattr(value, "stamp_ns", None)
    if not isinstance(stamp_ns, int):
        raise InputError(f"a {type(value).__name__} has no stamp")
    return clock.to_datetime(stamp_ns)


def to_numpy(value: Any) -> dict[str, NDArray[Any]]:
    """Return the arrays of a message by name.

    Layers of a map ``(rows, cols)``; ``points_m (n, 3)`` of a cloud; ``image`` of a frame; ``matrix (4, 4)``
    and ``covariance (6, 6)`` of a pose; ``stamps_ns`` and ``matrices (n, 4, 4)`` of a trajectory; of other
    types the fields that are arrays.
    """
    if hasattr(value, "layer_names"):
        return {name: value.layer(name) for name in value.layer_names}
    if hasattr(value, "transform"):
        covariance = value.transform.covariance
        return {"matrix": value.transform.matrix} | ({} if covariance is None else {"covariance": covariance})
    values_by_name = {name: getattr(value, name) for name in _ARRAYS if hasattr(type(value), name)}
    values_by_name = values_by_name or {field.name: getattr(value, field.name) for field in fields(value)}
    return {name: array for name, array in values_by_name.items() if isinstance(array, np.ndarray)}


def to_xarray(value: Any) -> Any:
    """Return a map, an image or a trajectory as ``xarray.Dataset`` with metres, pixels or times."""
    xarray = import_extra("xarray")
    attributes = {"frame": getattr(value, "frame", None) or getattr(value, "parent_frame", "")}
    if hasattr(value, "layer_names"):
        g = value.geometry
        x_m = g.xmin_m + (np.arange(g.cols) + 0.5) * g.resolution_m
        y_m = g.ymax_m - (np.arange(g.rows) + 0.5) * g.resolution_m
        layers = {name: (("y", "x"), layer) for name, layer in to_numpy(value).items()}
        return xarray.Dataset(layers, {"x": x_m, "y": y_m}, attributes | {"resolution_m": g.resolution_m})
    if hasattr(value, "image"):
        names = ("row", "column", "channel")[: value.image.ndim]
        return xarray.Dataset({"image": (names, value.image)}, attrs=attributes)
    if hasattr(value, "stamps_ns") and hasattr(value, "matrices"):
        poses = {"T": (("time", "row", "column"), value.matrices)}
        return xarray.Dataset(poses, {"time": _times(value.stamps_ns)}, attributes)
    raise _unsupported(value, "xarray", "maps, images, trajectories")


def to_pandas(value: Any) -> Any:
    """Return a cloud, a trajectory or matches as ``pandas.DataFrame``; a trajectory has its times as index.

    Columns: x, y, z in metres, with intensity; positions and quaternion x, y, z, w; pixels and probability.
    """
    pandas = import_extra("pandas")
    if hasattr(value, "stamps_ns") and hasattr(value, "matrices"):
        from cdff_common.geometry import se3

        rows = np.hstack(
            [value.matrices[:, :3, 3], se3.quaternion_xyzw_from_matrix(value.matrices[:, :3, :3])]
        )
        index = pandas.DatetimeIndex(_times(value.stamps_ns), name="time")
        return pandas.DataFrame(rows, index, ["x", "y", "z", "qx", "qy", "qz", "qw"])
    if hasattr(value, "points_m"):
        columns = dict(zip("xyz", np.asarray(value.points_m).T, strict=True))
        others = {name: getattr(value, name, None) for name in ("intensity", "ring", "time_offset_us")}
        return pandas.DataFrame(columns | {name: a for name, a in others.items() if a is not None})
    if hasattr(value, "sources_px"):
        table = np.column_stack([value.sources_px, value.sinks_px, value.probabilities])
        return pandas.DataFrame(table, columns=["x0", "y0", "x1", "y1", "probability"])
    raise _unsupported(value, "pandas", "point clouds, scans, trajectories, matches")


def to_geopandas(value: Any) -> Any:
    """Return poses, paths and areas as ``geopandas.GeoDataFrame`` in metres of their frame."""
    from cdff_common.formats.payload import FORMATS, to_file

    geopandas = import_extra("geopandas")
    if "geojson" not in FORMATS.get(type(value).__name__, ()):
        raise _unsupported(value, "geopandas", "poses, trajectories, navigation maps, ground areas")
    return geopandas.GeoDataFrame.from_features(json.loads(to_file(value, "geojson"))["features"])


def to_open3d(value: Any) -> Any:
    """Return a cloud or a scan as ``open3d.geometry.PointCloud``, points that are not finite omitted."""
    if not hasattr(value, "points_m"):
        raise _unsupported(value, "open3d", "point clouds, scans, lidar maps")
    open3d = import_extra("open3d")
    points_m = np.asarray(value.points_m, dtype=np.float64)
    finite = np.isfinite(points_m).all(axis=1)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points_m[finite]))
    colors = getattr(value, "colors", None)
    if colors is not None:
        scale = 255.0 if np.nanmax(colors, initial=0.0) > 1.0 else 1.0
        cloud.colors = open3d.utility.Vector3dVector(np.nan_to_num(colors[finite] / scale))
    return cloud


def save(value: Any, path: str | Path) -> None:
    """Write a message to a file; the suffix selects a file format of its type, or a codec (``.uper``).

    Raises
    ------
    InputError
        If the type has no such format.
    StorageError
        If the file cannot be written.
    """
    from cdff_common.codecs import CODECS, encode
    from cdff_common.formats.payload import FORMATS, to_file

    path, name = Path(path), type(value).__name__
    form = format_of_suffix(path, (*FORMATS.get(name, ()), *CODECS), name, option="")
    check_file(path)
    write_file(path, encode(value, form) if form in CODECS else to_file(value, form))


def plot(value: Any, path: str | Path | None = None) -> Any:
    """Return a ``matplotlib.figure.Figure`` of a message; write it to a ``.png`` or ``.svg`` file."""
    from cdff_common.plots import figure_of, write_figure

    figure = figure_of({type(value).__name__: value})
    if path is not None:
        write_figure(Path(path), figure)
    return figure


def _times(stamps_ns: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(stamps_ns, dtype=np.int64).astype("datetime64[ns]")


def _unsupported(value: Any, library: str, known: str) -> InputError:
    return InputError(f"a {type(value).__name__} has no form in {library}: expected one of {known}")
