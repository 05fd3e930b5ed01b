# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frame, extent, resolution and type of delivered products."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from cdff_common.raster import GridGeometry
from cdff_common.types import (
    Array3DDepthT,
    ElevationMap,
    MapTypeT,
    NavigationMap,
    Pointcloud,
    PoseTrajectory,
    RigidBodyState,
    TransformWithCovariance,
)
from cdff_core.orchestration import conversion

STAMP_NS = 1_500_000_000_000_000_000


def some_transform(rng: np.random.Generator, *, level: bool = False) -> UncertainTransform:
    phi = np.array([0.0, 0.0, 1.0]) if level else rng.normal(size=3)
    root = rng.normal(size=(6, 6)) * 0.05
    return UncertainTransform(se3.transform(se3.exp_so3(phi), rng.normal(size=3)), root @ root.T)


def elevation(rows: int = 4, cols: int = 6) -> ElevationMap:
    g = GridGeometry("site", 0.5, -1.0, 2.0, rows, cols)
    mean = np.arange(rows * cols, dtype=np.float32).reshape(rows, cols)
    mean[0, 0] = np.nan
    layers = dict.fromkeys(("mean", "variance", "min", "max", "count", "age_s"), mean)
    return ElevationMap.from_layers(g, layers, t0_ns=STAMP_NS - 1000, t1_ns=STAMP_NS)


def test_a_pose_as_transform_keeps_its_whole_covariance(rng: np.random.Generator) -> None:
    T = some_transform(rng)
    value, reasons = conversion.pose_as(T, "site", "mana/base", STAMP_NS, "TransformWithCovariance", "me")
    assert reasons == ()
    assert isinstance(value, TransformWithCovariance)
    assert value.metadata.producer_id == "me"
    np.testing.assert_allclose(value.transform.covariance, T.covariance)
    np.testing.assert_allclose(value.transform.matrix, T.matrix, atol=1e-12)


def test_a_pose_as_rigid_body_state_names_its_frames_and_the_dropped_parts(
    rng: np.random.Generator,
) -> None:
    T = some_transform(rng)
    value, reasons = conversion.pose_as(T, "site", "mana/base", STAMP_NS, "RigidBodyState", "me")
    assert isinstance(value, RigidBodyState)
    assert (value.target_frame, value.source_frame) == ("site", "mana/base")
    assert reasons == ("cross_covariance_dropped",)
    assert T.covariance is not None
    np.testing.assert_allclose(value.cov_position, T.covariance[:3, :3])
    np.testing.assert_allclose(value.cov_orientation, T.covariance[3:, 3:])
    assert np.isnan(value.velocity).all()


def test_a_pose_comes_as_no_other_type(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="as='Pointcloud': a pose comes as TransformWithCovariance or"):
        conversion.pose_as(some_transform(rng), "a", "b", STAMP_NS, "Pointcloud", "me")


def test_an_unknown_covariance_remains_unknown_in_the_conversion(rng: np.random.Generator) -> None:
    T = UncertainTransform(some_transform(rng).matrix)
    value, reasons = conversion.pose_as(T, "a", "b", STAMP_NS, "RigidBodyState", "me")
    assert isinstance(value, RigidBodyState)
    assert reasons == ()
    assert np.isnan(value.cov_position).all()


def test_a_trajectory_in_another_frame_includes_the_errors_of_poses_and_frame(
    rng: np.random.Generator,
) -> None:
    T_site_odom, poses = some_transform(rng), [some_transform(rng) for _ in range(3)]
    t = PoseTrajectory.from_arrays(
        [STAMP_NS + i * 1000 for i in range(3)],
        [p.matrix for p in poses],
        [p.covariance for p in poses],
        parent="odom",
        child="mana/base",
    )
    converted = conversion.trajectory_in(t, T_site_odom, "site")
    assert converted.parent_frame == "site"
    assert converted.covariances is not None
    for i, pose in enumerate(poses):
        expected = T_site_odom @ pose
        np.testing.assert_allclose(converted.matrices[i], expected.matrix, atol=1e-9)
        np.testing.assert_allclose(converted.covariances[i], expected.covariance, atol=1e-9)


