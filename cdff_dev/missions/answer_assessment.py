# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assessment of an answer to a request: type, frame, region, freshness, resolution and coverage."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cdff_common.contract.products import product_type
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import Header
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.region import coverage as coverage_of_region
from cdff_common.raster.region import mask
from cdff_common.types import (
    BodyMotion,
    ElevationMap,
    Frame,
    Mesh,
    NavigationMap,
    ObjectDetections,
    ObjectTrack,
    Pointcloud,
    PoseTrajectory,
    RigidBodyState,
    TransformWithCovariance,
)
from cdff_dev.missions.script import TimedRequest

#: Largest distance of a point from the requested region, metres: the rover moves while the answer is
#: computed.
REGION_SLACK_M = 0.5


def assess_answer(
    request: TimedRequest, value: Any, header: Header, now_ns: int, region: Region | None
) -> Iterator[str]:
    """Yield the faults of an answer: its differences from the request.

    Parameters
    ----------
    value
        Decoded answer, a type of ``cdff_common.types``; an ElevationMap if it was delivered as GeoTIFF.
    now_ns : int
        Mission time at which the answer arrived.
    region : Region or None
        Region of the request; ``near:`` is already replaced by a circle around a position.
    """
    expected = request.as_ or product_type(request.type).type_name
    if request.format == "tif":
        expected = ElevationMap.__name__
    if type(value).__name__ != expected:
        yield f"type {type(value).__name__}, expected {expected}"
        return
    if header.frame != request.frame:
        yield f"frame {header.frame}, expected {request.frame}"
    age_s = (now_ns - header.t1_ns) * 1e-9
    if age_s > request.max_age_s:
        yield f"{age_s:.1f} s old, expected at most {request.max_age_s:g} s"
    if request.provider is not None and header.producer.partition("/")[0] != request.provider:
        yield f"made by {header.producer}, expected {request.provider}"
    if isinstance(value, (TransformWithCovariance, RigidBodyState)):
        yield from _pose_faults(request, value)
    elif isinstance(value, PoseTrajectory):
        if (value.parent_frame, value.child_frame) != (request.frame, f"{request.robot}/base"):
            frames = f"{value.child_frame} in {value.parent_frame}"
            yield f"a trajectory of {frames}, expected {request.robot}/base in {request.frame}"
        if len(value.stamps_ns) < 2:
            yield f"{len(value.stamps_ns)} poses, expected a trajectory"
    elif isinstance(value, Pointcloud):
        if value.frame != request.frame:
            yield f"points in {value.frame}, expected {request.frame}"
        yield from _cloud_faults(value, region)
    elif isinstance(value, ObjectTrack):
        yield from _track_faults(request, value)
    elif isinstance(value, Mesh):
        if not len(value.data.triangles):
            yield "a mesh without triangles"
    elif isinstance(value, Frame):
        if not value.image.any():
            yield "a black image"
    elif isinstance(value, BodyMotion):
        if not np.isfinite(value.rate):
            yield "a motion without a rate"
    elif isinstance(value, ObjectDetections):
        if value.frame_id != request.frame:
            yield f"detections in {value.frame_id}, expected {request.frame}"
    else:
        yield from _grid_faults(request, *_grid_of(value), region)


def _track_faults(request: TimedRequest, value: ObjectTrack) -> Iterator[str]:
    """Yield the faults of a track: frame, pose or bearing, and whether the range is known as expected."""
    if value.metadata.frame_id != request.frame:
        yield f"a track in {value.metadata.frame_id}, expected {request.frame}"
    if not len(value.data.bearings):
        if not np.isfinite(value.data.poses[-1]).all():
            yield f"pose {value.data.poses[-1].tolist()}, expected finite values"
        return
    bearing, range_m = value.data.bearings[-1, :4], float(value.data.bearings[-1, 4])
    if not (np.isfinite(bearing).all() and (bearing[2:] > 0.0).all()):
        yield f"bearing {bearing.tolist()}, expected finite angles with standard deviations"
    if request.observable is not None and np.isfinite(range_m) != (request.observable == "range"):
        yield f"range {range_m:g} m, expected {request.observable}"


def _pose_faults(request: TimedRequest, value: TransformWithCovariance | RigidBodyState) -> Iterator[str]:
    """Yield the faults of a pose: other frames, or values that are not finite."""
    if isinstance(value, RigidBodyState):
        parent, child, position = value.target_frame, value.source_frame, np.asarray(value.pos)
    else:
        parent, child, position = value.parent_frame, value.child_frame, value.transform.matrix[:3, 3]
    expected_child = request.child or f"{request.robot}/base"
    if (parent, child) != (request.frame, expected_child):
        yield f"pose of {child} in {parent}, expected {expected_child} in {request.frame}"
    if not np.all(np.isfinite(position)):
        yield f"position {position} is not finite"


def _cloud_faults(value: Pointcloud, region: Region | None) -> Iterator[str]:
    """Yield the faults of a cloud: too few points, or points outside the region."""
    points = value.points_m
    if len(points) < 100:
        yield f"{len(points)} points, expected a cloud"
    if region is not None and len(points):
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        xmin, ymin, xmax, ymax = region.bounds
        outside = max(xmin - low[0], ymin - low[1], high[0] - xmax, high[1] - ymax)
        if outside > REGION_SLACK_M:
            yield f"points up to {outside:.2f} m outside the region"


def _grid_of(value: Any) -> tuple[GridGeometry, np.ndarray[Any, np.dtype[np.bool_]]]:
    """Return the geometry and the observed cells of a map of any type."""
    if isinstance(value, ElevationMap):
        return value.geometry, np.isfinite(value.layer("mean"))
    if isinstance(value, NavigationMap):
        return value.geometry, value.layer("class") != 0
    heights = value.data.array
    pose = value.metadata.pose_fixed_frame_map_frame
    x, y, _ = pose.transform.matrix[:3, 3]
    rows, cols = heights.shape[:2]
    geometry = GridGeometry(pose.parent_frame, float(value.metadata.scale), float(x), float(y), rows, cols)
    return geometry, np.isfinite(heights.reshape(rows, cols))


def _grid_faults(
    request: TimedRequest, geometry: GridGeometry, observed: Any, region: Region | None
) -> Iterator[str]:
    """Yield the faults of a map: frame, cell size, or too few observed cells."""
    if geometry.frame != request.frame:
        yield f"a grid in {geometry.frame}, expected {request.frame}"
    if request.resolution_m is not None and abs(geometry.resolution_m / request.resolution_m - 1) > 1e-6:
        yield f"cells of {geometry.resolution_m:g} m, expected {request.resolution_m:g} m"
    if not observed.any():
        yield "no cell is observed"
    if region is not None:
        coverage = coverage_of_region(region, geometry, observed)
        if coverage < (request.min_coverage or 0.0):
            yield f"coverage {coverage:.2f}, expected at least {request.min_coverage:.2f}"
        if (observed & ~mask(region, geometry)).any():
            yield "cells outside the region have data"
