# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of messages: conversion from and to arrays, images, transforms and maps."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import decode, encode
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.uncertain_transform import UncertainTransform
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types.message import COLUMNS, POSITIONS


@pytest.fixture
def T_site_base(rng: np.random.Generator) -> UncertainTransform:
    A = rng.normal(size=(6, 6))
    return UncertainTransform(se3.exp_se3(rng.normal(size=6)), A @ A.T)


def test_a_transform_message_keeps_matrix_frames_time_and_covariance(T_site_base: UncertainTransform) -> None:
    message = types.TransformWithCovariance.from_transform(
        T_site_base, parent="site", child="mana/base", stamp_ns=1_530_195_435_193_075_000, producer="pom"
    )
    assert (message.parent_frame, message.child_frame, message.metadata.producer_id) == (
        "site",
        "mana/base",
        "pom",
    )
    assert message.stamp_ns == 1_530_195_435_193_075_000
    np.testing.assert_allclose(message.transform.matrix, T_site_base.matrix, atol=1e-12)
    np.testing.assert_array_equal(message.transform.covariance, T_site_base.covariance)
    x, y, z = T_site_base.matrix[:3, 3]
    assert message.extent_m() == (x, y, z, x, y, z)


@pytest.mark.req("CDFF-CORE-061")
@pytest.mark.parametrize("codec", ["uper", "ber", "xer", "msgpack"])
def test_an_unknown_covariance_survives_a_round_trip(T_site_base: UncertainTransform, codec: str) -> None:
    message = types.TransformWithCovariance.from_transform(
        UncertainTransform(T_site_base.matrix), parent="a", child="b", stamp_ns=0
    )
    decoded = decode("TransformWithCovariance", encode(message, codec), codec)
    assert decoded.transform.covariance is None
    assert decoded == message


def test_an_invalid_transform_is_refused() -> None:
    data = types.TransformWithCovarianceData(orientation=[0, 0, 0, 0])
    with pytest.raises(InputError, match="unit quaternion"):
        _ = types.TransformWithCovariance(data=data).transform


def test_the_transform_of_a_rigid_body_state_has_no_cross_covariance(
    T_site_base: UncertainTransform,
) -> None:
    state = types.RigidBodyState.from_transform(T_site_base, parent="site", child="mana/base", stamp_ns=1000)
    assert (state.target_frame, state.source_frame, state.stamp_ns) == ("site", "mana/base", 1000)
    assert T_site_base.covariance is not None
    assert state.transform.covariance is not None
    np.testing.assert_array_equal(state.transform.covariance[:3, :3], T_site_base.covariance[:3, :3])
    assert not state.transform.covariance[:3, 3:].any()


def test_a_pose_survives_conversion_to_a_matrix(T_site_base: UncertainTransform) -> None:
    np.testing.assert_allclose(
        types.Pose.from_matrix(T_site_base.matrix).matrix, T_site_base.matrix, atol=1e-12
    )


@pytest.mark.req("CDFF-CORE-062")
def test_stamps_are_whole_microseconds() -> None:
    assert types.Time.from_ns(5000).ns == 5000
    assert types.Time(5, 1000).ns == 5_000_000
    with pytest.raises(InputError, match="multiple of 1000"):
        types.Time.from_ns(5001)
    with pytest.raises(InputError, match="usec_per_sec=0"):
        _ = types.Time(5, 0).ns
    for microseconds in (9_300_000_000_000_000, -9_300_000_000_000_000):
        with pytest.raises(InputError, match="64 bits"):
            _ = types.Time(microseconds).ns
        with pytest.raises(InputError, match="64 bits"):
            types.Time.from_ns(microseconds * 1000)


def test_a_cloud_has_its_frame_time_extent_and_sensor_pose(T_site_base: UncertainTransform) -> None:
    points = np.array([[0, 0, 0], [1, 2, 3], [np.nan, 0, 0]])
    cloud = types.Pointcloud.from_points(
        points, frame="mana/lidar", stamp_ns=2000, T_robot_sensor=T_site_base
    )
    assert cloud.intensity is None
    assert cloud.colors is None
    assert cloud.extent_m() == (0, 0, 0, 1, 2, 3)
    assert (cloud.frame, cloud.stamp_ns, cloud.metadata.width) == ("mana/lidar", 2000, 3)
    assert cloud.T_fixed_robot is None
    assert cloud.T_robot_sensor is not None
    assert cloud.metadata.pose_robot_frame_sensor_frame.parent_frame == "mana/base"
    assert types.Pointcloud.from_points(np.zeros((0, 3)), frame="a", stamp_ns=0).extent_m() is None


