# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Typed values as files: which formats a type has, and the bytes of one."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.pose import PoseValue

if TYPE_CHECKING:
    from cdff_common.types import (
        BundleProblem,
        CorrespondenceMap2D,
        ElevationMap,
        Frame,
        GroundAreas,
        NavigationMap,
        Pointcloud,
        PoseGraph,
        PoseTrajectory,
        TransformWithCovariance,
    )

#: Media type of each format.
MEDIA_TYPES = {
    "ply": "application/x-ply",
    "las": "application/vnd.las",
    "laz": "application/vnd.laszip",
    "pcd": "application/x-pcd",
    "npz": "application/x-npz",
    "tif": "image/tiff; application=geotiff",
    "png": "image/png",
    "jpg": "image/jpeg",
    "json": "application/json",
    "geojson": "application/geo+json",
    "tum": "text/plain; charset=utf-8",
    "g2o": "text/plain; charset=utf-8",
    "csv": "text/csv; charset=utf-8",
    "bal": "text/plain; charset=utf-8",
    "libmv": "application/octet-stream",
}

#: Formats of each type, the preferred one first.
FORMATS: dict[str, tuple[str, ...]] = {
    "Pointcloud": ("ply", "las", "laz", "pcd", "npz"),
    "ElevationMap": ("tif", "png", "npz"),
    "NavigationMap": ("tif", "png", "npz", "geojson"),
    "TransformWithCovariance": ("json", "tum", "geojson"),
    "PoseTrajectory": ("tum", "npz", "geojson"),
    "PoseGraph": ("g2o",),
    "CorrespondenceMap2D": ("csv",),
    "BundleProblem": ("bal", "libmv"),
    "Frame": ("png", "jpg", "tif", "npz"),
    "GroundAreas": ("geojson",),
}


def cloud_arrays(value: Pointcloud) -> CloudArrays:
    """The columns of a point cloud; colours in 0 to 1 or 0 to 255 become 8 bits."""
    colors = value.colors
    if colors is not None:
        scale = 255.0 if colors.size and np.nanmax(colors) <= 1.0 else 1.0
        colors = np.clip(np.nan_to_num(colors * scale), 0.0, 255.0).round()
    return CloudArrays.of(value.points_m, value.intensity, colors)


def to_file(value: Any, fmt: str, wkt: str | None = None) -> bytes:
    """Bytes of a value in a format of ``FORMATS``.

    Parameters
    ----------
    value : Any
        A ``cdff_common.types`` object.
    fmt : str
    wkt : str, optional
        CRS of its frame, for formats that say one; an engineering CRS named after the frame without.

    Raises
    ------
    InputError
        If the type has no such format, or this value does not fit it (a float image as png, for one).
    """
    name = type(value).__name__
    if fmt not in FORMATS.get(name, ()):
        raise InputError(f"{name} as {fmt!r}: expected one of {', '.join(FORMATS.get(name, ())) or 'none'}")
    writers: dict[str, Callable[[Any, str, str | None], bytes]] = {
        "Pointcloud": _cloud,
        "ElevationMap": _map,
        "NavigationMap": _map,
        "TransformWithCovariance": _pose,
        "PoseTrajectory": _trajectory,
        "PoseGraph": _pose_graph,
        "CorrespondenceMap2D": _matches,
        "BundleProblem": _bundle,
        "Frame": _frame,
        "GroundAreas": _areas,
    }
    return writers[name](value, fmt, wkt)


def pose_value(value: TransformWithCovariance, covariance_kind: str = "none") -> PoseValue:
    """The pose value of contract §2."""
    return PoseValue(value.transform, value.parent_frame, value.child_frame, value.stamp_ns, covariance_kind)


def _cloud(value: Pointcloud, fmt: str, wkt: str | None) -> bytes:
    from cdff_common.formats.las import write_las, write_laz
    from cdff_common.formats.npz import write_npz
    from cdff_common.formats.pcd import write_pcd
    from cdff_common.formats.ply import write_ply

    arrays = cloud_arrays(value)
    if fmt == "ply":
        return write_ply(arrays, comments={"frame": value.frame, "stamp_ns": str(value.stamp_ns)})
    if fmt == "npz":
        extra: dict[str, NDArray[Any]] = {} if arrays.intensity is None else {"intensity": arrays.intensity}
        extra |= {} if arrays.colors is None else {"colors": arrays.colors}
        stated = {"frame": np.array(value.frame), "stamp_ns": np.array(value.stamp_ns)}
        return write_npz({"points_m": arrays.points_m, **extra, **stated})
    if fmt == "pcd":
        return write_pcd(arrays)
    return write_las(arrays) if fmt == "las" else write_laz(arrays)


