# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A scene of Foxglove: a WebSocket server on this machine, or an MCAP file with Foxglove's messages."""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatchmethod
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove import channels, messages
from numpy.typing import NDArray

from cdff_common.errors import UnavailableError
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

#: Thickness of lines, pixels of the user interface.
_LINE_PX, _MARK_PX = 2.0, 4.0
#: Opacity of colours: of lines, and of boxes through which the points remain visible.
_OPAQUE, _TRANSPARENT = 1.0, 0.4
_LEVELS = {
    "INFO": messages.LogLevel.Info,
    "WARN": messages.LogLevel.Warning,
    "ERROR": messages.LogLevel.Error,
}
_NUMBER_SCHEMA = {"type": "object", "properties": {"value": {"type": "number"}}}


def mcap_scene(path: Path) -> FoxgloveScene:
    """Return the scene of a new MCAP file."""
    context = foxglove.Context()
    writer = foxglove.open_mcap(path, allow_overwrite=True, context=context)
    return FoxgloveScene(context, writer.close)


def server_scene(host: str, port: int) -> FoxgloveScene:
    """Return the scene of a new WebSocket server; raises UnavailableError if it cannot listen."""
    context = foxglove.Context()
    try:
        server = foxglove.start_server(name="cdff", host=host, port=port, context=context)
    except (OSError, RuntimeError) as error:
        raise UnavailableError(
            f"Foxglove server on {host}:{port}: {error}; choose another with --port"
        ) from error
    return FoxgloveScene(context, server.stop)


