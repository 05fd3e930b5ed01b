# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layers have the frames, units and numbers of the values that they show."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, Quality, Status
from cdff_common.raster import GridGeometry
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY
from cdff_dev.view.drawings import (
    Boxes,
    Ellipsoid,
    Lines,
    Note,
    Number,
    Picture,
    Points,
    Surface,
    Transform,
    colours_of,
)
from cdff_dev.view.layers import MAX_POINTS, is_drawn, layers_of

S = 1_000_000_000


def only(value: Any, drawing: type, path: str = "/mana/x/y") -> Any:
    """Return the only layer of a value with a kind of drawing."""
    (layer,) = (layer for layer in layers_of(path, value) if isinstance(layer.drawing, drawing))
    return layer


def test_a_pose_is_a_transform_with_the_ellipsoid_of_95_percent_in_its_parent() -> None:
    covariance = np.diag([0.04, 0.01, 0.09, 1e-4, 1e-4, 1e-4])
    T = UncertainTransform(se3.transform(np.eye(3), [1.0, 2.0, 3.0]), covariance)
    pose = types.TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=0)
    edge = only(pose, Transform).drawing
    assert (edge.parent, edge.child) == ("site", "mana/base")
    np.testing.assert_array_equal(edge.matrix, T.matrix)
    layer = only(pose, Ellipsoid)
    assert layer.frame == "site"
    np.testing.assert_allclose(layer.drawing.centre_m, [1.0, 2.0, 3.0])
    # The quantile 0.95 of chi-squared with three degrees of freedom is 7.815.
    expected = np.sqrt(7.815 * np.sort([0.04, 0.01, 0.09]))
    np.testing.assert_allclose(np.sort(layer.drawing.half_axes_m), expected, rtol=1e-3)
    assert np.linalg.det(layer.drawing.rotation) == pytest.approx(1.0)
    assert only(pose, Number).drawing.value == pytest.approx(np.sqrt(0.14))


def test_random_positions_are_inside_the_ellipsoid_with_its_probability(rng: np.random.Generator) -> None:
    A = rng.normal(size=(6, 6))
    T = UncertainTransform(np.eye(4), A @ A.T)
    pose = types.TransformWithCovariance.from_transform(T, parent="a", child="b", stamp_ns=0)
    ellipsoid = only(pose, Ellipsoid).drawing
    samples = rng.multivariate_normal(np.zeros(3), T.covariance[:3, :3], size=20_000)
    scaled = samples @ ellipsoid.rotation / ellipsoid.half_axes_m
    assert (np.linalg.norm(scaled, axis=1) < 1.0).mean() == pytest.approx(0.95, abs=0.01)


def test_a_pose_without_covariance_has_no_ellipsoid() -> None:
    T = UncertainTransform(np.eye(4))
    pose = types.TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=0)
    assert [type(layer.drawing) for layer in layers_of("/m/x/y", pose)] == [Transform]


def test_a_large_cloud_is_thinned_and_keeps_its_frame() -> None:
    points_m = np.zeros((3 * MAX_POINTS + 1, 3))
    points_m[:, 2] = np.arange(len(points_m))
    layer = only(types.Pointcloud.from_points(points_m, frame="mana/lidar", stamp_ns=0), Points)
    assert layer.frame == "mana/lidar"
    assert MAX_POINTS // 2 < len(layer.drawing.points_m) <= MAX_POINTS
    assert len(layer.drawing.colours) == len(layer.drawing.points_m)


def test_points_that_are_not_finite_are_left_out() -> None:
    scan = types.LidarScan.from_arrays(
        [[1, 2, 3], [np.nan, 0, 0]], [0, 0], frame="mana/lidar", t0_ns=0, t1_ns=S
    )
    np.testing.assert_array_equal(only(scan, Points).drawing.points_m, [[1, 2, 3]])


def test_a_pose_graph_shows_its_loops_in_their_own_layer() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [0.0, 1.0, 2.0]
    information = np.tile(np.eye(6), (3, 1, 1))
    graph = types.PoseGraph.from_arrays(
        [7, 8, 9], [0, S, 2 * S], poses, [[7, 8], [8, 9], [9, 7]], poses, information,
        [ODOMETRY, ODOMETRY, LOOP_CLOSURE], frame="slam",
    )  # fmt: skip
    layers = {layer.path: layer for layer in layers_of("/mana/slam/graph", graph)}
    assert len(layers["/mana/slam/graph/odometry"].drawing.lines_m) == 2
    (loop,) = layers["/mana/slam/graph/loops"].drawing.lines_m
    np.testing.assert_array_equal(loop, [[2, 0, 0], [0, 0, 0]])