def test_a_value_that_already_is_in_the_frame_is_returned_unchanged(rng: np.random.Generator) -> None:
    wrong = some_transform(rng)
    t = PoseTrajectory.from_arrays([STAMP_NS], [np.eye(4)], None, parent="odom", child="mana/base")
    assert conversion.trajectory_in(t, wrong, "odom") is t
    c = Pointcloud.from_points(np.zeros((2, 3)), frame="odom", stamp_ns=STAMP_NS)
    assert conversion.cloud_in(c, wrong, "odom") is c
    region = parse_region("bbox:0,0,1,1")
    assert conversion.region_in(region, np.eye(4)) is region


def test_an_unknown_covariance_of_a_pose_remains_unknown_in_another_frame(rng: np.random.Generator) -> None:
    T, covariances = some_transform(rng), np.stack([np.eye(6), np.full((6, 6), np.nan)])
    t = PoseTrajectory.from_arrays(
        [STAMP_NS, STAMP_NS + 1000], [np.eye(4)] * 2, covariances, parent="odom", child="mana/base"
    )
    converted = conversion.trajectory_in(t, T, "site").covariances
    assert converted is not None
    assert np.isfinite(converted[0]).all()
    assert np.isnan(converted[1]).all()
    assert conversion.trajectory_in(t, UncertainTransform(T.matrix), "site").covariances is None


def test_clouds_are_transformed_cropped_downsampled_and_merged_with_their_point_fields(
    rng: np.random.Generator,
) -> None:
    points = rng.uniform(-5, 5, (500, 3))
    cloud = Pointcloud.from_points(
        points, frame="mana/lidar", stamp_ns=STAMP_NS, intensity=np.arange(500), sensor="lidar"
    )
    T = some_transform(rng)
    converted = conversion.cloud_in(cloud, T, "site")
    np.testing.assert_allclose(converted.points_m, T.apply(points), atol=1e-9)
    assert (converted.frame, converted.metadata.sensor_id) == ("site", "lidar")
    region = parse_region("circle:0,0,2")
    inside = conversion.cropped_cloud(cloud, region)
    keep = np.hypot(points[:, 0], points[:, 1]) <= 2
    np.testing.assert_array_equal(inside.points_m, points[keep])
    np.testing.assert_array_equal(inside.intensity, np.arange(500)[keep])
    downsampled = conversion.thinned_cloud(cloud, 2.0)
    cells = {tuple(c) for c in np.floor(points / 2.0).astype(int)}
    assert len(downsampled.points_m) == len(cells)
    assert {tuple(p) for p in downsampled.points_m} <= {tuple(p) for p in points}
    assert len(conversion.merged_clouds([inside, downsampled]).points_m) == len(inside.points_m) + len(
        downsampled.points_m
    )
    with pytest.raises(InputError, match="frames"):
        conversion.merged_clouds([cloud, converted])
    assert conversion.merged_clouds([cloud]) is cloud


def test_a_thinned_cloud_has_the_point_nearest_to_the_mean_of_each_voxel(rng: np.random.Generator) -> None:
    points = rng.uniform([3.0, -2.0, -2.0], [7.0, 2.0, 2.0], (80, 3))
    cloud = Pointcloud.from_points(points, frame="site", stamp_ns=STAMP_NS, intensity=np.arange(80))
    expected = set()
    for cell in np.unique(np.floor(points / 1.5), axis=0):
        rows = np.flatnonzero(np.all(np.floor(points / 1.5) == cell, axis=1))
        expected.add(int(rows[np.linalg.norm(points[rows] - points[rows].mean(axis=0), axis=1).argmin()]))
    thinned = conversion.thinned_cloud(cloud, 1.5)
    np.testing.assert_allclose(thinned.points_m, points[sorted(expected)])
    np.testing.assert_array_equal(thinned.intensity, sorted(expected))
    empty = conversion.thinned_cloud(conversion.cropped_cloud(cloud, parse_region("bbox:50,50,51,51")), 1.5)
    assert len(empty.points_m) == 0


