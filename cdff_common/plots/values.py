# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Figure of one value or of several: a panel each."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.plots import drawing
from cdff_common.plots.figure import new_figure
from cdff_common.value_text import value_lines

Draw = Callable[[Any, Any, Any], None]
#: Width and height of a panel, inches, and largest number of panels of a figure.
_PANEL_IN, _MAX_PANELS = (6.5, 5.2), 9


def figure_of(values: Mapping[str, Any]) -> Any:
    """Return a figure with a panel for each value that can be drawn, with its name as the title.

    At most nine panels are drawn; the title of the figure gives how many more values could be drawn.

    Parameters
    ----------
    values : mapping of str to Any
        Messages, or arrays: points ``(n, 3)``, poses ``(4, 4)`` or ``(n, 4, 4)``, images ``(rows, cols)``.

    Raises
    ------
    InputError
        If none can be drawn.
    """
    panels = [(name, value, draw) for name, value in values.items() if (draw := _drawing_of(value))]
    if not panels:
        names_and_types = (
            ", ".join(f"{name}: {type(value).__name__}" for name, value in values.items()) or "no value"
        )
        raise InputError(
            f"nothing to draw ({names_and_types}); drawn are {', '.join(sorted(_DRAWINGS))} and arrays"
        )
    left_out, panels = len(panels[_MAX_PANELS:]), panels[:_MAX_PANELS]
    columns = math.ceil(math.sqrt(len(panels)))
    rows = math.ceil(len(panels) / columns)
    figure = new_figure(_PANEL_IN[0] * columns, _PANEL_IN[1] * rows)
    all_axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (name, value, draw) in zip(all_axes, panels, strict=False):
        draw(figure, axes, value)
        axes.set_title(name, fontsize=10)
    for axes in all_axes[len(panels) :]:
        axes.set_axis_off()
    if left_out:
        figure.suptitle(f"{len(panels)} of {len(panels) + left_out} values drawn, {left_out} left out")
    return figure


def _drawing_of(value: Any) -> Draw | None:
    if isinstance(value, np.ndarray):
        return _array if _is_drawable(value) else None
    if isinstance(value, types.NavigationMap) and "class" not in value.layer_names:
        return None
    return _DRAWINGS.get(type(value).__name__)


def _is_drawable(array: NDArray[Any]) -> bool:
    if array.dtype.kind not in "biuf" or not array.size:
        return False
    return array.shape[-2:] == (4, 4) or array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3)


def _array(figure: Any, axes: Any, array: NDArray[Any]) -> None:
    if array.shape[-2:] == (4, 4):
        _poses(axes, array.reshape(-1, 4, 4), "poses")
    elif array.ndim == 2 and array.shape[1] == 3:
        drawing.draw_cloud(figure, axes, array)
    else:
        drawing.draw_image(figure, axes, array)


def _poses(axes: Any, matrices: NDArray[Any], label: str) -> None:
    positions_m = matrices[:, :3, 3]
    plane = drawing.widest_plane(positions_m) if len(matrices) > 1 else (0, 1)
    drawing.draw_path(axes, positions_m, plane, "C0", label)
    spread_m = float(np.ptp(positions_m, axis=0).max()) if len(matrices) else 0.0
    shown = matrices if len(matrices) == 1 else matrices[[0, -1]]
    drawing.draw_axes(axes, shown, plane, 0.08 * spread_m or 1.0)
    axes.legend(fontsize=8)


def _pose(_: Any, axes: Any, value: Any) -> None:
    _poses(axes, value.transform.matrix[None], value_lines(value)[0])
    covariance = value.transform.covariance
    if covariance is not None and np.isfinite(covariance[:2, :2]).all():
        _ellipse(axes, value.transform.matrix[:2, 3], covariance[:2, :2])