def test_a_scan_keeps_the_time_of_each_point() -> None:
    scan = types.LidarScan.from_arrays(
        np.ones((2, 3)), [0, 100], frame="mana/lidar", t0_ns=1000, t1_ns=101_000, ring=[3, 4]
    )
    assert scan.points_m.dtype == np.float32
    assert scan.time_offset_us.tolist() == [0, 100]
    assert scan.ring is not None
    assert scan.ring.tolist() == [3, 4]
    assert (scan.intensity, scan.t0_ns, scan.t1_ns, scan.stamp_ns) == (None, 1000, 101_000, 101_000)
    with pytest.raises(InputError, match="lies after t1"):
        types.LidarScan.from_arrays(np.ones((1, 3)), [101], frame="a", t0_ns=0, t1_ns=100_000)
    with pytest.raises(InputError, match="time_offsets: 1 rows, expected 2"):
        types.LidarScan.from_arrays(np.ones((2, 3)), [1], frame="a", t0_ns=0, t1_ns=100_000)


@pytest.mark.parametrize(
    "dtype", ["uint8", "int8", "uint16", "int16", "int32", "float32", "float64", ">u2", ">f4"]
)
@pytest.mark.parametrize("shape", [(4, 5), (4, 5, 3), (1, 1), (0, 0)])
def test_an_image_survives_a_round_trip(dtype: str, shape: tuple[int, ...]) -> None:
    image = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    frame = types.Frame.from_image(image, stamp_ns=3000, mode="UNDEF")
    assert np.array_equal(frame.image, image)
    assert frame.image.shape == shape
    assert not frame.image.flags.writeable
    assert np.array_equal(decode("Frame", encode(frame)).image, image)


def test_an_image_with_row_padding_is_read() -> None:
    array = types.Array3D(rows=2, cols=2, channels=1, depth=0, row_size=4, data=bytes([1, 2, 0, 0, 3, 4]))
    assert array.array.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": 3}, "expected 10 for"),
        ({"row_size": 1}, "row size 1"),
        ({"channels": 9}, "expected"),
        ({"cols": 4294967295, "rows": 4294967295, "row_size": 0}, "expected"),
    ],
)
def test_too_few_octets_for_an_image_are_refused(change: dict[str, int], message: str) -> None:
    fields = {"rows": 2, "cols": 2, "channels": 1, "depth": 0, "row_size": 4, "data": bytes(6)} | change
    with pytest.raises(InputError, match=message):
        _ = types.Array3D(**fields).array


def test_images_of_invalid_type_or_mode_are_refused() -> None:
    with pytest.raises(InputError, match="dtype"):
        types.Frame.from_image(np.zeros((2, 2), np.int64), stamp_ns=0)
    with pytest.raises(InputError, match="3 channels"):
        types.Frame.from_image(np.zeros((2, 2, 3), np.uint8), stamp_ns=0, mode="GRAY")
    with pytest.raises(InputError, match="mode 'PINK'"):
        types.Frame.from_image(np.zeros((2, 2), np.uint8), stamp_ns=0, mode="PINK")


def test_a_pair_has_both_images_and_the_right_camera_at_the_baseline() -> None:
    left, right = np.zeros((4, 6), np.uint8), np.ones((4, 6), np.uint8)
    K = np.array([[500.0, 0, 3], [0, 500, 2], [0, 0, 1]])
    pair = types.FramePair.from_images(
        left,
        right,
        baseline_m=0.2,
        camera_matrix=K,
        stamp_ns=4000,
        sensor="mana/navcam_left",
        T_robot_sensor=UncertainTransform.identity(),
    )
    assert pair.right.image.all()
    assert pair.right.frame == "mana/navcam_right"
    assert (pair.baseline, pair.stamp_ns) == (0.2, 4000)
    np.testing.assert_array_equal(pair.camera_matrix, K)
    assert pair.right.T_robot_sensor is not None
    assert pair.right.T_robot_sensor.matrix[0, 3] == 0.2
    with pytest.raises(InputError, match="expected equal"):
        types.FramePair.from_images(left, right[:2], baseline_m=0.2, camera_matrix=K, stamp_ns=0)


def test_a_map_gives_its_geometry_and_layers() -> None:
    geometry = GridGeometry("site", 0.5, -1.0, 2.0, 2, 4)
    mean = np.arange(8, dtype=np.float32).reshape(2, 4)
    mean[0, 0] = np.nan
    elevation = types.ElevationMap.from_layers(
        geometry, {"mean": mean, "count": np.ones((2, 4), np.float32)}, t0_ns=0, t1_ns=1000
    )
    assert elevation.geometry == geometry
    assert elevation.layer_names == ("mean", "count")
    np.testing.assert_array_equal(elevation.layer("mean"), mean)
    assert elevation.extent_m() == (-1.0, 1.0, 1.0, 1.0, 2.0, 7.0)
    assert decode("ElevationMap", encode(elevation)) == elevation
    with pytest.raises(InputError, match="expected one of mean, count"):
        elevation.layer("slope")
    with pytest.raises(InputError, match="shape"):
        types.ElevationMap.from_layers(geometry, {"mean": mean.T}, t0_ns=0, t1_ns=0)
    navigation = types.NavigationMap.from_layers(
        geometry, {"class": np.ones((2, 4), np.uint8)}, t0_ns=0, t1_ns=0
    )
    assert navigation.layer("class").dtype == np.uint8
    assert navigation.extent_m() == (-1.0, 1.0, 0.0, 1.0, 2.0, 0.0)


