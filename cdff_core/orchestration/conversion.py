# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of products to the requested frame, extent, resolution and type (paper §2.2, function 2).

The covariance is transformed with the frame; a reason code states that a part of it was dropped. A product
that cannot be expressed exactly in the requested frame (a grid in a rotated frame) is refused, not resampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import Region
from cdff_common.raster import GridGeometry, delivered_resolution
from cdff_common.raster.resample import integer_factor, largest_of_blocks
from cdff_common.types import (
    Array3D,
    Array3DDepthT,
    ElevationMap,
    Map,
    MapMetadataT,
    MapTypeT,
    NavigationMap,
    Pointcloud,
    PointCloudData,
    PoseTrajectory,
    RigidBodyState,
    Time,
    TransformWithCovariance,
)

FloatArray = NDArray[np.float64]
MapT = TypeVar("MapT", ElevationMap, NavigationMap)

#: Reason code of a RigidBodyState, which has no covariance between position and orientation.
CROSS_COVARIANCE_DROPPED = "cross_covariance_dropped"
#: Cosine of the largest tilt (10 degrees) between two frames for the conversion of a plane region.
_MIN_COS_TILT = 0.985
#: Largest rows and columns of an InFuse ``Map`` (Array3D); a larger DEM is delivered by reference as tif.
MAP_MAX_ROWS, MAP_MAX_COLS = 1080, 1920


def pose_as(
    T: UncertainTransform, parent: str, child: str, stamp_ns: int, type_name: str, producer: str
) -> tuple[TransformWithCovariance | RigidBodyState, tuple[str, ...]]:
    """Return ``T_parent_child`` as the requested type, with reason codes for information that is dropped.

    A ``RigidBodyState`` has the parent as target frame and the child as source frame; its velocities are
    unknown and therefore NaN.
    """
    if type_name == "TransformWithCovariance":
        value = TransformWithCovariance.from_transform(
            T, parent=parent, child=child, stamp_ns=stamp_ns, producer=producer
        )
        return value, ()
    if type_name != "RigidBodyState":
        raise InputError(f"as={type_name!r}: a pose comes as TransformWithCovariance or RigidBodyState")
    state = RigidBodyState.from_transform(T, parent=parent, child=child, stamp_ns=stamp_ns)
    c = T.covariance
    has_cross_covariance = c is not None and bool(np.any(c[:3, 3:] != 0.0))
    return state, (CROSS_COVARIANCE_DROPPED,) if has_cross_covariance else ()


def trajectory_in(
    trajectory: PoseTrajectory, T_frame_parent: UncertainTransform, frame: str
) -> PoseTrajectory:
    """Return a trajectory with its covariances in another parent frame, fixed relative to the old one."""
    if frame == trajectory.parent_frame:
        return trajectory
    matrices = T_frame_parent.matrix @ trajectory.matrices
    covariances = None
    if trajectory.covariances is not None and T_frame_parent.covariance is not None:
        poses = zip(trajectory.matrices, trajectory.covariances, strict=True)
        covariances = np.stack([_composed(T_frame_parent, matrix, c) for matrix, c in poses])
    return PoseTrajectory.from_arrays(
        trajectory.stamps_ns, matrices, covariances, parent=frame, child=trajectory.child_frame
    )