def _map(value: ElevationMap | NavigationMap, fmt: str, wkt: str | None) -> bytes:
    from cdff_common.formats.geotiff import write_map
    from cdff_common.formats.hillshade import classes_png, hillshade_png
    from cdff_common.formats.npz import write_npz
    from cdff_common.raster.areas import CLASSES, outlined

    if fmt == "tif":
        return write_map(value, wkt=wkt)
    if fmt == "geojson":
        return _areas(outlined(value, CLASSES), fmt, wkt)  # type: ignore[arg-type]
    if fmt == "png":
        return classes_png(value) if type(value).__name__ == "NavigationMap" else hillshade_png(value)  # type: ignore[arg-type]
    g = value.geometry
    layers = {name: value.layer(name) for name in value.layer_names}
    placement = np.array([g.resolution_m, g.xmin_m, g.ymax_m])
    times = np.array([value.t0_ns, value.t1_ns])
    return write_npz({**layers, "frame": np.array(g.frame), "resolution_xmin_ymax_m": placement, "t0_t1_ns": times})


def _areas(value: GroundAreas, _fmt: str, wkt: str | None) -> bytes:
    from cdff_common.formats.geojson import area_features, write_geojson

    return write_geojson(area_features(value), value.frame, wkt)


def _pose(value: TransformWithCovariance, fmt: str, wkt: str | None) -> bytes:
    from cdff_common.formats.geojson import pose_feature, write_geojson
    from cdff_common.formats.tum import write_tum

    if fmt == "tum":
        return write_tum([value.stamp_ns], value.transform.matrix[None])
    if fmt == "geojson":
        return write_geojson([pose_feature(value)], value.parent_frame, wkt)
    return (json.dumps(pose_value(value).to_json(), indent=1) + "\n").encode()


def _trajectory(value: PoseTrajectory, fmt: str, wkt: str | None) -> bytes:
    from cdff_common.formats.geojson import path_feature, write_geojson
    from cdff_common.formats.npz import write_npz
    from cdff_common.formats.tum import write_tum

    if fmt == "tum":
        return write_tum(value.stamps_ns, value.matrices)
    if fmt == "geojson":
        return write_geojson([path_feature(value)], value.parent_frame, wkt)
    extra = {} if value.covariances is None else {"covariances": value.covariances}
    frames = {"parent": np.array(value.parent_frame), "child": np.array(value.child_frame)}
    return write_npz({"stamps_ns": value.stamps_ns, "matrices": value.matrices, **extra, **frames})


def _pose_graph(value: PoseGraph, _fmt: str, _wkt: str | None) -> bytes:
    from cdff_common.formats.pose_graph import write_pose_graph

    return write_pose_graph(value)


def _bundle(value: BundleProblem, fmt: str, _wkt: str | None) -> bytes:
    from cdff_common.formats.bal import write_bal
    from cdff_common.formats.libmv import write_libmv

    return write_bal(value) if fmt == "bal" else write_libmv(value)


def _matches(value: CorrespondenceMap2D, _fmt: str, _wkt: str | None) -> bytes:
    """Contract §2: ``x0,y0,x1,y1,score``, the score being the probability."""
    rows = np.column_stack([value.sources_px, value.sinks_px, value.probabilities]).tolist()
    lines = [f"{a:.4f},{b:.4f},{c:.4f},{d:.4f},{p:.6f}" for a, b, c, d, p in rows]
    return "\n".join(["x0,y0,x1,y1,score", *lines, ""]).encode()


def _frame(value: Frame, fmt: str, wkt: str | None) -> bytes:
    from cdff_common.formats.geotiff import write_bands
    from cdff_common.formats.image import write_jpg, write_png
    from cdff_common.formats.npz import write_npz

    image = value.image
    if fmt == "npz":
        return write_npz({"image": image, "camera_matrix": value.camera_matrix})
    if fmt == "tif":
        channels = image[:, :, None] if image.ndim == 2 else image
        return write_bands({f"band{i + 1}": channels[:, :, i] for i in range(channels.shape[2])})
    mode = value.metadata.mode.name
    write = write_jpg if fmt == "jpg" else write_png
    return write(image[:, :, ::-1] if mode == "MODE_BGR" and image.ndim == 3 else image)