def _ellipse(axes: Any, centre_m: NDArray[Any], covariance_m2: NDArray[Any]) -> None:
    """Draw the ellipse that holds 95 % of the positions of a normal distribution in the plane."""
    variances, directions = np.linalg.eigh(covariance_m2)
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    half_axes_m = np.sqrt(5.991 * np.maximum(variances, 0.0))  # chi-squared of 2 degrees of freedom, 95 %
    outline = centre_m + (half_axes_m * np.column_stack([np.cos(angle), np.sin(angle)])) @ directions.T
    axes.plot(outline[:, 0], outline[:, 1], color="gray", lw=1.0, label="95 % of the position")
    axes.legend(fontsize=8)


def _elevation(figure: Any, axes: Any, value: types.ElevationMap) -> None:
    drawing.draw_heights(figure, axes, np.asarray(value.layer("mean")), value.geometry)


def _navigation(figure: Any, axes: Any, value: types.NavigationMap) -> None:
    drawing.draw_classes(figure, axes, np.asarray(value.layer("class")), value.geometry)


def _cloud(figure: Any, axes: Any, value: Any) -> None:
    drawing.draw_cloud(figure, axes, np.asarray(value.points_m))


def _image(figure: Any, axes: Any, value: types.Frame) -> None:
    is_reversed = value.metadata.mode.name == "MODE_BGR" and value.image.ndim == 3
    drawing.draw_image(figure, axes, value.image[:, :, ::-1] if is_reversed else value.image)


def _distances(figure: Any, axes: Any, value: types.DistanceImage) -> None:
    distances_m = np.asarray(value.data).reshape(value.height, value.width)
    drawing.draw_image(figure, axes, np.where(distances_m > 0.0, distances_m, np.nan), "distance, m")


def _matches(_: Any, axes: Any, value: types.CorrespondenceMap2D) -> None:
    """Draw the points of the first image, with lines to the same points of the second one."""
    lines = np.full((len(value.sources_px), 3, 2), np.nan)  # a row of NaN separates the lines
    lines[:, 0], lines[:, 1] = value.sources_px, value.sinks_px
    axes.plot(lines[..., 0].ravel(), lines[..., 1].ravel(), color="C1", lw=0.8, label="to the second image")
    axes.plot(*value.sources_px.T, "o", ms=2, color="C0", label="first image")
    axes.set(xlabel="column, px", ylabel="row, px", aspect="equal")
    axes.invert_yaxis()
    axes.legend(fontsize=8)


def _graph(_: Any, axes: Any, value: types.PoseGraph) -> None:
    """Draw the vertices and edges of a pose graph in the plane in which it is widest."""
    positions_m = value.vertices.matrices[:, :3, 3]
    plane = drawing.widest_plane(positions_m) if len(positions_m) > 1 else (0, 1)
    order = np.argsort(value.vertices.ids)
    ends = order[np.searchsorted(value.vertices.ids, value.edges.ends, sorter=order)]
    lines_m = np.full((len(ends), 3, 3), np.nan)  # a row of NaN separates the edges
    lines_m[:, :2] = positions_m[ends]
    x, y = plane
    axes.plot(lines_m[..., x].ravel(), lines_m[..., y].ravel(), color="C1", lw=0.8, label="edges")
    drawing.draw_path(axes, positions_m, plane, "C0", "vertices")
    axes.legend(fontsize=8)


_DRAWINGS: dict[str, Draw] = {
    "CorrespondenceMap2D": _matches,
    "DistanceImage": _distances,
    "ElevationMap": _elevation,
    "Frame": _image,
    "FramePair": lambda figure, axes, value: _image(figure, axes, value.left),
    "LandmarkMap": lambda figure, axes, value: drawing.draw_cloud(figure, axes, value.data.positions),
    "LidarMap": _cloud,
    "LidarScan": _cloud,
    "Mesh": lambda figure, axes, value: drawing.draw_cloud(figure, axes, value.data.vertices),
    "NavigationMap": _navigation,
    "ObjectTrack": lambda _, axes, value: _poses(axes, value.matrices, "track"),
    "Pointcloud": _cloud,
    "PoseGraph": _graph,
    "PoseTrajectory": lambda _, axes, value: _poses(axes, value.matrices, "trajectory"),
    "RigidBodyState": _pose,
    "TransformWithCovariance": _pose,
}
