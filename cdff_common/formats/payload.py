# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of messages to files: the formats of each type."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.formats.bal import write_bal
from cdff_common.formats.body_motion import write_body_motion
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.geojson import area_features, path_feature, pose_feature, write_geojson
from cdff_common.formats.geotiff import write_bands, write_map
from cdff_common.formats.hillshade import classes_png, hillshade_png
from cdff_common.formats.image import write_jpg, write_png
from cdff_common.formats.las import write_las, write_laz
from cdff_common.formats.libmv import write_libmv
from cdff_common.formats.meshes.ply_faces import write_ply_mesh
from cdff_common.formats.npz import write_npz
from cdff_common.formats.pcd import write_pcd
from cdff_common.formats.ply import write_ply
from cdff_common.formats.pose import PoseValue
from cdff_common.formats.pose_graph import write_pose_graph
from cdff_common.formats.track_csv import write_track_csv
from cdff_common.formats.tracks import track_json, tracks_csv
from cdff_common.formats.tum import write_tum
from cdff_common.formats.visual_map import write_visual_map

if TYPE_CHECKING:
    from cdff_common.geodesy import Georeference
    from cdff_common.types import (
        CorrespondenceMap2D,
        ElevationMap,
        Frame,
        GroundAreas,
        Mesh,
        NavigationMap,
        ObjectTrack,
        Pointcloud,
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
    "tif": "image/tiff; application=geotiff; profile=cloud-optimized",
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


def cloud_arrays(value: Pointcloud) -> CloudArrays:
    """Return the columns of a point cloud; colours in 0 to 1 or 0 to 255 become 8 bits."""
    colors = value.colors
    if colors is not None:
        scale = 255.0 if colors.size and np.nanmax(colors) <= 1.0 else 1.0
        colors = np.clip(np.nan_to_num(colors * scale), 0.0, 255.0).round()
    return CloudArrays.of(value.points_m, value.intensity, colors)


def _track_csv(track: ObjectTrack) -> bytes:
    """Return directions if the track has them, else poses and velocities."""
    return tracks_csv(track) if len(track.data.bearings) else write_track_csv([track])


def to_file(value: Any, fmt: str, place: Georeference | None = None) -> bytes:
    """Return a message in a format of ``FORMATS``.

    Parameters
    ----------
    value : Any
        A ``cdff_common.types`` object.
    fmt : str
    place : Georeference, optional
        CRS of its frame, for formats that contain one; by default an engineering CRS named after the frame.

    Raises
    ------
    InputError
        If the type has no such format, or the format cannot represent the value (e.g. a float image as png).
    """
    name = type(value).__name__
    if fmt not in FORMATS.get(name, ()):
        raise InputError(f"{name} as {fmt!r}: expected one of {', '.join(FORMATS.get(name, ())) or 'none'}")
    return _WRITERS[name][fmt](value, place)


def pose_value(value: TransformWithCovariance, covariance_kind: str = "none") -> PoseValue:
    """Return the pose for a file."""
    return PoseValue(value.transform, value.parent_frame, value.child_frame, value.stamp_ns, covariance_kind)


def _cloud_ply(value: Pointcloud, _: Georeference | None) -> bytes:
    comments = {"frame": value.frame, "stamp_ns": str(value.stamp_ns)}
    return write_ply(cloud_arrays(value), comments=comments)


def _cloud_npz(value: Pointcloud, _: Georeference | None) -> bytes:
    arrays = cloud_arrays(value)
    extra: dict[str, NDArray[Any]] = {} if arrays.intensity is None else {"intensity": arrays.intensity}
    extra |= {} if arrays.colors is None else {"colors": arrays.colors}
    header = {"frame": np.array(value.frame), "stamp_ns": np.array(value.stamp_ns)}
    return write_npz({"points_m": arrays.points_m, **extra, **header})


def _mesh_ply(value: Mesh, _: Georeference | None) -> bytes:
    data = value.data
    normals, colors = (column if len(column) else None for column in (data.normals, data.colors))
    vertices = CloudArrays.of(data.vertices, None, colors, normals)
    comments = {"frame": value.frame, "stamp_ns": str(value.stamp_ns)}
    return write_ply_mesh(vertices, data.triangles.astype(np.int64), comments=comments)


def _map(value: ElevationMap | NavigationMap, place: Georeference | None) -> bytes:
    return write_map(value, place=place)


def _map_npz(value: ElevationMap | NavigationMap, _: Georeference | None) -> bytes:
    g = value.geometry
    layers = {name: value.layer(name) for name in value.layer_names}
    placement = np.array([g.resolution_m, g.xmin_m, g.ymax_m])
    times = np.array([value.t0_ns, value.t1_ns])
    return write_npz(
        {**layers, "frame": np.array(g.frame), "resolution_xmin_ymax_m": placement, "t0_t1_ns": times}
    )


def _class_areas(value: NavigationMap, place: Georeference | None) -> bytes:
    from cdff_common.raster.areas import CLASSES, area_outlines  # loads numba

    return _areas(area_outlines(value, CLASSES), place)


def _areas(value: GroundAreas, place: Georeference | None) -> bytes:
    return write_geojson(area_features(value), value.frame, place)


def _pose_json(value: TransformWithCovariance, _: Georeference | None) -> bytes:
    return (json.dumps(pose_value(value).to_json(), indent=1) + "\n").encode()


def _trajectory_npz(value: PoseTrajectory, _: Georeference | None) -> bytes:
    extra = {} if value.covariances is None else {"covariances": value.covariances}
    frames = {"parent": np.array(value.parent_frame), "child": np.array(value.child_frame)}
    return write_npz({"stamps_ns": value.stamps_ns, "matrices": value.matrices, **extra, **frames})


def _matches_csv(value: CorrespondenceMap2D, _: Georeference | None) -> bytes:
    """Return CSV rows ``x0,y0,x1,y1,score``; the score is the probability."""
    rows = np.column_stack([value.sources_px, value.sinks_px, value.probabilities]).tolist()
    lines = [f"{a:.4f},{b:.4f},{c:.4f},{d:.4f},{p:.6f}" for a, b, c, d, p in rows]
    return "\n".join(["x0,y0,x1,y1,score", *lines, ""]).encode()


def _frame_tif(value: Frame, _: Georeference | None) -> bytes:
    channels = np.atleast_3d(value.image)
    return write_bands({f"band{i + 1}": channels[:, :, i] for i in range(channels.shape[2])})


def _pixels(value: Frame) -> NDArray[Any]:
    """Return the pixels of an image in the order red, green, blue."""
    is_bgr = value.metadata.mode.name == "MODE_BGR" and value.image.ndim == 3
    return value.image[:, :, ::-1] if is_bgr else value.image


#: Type -> format -> writer of a value, given the CRS of its frame; the preferred format first.
_WRITERS: dict[str, dict[str, Callable[[Any, Georeference | None], bytes]]] = {
    "Pointcloud": {
        "ply": _cloud_ply,
        "las": lambda value, _: write_las(cloud_arrays(value)),
        "laz": lambda value, _: write_laz(cloud_arrays(value)),
        "pcd": lambda value, _: write_pcd(cloud_arrays(value)),
        "npz": _cloud_npz,
    },
    "Mesh": {"ply": _mesh_ply},
    "ElevationMap": {"tif": _map, "png": lambda value, _: hillshade_png(value), "npz": _map_npz},
    "NavigationMap": {
        "tif": _map,
        "png": lambda value, _: classes_png(value),
        "npz": _map_npz,
        "geojson": _class_areas,
    },
    "TransformWithCovariance": {
        "json": _pose_json,
        "tum": lambda value, _: write_tum([value.stamp_ns], value.transform.matrix[None]),
        "geojson": lambda value, place: write_geojson([pose_feature(value)], value.parent_frame, place),
    },
    "PoseTrajectory": {
        "tum": lambda value, _: write_tum(value.stamps_ns, value.matrices),
        "npz": _trajectory_npz,
        "geojson": lambda value, place: write_geojson([path_feature(value)], value.parent_frame, place),
    },
    "PoseGraph": {"g2o": lambda value, _: write_pose_graph(value)},
    "CorrespondenceMap2D": {"csv": _matches_csv},
    "BundleProblem": {
        "bal": lambda value, _: write_bal(value),
        "libmv": lambda value, _: write_libmv(value),
    },
    "Frame": {
        "png": lambda value, _: write_png(_pixels(value)),
        "jpg": lambda value, _: write_jpg(_pixels(value)),
        "tif": _frame_tif,
        "npz": lambda value, _: write_npz({"image": value.image, "camera_matrix": value.camera_matrix}),
    },
    "VisualMap": {"npz": lambda value, _: write_visual_map(value)},
    "GroundAreas": {"geojson": _areas},
    "BodyMotion": {"json": lambda value, _: write_body_motion(value)},
    "ObjectTrack": {
        "csv": lambda value, _: _track_csv(value),
        "json": lambda value, _: track_json(value, _track_csv(value)),
    },
}
#: Formats of each type, the preferred one first.
FORMATS = {name: tuple(writers) for name, writers in _WRITERS.items()}
