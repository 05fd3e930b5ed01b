# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import ConflictError, FrameNotFoundError, InputError, StorageError
from cdff_common.geometry import UncertainTransform, se3
from dpm_store import Store
from dpm_store.frames.frames import HistoryView


def shift(x: float, y: float = 0.0, sigma: float = 0.1) -> UncertainTransform:
    return UncertainTransform(se3.transform(np.eye(3), [x, y, 0.0]), np.eye(6) * sigma**2)


def test_a_lookup_composes_up_and_down_the_tree(store: Store) -> None:
    store.frames.set("mana/odom", "site", shift(1))
    store.frames.set("minnie/odom", "site", shift(10))
    store.frames.set("mana/lander", "mana/odom", shift(2))
    T = store.poses.at(0, "minnie/odom", "mana/lander")
    assert T.matrix[0, 3] == pytest.approx(1 + 2 - 10)
    assert T.covariance is not None
    assert T.covariance[0, 0] == pytest.approx(0.03)
    direct = store.frames.tree().find("minnie/odom", "mana/lander")
    assert direct is not None
    assert np.array_equal(direct.matrix, T.matrix)
    assert np.array_equal(store.poses.at(0, "site", "site").matrix, np.eye(4))


def test_every_revision_is_kept_and_the_last_one_is_used(store: Store, clock: ManualClock) -> None:
    assert store.frames.set("mana/odom", "site", shift(1), producer="a").revision == 1
    before_ns = clock.now_ns()
    clock.set_ns(before_ns + 10**9)
    assert store.frames.set("mana/odom", "site", shift(5), producer="b").revision == 2
    assert store.poses.at(0, "site", "mana/odom").matrix[0, 3] == 5.0
    assert store.poses.at(0, "site", "mana/odom", view=HistoryView(before_ns)).matrix[0, 3] == 1.0
    assert [(r.revision, r.producer) for r in store.frames.revisions("mana/odom")] == [(1, "a"), (2, "b")]
    assert [r.revision for r in store.frames.current()] == [2]
    assert [r.revision for r in store.frames.current(as_of_ns=before_ns)] == [1]


def test_a_revision_is_used_only_within_its_validity(store: Store) -> None:
    store.frames.set("mana/odom", "site", shift(1), valid_until_ns=1000)
    store.frames.set("mana/odom", "site", shift(2), valid_from_ns=1000, valid_until_ns=2000)
    assert store.poses.at(0, "site", "mana/odom").matrix[0, 3] == 1.0
    assert store.poses.at(1000, "site", "mana/odom").matrix[0, 3] == 2.0
    with pytest.raises(FrameNotFoundError):
        store.poses.at(2000, "site", "mana/odom")


def test_concurrent_revisions_are_refused(store: Store) -> None:
    store.frames.set("mana/odom", "site", shift(1), expected_revision=0)
    with pytest.raises(ConflictError, match="revision 1"):
        store.frames.set("mana/odom", "site", shift(2), expected_revision=0)
    assert len(store.frames.revisions("mana/odom")) == 1


def test_loops_and_empty_validities_are_refused(store: Store) -> None:
    store.frames.set("b", "a", shift(1))
    store.frames.set("c", "b", shift(1))
    with pytest.raises(InputError, match="loop"):
        store.frames.set("a", "c", shift(1))
    with pytest.raises(InputError, match="loop"):
        store.frames.set("a", "a", shift(1))
    with pytest.raises(InputError, match="empty"):
        store.frames.set("d", "a", shift(1), valid_from_ns=5000, valid_until_ns=5000)
    with pytest.raises(InputError, match="frame"):
        store.frames.set("Not A Frame", "a", shift(1))


def test_a_chain_of_more_than_64_frames_is_refused(store: Store) -> None:
    for i in range(64):
        store.frames.set(f"f{i + 1}", f"f{i}", shift(1))
    with pytest.raises(InputError, match="64 ancestors or more"):
        store.frames.set("f65", "f64", shift(1))


def test_unknown_frames_are_not_found(store: Store) -> None:
    with pytest.raises(FrameNotFoundError):
        store.frames.revisions("nowhere")
    with pytest.raises(FrameNotFoundError):
        store.poses.at(0, "site", "nowhere")
    assert store.frames.tree().find("site", "nowhere") is None


def test_revisions_cannot_be_changed(store: Store) -> None:
    store.frames.set("mana/odom", "site", shift(1))
    for statement in ("DELETE FROM frames", "UPDATE frames SET parent = 'x'"):
        with pytest.raises(StorageError, match="append-only"), store._database.write() as connection:
            connection.exec_driver_sql(statement)


@pytest.mark.req("CDFF-SUP-082")
def test_trees_of_one_time_and_several_states_are_distinguished(store: Store) -> None:
    store.frames.set("mana/odom", "site", shift(1.0))
    now_ns = store.frames.set("mana/odom", "site", shift(2.0)).inserted_ns

    def edges(state: int | None) -> list[float]:
        return [edge.T_parent_frame.matrix[0, 3] for edge in store.frames.current(now_ns, state)]

    assert (edges(None), edges(1), edges(2), edges(None)) == ([2.0], [1.0], [2.0], [2.0])