def test_a_dem_as_infuse_map_has_the_position_of_its_first_cell(rng: np.random.Generator) -> None:
    T_odom_site = some_transform(rng, level=True)
    result = conversion.elevation_as_map(elevation(), T_odom_site, "mana/odom", "me")
    corner = result.metadata.pose_fixed_frame_map_frame
    assert corner.parent_frame == "mana/odom"
    expected = T_odom_site @ UncertainTransform.exact(se3.transform(np.eye(3), [-1.0, 2.0, 0.0]))
    np.testing.assert_allclose(corner.transform.matrix, expected.matrix, atol=1e-9)
    np.testing.assert_allclose(corner.transform.covariance, expected.covariance, atol=1e-12)
    decoded = decode("Map", encode(result, "uper"), "uper")
    heights = decoded.data.data.view("<f4").reshape(decoded.data.rows, decoded.data.cols)
    np.testing.assert_array_equal(heights, elevation().layer("mean"))
    assert decoded.metadata.scale == 0.5
    assert decoded.metadata.type is MapTypeT.MAP_DEM
    assert decoded.metadata.time_stamp.ns == STAMP_NS
    data = decoded.data
    assert (data.rows, data.cols, data.channels, data.row_size) == (4, 6, 1, 24)
    assert data.depth is Array3DDepthT.DEPTH_32F
    assert corner.metadata.producer_id == "me"
    assert (corner.child_frame, corner.stamp_ns) == ("site/map", STAMP_NS)


def test_a_dem_too_large_for_an_infuse_map_is_refused_with_alternatives() -> None:
    g = GridGeometry("site", 1.0, 0.0, 0.0, 1081, 2)
    too_large = ElevationMap.from_layers(g, {"mean": np.zeros(g.shape, np.float32)}, t0_ns=0, t1_ns=0)
    with pytest.raises(InputError, match="tif"):
        conversion.elevation_as_map(too_large, UncertainTransform.identity(), "site", "me")


def test_cells_outside_the_region_are_unobserved_and_inside_ones_are_kept() -> None:
    region = parse_region("circle:0,1,0.8")
    masked = conversion.masked_map(elevation(), region)
    x, y = masked.geometry.centres_m()
    inside = np.hypot(x, y - 1.0) <= 0.8
    assert np.isnan(masked.layer("mean")[~inside]).all()
    assert np.isfinite(masked.layer("mean")[inside]).all()
    g = GridGeometry("site", 1.0, 0.0, 2.0, 2, 2)
    nav = NavigationMap.from_layers(g, {"class": np.ones((2, 2), np.uint8)}, t0_ns=0, t1_ns=0)
    assert conversion.masked_map(nav, parse_region("bbox:0,0,1,2")).layer("class").tolist() == [[1], [1]]


def test_coverage_counts_cells_with_centres_inside_the_region_also_outside_the_grid() -> None:
    elevation_request = elevation()
    map_region = parse_region("bbox:-1,0,2,2")
    assert conversion.grid_coverage(
        elevation_request.geometry, conversion.observed_cells(elevation_request), map_region
    ) == pytest.approx(23 / 24)
    double_region = parse_region("bbox:-1,0,5,2")
    assert conversion.grid_coverage(
        elevation_request.geometry, conversion.observed_cells(elevation_request), double_region
    ) == pytest.approx(23 / 48)
    assert (
        conversion.grid_coverage(
            elevation_request.geometry,
            conversion.observed_cells(elevation_request),
            parse_region("circle:50,50,1"),
        )
        == 0.0
    )


