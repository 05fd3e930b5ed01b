# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.codecs import encode
from cdff_common.errors import CodecError, ExtrapolationError, FrameNotFoundError, InputError, StorageError
from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.frame_graph import EXTRAPOLATION_LIMIT_NS
from cdff_common.types import TransformWithCovariance
from dpm_store import Store
from dpm_store.frames.frames import HistoryView
from tests.support.store_products import header, put

S = 1_000_000_000
POSE = {"product": "pose", "type_name": "TransformWithCovariance", "port": "pose", "dfpc": "position_manager"}


def pose(x: float, yaw: float = 0.0) -> UncertainTransform:
    return UncertainTransform(se3.transform(se3.exp_so3([0, 0, yaw]), [x, 0, 0]), np.eye(6) * 0.04)


def insert(
    store: Store,
    second: float,
    T: UncertainTransform,
    *,
    child: str = "mana/base",
    parent: str = "site",
    **names: str,
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


def test_the_source_with_the_closest_poses_is_used(store: Store) -> None:
    for second, x in ((0, 0), (10, 0)):
        insert(store, second, pose(x), dfpc="rare")
    for second, x in ((4, 7), (6, 7)):
        insert(store, second, pose(x), dfpc="often")
    assert store.poses.at(5 * S, "site", "mana/base").matrix[0, 3] == pytest.approx(7)
    assert store.poses.at(2 * S, "site", "mana/base").matrix[0, 3] == pytest.approx(0)


def test_a_series_has_the_poses_of_an_interval(store: Store) -> None:
    for second in range(5):
        insert(store, second, pose(second))
    series = store.poses.series("mana", 1 * S, 3 * S, frame="site")
    assert [p.pose.matrix[0, 3] for p in series] == [1, 2, 3]
    assert [p.stamp_ns for p in series] == [1 * S, 2 * S, 3 * S]
    with pytest.raises(InputError, match="more than 2"):
        store.poses.series("mana", limit=2, frame="site")
    thinned = store.poses.series("mana", limit=2, thin=True, frame="site")
    assert [p.stamp_ns for p in thinned] == [0, 3 * S, 4 * S]  # every third and the last
    (track,) = store.poses.tracks("mana")
    assert (track.t0_ns, track.t1_ns, track.count) == (0, 4 * S, 5)


def test_the_newest_time_has_a_pose_of_every_edge_of_the_chain(store: Store) -> None:
    assert store.poses.newest_ns("site", "mana/base") is None
    for second in range(3):
        insert(store, second, pose(second))
    insert(store, 1, pose(0), child="minnie/base")
    assert store.poses.newest_ns("site", "mana/base") == 2 * S
    assert store.poses.newest_ns("minnie/base", "mana/base") == 1 * S


def test_a_deleted_pose_is_not_in_the_series(store: Store) -> None:
    insert(store, 0, pose(0))
    deleted_id = insert(store, 1, pose(99))
    insert(store, 2, pose(2))
    store.delete(deleted_id)
    assert store.poses.at(S, "site", "mana/base").matrix[0, 3] == pytest.approx(1)


def test_a_pose_that_cannot_be_decoded_is_not_stored(store: Store) -> None:
    with pytest.raises(CodecError):
        put(store, header(0, child="mana/base"), b"\xff\xff", **POSE)
    assert store.statistics().count == 0


@pytest.mark.req("CDFF-SUP-085")
def test_robots_of_two_sites_are_connected_through_the_body(store: Store) -> None:
    mars = body("mars")
    degree_m = np.deg2rad(1.0) * mars.axes_m[0]
    store.anchors.anchor("site", Anchor(mars, 77.5, 18.4), sigma_m=1.0)
    first = store.anchors.anchor("site_b", Anchor(mars, 77.5, 18.4 + 200.0 / degree_m), sigma_m=1.0)
    insert(store, 0, pose(0.0))
    insert(store, 2, pose(4.0))
    insert(store, 0, pose(10.0), child="minnie/base", parent="site_b", robot="minnie")
    insert(store, 2, pose(12.0), child="minnie/base", parent="site_b", robot="minnie")
    T = store.poses.at(1 * S, "mana/base", "minnie/base")
    assert T.matrix[:2, 3] == pytest.approx([11.0 - 2.0, 200.0], abs=0.02)
    assert T.covariance is not None
    assert np.diag(T.covariance)[:2] == pytest.approx(
        [2 * 0.04 + 2.0, 2 * 0.04 + 2.0], abs=0.01 + 0.04 * 200**2
    )
    # A corrected anchor of the second site moves its robot; the earlier state can still be queried.
    store.anchors.anchor("site_b", Anchor(mars, 77.5, 18.4 + 300.0 / degree_m), sigma_m=1.0)
    assert store.poses.at(1 * S, "mana/base", "minnie/base").matrix[1, 3] == pytest.approx(300.0, abs=0.02)
    earlier = store.poses.at(1 * S, "mana/base", "minnie/base", view=HistoryView(state=first.state))
    assert np.array_equal(earlier.matrix, T.matrix)


@pytest.mark.req("CDFF-SUP-081", "CDFF-SUP-085")
def test_a_replaced_pose_can_be_queried_in_its_earlier_state(store: Store, clock: ManualClock) -> None:
    insert(store, 0, pose(0.0))
    replaced_id = insert(store, 2, pose(2.0))
    before_ns = clock.now_ns()
    clock.set_ns(before_ns + S)
    store.delete(replaced_id)
    insert(store, 3, pose(9.0))
    assert store.poses.at(2 * S, "site", "mana/base").matrix[0, 3] == pytest.approx(6.0)
    assert store.poses.at(2 * S, "site", "mana/base", view=HistoryView(before_ns)).matrix[0, 3] == 2.0
    assert store.poses.newest_ns("mana/base", view=HistoryView(before_ns)) == 2 * S
    with pytest.raises(ExtrapolationError):
        store.poses.at(3 * S, "site", "mana/base", view=HistoryView(before_ns))
    assert [p.stamp_ns for p in store.poses.series("mana", frame="site", view=HistoryView(before_ns))] == [
        0,
        2 * S,
    ]


def test_a_series_is_transformed_into_any_connected_frame(store: Store) -> None:
    store.frames.set("site_b", "site", pose(100.0))
    insert(store, 0, pose(1.0), parent="site_b")
    insert(store, 1, pose(2.0))
    insert(store, 2, pose(3.0), parent="nowhere")
    assert [p.pose.matrix[0, 3] for p in store.poses.series("mana", frame="site")] == [101.0, 2.0]


@pytest.mark.req("CDFF-SUP-081")
def test_a_frame_revision_and_its_event_are_in_one_transaction(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_arguments: object, **_fields: object) -> None:
        raise StorageError("no space left")

    monkeypatch.setattr(type(store.events), "append", fails)
    with pytest.raises(StorageError):
        store.frames.set("mana/odom", "site", pose(1.0))
    assert store.frames.current() == ()
    assert store.frames.state() == 0
