# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layers of each type of value: one function per type, for every viewer."""

from __future__ import annotations

from collections.abc import Iterator
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common import types
from cdff_common.geometry.covariance import checked_covariance
from cdff_common.interfaces.product import Header, Status
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE
from cdff_common.world.history import frame_of, frames_of_pose, mounts_of
from cdff_dev.view.drawings import (
    BLUE,
    GREEN,
    GREY,
    RED,
    Boxes,
    Ellipsoid,
    Layer,
    Lines,
    Marks,
    Note,
    Number,
    Picture,
    Points,
    Rectangles,
    Surface,
    Transform,
    colours_of,
)
from cdff_dev.view.surfaces import surface_of_map

#: Most points drawn of a cloud; larger clouds are thinned evenly.
MAX_POINTS = 60_000
#: Radius of a region with 95 % of a normal distribution in three dimensions, standard deviations.
_SIGMAS_95 = 2.7955
#: Most ellipsoids drawn of a trajectory.
_MAX_ELLIPSOIDS = 20
#: Size of a detected object without a stated size, metres.
_UNKNOWN_SIZE_M = 0.1
_LEVELS = {Status.DEGRADED: "WARN", Status.FAILED: "ERROR"}


def layers_of(path: str, value: Any, header: Header | None = None) -> list[Layer]:
    """Return the layers of a value and of the quality in its header; a type without a function has none.

    Parameters
    ----------
    path : str
        Name of the layers: ``/robot/sensor/stream``.
    """
    layers = list(draw(value, path, frame_of(value, header), header))
    for mount in mounts_of(value):
        if mount.parent_frame and mount.child_frame:
            edge = Transform(mount.parent_frame, mount.child_frame, mount.transform.matrix)
            layers.append(Layer(f"/frames/{mount.child_frame}", mount.parent_frame, edge))
    return [*layers, *_quality_layers(path, header)]


def is_drawn(value: Any) -> bool:
    """Return whether the type of a value has layers."""
    return draw.dispatch(type(value)) is not draw.dispatch(object)