def test_an_elevation_map_is_a_surface_at_the_centres_of_its_known_cells() -> None:
    geometry = GridGeometry("site", 0.5, 10.0, 4.0, 3, 4)
    heights = np.arange(12, dtype=np.float32).reshape(3, 4)
    heights[0, 0] = np.nan
    value = types.ElevationMap.from_layers(geometry, {"mean": heights}, t0_ns=0, t1_ns=0)
    layer = only(value, Surface)
    assert layer.frame == "site"
    assert len(layer.drawing.vertices_m) == 11
    np.testing.assert_allclose(layer.drawing.vertices_m[0], [10.75, 3.75, 1.0])
    # Six squares of four cells, one of them with the unknown cell; seen from above counter-clockwise.
    assert len(layer.drawing.triangles) == 10
    a, b, c = (layer.drawing.vertices_m[layer.drawing.triangles[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_images_are_shown_as_red_green_blue() -> None:
    pixels = np.zeros((2, 3, 3), np.uint8)
    pixels[..., 0] = 255
    frame = types.Frame.from_image(
        pixels, stamp_ns=0, mode="BGR", camera_matrix=np.diag([100.0, 100.0, 1.0]), sensor="mana/navcam"
    )
    layer = only(frame, Picture)
    assert layer.frame == "mana/navcam"
    assert layer.drawing.pixels[0, 0].tolist() == [0, 0, 255]
    assert layer.drawing.camera_matrix is not None
    disparity = types.Frame.from_image(np.ones((2, 3), np.float32), stamp_ns=0, mode="GRAY")
    assert only(disparity, Picture).drawing.pixels.shape == (2, 3, 3)


def test_detections_are_boxes_in_the_frame_of_their_sensor() -> None:
    T = UncertainTransform(se3.transform(np.eye(3), [0.0, 0.0, 5.0]))
    pose = types.TransformWithCovariance.from_transform(T, parent="mana/navcam", child="rock", stamp_ns=0)
    detection = types.ObjectDetection("rock", 0.9, pose, np.array([0.5, 0.4, 0.3]))
    layer = only(types.ObjectDetections(frame_id="mana/navcam", detections=(detection,)), Boxes)
    assert layer.frame == "mana/navcam"
    assert layer.drawing.labels == ("rock 0.90",)
    np.testing.assert_array_equal(layer.drawing.sizes_m, [[0.5, 0.4, 0.3]])


def test_the_quality_of_a_product_is_plotted_and_its_reasons_are_noted() -> None:
    quality = Quality(Status.DEGRADED, ("few_inliers:12<30",), metrics={"inliers": 12.0})
    header = Header(
        "00000000-0000-4000-8000-000000000001", 0, 0, 0, "site", "x/y/1", child="mana/base", quality=quality
    )
    pose = types.TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4)), parent="site", child="mana/base", stamp_ns=0
    )
    layers = {layer.path: layer.drawing for layer in layers_of("/mana/vo/pose", pose, header)}
    assert layers["/mana/vo/pose/quality/inliers"] == Number(12.0)
    assert layers["/mana/vo/pose/notes"] == Note("WARN", "DEGRADED: few_inliers:12<30")


def test_a_trajectory_has_a_line_and_at_most_some_ellipsoids() -> None:
    n = 500
    poses = np.tile(np.eye(4), (n, 1, 1))
    covariances = np.tile(np.eye(6), (n, 1, 1))
    value = types.PoseTrajectory.from_arrays(
        np.arange(n) * S, poses, covariances, parent="site", child="mana/base"
    )
    layers = layers_of("/mana/slam/trajectory", value)
    assert sum(isinstance(layer.drawing, Lines) for layer in layers) == 1
    assert 10 <= sum(isinstance(layer.drawing, Ellipsoid) for layer in layers) <= 21


def test_types_without_a_drawing_are_named() -> None:
    assert is_drawn(types.Pointcloud.from_points([[0, 0, 0]], frame="a", stamp_ns=0))
    assert not is_drawn(types.Time())
    assert layers_of("/a/b/c", types.Time()) == []


def test_colours_go_from_low_to_high_and_unknown_values_are_grey() -> None:
    colours = colours_of(np.array([0.0, 1.0, np.nan]))
    assert colours.tolist() == [[68, 1, 84], [253, 231, 37], [150, 150, 150]]