class FoxgloveScene:
    """Writes layers to the channels of a context: one topic per layer; all transforms share a topic."""

    def __init__(self, context: foxglove.Context, close: Callable[[], Any]) -> None:
        self._context = context
        self._close = close
        self._channels: dict[str, Any] = {}

    def put(self, stamp_ns: int, layer: Layer) -> None:
        """Show a layer from a mission time on."""
        self._put(layer.drawing, layer, stamp_ns)

    def close(self) -> None:
        """Complete the file, or stop the server."""
        self._close()

    def _channel(self, kind: type, topic: str) -> Any:
        if topic not in self._channels:
            self._channels[topic] = kind(topic, context=self._context)
        return self._channels[topic]

    def _put_entity(self, layer: Layer, stamp_ns: int, **primitives: Any) -> None:
        entity = messages.SceneEntity(
            timestamp=_stamp(stamp_ns), frame_id=layer.frame, id=layer.path, frame_locked=True, **primitives
        )
        channel = self._channel(channels.SceneUpdateChannel, layer.path)
        channel.log(messages.SceneUpdate(entities=[entity]), log_time=stamp_ns)

    @singledispatchmethod
    def _put(self, drawing: Any, layer: Layer, stamp_ns: int) -> None:
        raise TypeError(f"{type(drawing).__name__}: expected one of the types of Drawing")

    @_put.register
    def _(self, drawing: Points, layer: Layer, stamp_ns: int) -> None:
        n = len(drawing.points_m)
        rows = np.zeros(n, dtype=[("xyz", "<f4", 3), ("rgba", "u1", 4)])
        rows["xyz"], rows["rgba"][:, :3], rows["rgba"][:, 3] = drawing.points_m, drawing.colours, 255
        numeric = messages.PackedElementFieldNumericType
        fields = [
            messages.PackedElementField(name=name, offset=4 * i, type=numeric.Float32)
            for i, name in enumerate("xyz")
        ] + [
            messages.PackedElementField(name=name, offset=12 + i, type=numeric.Uint8)
            for i, name in enumerate(("red", "green", "blue", "alpha"))
        ]
        cloud = messages.PointCloud(
            timestamp=_stamp(stamp_ns),
            frame_id=layer.frame,
            pose=_pose(np.zeros(3)),
            point_stride=rows.itemsize,
            fields=fields,
            data=rows.tobytes(),
        )
        self._channel(channels.PointCloudChannel, layer.path).log(cloud, log_time=stamp_ns)

    @_put.register
    def _(self, drawing: Lines, layer: Layer, stamp_ns: int) -> None:
        lines = [
            messages.LinePrimitive(
                type=messages.LinePrimitiveLineType.LineStrip,
                thickness=_LINE_PX,
                scale_invariant=True,
                points=[_point(p) for p in line],
                color=_colour(drawing.colour),
            )
            for line in drawing.lines_m
        ]
        self._put_entity(layer, stamp_ns, lines=lines)

    @_put.register
    def _(self, drawing: Surface, layer: Layer, stamp_ns: int) -> None:
        surface = messages.TriangleListPrimitive(
            points=[_point(p) for p in drawing.vertices_m],
            colors=[_colour(c) for c in drawing.colours],
            indices=drawing.triangles.ravel().tolist(),
        )
        self._put_entity(layer, stamp_ns, triangles=[surface])

    @_put.register
    def _(self, drawing: Picture, layer: Layer, stamp_ns: int) -> None:
        rows, cols = drawing.pixels.shape[:2]
        is_grey = drawing.pixels.ndim == 2
        image = messages.RawImage(
            timestamp=_stamp(stamp_ns),
            frame_id=layer.frame,
            width=cols,
            height=rows,
            encoding="mono8" if is_grey else "rgb8",
            step=cols if is_grey else 3 * cols,
            data=np.ascontiguousarray(drawing.pixels).tobytes(),
        )
        self._channel(channels.RawImageChannel, layer.path).log(image, log_time=stamp_ns)
        if drawing.camera_matrix is not None:
            calibration = messages.CameraCalibration(
                timestamp=_stamp(stamp_ns),
                frame_id=layer.frame,
                width=cols,
                height=rows,
                K=drawing.camera_matrix.ravel().tolist(),
                P=np.pad(drawing.camera_matrix, ((0, 0), (0, 1))).ravel().tolist(),
            )
            channel = self._channel(channels.CameraCalibrationChannel, f"{layer.path}/calibration")
            channel.log(calibration, log_time=stamp_ns)

    @_put.register
    def _(self, drawing: Marks, layer: Layer, stamp_ns: int) -> None:
        kind = messages.PointsAnnotationType
        parts = [_annotation(kind.Points, drawing.pixels, stamp_ns, _MARK_PX)]
        if drawing.ends is not None:
            segments = np.stack([drawing.pixels, drawing.ends], axis=1).reshape(-1, 2)
            parts.append(_annotation(kind.LineList, segments, stamp_ns, _LINE_PX))
        channel = self._channel(channels.ImageAnnotationsChannel, layer.path)
        channel.log(messages.ImageAnnotations(points=parts), log_time=stamp_ns)

    @_put.register
    def _(self, drawing: Rectangles, layer: Layer, stamp_ns: int) -> None:
        left, top, width, height = drawing.rectangles_px.T
        corners = np.array(
            [[left, top], [left + width, top], [left + width, top + height], [left, top + height]]
        )
        loop = messages.PointsAnnotationType.LineLoop
        outlines = [_annotation(loop, corners[:, :, i].copy(), stamp_ns, _LINE_PX) for i in range(len(left))]
        texts = [
            messages.TextAnnotation(
                timestamp=_stamp(stamp_ns),
                position=messages.Point2(x=float(x), y=float(y)),
                text=label,
                font_size=12.0,
                text_color=_colour(ORANGE),
            )
            for x, y, label in zip(left, top, drawing.labels, strict=True)
        ]
        channel = self._channel(channels.ImageAnnotationsChannel, layer.path)
        channel.log(messages.ImageAnnotations(points=outlines, texts=texts), log_time=stamp_ns)

    @_put.register
    def _(self, drawing: Transform, layer: Layer, stamp_ns: int) -> None:
        transform = messages.FrameTransform(
            timestamp=_stamp(stamp_ns),
            parent_frame_id=drawing.parent,
            child_frame_id=drawing.child,
            translation=messages.Vector3(**_xyz(drawing.matrix[:3, 3])),
            rotation=_quaternion(drawing.matrix[:3, :3]),
        )
        self._channel(channels.FrameTransformChannel, "/tf").log(transform, log_time=stamp_ns)

    @_put.register
    def _(self, drawing: Ellipsoid, layer: Layer, stamp_ns: int) -> None:
        sphere = messages.SpherePrimitive(
            pose=_pose(drawing.centre_m, drawing.rotation),
            size=messages.Vector3(**_xyz(2.0 * drawing.half_axes_m)),
            color=_colour(ORANGE, _TRANSPARENT),
        )
        self._put_entity(layer, stamp_ns, spheres=[sphere])

    @_put.register
    def _(self, drawing: Boxes, layer: Layer, stamp_ns: int) -> None:
        poses = [_pose(T[:3, 3], T[:3, :3]) for T in drawing.poses]
        cubes = [
            messages.CubePrimitive(
                pose=pose, size=messages.Vector3(**_xyz(size)), color=_colour(ORANGE, _TRANSPARENT)
            )
            for pose, size in zip(poses, drawing.sizes_m, strict=True)
        ]
        texts = [
            messages.TextPrimitive(
                pose=pose, text=label, font_size=12.0, scale_invariant=True, billboard=True,
                color=_colour(ORANGE),
            )
            for pose, label in zip(poses, drawing.labels, strict=True)
        ]  # fmt: skip
        self._put_entity(layer, stamp_ns, cubes=cubes, texts=texts)

    @_put.register
    def _(self, drawing: Number, layer: Layer, stamp_ns: int) -> None:
        if layer.path not in self._channels:
            self._channels[layer.path] = foxglove.Channel(
                layer.path, schema=_NUMBER_SCHEMA, message_encoding="json", context=self._context
            )
        self._channels[layer.path].log({"value": drawing.value}, log_time=stamp_ns)

    @_put.register
    def _(self, drawing: Note, layer: Layer, stamp_ns: int) -> None:
        note = messages.Log(
            timestamp=_stamp(stamp_ns), level=_LEVELS[drawing.level], message=drawing.text, name=layer.path
        )
        self._channel(channels.LogChannel, layer.path).log(note, log_time=stamp_ns)