def _composed(T: UncertainTransform, matrix: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of ``T @ matrix``; NaN if one covariance is unknown."""
    if not np.all(np.isfinite(covariance)):
        return np.full((6, 6), np.nan)
    result = (T @ UncertainTransform(matrix, covariance)).covariance
    return np.full((6, 6), np.nan) if result is None else result


def region_in(region: Region, T_frame_region: FloatArray) -> Region:
    """Return a resolved region in another frame by ``T_frame_region`` (4, 4).

    Raises InputError if the frames are tilted relative to each other, so that the region is not horizontal.
    """
    if np.allclose(T_frame_region, np.eye(4), atol=1e-12):
        return region
    if T_frame_region[2, 2] < _MIN_COS_TILT:
        raise InputError(
            f"region={region.text!r}: its frame is tilted relative to that of the product; use a level frame"
        )
    if region.kind == "circle":
        x, y, r = region.values
        centre = T_frame_region @ np.array([x, y, 0.0, 1.0])
        return Region("circle", (float(centre[0]), float(centre[1]), r))
    corners = region.corners
    transformed = se3.transform_points(T_frame_region, np.column_stack([corners, np.zeros(len(corners))]))
    numbers = tuple(float(v) for v in transformed[:, :2].ravel())
    return (
        Region("path", (region.values[0], *numbers)) if region.kind == "path" else Region("polygon", numbers)
    )


def cloud_in(cloud: Pointcloud, T_frame_cloud: UncertainTransform, frame: str) -> Pointcloud:
    """Return a cloud with its points in another frame; the sensor pose in its metadata is unchanged."""
    if frame == cloud.frame:
        return cloud
    return _rebuilt(
        cloud, T_frame_cloud.apply(cloud.points_m), np.ones(len(cloud.points_m), dtype=bool), frame
    )


def cropped_cloud(cloud: Pointcloud, region: Region) -> Pointcloud:
    """Return the points of a cloud that lie in a region of the cloud's frame."""
    p = cloud.points_m
    inside = region.contains(p[:, 0], p[:, 1], p[:, 2])
    return cloud if inside.all() else _rebuilt(cloud, p, inside, cloud.frame)


def thinned_cloud(cloud: Pointcloud, resolution_m: float) -> Pointcloud:
    """Return a cloud with one point per voxel of ``resolution_m``: the point nearest to the mean."""
    p = cloud.points_m
    if len(p) == 0:
        return cloud
    cells = np.floor(p / resolution_m).astype(np.int64)
    _, voxel, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    voxel = voxel.reshape(-1)
    mean = np.stack([np.bincount(voxel, p[:, i]) for i in range(3)], axis=1) / counts[:, None]
    order = np.lexsort((np.linalg.norm(p - mean[voxel], axis=1), voxel))
    nearest = order[np.searchsorted(voxel[order], np.arange(len(counts)))]
    is_nearest = np.zeros(len(p), dtype=bool)
    is_nearest[nearest] = True
    return _rebuilt(cloud, p, is_nearest, cloud.frame)


def merged_clouds(clouds: Sequence[Pointcloud]) -> Pointcloud:
    """Return the points of several clouds of one frame as one cloud with the newest stamp.

    Raises InputError if there is no cloud, or their frames differ.
    """
    frames = {c.frame for c in clouds}
    if len(frames) != 1:
        raise InputError(f"clouds to merge: frames {sorted(frames)}, expected exactly one")
    if len(clouds) == 1:
        return clouds[0]
    intensities = [c.intensity for c in clouds]
    present = [i for i in intensities if i is not None]
    intensity = np.concatenate(present) if len(present) == len(clouds) else None
    return Pointcloud.from_points(
        np.concatenate([c.points_m for c in clouds]),
        frame=clouds[0].frame,
        stamp_ns=max(c.stamp_ns for c in clouds),
        intensity=intensity,
    )


def _rebuilt(cloud: Pointcloud, points_m: FloatArray, keep: NDArray[np.bool_], frame: str) -> Pointcloud:
    """Return the points of a mask with their attributes; poses in the metadata are unchanged."""
    n = int(keep.sum())
    metadata = replace(cloud.metadata, frame_id=frame, height=1, width=n, is_ordered=False)
    data = PointCloudData(
        points_m[keep],
        cloud.data.colors[keep] if len(cloud.data.colors) else cloud.data.colors,
        cloud.data.intensity[keep] if len(cloud.data.intensity) else cloud.data.intensity,
    )
    return Pointcloud(metadata, data)


def elevation_as_map(
    elevation: ElevationMap, T_frame_map_frame: UncertainTransform, frame: str, producer: str
) -> Map:
    """Return the mean heights as an InFuse ``Map`` of type DEM with its pose in ``frame``.

    The cells are unchanged: only the pose of the outer corner, with its covariance, is composed with
    ``T_frame_map_frame``, which is exact for any frame. Raises InputError for more cells than a ``Map`` may
    have.
    """
    g = elevation.geometry
    if g.rows > MAP_MAX_ROWS or g.cols > MAP_MAX_COLS:
        raise InputError(
            f"a DEM of {g.rows} x {g.cols} cells exceeds an InFuse Map ({MAP_MAX_ROWS} x {MAP_MAX_COLS}): "
            "request format=tif, a smaller region or a larger resolution_m"
        )
    corner = UncertainTransform.exact(se3.transform(np.eye(3), [g.xmin_m, g.ymax_m, 0.0]))
    mean = np.ascontiguousarray(elevation.layer("mean"), dtype="<f4")
    stamp = Time.from_ns(elevation.stamp_ns)
    return Map(
        metadata=MapMetadataT(
            time_stamp=stamp,
            type=MapTypeT.MAP_DEM,
            scale=g.resolution_m,
            pose_fixed_frame_map_frame=TransformWithCovariance.from_transform(
                T_frame_map_frame @ corner,
                parent=frame,
                child=f"{g.frame}/map",
                stamp_ns=elevation.stamp_ns,
                producer=producer,
            ),
        ),
        data=Array3D(
            rows=g.rows,
            cols=g.cols,
            channels=1,
            depth=Array3DDepthT.DEPTH_32F,
            row_size=4 * g.cols,
            data=mean.reshape(-1).view(np.uint8),
        ),
    )


def box_in(
    box_m: tuple[float, float, float, float, float, float] | None, T_frame_box: UncertainTransform
) -> tuple[float, float, float, float, float, float] | None:
    """Return the bounding box, in another frame, of a box ``(x0, y0, z0, x1, y1, z1)``."""
    if box_m is None:
        return None
    corners = np.array([[x, y, z] for x in box_m[0::3] for y in box_m[1::3] for z in box_m[2::3]])
    transformed = T_frame_box.apply(corners)
    x0, y0, z0 = (float(v) for v in transformed.min(axis=0))
    x1, y1, z1 = (float(v) for v in transformed.max(axis=0))
    return x0, y0, z0, x1, y1, z1


def merged_maps(maps: Sequence[NavigationMap]) -> NavigationMap:
    """Return several maps of the same cells as one: each cell from the first map that observed it.

    Raises InputError if there is no map, or their cells differ.
    """
    if not maps or not all(m.geometry.shares_cells_with(maps[0].geometry) for m in maps):
        raise InputError("maps to merge: expected at least one, all of the same frame and cell size")
    if len(maps) == 1:
        return maps[0]
    union = maps[0].geometry
    for m in maps[1:]:
        union = union.union(m.geometry)
    layers = {
        name: np.full(union.shape, 0 if layer.dtype == np.uint8 else np.nan, layer.dtype)
        for name in maps[0].layer_names
        for layer in [maps[0].layer(name)]
    }
    for m in maps:
        rows, cols = union.slices_of(m.geometry)
        is_new = observed_cells(m) & (layers["class"][rows, cols] == 0)
        for name, layer in layers.items():
            layer[rows, cols][is_new] = m.layer(name)[is_new]
    return NavigationMap.from_layers(
        union, layers, t0_ns=min(m.t0_ns for m in maps), t1_ns=max(m.t1_ns for m in maps)
    )


def coarser_map(value: NavigationMap, resolution_m: float | None) -> NavigationMap:
    """Return a map in the largest cells up to ``resolution_m``, with the worst class in each cell.

    A cell is unknown if all its parts are; slope, step, roughness and cost are the largest in the cell.
    """
    g = value.geometry
    if resolution_m is None or resolution_m < 2.0 * g.resolution_m * (1.0 - 1e-6):
        return value
    factor = integer_factor(g.resolution_m, delivered_resolution([g.resolution_m], resolution_m))
    layers, geometry = largest_of_blocks({n: value.layer(n) for n in value.layer_names}, g, factor)
    return NavigationMap.from_layers(geometry, layers, t0_ns=value.t0_ns, t1_ns=value.t1_ns)


def masked_map(value: MapT, region: Region) -> MapT:
    """Return a map cropped to a region; cells whose centre is outside the region become unobserved."""
    old = value.geometry
    region_geometry = GridGeometry.aligned(old.frame, old.resolution_m, region.bounds)
    window = old.intersection(region_geometry)
    if window is None:
        raise InputError(f"region {region.text} does not overlap the map {old.bounds} in {old.frame}")
    rows, cols = old.slices_of(window)
    outside = ~region.contains(*window.centres_m())
    layers = {}
    for name in value.layer_names:
        layer = np.array(value.layer(name)[rows, cols])
        layer[outside] = np.nan if np.issubdtype(layer.dtype, np.floating) else 0
        layers[name] = layer
    return type(value).from_layers(window, layers, t0_ns=value.t0_ns, t1_ns=value.t1_ns)


def observed_cells(value: ElevationMap | NavigationMap) -> NDArray[np.bool_]:
    """Return the mask of observed cells of a map, shape ``(rows, cols)``."""
    if isinstance(value, ElevationMap):
        return np.asarray(np.isfinite(value.layer("mean")), dtype=np.bool_)
    return np.asarray(value.layer("class") != 0, dtype=np.bool_)


def grid_coverage(geometry: GridGeometry, observed: NDArray[np.bool_], region: Region) -> float:
    """Return the observed fraction of the cells whose centre is in a region; 0 outside the grid."""
    region_grid = GridGeometry.aligned(geometry.frame, geometry.resolution_m, region.bounds)
    inside = region.contains(*region_grid.centres_m())
    total = int(inside.sum())
    common = region_grid.intersection(geometry)
    if total == 0 or common is None:
        return 0.0
    return float((inside[region_grid.slices_of(common)] & observed[geometry.slices_of(common)]).sum()) / total


def cloud_coverage(cloud: Pointcloud, region: Region, cell_m: float) -> float:
    """Return the fraction of the cells of edge ``cell_m`` in a region that contain a point of the cloud."""
    grid = GridGeometry.aligned(cloud.frame, cell_m, region.bounds)
    rows, cols, inside = grid.cells_of(cloud.points_m[:, 0], cloud.points_m[:, 1])
    observed = np.zeros(grid.shape, dtype=bool)
    observed[rows[inside], cols[inside]] = True
    return grid_coverage(grid, observed, region)