@singledispatch
def draw(value: Any, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    """Yield the layers of a value."""
    yield from ()


@draw.register(types.TransformWithCovariance)
@draw.register(types.RigidBodyState)
def _(value: Any, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    parent, child = frames_of_pose(value, header)
    T = value.transform
    yield Layer(path, parent, Transform(parent, child, T.matrix))
    if T.covariance is not None:
        yield Layer(f"{path}/ellipsoid", parent, ellipsoid_95(T.matrix[:3, 3], T.covariance))
        sigma_m = float(np.sqrt(max(np.trace(T.covariance[:3, :3]), 0.0)))
        yield Layer(f"{path}/quality/sigma_m", "", Number(sigma_m))


@draw.register
def _(value: types.PoseTrajectory, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    positions_m = value.matrices[:, :3, 3]
    yield Layer(path, frame, Lines((positions_m,), BLUE))
    if value.covariances is None:
        return
    step = max(1, len(positions_m) // _MAX_ELLIPSOIDS)
    known = [i for i in range(0, len(positions_m), step) if np.isfinite(value.covariances[i]).all()]
    for number, i in enumerate(known):
        ellipsoid = ellipsoid_95(positions_m[i], value.covariances[i])
        yield Layer(f"{path}/ellipsoids/{number}", frame, ellipsoid)


@draw.register
def _(value: types.PoseGraph, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    positions_m = value.vertices.matrices[:, :3, 3]
    yield Layer(
        f"{path}/vertices", frame, Points(positions_m, np.full((len(positions_m), 3), GREY, np.uint8))
    )
    ids = np.asarray(value.vertices.ids)
    order = np.argsort(ids)
    rows = order[np.searchsorted(ids, value.edges.ends, sorter=order)]
    segments = positions_m[rows]
    is_loop = np.asarray(value.edges.kinds) == LOOP_CLOSURE
    yield Layer(f"{path}/odometry", frame, Lines(tuple(segments[~is_loop]), GREY))
    yield Layer(f"{path}/loops", frame, Lines(tuple(segments[is_loop]), RED))


@draw.register(types.Pointcloud)
@draw.register(types.LidarScan)
@draw.register(types.LidarMap)
def _(value: Any, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    points_m = np.asarray(value.points_m)
    rows = np.flatnonzero(np.isfinite(points_m).all(axis=1))
    rows = rows[:: -(-len(rows) // MAX_POINTS) or 1]
    colours = getattr(value, "colors", None)
    if colours is not None and len(colours) and value.data.colors.max(initial=0.0) > 0.0:
        scale = 255.0 if colours.max() <= 1.0 else 1.0
        point_colours = np.clip(colours[rows] * scale, 0, 255).astype(np.uint8)
    else:
        point_colours = colours_of(points_m[rows, 2])
    yield Layer(path, frame, Points(points_m[rows].astype(np.float32), point_colours))


@draw.register(types.ElevationMap)
@draw.register(types.NavigationMap)
def _(value: Any, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    yield Layer(path, frame, surface_of_map(value))


@draw.register
def _(value: types.Mesh, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    data = value.data
    colours = data.colors if len(data.colors) else colours_of(data.vertices[:, 2])
    yield Layer(path, frame, Surface(data.vertices, data.triangles, colours))


@draw.register
def _(value: types.LandmarkMap, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    positions_m = value.data.positions
    yield Layer(path, frame, Points(positions_m, colours_of(positions_m[:, 2])))


@draw.register
def _(value: types.Frame, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    K = value.camera_matrix if value.camera_matrix.any() else None
    yield Layer(path, value.frame or frame, Picture(picture_of(value), K))


@draw.register
def _(value: types.FramePair, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    yield from draw(value.left, f"{path}/left", frame, header)
    yield from draw(value.right, f"{path}/right", value.right.frame, header)


@draw.register
def _(value: types.DistanceImage, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    distances_m = np.asarray(value.data).reshape(value.height, value.width)
    K = np.array([[value.scale_x, 0, value.center_x], [0, value.scale_y, value.center_y], [0, 0, 1]])
    known = np.where(distances_m > 0.0, distances_m, np.nan)
    yield Layer(path, frame, Picture(colours_of(known), K if value.scale_x else None))


@draw.register
def _(
    value: types.VisualPointFeatureVector2D, path: str, frame: str, header: Header | None
) -> Iterator[Layer]:
    yield Layer(path, frame, Marks(value.points_px))


@draw.register
def _(value: types.CorrespondenceMap2D, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    yield Layer(path, frame, Marks(value.sources_px, value.sinks_px))


@draw.register
def _(value: types.ObjectDetections, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    placed = [item for item in value.detections if item.pose.is_set]
    if placed:
        poses = np.array([item.pose.transform.matrix for item in placed])
        labels = tuple(f"{item.label} {item.score:.2f}" for item in placed)
        sizes_m = _known_sizes(np.array([item.size for item in placed]))
        yield Layer(path, value.frame_id or frame, Boxes(poses, sizes_m, labels))
    detections_with_box = [item for item in value.detections if item.image_box.any()]
    if detections_with_box:
        rectangles_px = np.array([item.image_box for item in detections_with_box], dtype=np.float64)
        labels = tuple(f"{item.label} {item.score:.2f}" for item in detections_with_box)
        yield Layer(f"{path}/image", value.frame_id or frame, Rectangles(rectangles_px, labels))


@draw.register
def _(value: types.ObjectTrack, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    T, metadata = value.matrices, value.metadata
    yield Layer(f"{path}/{metadata.track_id}/path", frame, Lines((T[:, :3, 3],), GREEN))
    sizes_m = _known_sizes(metadata.size.reshape(1, 3))
    label = metadata.label or str(metadata.track_id)
    yield Layer(f"{path}/{metadata.track_id}", frame, Boxes(T[-1:], sizes_m, (label,)))


@draw.register
def _(value: types.GroundAreas, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    rings = [ring for polygon in value.polygons for ring in polygon]
    closed = [np.vstack([ring, ring[:1]]) for ring in rings]
    yield Layer(path, frame, Lines(tuple(np.pad(ring, ((0, 0), (0, 1))) for ring in closed), RED))


@draw.register
def _(value: types.IMUSensors, path: str, frame: str, header: Header | None) -> Iterator[Layer]:
    for name, vector in (("acc_m_s2", value.acc), ("gyro_rad_s", value.gyro)):
        for axis, component in zip("xyz", vector, strict=True):
            if np.isfinite(component):
                yield Layer(f"{path}/{name}/{axis}", "", Number(float(component)))


def ellipsoid_95(centre_m: NDArray[np.float64], covariance: NDArray[np.float64]) -> Ellipsoid:
    """Return the ellipsoid with 95 % of the probability of a position, from the covariance of its pose."""
    variances, axes = np.linalg.eigh(checked_covariance(covariance)[:3, :3])
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return Ellipsoid(centre_m, _SIGMAS_95 * np.sqrt(np.maximum(variances, 0.0)), axes)


def picture_of(value: types.Frame) -> NDArray[np.uint8]:
    """Return an image as grey or red, green, blue of 8 bits; other types, as disparities, in colours."""
    pixels = value.image
    if pixels.dtype != np.uint8:
        single = pixels if pixels.ndim == 2 else pixels[..., 0]
        known = np.where(single > 0, single, np.nan).astype(np.float64)
        return colours_of(known)
    if pixels.ndim == 3 and pixels.shape[2] >= 3:
        is_blue_first = value.metadata.mode in (types.FrameModeT.MODE_BGR, types.FrameModeT.MODE_BGRA)
        return np.ascontiguousarray(pixels[..., 2::-1] if is_blue_first else pixels[..., :3])
    return pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[..., 0])


def _known_sizes(sizes_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(sizes_m > 0.0, sizes_m, _UNKNOWN_SIZE_M)


def _quality_layers(path: str, header: Header | None) -> Iterator[Layer]:
    """Yield the metrics of a product as numbers, and a note if its status is not OK."""
    if header is None:
        return
    quality = header.quality
    for name, number in quality.metrics.items():
        if np.isfinite(number):
            yield Layer(f"{path}/quality/{name}", "", Number(number))
    if (level := _LEVELS.get(quality.status)) is not None:
        text = f"{quality.status}: {', '.join(quality.reasons) or 'no reason stated'}"
        yield Layer(f"{path}/notes", "", Note(level, text))