def _annotation(kind: Any, pixels: NDArray[Any], stamp_ns: int, width_px: float) -> messages.PointsAnnotation:
    return messages.PointsAnnotation(
        timestamp=_stamp(stamp_ns),
        type=kind,
        points=[messages.Point2(x=float(x), y=float(y)) for x, y in pixels],
        outline_color=_colour(GREEN),
        thickness=width_px,
    )


def _stamp(stamp_ns: int) -> messages.Timestamp:
    return messages.Timestamp(sec=stamp_ns // 1_000_000_000, nsec=stamp_ns % 1_000_000_000)


def _xyz(vector: NDArray[Any]) -> dict[str, float]:
    return {name: float(v) for name, v in zip("xyz", vector, strict=True)}


def _point(position_m: NDArray[Any]) -> messages.Point3:
    return messages.Point3(**_xyz(position_m))


def _quaternion(rotation: NDArray[Any]) -> messages.Quaternion:
    x, y, z, w = se3.quaternion_xyzw_from_matrix(rotation).tolist()
    return messages.Quaternion(x=x, y=y, z=z, w=w)


def _pose(position_m: NDArray[Any], rotation: NDArray[Any] | None = None) -> messages.Pose:
    return messages.Pose(
        position=messages.Vector3(**_xyz(position_m)),
        orientation=_quaternion(np.eye(3) if rotation is None else rotation),
    )


def _colour(rgb: Any, opacity: float = _OPAQUE) -> messages.Color:
    r, g, b = (float(v) / 255.0 for v in rgb)
    return messages.Color(r=r, g=g, b=b, a=opacity)
