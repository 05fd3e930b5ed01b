# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Meshes are drawn at the poses of their bodies, and their visible edges over the images of a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_dev.logs.source import LogSample
from cdff_dev.view.drawings import Marks, Surface
from cdff_dev.view.models import ModelLayers

K = np.array([[400.0, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]])
T = se3.transform(np.eye(3), [0.1, 0.0, 4.0])
CUBE = "".join(f"v {x} {y} {z}\n" for x in (-500, 500) for y in (-500, 500) for z in (-500, 500)) + "".join(
    f"f {face}\n" for face in ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
)


@pytest.fixture
def cube(tmp_path: Path) -> str:
    """A cube with edges of 1 m, in millimetres."""
    path = tmp_path / "Cube.obj"
    path.write_text(CUBE, encoding="utf-8")
    return str(path)


def sample(stream: str, value: Any) -> LogSample:
    return LogSample(stream, type(value).__name__, 0, 0, value)


def pose() -> types.TransformWithCovariance:
    transform = UncertainTransform(T)
    return types.TransformWithCovariance.from_transform(
        transform, parent="camera", child="cube/body", stamp_ns=0
    )


def image(dist_coeffs: tuple[float, ...] = ()) -> LogSample:
    frame = types.Frame.from_image(
        np.zeros((240, 320), np.uint8),
        stamp_ns=0,
        sensor="camera",
        camera_matrix=K,
        dist_coeffs=np.array(dist_coeffs),
    )
    return sample("/client/camera.image", frame)


def test_the_visible_edges_of_a_pose_are_drawn_over_the_image_and_hidden_edges_are_not(cube: str) -> None:
    models = ModelLayers([cube], "mm")
    assert not [*models.layers_of(sample("/client/tracker.pose", pose()))], "no image yet"
    assert not [*models.layers_of(image())]
    (layer,) = models.layers_of(sample("/client/tracker.pose", pose()))
    assert (layer.path, layer.frame) == ("/client/tracker/pose/model", "camera")
    assert isinstance(layer.drawing, Marks)
    # The near face, at a depth of 3.5 m, hides the far one; the left face is seen edge-on.
    low, high = (160.0 + 400.0 * (0.1 + side) / 3.5 for side in (-0.5, 0.5))
    u, v = layer.drawing.pixels.T
    assert u.min() == pytest.approx(low, abs=1.0)
    assert u.max() == pytest.approx(high, abs=1.0)
    assert len(u) > 50
    on_outline = np.minimum(abs(u - low), abs(u - high)) < 1.5
    on_outline |= abs(abs(v - 120.0) - 400.0 * 0.5 / 3.5) < 1.5
    assert np.mean(on_outline) > 0.95


def test_the_edges_have_the_distortion_of_the_lens(cube: str) -> None:
    extents = []
    for coefficients in ((), (-0.3, 0.0, 0.0, 0.0)):
        models = ModelLayers([cube], "mm")
        list(models.layers_of(image(coefficients)))
        (layer,) = models.layers_of(sample("/client/tracker.pose", pose()))
        extents.append(np.ptp(layer.drawing.pixels[:, 0]))
    assert extents[1] < extents[0] - 0.5


def test_a_mesh_is_a_surface_in_its_frame_and_at_the_best_detection_of_its_name(cube: str) -> None:
    models = ModelLayers([cube], "mm")
    (surface,) = models.surfaces()
    assert (surface.path, surface.frame) == ("/models/cube", "cube/body")
    assert isinstance(surface.drawing, Surface)
    assert np.ptp(surface.drawing.vertices_m, axis=0) == pytest.approx([1.0, 1.0, 1.0])
    detection = types.ObjectDetection(label="cube", score=0.9, pose=pose())
    other = types.ObjectDetection(label="cone", score=0.9, pose=pose())
    detections = types.ObjectDetections(frame_id="camera", detections=(other, detection, detection))
    list(models.layers_of(image()))
    drawn, marks = models.layers_of(sample("/client/detection.detections", detections))
    assert (drawn.path, drawn.frame) == ("/client/detection/detections/cube", "camera")
    assert drawn.drawing.vertices_m.mean(axis=0) == pytest.approx([0.1, 0.0, 4.0], abs=1e-6)
    assert isinstance(marks.drawing, Marks)


def test_two_meshes_of_one_name_and_a_mesh_without_extent_are_refused(cube: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cube/body has another mesh; rename"):
        ModelLayers([cube, cube])
    point = tmp_path / "point.obj"
    point.write_text("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"all vertices are equal"):
        ModelLayers([str(point)])