def test_a_region_in_a_rotated_frame_contains_the_same_points(rng: np.random.Generator) -> None:
    T = some_transform(rng, level=True).matrix
    points = rng.uniform(-6, 6, (400, 2))
    transformed = se3.transform_points(T, np.column_stack([points, np.zeros(400)]))
    for text in ("bbox:-2,-1,3,2", "circle:1,1,2", "polygon:0,0,4,0,0,4"):
        region = parse_region(text)
        converted = conversion.region_in(region, T)
        np.testing.assert_array_equal(
            converted.contains(transformed[:, 0], transformed[:, 1]),
            region.contains(points[:, 0], points[:, 1]),
        )
    tilted = se3.transform(se3.exp_so3([0.5, 0, 0]), [0, 0, 0])
    with pytest.raises(InputError, match="tilted"):
        conversion.region_in(parse_region("circle:0,0,1"), tilted)


def test_a_box_in_another_frame_contains_the_original_box(rng: np.random.Generator) -> None:
    T = some_transform(rng)
    box = conversion.box_in((-1.0, 0.0, 2.0, 1.0, 3.0, 4.0), T)
    assert box is not None
    transformed = T.apply(rng.uniform((-1, 0, 2), (1, 3, 4), (200, 3)))
    assert (transformed >= np.array(box[:3]) - 1e-9).all()
    assert (transformed <= np.array(box[3:]) + 1e-9).all()
    assert conversion.box_in(None, T) is None


def test_maps_are_assembled_from_the_first_map_that_has_each_cell() -> None:
    def map_part(xmin_m: float, classes: list[int]) -> NavigationMap:
        geometry = GridGeometry("site", 1.0, xmin_m, 1.0, 1, len(classes))
        layers = {"class": np.array([classes], np.uint8)}
        layers |= {n: np.array([classes], np.float32) for n in ("slope_deg", "step_m", "roughness_m", "cost")}
        return NavigationMap.from_layers(geometry, layers, t0_ns=int(xmin_m) * 1000, t1_ns=int(xmin_m) * 1000)

    merged = conversion.merged_maps([map_part(2.0, [1, 0, 2]), map_part(0.0, [3, 3, 3, 3])])
    assert merged.geometry.bounds == (0.0, 0.0, 5.0, 1.0)
    assert merged.layer("class").tolist() == [[3, 3, 1, 3, 2]]
    assert merged.layer("cost").tolist() == [[3, 3, 1, 3, 2]]
    assert (merged.t0_ns, merged.t1_ns) == (0, 2000)
    with pytest.raises(InputError, match="same frame and cell size"):
        conversion.merged_maps([])


def test_a_coarser_cell_has_the_worst_class() -> None:
    geometry = GridGeometry("site", 0.1, 0.1, 0.5, 4, 4)  # not aligned with cells of 0.2 m
    classes = np.array([[1, 1, 0, 0], [1, 3, 0, 0], [0, 0, 2, 1], [0, 0, 1, 1]], dtype=np.uint8)
    slope = np.where(classes == 0, np.nan, classes * 10.0).astype(np.float32)
    fine = NavigationMap.from_layers(geometry, {"class": classes, "slope_deg": slope}, t0_ns=0, t1_ns=1000)
    coarse = conversion.coarser_map(fine, 0.25)
    assert coarse.geometry == GridGeometry("site", 0.2, 0.0, 0.6, 3, 3)
    np.testing.assert_array_equal(coarse.layer("class"), [[1, 1, 0], [1, 3, 1], [0, 1, 1]])
    np.testing.assert_array_equal(
        coarse.layer("slope_deg"), [[10, 10, np.nan], [10, 30, 10], [np.nan, 10, 10]]
    )
    assert conversion.coarser_map(fine, 0.15) is fine
    assert conversion.coarser_map(fine, 0.2 * (1.0 - 1e-5)) is fine
    assert conversion.coarser_map(fine, 0.2 * (1.0 - 1e-7)).geometry.resolution_m == pytest.approx(0.2)
    assert conversion.coarser_map(fine, 0.2).geometry.resolution_m == pytest.approx(0.2)
    assert conversion.coarser_map(fine, None) is fine
