# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from cdff_common.codecs import encode
from cdff_common.errors import CodecError, ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import TransformWithCovariance
from dpm_store import Store
from dpm_store.poses import EXTRAPOLATION_LIMIT_NS

from .conftest import header, put

S = 1_000_000_000
POSE = {"product": "pose", "type_name": "TransformWithCovariance", "port": "pose", "dfpc": "position_manager"}


def pose(x: float, yaw: float = 0.0) -> UncertainTransform:
    return UncertainTransform(se3.transform(se3.exp_so3([0, 0, yaw]), [x, 0, 0]), np.eye(6) * 0.04)


def insert(
    store: Store, second: float, T: UncertainTransform, *, child: str = "mana/base", parent: str = "site", **names: str
) -> str:
    stamp_ns = int(second * S)
    value = TransformWithCovariance.from_transform(T, parent=parent, child=child, stamp_ns=stamp_ns)
    seq = sum(ord(c) for c in child + parent + names.get("dfpc", ""))
    a_header = header(seq, t1_ns=stamp_ns, frame=parent, child=child)
    put(store, a_header, encode(value, "uper"), **(POSE | names))
    return a_header.id


@pytest.mark.req("CDFF-SUP-033")
def test_poses_between_two_are_interpolated_with_their_covariance(store: Store) -> None:
    insert(store, 0, pose(0, 0))
    insert(store, 2, pose(4, 1))
    T = store.poses.at(1 * S, "site", "mana/base")
    assert T.matrix[:3, 3] == pytest.approx([2, 0, 0])
    assert se3.log_so3(T.matrix[:3, :3]) == pytest.approx([0, 0, 0.5])
    assert T.covariance is not None
    assert T.covariance[0, 0] == pytest.approx(0.04)


def test_extrapolation_is_refused_beyond_the_limit(store: Store) -> None:
    insert(store, 1, pose(1))
    insert(store, 2, pose(2))
    assert store.poses.at(2 * S + EXTRAPOLATION_LIMIT_NS, "site", "mana/base").matrix[0, 3] == 2.0
    for stamp_ns in (2 * S + EXTRAPOLATION_LIMIT_NS + 1000, 0):
        with pytest.raises(ExtrapolationError, match="outside"):
            store.poses.at(stamp_ns, "site", "mana/base")
    assert store.poses.at(0, "site", "mana/base", limit_ns=S).matrix[0, 3] == 1.0


def test_lookups_compose_fixed_and_moving_edges_across_robots(store: Store) -> None:
    store.frames.set("mana/navcam", "mana/base", pose(0.5))
    store.frames.set("lander", "site", pose(100))
    insert(store, 0, pose(0))
    insert(store, 2, pose(2))
    insert(store, 0, pose(10), child="minnie/base")
    insert(store, 2, pose(20), child="minnie/base")
    assert store.poses.at(S, "minnie/base", "mana/navcam").matrix[0, 3] == pytest.approx(1.5 - 15)
    assert store.poses.at(S, "lander", "mana/navcam").matrix[0, 3] == pytest.approx(1.5 - 100)
    with pytest.raises(FrameNotFoundError):
        store.poses.at(S, "site", "nobody/base")


def test_of_several_sources_the_one_with_poses_closest_around_is_taken(store: Store) -> None:
    for second, x in ((0, 0), (10, 0)):
        insert(store, second, pose(x), dfpc="rare")
    for second, x in ((4, 7), (6, 7)):
        insert(store, second, pose(x), dfpc="often")
    assert store.poses.at(5 * S, "site", "mana/base").matrix[0, 3] == pytest.approx(7)
    assert store.poses.at(2 * S, "site", "mana/base").matrix[0, 3] == pytest.approx(0)


def test_a_trajectory_is_the_series_of_a_span(store: Store) -> None:
    for second in range(5):
        insert(store, second, pose(second))
    series = store.poses.trajectory("mana", 1 * S, 3 * S)
    assert [p.pose.matrix[0, 3] for p in series] == [1, 2, 3]
    assert [p.stamp_ns for p in series] == [1 * S, 2 * S, 3 * S]
    newest = store.poses.latest("mana", "site", "mana/base")
    assert newest is not None
    assert newest.stamp_ns == 4 * S
    with pytest.raises(InputError, match="more than 2"):
        store.poses.trajectory("mana", limit=2)
    (track,) = store.poses.tracks("mana")
    assert (track.t0_ns, track.t1_ns, track.count) == (0, 4 * S, 5)


def test_the_newest_time_is_when_every_edge_of_the_chain_is_known(store: Store) -> None:
    assert store.poses.newest_ns("site", "mana/base") is None
    for second in range(3):
        insert(store, second, pose(second))
    insert(store, 1, pose(0), child="minnie/base")
    assert store.poses.newest_ns("site", "mana/base") == 2 * S
    assert store.poses.newest_ns("minnie/base", "mana/base") == 1 * S


def test_a_deleted_pose_is_out_of_the_series(store: Store) -> None:
    insert(store, 0, pose(0))
    gone = insert(store, 1, pose(99))
    insert(store, 2, pose(2))
    store.delete(gone)
    assert store.poses.at(S, "site", "mana/base").matrix[0, 3] == pytest.approx(1)


def test_a_pose_that_cannot_be_decoded_is_not_stored(store: Store) -> None:
    with pytest.raises(CodecError):
        put(store, header(0, child="mana/base"), b"\xff\xff", **POSE)
    assert store.statistics().count == 0