def test_a_trajectory_survives_a_round_trip(rng: np.random.Generator) -> None:
    T = se3.exp_se3(rng.normal(size=(5, 6)))
    covariances = np.tile(np.eye(6), (5, 1, 1))
    track = types.PoseTrajectory.from_arrays(
        np.arange(5) * 1000, T, covariances, parent="site", child="mana/base"
    )
    np.testing.assert_allclose(track.matrices, T, atol=1e-12)
    np.testing.assert_array_equal(track.covariances, covariances)
    np.testing.assert_array_equal(track.stamps_ns, np.arange(5) * 1000)
    assert (track.stamp_ns, track.parent_frame, track.child_frame) == (4000, "site", "mana/base")
    assert track.extent_m() is not None
    assert types.PoseTrajectory.from_arrays([0], T[:1], parent="a", child="b").covariances is None
    with pytest.raises(InputError, match="ascending"):
        types.PoseTrajectory.from_arrays([0, 0], T[:2], parent="a", child="b")
    with pytest.raises(InputError, match="rigid"):
        types.PoseTrajectory.from_arrays([0], np.zeros((1, 4, 4)), parent="a", child="b")


def test_every_type_with_positions_has_an_extent() -> None:
    pose, other = types.Pose([1, 2, 3]), types.Pose([-1, 5, 0])
    transform = types.TransformWithCovariance(data=types.TransformWithCovarianceData([1, 2, 3]))
    point = (1.0, 2.0, 3.0, 1.0, 2.0, 3.0)
    assert pose.extent_m() == point
    assert types.PosesSequence([pose, other]).extent_m() == (-1, 2, 0, 1, 5, 3)
    assert types.PointSequence([[1, 2, 3], [-1, 5, 0]]).extent_m() == (-1, 2, 0, 1, 5, 3)
    assert types.Trajectory(points=[[1, 2, 3]]).extent_m() == point
    assert types.Waypoint([1, 2, 3]).extent_m() == point
    assert types.Path(waypoints=[transform]).extent_m() == point
    assert types.BodyState(types.Time(5), transform).extent_m() == point
    assert types.Pose([np.nan, 0, 0]).extent_m() is None
    assert types.Path().extent_m() is None
    cloud = types.Pointcloud.from_points([[1, 2, 3]], frame="a", stamp_ns=7000)
    assert types.Octree(2.0, cloud).extent_m() == (0, 1, 2, 2, 3, 4)
    corner = types.TransformWithCovariance.from_transform(
        UncertainTransform(se3.transform(np.eye(3), [10.0, 20.0, 0.0])),
        parent="site",
        child="map",
        stamp_ns=0,
    )
    metadata = types.MapMetadataT(scale=0.5, pose_fixed_frame_map_frame=corner)
    grid = types.Map(metadata=metadata, data=types.Array3D.from_array(np.zeros((4, 6), np.float32)))
    assert grid.extent_m() == (10, 18, 0, 13, 20, 0)
    assert grid.frame == "site"


def test_every_type_with_a_time_has_a_stamp() -> None:
    time = types.Time(7)
    twist = types.TwistWithCovariance(types.TwistWithCovarianceMetadata(time_stamp=time))
    for value in (
        types.IMUSensors(time),
        types.BodyState(time),
        types.Path(time_stamp=time),
        types.Pressure(time),
        types.LaserScan(time),
        types.Joints(time),
        twist,
    ):
        assert value.stamp_ns == 7000


def test_copies_and_unpickled_messages_are_read_only() -> None:
    cloud = types.Pointcloud.from_points(np.ones((3, 3)), frame="a", stamp_ns=0)
    for duplicate in (copy.deepcopy(cloud), pickle.loads(pickle.dumps(cloud)), dataclasses.replace(cloud)):
        assert duplicate == cloud
        assert not duplicate.points_m.flags.writeable


def test_the_tables_of_positions_and_of_columns_name_attributes_of_existing_types() -> None:
    for name in POSITIONS:
        assert name == types.__dict__[name].ASN1_NAME
        types.__dict__[name]().extent_m()
    for name, columns in COLUMNS.items():
        attributes = {f.name for f in dataclasses.fields(types.__dict__[name])}
        named = {*columns.required, *columns.optional, columns.unique, columns.ascending} - {""}
        assert named <= attributes
