# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frame graphs and pose tracks: lookup, interpolation and pruning."""

import numpy as np
import pytest

from cdff_common.errors import ConflictError, ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, PoseTrack, UncertainTransform, checked_frame, interpolate, se3


def pose_at(x: float, yaw: float = 0.0, sigma: float | None = 0.0) -> UncertainTransform:
    c = None if sigma is None else np.eye(6) * sigma**2
    return UncertainTransform(se3.transform(se3.exp_so3([0, 0, yaw]), [x, 0, 0]), c)


@pytest.fixture
def graph() -> FrameGraph:
    graph = FrameGraph()
    graph.set_static("site", "mana/odom", pose_at(1.0))
    graph.track("mana/odom", "mana/base").insert(0, pose_at(0.0))
    graph.track("mana/odom", "mana/base").insert(1000, pose_at(2.0))
    graph.set_static("mana/base", "mana/lidar", pose_at(0.5))
    graph.set_static("site", "minnie/odom", pose_at(10.0))
    return graph


def test_a_lookup_composes_the_edges_of_a_chain(graph: FrameGraph) -> None:
    assert np.isclose(graph.lookup("site", "mana/lidar", 1000).matrix[0, 3], 3.5)


def test_a_lookup_from_child_to_parent_is_the_inverse(graph: FrameGraph) -> None:
    down, up = graph.lookup("site", "mana/lidar", 1000), graph.lookup("mana/lidar", "site", 1000)
    assert np.allclose(down.matrix @ up.matrix, np.eye(4))


def test_a_lookup_uses_the_common_ancestor(graph: FrameGraph) -> None:
    assert np.isclose(graph.lookup("minnie/odom", "mana/base", 0).matrix[0, 3], -9.0)


def test_moving_edges_are_interpolated(graph: FrameGraph) -> None:
    assert np.isclose(graph.lookup("mana/odom", "mana/base", 500).matrix[0, 3], 1.0)


def test_a_time_outside_the_track_is_refused(graph: FrameGraph) -> None:
    with pytest.raises(ExtrapolationError, match="known from 0 to 1000"):
        graph.lookup("site", "mana/base", 5000)


def test_the_nearest_pose_is_used_within_the_limit() -> None:
    track = PoseTrack(extrapolation_limit_ns=100)
    track.insert(0, pose_at(1.0))
    assert track.at(100).matrix[0, 3] == 1.0
    with pytest.raises(ExtrapolationError):
        track.at(101)


def test_an_unknown_frame_is_refused_with_the_known_ones(graph: FrameGraph) -> None:
    with pytest.raises(FrameNotFoundError, match=r"venus.*mana/base"):
        graph.lookup("site", "venus", 0)


def test_a_frame_has_one_parent(graph: FrameGraph) -> None:
    with pytest.raises(ConflictError, match="has the parent"):
        graph.set_static("minnie/odom", "mana/base", pose_at(0.0))


def test_an_edge_that_closes_a_loop_is_refused(graph: FrameGraph) -> None:
    with pytest.raises(InputError, match="loop"):
        graph.set_static("mana/lidar", "site", pose_at(0.0))


def test_a_lookup_over_an_edge_without_covariance_has_none(graph: FrameGraph) -> None:
    graph.set_static("mana/base", "mana/imu", pose_at(0.0, sigma=None))
    assert graph.lookup("site", "mana/imu", 0).covariance is None
    assert graph.lookup("site", "mana/lidar", 0).covariance is not None


def test_rotation_is_interpolated_along_the_geodesic() -> None:
    half = interpolate(pose_at(0.0, 0.0), pose_at(0.0, 1.0), 0.5)
    assert np.isclose(se3.log_so3(half.matrix[:3, :3])[2], 0.5)


def test_a_fraction_above_one_is_refused_by_interpolation() -> None:
    with pytest.raises(InputError, match="fraction"):
        interpolate(pose_at(0.0), pose_at(1.0), 1.5)


def test_pruning_keeps_the_last_pose_before_the_limit() -> None:
    track = PoseTrack()
    for stamp in range(5):
        track.insert(stamp * 10, pose_at(float(stamp)))
    track.evict_before(25)
    assert track.stamps_ns == [20, 30, 40]
    assert track.at(25).matrix[0, 3] == 2.5


def test_pruning_keeps_poses_around_pinned_times_and_refuses_times_in_between() -> None:
    track = PoseTrack()
    for stamp in range(10):
        track.insert(stamp * 10, pose_at(float(stamp)))
    track.evict_before(65, keep_ns=[15, 40])
    assert track.stamps_ns == [10, 20, 40, 50, 60, 70, 80, 90]
    assert track.at(15).matrix[0, 3] == 1.5
    assert track.at(45).matrix[0, 3] == 4.5
    with pytest.raises(ExtrapolationError, match="from 20 to 40 were evicted"):
        track.at(30)
    track.evict_before(85, keep_ns=[15])
    assert track.stamps_ns == [10, 20, 80, 90]
    with pytest.raises(ExtrapolationError, match="from 20 to 80 were evicted"):
        track.at(70)
    track.evict_before(85)
    assert track.stamps_ns == [80, 90]
    assert track.at(80).matrix[0, 3] == 8.0
    assert not track.gap_ends


@pytest.mark.parametrize("frame", ["", "Site", "a//b", "/a", "a/", "a b", "x" * 200, "a\n"])
def test_invalid_frame_ids_are_refused(frame: str) -> None:
    with pytest.raises(InputError):
        checked_frame(frame)


def test_a_non_rigid_transform_is_refused() -> None:
    with pytest.raises(InputError, match="rigid"):
        UncertainTransform(2 * np.eye(4))
