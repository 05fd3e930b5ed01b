# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values of products in words and units, for people."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common import types
from cdff_common.clock import format_stamp
from cdff_common.errors import CdffError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.rotation_forms import rpy_deg_from_matrix

_AXES = ("x", "y", "z")


def value_summary(value: Any) -> str:
    """Return the content of a value in one line: the position of a pose, else the first of its lines."""
    try:
        lines = value_lines(value)
    except CdffError as error:  # for example a quaternion that is not one
        return f"{type(value).__name__}: {error}"
    position = next((line for line in lines if line.startswith("position: ")), None)
    return position or lines[0]


@singledispatch
def value_lines(value: Any) -> list[str]:
    """Return the content of a value in a few lines; the name of the type for types without a description."""
    return [type(value).__name__]


@value_lines.register
def _(value: types.TransformWithCovariance) -> list[str]:
    metadata = value.metadata
    return _pose_lines(value.transform, metadata.parent_frame_id, metadata.child_frame_id, value.stamp_ns)


@value_lines.register
def _(value: types.RigidBodyState) -> list[str]:
    return _pose_lines(value.transform, value.parent_frame, value.child_frame, value.timestamp.ns)


@value_lines.register
def _(value: types.PoseTrajectory) -> list[str]:
    positions_m, stamps_ns = value.matrices[:, :3, 3], value.stamps_ns
    if not len(stamps_ns):
        return ["trajectory without poses"]
    length_m = float(np.linalg.norm(np.diff(positions_m, axis=0), axis=1).sum())
    duration_s, start = float(stamps_ns[-1] - stamps_ns[0]) * 1e-9, format_stamp(int(stamps_ns[0]))
    return [
        f"{len(stamps_ns)} poses, path {length_m:.2f} m in {duration_s:.1f} s from {start}",
        f"end: {_position(positions_m[-1])}",
    ]


@value_lines.register
def _(value: types.ElevationMap) -> list[str]:
    return _map_lines(value, "mean", "m")


@value_lines.register
def _(value: types.NavigationMap) -> list[str]:
    return _map_lines(value, "cost", "")


@value_lines.register(types.Pointcloud)
@value_lines.register(types.LidarScan)
def _(value: types.Pointcloud | types.LidarScan) -> list[str]:
    points_m = np.asarray(value.points_m)
    return [f"{len(points_m)} points, {_extent(points_m)}"]


@value_lines.register
def _(value: types.IMUSensors) -> list[str]:
    return [f"specific force {_row(value.acc, '.2f')} m/s², rate {_row(np.rad2deg(value.gyro), '.1f')} °/s"]


@value_lines.register
def _(value: types.Joints) -> list[str]:
    return [", ".join(f"{name} {position:.3f}" for name, position in value.positions.items()) + " rad or m"]


@value_lines.register
def _(value: types.PoseGraph) -> list[str]:
    return [f"{len(value.vertices.ids)} vertices, {len(value.edges.ends)} edges"]


@value_lines.register
def _(value: types.Frame) -> list[str]:
    rows, cols = value.image.shape[:2]
    channels = value.image.shape[2] if value.image.ndim == 3 else 1
    return [f"image of {cols} x {rows} pixels, {channels} channels, {value.image.dtype}"]


@value_lines.register
def _(value: types.FramePair) -> list[str]:
    rows, cols = value.left.image.shape[:2]
    return [f"stereo pair of {cols} x {rows} pixels, baseline {value.baseline:.3f} m"]


def _pose_lines(transform: UncertainTransform, parent: str, child: str, stamp_ns: int) -> list[str]:
    """Return position, orientation and standard deviations of a pose, in the axes of the parent."""
    T = transform.matrix
    lines = [
        f"{child or 'pose'} in {parent or 'unnamed frame'} at {format_stamp(stamp_ns)}",
        f"position: {_position(T[:3, 3])}",
        "orientation: "
        + ", ".join(
            f"{n} {a:.2f}"
            for n, a in zip(("roll", "pitch", "yaw"), rpy_deg_from_matrix(T[:3, :3]) + 0.0, strict=True)
        )
        + " degrees",
    ]
    if transform.covariance is None or not np.isfinite(np.diag(transform.covariance)).all():
        return [*lines, "standard deviations: unknown"]
    sigma = np.sqrt(np.diag(transform.covariance))
    metres, degrees = sigma[:3], np.degrees(sigma[3:])
    return [
        *lines,
        f"standard deviations: {_row(metres, '.3g')} m; {_row(degrees, '.2g')} degrees about x, y, z",
    ]


def _map_lines(value: Any, layer: str, unit: str) -> list[str]:
    """Return the lines that describe a map: size, layers and the range of one layer."""
    geometry = value.geometry
    width_m, height_m = geometry.cols * geometry.resolution_m, geometry.rows * geometry.resolution_m
    lines = [
        f"{geometry.cols} x {geometry.rows} cells of {geometry.resolution_m:g} m in {geometry.frame}: "
        f"{width_m:g} x {height_m:g} m from x {geometry.xmin_m:g}, y {geometry.ymax_m - height_m:g}",
        f"layers: {', '.join(value.layer_names)}",
    ]
    if layer in value.layer_names:
        cells = np.asarray(value.layer(layer), dtype=np.float64)
        known_cells = cells[np.isfinite(cells)]
        share = 100.0 * known_cells.size / max(cells.size, 1)
        spread = (
            f", {known_cells.min():.3g} to {known_cells.max():.3g} {unit}".rstrip()
            if known_cells.size
            else ""
        )
        lines.append(f"{layer}: {share:.0f} % of the cells known{spread}")
    return lines


def _extent(points_m: NDArray[Any]) -> str:
    finite = points_m[np.isfinite(points_m).all(axis=1)]
    if not len(finite):
        return "none finite"
    bounds = zip(_AXES, finite.min(axis=0), finite.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.2f} to {high:.2f}" for axis, low, high in bounds) + " m"


def _position(t_m: NDArray[np.float64]) -> str:
    return ", ".join(f"{axis} {v:.3f}" for axis, v in zip(_AXES, t_m, strict=True)) + " m"


def _row(values: NDArray[np.float64], form: str) -> str:
    return ", ".join(format(v, form) for v in values)
