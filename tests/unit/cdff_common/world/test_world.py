# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The world at a time: frames with covariances, items, differences and its file."""

from __future__ import annotations

import msgpack
import numpy as np
import pytest

from cdff_common.errors import CodecError, FrameNotFoundError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_common.world import World, WorldHistory, read_world, write_world

S = 1_000_000_000
MOUNT = UncertainTransform.exact(se3.transform(np.eye(3), [0.0, 0.0, 1.5]))


def pose(
    x_m: float, stamp_ns: int, *, child: str = "mana/base", sigma_m: float = 0.1, parent: str = "site"
) -> TransformWithCovariance:
    T = UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0]), np.eye(6) * sigma_m**2)
    return TransformWithCovariance.from_transform(T, parent=parent, child=child, stamp_ns=stamp_ns)


def history() -> WorldHistory:
    """A rover that drives 2 m along x in 2 s with a lidar, and a cloud at 1 s."""
    world_history = WorldHistory()
    world_history.add_fixed("mana/base", "mana/lidar", MOUNT)
    for second, sigma_m in ((0, 0.1), (1, 0.2), (2, 0.3)):
        world_history.add_pose("/mana/vo.pose", pose(float(second), second * S, sigma_m=sigma_m))
    cloud = Pointcloud.from_points([[1.0, 2.0, 3.0]], frame="mana/lidar", stamp_ns=S)
    world_history.add_item("/mana/lidar.cloud", "Pointcloud", S, cloud)
    return world_history


