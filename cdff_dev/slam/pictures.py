# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of a trajectory and of a map as PNG, drawn by matplotlib."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.plots import figure_bytes, new_figure
from cdff_common.plots.drawing import draw_cloud, draw_heights, draw_path, widest_plane
from cdff_common.types import ElevationMap
from cdff_dev.compare.trajectory.compare import Comparison
from cdff_dev.compare.trajectory.track import Track

#: Share of the longest extent of a path below which another extent does not determine the plane of a picture.
_LEAST_EXTENT = 0.1
#: Quantiles of the coordinates of a map between which its extents are measured.
_INNER = (0.05, 0.95)


def map_plane(points_m: FloatArray, path_m: FloatArray) -> tuple[int, int]:
    """Return the two axes of a picture of a map: those of the path or, if it is straight, of the points."""
    path = np.ptp(path_m, axis=0)
    longest, second = np.sort(path)[::-1][:2]
    if longest > 1.0 and second > _LEAST_EXTENT * longest:
        return widest_plane(path_m)
    low, high = np.quantile(points_m, _INNER, axis=0)
    extents = high - low
    first = int(np.argmax(path if longest > 1.0 else extents))
    extents[first] = 0.0
    x, y = sorted((first, int(np.argmax(extents))))
    return x, y


def trajectory_picture(
    track: Track, comparison: Comparison | None, plane: tuple[int, int] | None = None
) -> bytes:
    """Return a PNG: the path in a plane, and height or, with true poses, the error along it.

    By default the plane is that of the two axes of its largest extents.
    """
    figure = new_figure(10.4, 4.2)
    above, along = figure.subplots(1, 2)
    if comparison is None:
        draw_path(above, track.positions_m, plane or widest_plane(track.positions_m), "C3", "estimate")
        for axis in range(3):
            along.plot(track.distances_m, track.positions_m[:, axis], lw=1.2, label="xyz"[axis])
        along.set(xlabel="path length, m", ylabel="position, m")
        along.legend(fontsize=8)
    else:
        truth_m = comparison.reference.positions_m
        plane = plane or widest_plane(truth_m)
        draw_path(above, truth_m, plane, "0.7", "truth", width_pt=5.0)
        draw_path(above, comparison.estimate.positions_m, plane, "C3", "estimate, aligned")
        along.plot(comparison.reference.distances_m, comparison.position_errors_m, color="C3", lw=1.2)
        along.set(xlabel="path length, m", ylabel="position error, m", ylim=(0.0, None))
    above.legend(fontsize=8)
    return figure_bytes(figure)


def error_picture(comparison: Comparison) -> bytes:
    """Return a PNG of the errors along the path: position by axis of the true poses' frame, and rotation.

    The rotation error is that since the first pose: the alignment by positions leaves the rotation about a
    straight path undetermined.
    """
    figure = new_figure(10.4, 4.2)
    position, rotation = figure.subplots(1, 2)
    estimate, truth = comparison.estimate, comparison.reference
    errors_m = estimate.positions_m - truth.positions_m
    for axis in range(3):
        position.plot(truth.distances_m, errors_m[:, axis], lw=1.2, label="xyz"[axis])
    position.set(xlabel="path length, m", ylabel="position error, m")
    position.legend(fontsize=8)
    R_true, R = (_since_start(track.matrices[:, :3, :3]) for track in (truth, estimate))
    errors_deg = np.degrees(se3.rotation_angle(np.swapaxes(R_true, 1, 2) @ R))
    rotation.plot(truth.distances_m, errors_deg, color="C3", lw=1.2)
    rotation.set(xlabel="path length, m", ylabel="rotation error since the start, degrees", ylim=(0.0, None))
    return figure_bytes(figure)


def _since_start(rotations: FloatArray) -> FloatArray:
    """Return rotations ``(n, 3, 3)`` relative to the first one."""
    relative: FloatArray = rotations[0].T @ rotations
    return relative


def timing_picture(step_s: FloatArray) -> bytes:
    """Return a PNG of the time that each sample took."""
    figure = new_figure(10.4, 2.8)
    axes = figure.subplots()
    axes.plot(1e3 * np.asarray(step_s), lw=1.0)
    axes.set(xlabel="sample", ylabel="elapsed time, ms", ylim=(0.0, None))
    axes.xaxis.get_major_locator().set_params(integer=True)
    return figure_bytes(figure)


def map_picture(points_m: FloatArray, path_m: FloatArray) -> bytes:
    """Return a PNG of the points (n, 3) of a map in the plane of ``map_plane``, with the path (m, 3).

    The colours are the coordinates along the third axis.
    """
    plane = map_plane(points_m, path_m)
    figure = new_figure()
    axes = figure.subplots()
    draw_cloud(figure, axes, points_m, plane)
    draw_path(axes, path_m, plane, "C3", "path")
    axes.legend(fontsize=8, loc="upper right")
    return figure_bytes(figure)


def elevation_picture(elevation: ElevationMap) -> bytes:
    """Return a PNG of the heights of a map in colours under their shaded relief."""
    figure = new_figure()
    draw_heights(figure, figure.subplots(), np.asarray(elevation.layer("mean")), elevation.geometry)
    return figure_bytes(figure)
