# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A scene of the Rerun viewer: one timeline, the mission time, and frames by name."""

from __future__ import annotations

from functools import singledispatchmethod
from typing import Any

import numpy as np
import rerun as rr

from cdff_common.geometry import se3
from cdff_dev.view.drawings import (
    GREEN,
    ORANGE,
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
)

TIMELINE = "mission_time"
#: Length of the axes of a frame, metres; radii of points and lines, pixels of the user interface.
_AXES_M = 0.5
_POINT_RADIUS, _LINE_RADIUS, _MARK_RADIUS = (rr.Radius.ui_points(r) for r in (1.2, 1.5, 1.5))
#: Distance of the drawn image plane of a camera, metres.
_IMAGE_PLANE_M = 1.0


class RerunScene:
    """Writes layers to a recording of Rerun."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._frame_of: dict[str, str] = {}

    def put(self, stamp_ns: int, layer: Layer) -> None:
        """Show a layer from a mission time on."""
        self._recording.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))
        self._put(layer.drawing, layer)

    def close(self) -> None:
        """Send the buffered layers."""
        self._recording.flush()

    def _log(self, layer: Layer, *parts: Any) -> None:
        """Log an archetype in the frame of its layer."""
        if layer.frame and self._frame_of.get(layer.path) != layer.frame:
            self._frame_of[layer.path] = layer.frame
            self._recording.log(layer.path, rr.CoordinateFrame(layer.frame), static=True)
        self._recording.log(layer.path, *parts)

    @singledispatchmethod
    def _put(self, drawing: Any, layer: Layer) -> None:
        raise TypeError(f"{type(drawing).__name__}: expected one of the types of Drawing")

    @_put.register
    def _(self, drawing: Points, layer: Layer) -> None:
        points = rr.Points3D(drawing.points_m, colors=drawing.colours, radii=_POINT_RADIUS)
        self._log(layer, points)

    @_put.register
    def _(self, drawing: Lines, layer: Layer) -> None:
        self._log(layer, rr.LineStrips3D(drawing.lines_m, colors=drawing.colour, radii=_LINE_RADIUS))

    @_put.register
    def _(self, drawing: Surface, layer: Layer) -> None:
        mesh = rr.Mesh3D(
            vertex_positions=drawing.vertices_m,
            triangle_indices=drawing.triangles,
            vertex_colors=drawing.colours,
        )
        self._log(layer, mesh)

    def _log_over(self, path: str, picture: str, *parts: Any) -> None:
        """Log archetypes in the pixels of the image of another layer."""
        pixels_frame = self._frame_of.get(picture, f"tf#{picture}") if picture else ""
        self._log(Layer(path, pixels_frame, parts[0]), *parts)

    @_put.register
    def _(self, drawing: Picture, layer: Layer) -> None:
        image = rr.Image(drawing.pixels, "L" if drawing.pixels.ndim == 2 else "RGB")
        if drawing.picture:
            self._log_over(layer.path, drawing.picture, image)
            return
        if drawing.camera_matrix is None or not layer.frame:
            self._recording.log(layer.path, image)
            return
        rows, cols = drawing.pixels.shape[:2]
        pixels_frame = f"{layer.frame}:{layer.path.strip('/')}"
        camera = rr.Pinhole(
            image_from_camera=drawing.camera_matrix,
            resolution=[cols, rows],
            parent_frame=layer.frame,
            child_frame=pixels_frame,
            image_plane_distance=_IMAGE_PLANE_M,
        )
        self._log(Layer(layer.path, pixels_frame, drawing), camera, image)

    @_put.register
    def _(self, drawing: Marks, layer: Layer) -> None:
        points = rr.Points2D(drawing.pixels, colors=GREEN, radii=_MARK_RADIUS)
        self._log_over(layer.path, drawing.picture, points)
        if drawing.ends is not None:
            segments = np.stack([drawing.pixels, drawing.ends], axis=1)
            lines = rr.LineStrips2D(segments, colors=GREEN, radii=_LINE_RADIUS)
            self._log_over(f"{layer.path}/lines", drawing.picture, lines)

    @_put.register
    def _(self, drawing: Rectangles, layer: Layer) -> None:
        boxes = rr.Boxes2D(
            array=drawing.rectangles_px,
            array_format=rr.Box2DFormat.XYWH,
            colors=ORANGE,
            radii=_LINE_RADIUS,
            labels=drawing.labels,
        )
        self._log_over(layer.path, drawing.picture, boxes)

    @_put.register
    def _(self, drawing: Transform, layer: Layer) -> None:
        transform = rr.Transform3D(
            translation=drawing.matrix[:3, 3],
            mat3x3=drawing.matrix[:3, :3],
            parent_frame=drawing.parent,
            child_frame=drawing.child,
        )
        child = Layer(layer.path, drawing.child, drawing)
        self._log(child, transform, rr.TransformAxes3D(_AXES_M))

    @_put.register
    def _(self, drawing: Ellipsoid, layer: Layer) -> None:
        rotation = se3.quaternion_xyzw_from_matrix(drawing.rotation)
        ellipsoid = rr.Ellipsoids3D(
            centers=[drawing.centre_m],
            half_sizes=[drawing.half_axes_m],
            quaternions=[rr.Quaternion(xyzw=rotation)],
            colors=ORANGE,
        )
        self._log(layer, ellipsoid)

    @_put.register
    def _(self, drawing: Boxes, layer: Layer) -> None:
        rotations = [se3.quaternion_xyzw_from_matrix(T[:3, :3]) for T in drawing.poses]
        boxes = rr.Boxes3D(
            centers=drawing.poses[:, :3, 3],
            half_sizes=drawing.sizes_m / 2.0,
            quaternions=[rr.Quaternion(xyzw=q) for q in rotations],
            colors=ORANGE,
            labels=drawing.labels,
        )
        self._log(layer, boxes)

    @_put.register
    def _(self, drawing: Number, layer: Layer) -> None:
        self._recording.log(layer.path, rr.Scalars(drawing.value))

    @_put.register
    def _(self, drawing: Note, layer: Layer) -> None:
        source = layer.path.split("/", 2)[-1].removesuffix("/notes")  # without the robot
        self._recording.log(layer.path, rr.TextLog(f"{source}: {drawing.text}", level=drawing.level))