def test_frames_are_interpolated_and_composed_with_their_covariance() -> None:
    T = history().at(S + S // 2).transform("site", "mana/lidar")
    np.testing.assert_allclose(T.matrix[:3, 3], [1.5, 0.0, 1.5])
    assert T.covariance is not None
    # Mean of the variances at both poses; x and y also have the lidar's height times the tilt.
    variance = 0.5 * (0.2**2 + 0.3**2)
    np.testing.assert_allclose(np.diag(T.covariance)[:3], [variance * (1 + 1.5**2)] * 2 + [variance])


def test_a_frame_whose_poses_do_not_cover_the_time_is_omitted_with_the_reason() -> None:
    world = history().at(5 * S)
    assert world.frames == ("mana/base", "mana/lidar")
    (reason,) = world.omitted.values()
    assert "3.000 s outside" in reason
    with pytest.raises(FrameNotFoundError):
        world.transform("site", "mana/base")


def test_true_poses_are_used_only_without_other_poses() -> None:
    world_history = history()
    world_history.add_pose("/mana/truth.pose", pose(7.0, S))
    world = world_history.at(S)
    assert world.transform("site", "mana/base").matrix[0, 3] == 1.0
    assert world.omitted == {"site to mana/base by /mana/truth.pose": "/mana/vo.pose is used instead"}
    only_truth = WorldHistory()
    only_truth.add_pose("/mana/truth.pose", pose(7.0, S))
    assert only_truth.at(S).transform("site", "mana/base").matrix[0, 3] == 7.0


def test_of_two_sources_the_one_nearest_in_time_is_used() -> None:
    world_history = history()
    world_history.add_pose("/mana/gnss.pose", pose(1.4, S + 400_000_000))
    world = world_history.at(S + 400_000_000)
    assert world.transform("site", "mana/base").matrix[0, 3] == 1.4
    assert world.omitted == {"site to mana/base by /mana/vo.pose": "/mana/gnss.pose is used instead"}


def test_a_pose_in_a_second_frame_connects_both_with_covariance() -> None:
    world_history = history()
    world_history.add_pose("/mana/slam.pose", pose(5.0, S, sigma_m=0.05, parent="mana/map"))
    world = world_history.at(S)
    assert not world.omitted
    T_map_base, T_site_map = world.transform("mana/map", "mana/base"), world.transform("site", "mana/map")
    assert T_map_base.matrix[0, 3] == pytest.approx(5.0)
    assert T_site_map.matrix[0, 3] == pytest.approx(1.0 - 5.0)
    assert T_map_base.covariance is not None
    np.testing.assert_allclose(np.diag(T_map_base.covariance), 0.05**2)
    reread = read_world(write_world(world))
    assert reread.transform("mana/map", "mana/base").matrix[0, 3] == pytest.approx(5.0)


def test_poses_without_valid_frames_are_omitted() -> None:
    world_history = WorldHistory()
    world_history.add_pose("/mana/arm.joint", pose(1.0, 0, child="Upper Arm"))
    world_history.add_pose("/mana/vo.motion", pose(1.0, 0, child="site"))
    world = world_history.at(0)
    assert world.frames == ()
    assert "expected [a-z0-9_]+" in world.omitted["/mana/arm.joint"]
    assert "motion of site" in world.omitted["/mana/vo.motion"]


def test_items_are_found_by_type_and_frame() -> None:
    world = history().at(S)
    assert [item.name for item in world.items_of("Pointcloud")] == ["/mana/lidar.cloud"]
    assert world.items_of("Pointcloud", "site") == ()
    assert world.item("/mana/lidar.cloud").stamp_ns == S
    with pytest.raises(ProductNotFoundError, match=r"it has /mana/lidar\.cloud"):
        world.item("/mana/camera.frame")


def test_a_sensor_states_its_mount() -> None:
    world_history = WorldHistory()
    cloud = Pointcloud.from_points([[0, 0, 0]], frame="mana/lidar", stamp_ns=0, T_robot_sensor=MOUNT)
    world_history.add_item("/mana/lidar.cloud", "Pointcloud", 0, cloud)
    assert world_history.at(0).transform("mana/base", "mana/lidar").matrix[2, 3] == 1.5


def test_the_difference_of_two_times_has_motions_and_new_items() -> None:
    world_history = history()
    first = world_history.at(0)
    world_history.add_item("/mana/lidar.cloud", "Pointcloud", 2 * S, first.item("/mana/lidar.cloud").value)
    world_history.add_item("/mana/vo.pose", "TransformWithCovariance", 2 * S, pose(2.0, 2 * S))
    changes = first.difference_to(world_history.at(2 * S))
    (motion,) = changes.motions
    assert (motion.parent, motion.child) == ("site", "mana/base")
    assert motion.distance_m == pytest.approx(2.0)
    assert motion.angle_rad == pytest.approx(0.0, abs=1e-9)
    assert changes.items_changed == ("/mana/lidar.cloud",)
    assert changes.items_added == ("/mana/vo.pose",)
    assert changes.frames_added == changes.frames_removed == changes.reparented == ()


def test_a_world_is_read_from_its_file_as_it_was_written() -> None:
    world = history().at(S + 1000)
    read = read_world(write_world(world))
    assert read.stamp_ns == world.stamp_ns
    assert read.frames == world.frames
    for ours, theirs in zip(world.edges, read.edges, strict=True):
        np.testing.assert_array_equal(ours.transform.matrix, theirs.transform.matrix)
        np.testing.assert_array_equal(ours.transform.covariance, theirs.transform.covariance)
    assert read.items[0].value == world.items[0].value


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\xc1", "not MessagePack"),
        (msgpack.packb([1]), "expected a MessagePack map"),
        (msgpack.packb({"format": "cdff world", "version": 9}), "version 9, expected 1"),
        (msgpack.packb({"format": "cdff world", "version": 1}), "KeyError"),
    ],
)
def test_other_bytes_are_refused(data: bytes, message: str) -> None:
    with pytest.raises(CodecError, match=message):
        read_world(data)


def test_edges_that_would_close_a_loop_are_omitted() -> None:
    from cdff_common.world import WorldEdge

    edges = [WorldEdge("a", "b", MOUNT, "/x/y.z"), WorldEdge("b", "a", MOUNT, "/x/y.w")]
    world = World.of(0, edges, [])
    assert [edge.child for edge in world.edges] == ["b"]
    assert "close a loop" in next(iter(world.omitted.values()))


def test_poses_of_a_static_topic_of_ros_hold_at_all_times() -> None:
    world_history = WorldHistory()
    world_history.add_pose("/mana/tf_static.lidar", pose(0.3, 900 * S, child="mana/lidar"))
    world_history.add_pose("/mana/vo.pose", pose(1.0, S))
    np.testing.assert_allclose(
        world_history.at(S).transform("site", "mana/lidar").matrix[:3, 3], [0.3, 0.0, 0.0]
    )
