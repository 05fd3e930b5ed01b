# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Meshes of bodies at their estimated poses: surfaces, and visible edges over the images of a camera."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera.model import CameraModel
from cdff_common.errors import InputError
from cdff_common.formats.meshes import read_mesh
from cdff_common.formats.meshes.arrays import UNITS
from cdff_common.geometry import se3
from cdff_common.types import Frame, FramePair, ObjectDetections, TransformWithCovariance
from cdff_core.object_models.decimation import decimate
from cdff_core.object_models.mesh_edges import MeshEdges, mesh_edges, visible_edge_points
from cdff_core.object_models.rendering import Window
from cdff_dev.logs.source import LogSample
from cdff_dev.run.inputs import mesh_frame
from cdff_dev.view.drawings import GREY, Layer, Marks, Surface
from cdff_dev.view.feed import path_of

#: Angle of two faces from which their edge is drawn, and distance of the marks along the edges, px.
_CREASE_RAD, _SPACING_PX = math.radians(20.0), 5.0
#: Most triangles of a surface; finer meshes are simplified.
_MAX_TRIANGLES = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """Mesh of a body in its own frame, metres, and its edges."""

    vertices_m: FloatArray
    triangles: np.ndarray
    edges: MeshEdges

    def surface(self, T: FloatArray) -> Surface:
        """Return the mesh at a pose (4, 4)."""
        colours = np.full((len(self.vertices_m), 3), GREY, np.uint8)
        return Surface(
            se3.transform_points(T, self.vertices_m).astype(np.float32),
            self.triangles.astype(np.uint32),
            colours,
        )


class ModelLayers:
    """Draws meshes at the poses of their frames, ``{name of the file}/body``, and at detections.

    Parameters
    ----------
    files : sequence of str
        Meshes (OBJ, PLY, STL, GLB, VRML).
    unit : str
        Unit of their vertices: m, mm, cm or km.

    Raises
    ------
    InputError
        If two files have the same name, or a mesh has no extent.
    """

    def __init__(self, files: Sequence[str], unit: str = "m") -> None:
        self._bodies: dict[str, _Body] = {}
        self._cameras: dict[str, CameraModel] = {}
        for file in files:
            frame = mesh_frame(file)
            if frame in self._bodies:
                raise InputError(
                    f"--model {file}: the frame {frame} has another mesh; rename one of the files"
                )
            mesh = read_mesh(Path(file))
            vertices_m = UNITS[unit] * np.asarray(mesh.vertices, np.float64)
            if not np.ptp(vertices_m, axis=0).any():
                raise InputError(f"--model {file}: all vertices are equal, expected a mesh with an extent")
            vertices_m, triangles, _ = decimate(vertices_m, mesh.triangles, _MAX_TRIANGLES)
            edges = mesh_edges(vertices_m, triangles, _CREASE_RAD)
            self._bodies[frame] = _Body(vertices_m, triangles, edges)

    def surfaces(self) -> Iterator[Layer]:
        """Yield each mesh in its frame."""
        for frame, body in self._bodies.items():
            yield Layer(f"/models/{frame.removesuffix('/body')}", frame, body.surface(np.eye(4)))

    def layers_of(self, sample: LogSample) -> Iterator[Layer]:
        """Yield the meshes of a pose or of detections; store the camera of an image."""
        value = sample.value
        if not self._bodies:
            return
        if isinstance(value, (Frame, FramePair)):
            self._add_camera(value.left if isinstance(value, FramePair) else value)
        elif isinstance(value, TransformWithCovariance) and value.child_frame in self._bodies:
            body, path = self._bodies[value.child_frame], f"{path_of(sample.stream)}/model"
            yield from self._marks(body, value.transform.matrix, value.parent_frame, path)
        elif isinstance(value, ObjectDetections):
            yield from self._detected(value, path_of(sample.stream))

    def _add_camera(self, image: Frame) -> None:
        if image.frame and image.frame not in self._cameras and image.camera_matrix.any():
            self._cameras[image.frame] = CameraModel.of_frame(image)

    def _detected(self, value: ObjectDetections, path: str) -> Iterator[Layer]:
        """Yield the meshes of the first detection of each model, which is the best one."""
        drawn: set[str] = set()
        for item in value.detections:
            frame = f"{item.label}/body"
            if frame in drawn or frame not in self._bodies or not item.pose.is_set:
                continue
            drawn.add(frame)
            body, T = self._bodies[frame], item.pose.transform.matrix
            yield Layer(f"{path}/{item.label}", value.frame_id, body.surface(T))
            yield from self._marks(body, T, value.frame_id, f"{path}/{item.label}/model")

    def _marks(self, body: _Body, T: FloatArray, frame: str, path: str) -> Iterator[Layer]:
        """Yield points on the visible edges of a mesh in the image of a camera; none without its image."""
        camera = self._cameras.get(frame)
        if camera is None:
            return
        window = Window(camera.fx, camera.fy, camera.cx, camera.cy, camera.rows, camera.cols)
        points_m, _, _ = visible_edge_points(
            body.edges, body.vertices_m, body.triangles, np.ascontiguousarray(T), window, _SPACING_PX
        )
        pixels = camera.project(se3.transform_points(T, points_m))
        yield Layer(path, frame, Marks(pixels[np.isfinite(pixels).all(axis=1)]))
