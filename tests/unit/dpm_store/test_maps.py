# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Windows and profiles out of a store: every patch once, in any frame, as it is and as it was."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from cdff_common.raster import CellStatistics
from cdff_common.raster.choice import Choice, Disagreement
from dpm_store import Store
from dpm_store.profile import elevation_profile
from dpm_store.windows import WindowQuery
from tests.unit.dpm_store.map_products import S, ground, put_known_patch, put_patch

WHOLE = parse_region("bbox:0,0,10,10")


def scattered(store: Store, rng: np.random.Generator, count: int) -> tuple[list[str], np.ndarray]:
    ids, points = [], []
    for seq in range(1, count + 1):
        x, y = rng.uniform(0.0, 8.0, 2)
        robot = "minnie" if seq % 3 == 0 else "mana"
        an_id, some = put_patch(store, rng, (x, y, x + 2.0, y + 2.0), seq, robot, n=800)
        ids.append(an_id)
        points.append(some)
    return ids, np.vstack(points)


@pytest.mark.parametrize(("cell_m", "delivered_m"), [(None, 0.1), (0.05, 0.1), (0.25, 0.2), (1.0, 1.0)])
def test_a_window_counts_every_point_of_every_robot_once(
    store: Store, rng: np.random.Generator, cell_m: float | None, delivered_m: float
) -> None:
    ids, points = scattered(store, rng, 40)
    found = store.maps.elevation_window(WindowQuery(WHOLE, cell_m))
    geometry = found.map.geometry
    assert geometry.resolution_m == pytest.approx(delivered_m)
    direct = CellStatistics.from_points(geometry, points, stamps_ns=0).to_layers(0)
    for name in ("mean", "variance", "min", "max", "count"):
        np.testing.assert_allclose(found.map.layer(name), direct[name], rtol=2e-4, atol=2e-6, err_msg=name)
    assert sorted(found.patches) == sorted(ids)
    assert (found.robots, found.robot) == (("mana", "minnie"), "ground")
    assert (found.oldest_ns, found.newest_ns) == (1 * S, 40 * S)


def test_one_robot_can_be_asked_for(store: Store, rng: np.random.Generator) -> None:
    scattered(store, rng, 9)
    assert store.maps.elevation_window(WindowQuery(WHOLE, robot="minnie")).robots == ("minnie",)


def test_a_window_of_two_robots_has_what_their_patches_know_beyond_heights(
    store: Store, rng: np.random.Generator
) -> None:
    first = put_known_patch(store, rng, (0.0, 0.0, 4.0, 4.0), 1, "mana", overhang_m=1.5)
    second = put_known_patch(store, rng, (2.0, 0.0, 6.0, 4.0), 2, "minnie")
    found = store.maps.elevation_window(WindowQuery(parse_region("bbox:0,0,6,4")))
    assert found.map.layer_names[:6] == ("mean", "variance", "min", "max", "count", "age_s")
    assert set(found.map.layer_names[6:]) == {
        "pose_variance", "error_variance", "first_age_s", "intensity", "overhang_m"
    }  # fmt: skip
    x, _ = found.map.geometry.centres_m()
    seen = np.isfinite(found.map.layer("mean"))
    for name in ("pose_variance", "error_variance", "first_age_s", "intensity"):
        np.testing.assert_array_equal(np.isfinite(found.map.layer(name)), seen, err_msg=name)
    np.testing.assert_allclose(found.map.layer("intensity")[seen & (x < 2.0)], 10.0)
    np.testing.assert_allclose(found.map.layer("first_age_s")[seen & (x < 2.0)], 1.5)
    n1, n2 = (np.nan_to_num(m.layer("count")) for m in (first, second))
    both, n1, n2 = seen[:, 20:40], n1[:, 20:], n2[:, :20]
    np.testing.assert_allclose(
        found.map.layer("pose_variance")[:, 20:40][both], ((0.01 * n1 + 0.02 * n2)[both] / (n1 + n2)[both]), rtol=1e-5
    )
    assert not np.isfinite(found.map.layer("overhang_m")[x > 4.0]).any()
    assert np.all(found.map.layer("error_variance")[seen] > found.map.layer("pose_variance")[seen])


def test_a_window_where_no_patch_knows_more_has_the_six_layers(store: Store, rng: np.random.Generator) -> None:
    put_known_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1)
    put_patch(store, rng, (4.0, 0.0, 6.0, 2.0), 2)
    without = store.maps.elevation_window(WindowQuery(parse_region("bbox:4,0,6,2")))
    assert without.map.layer_names == ("mean", "variance", "min", "max", "count", "age_s")


@pytest.mark.req("CDFF-SUP-180")
def test_what_disagrees_is_counted_and_can_be_left_out(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 4.0, 4.0), 1)
    put_patch(store, rng, (0.0, 0.0, 2.0, 4.0), 2, lift_m=0.5)
    region = parse_region("bbox:0,0,4,4")
    kept = store.maps.elevation_window(WindowQuery(region))
    assert 300 < kept.disagreeing <= 800
    left_out = store.maps.elevation_window(WindowQuery(region, disagreement=Disagreement.DROP))
    assert left_out.coverage == pytest.approx(kept.coverage - kept.disagreeing / 1600)
    assert left_out.header.id != kept.header.id
    newest = store.maps.elevation_window(WindowQuery(region, choice=Choice.NEWEST))
    x, y = newest.map.geometry.centres_m()
    lift = np.asarray(newest.map.layer("mean")) - ground(x, y)
    assert np.nanmedian(lift[x < 2.0]) == pytest.approx(0.5, abs=0.02)
    assert np.nanmedian(lift[x > 2.0]) == pytest.approx(0.0, abs=0.02)


def anchored(store: Store, dx_m: float, yaw_deg: float = 0.0) -> None:
    T = se3.transform(se3.exp_so3([0.0, 0.0, np.radians(yaw_deg)]), [dx_m, 0.0, 0.0])
    store.frames.set("mana/odom", "site", UncertainTransform(T))


@pytest.mark.req("CDFF-SUP-180")
def test_a_patch_of_a_corrected_frame_is_carried_to_where_it_is_now_and_was_then(
    store: Store, rng: np.random.Generator, clock: ManualClock
) -> None:
    anchored(store, 0.0)
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1, frame="mana/odom")
    before = store.maps.elevation_window(WindowQuery(WHOLE))
    state, known_ns = before.frames_revision, clock.now_ns()
    clock.set_ns(clock.now_ns() + S)
    anchored(store, 5.0, yaw_deg=90.0)
    after = store.maps.elevation_window(WindowQuery(WHOLE))
    columns = np.flatnonzero(np.isfinite(np.asarray(after.map.layer("mean"))).any(axis=0))
    assert (columns[0], columns[-1]) == (30, 49)
    assert after.resampled == {"mana/odom": 1}
    assert after.header.id != before.header.id
    for again in (WindowQuery(WHOLE, frames_revision=state), WindowQuery(WHOLE, as_of_ns=known_ns)):
        then = store.maps.elevation_window(again)
        np.testing.assert_array_equal(then.map.layer("mean"), before.map.layer("mean"))


def test_as_of_holds_what_was_deleted_since_and_not_what_came_since(
    store: Store, rng: np.random.Generator, clock: ManualClock
) -> None:
    gone, _ = put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1)
    known_ns = clock.now_ns()
    clock.set_ns(clock.now_ns() + S)
    store.delete(gone)
    newer, _ = put_patch(store, rng, (4.0, 0.0, 6.0, 2.0), 2)
    assert store.maps.elevation_window(WindowQuery(WHOLE)).patches == (newer,)
    assert store.maps.elevation_window(WindowQuery(WHOLE, as_of_ns=known_ns)).patches == (gone,)


def test_frames_that_cannot_be_carried_over_are_named(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1)
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 2, frame="elsewhere")
    tilted = UncertainTransform(se3.exp_se3([0.0, 0.0, 0.0, np.radians(45.0), 0.0, 0.0]))
    store.frames.set("mana/odom", "site", tilted)
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 3, frame="mana/odom")
    found = store.maps.elevation_window(WindowQuery(WHOLE))
    assert (found.skipped_frames, found.unplaced_frames) == (("mana/odom",), ("elsewhere",))
    assert len(found.patches) == 1


def test_windows_without_patches_or_too_large_are_refused(store: Store, rng: np.random.Generator) -> None:
    with pytest.raises(ProductNotFoundError, match="no dem patch in bbox"):
        store.maps.elevation_window(WindowQuery(WHOLE))
    put_patch(store, rng, (0.0, 0.0, 1.0, 1.0), 1)
    with pytest.raises(InputError, match="ask for a smaller region"):
        store.maps.elevation_window(WindowQuery(parse_region("bbox:-1000,-1000,1000,1000")))
    with pytest.raises(ProductNotFoundError, match="wanted"):
        store.maps.elevation_window(WindowQuery(WHOLE, newest_after_ns=2 * S))


@pytest.mark.req("CDFF-SUP-182")
def test_a_profile_reads_the_cell_under_each_sample(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 4.0, 2.0), 1, n=30_000)
    path = np.array([[0.55, 0.55], [3.55, 0.55], [3.55, 5.0]])
    found = elevation_profile(store.maps, WindowQuery(), path, 0.1)
    assert found.distance_m[0] == 0.0
    assert found.distance_m[-1] == pytest.approx(3.0 + 4.45)
    assert np.all(np.diff(found.distance_m) > 0.0)
    seen = found.count > 0
    assert seen[found.points_m[:, 1] < 1.99].all()
    assert not seen[found.points_m[:, 1] > 2.01].any()
    x, y = found.points_m[seen].T
    np.testing.assert_allclose(found.mean_m[seen], ground(x, y), atol=0.06)
    assert np.isnan(found.sigma_m[~seen]).all()
    assert 0.005 < np.nanmedian(found.sigma_m) < 0.05


def test_a_long_profile_agrees_with_the_window(store: Store, rng: np.random.Generator) -> None:
    for seq in range(1, 31):
        put_patch(store, rng, (2.0 * seq - 2.0, 0.0, 2.0 * seq + 0.5, 1.0), seq, n=4000)
    found = elevation_profile(store.maps, WindowQuery(), np.array([[0.05, 0.55], [59.0, 0.55]]), 0.1)
    window = store.maps.elevation_window(WindowQuery(parse_region("bbox:0,0,60,1")))
    rows, cols, _ = window.map.geometry.cells_of(found.points_m[:, 0], found.points_m[:, 1])
    np.testing.assert_allclose(found.mean_m, np.asarray(window.map.layer("mean"))[rows, cols], rtol=1e-5, atol=1e-6)


def test_profiles_without_length_or_end_are_refused(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 1.0, 1.0), 1)
    with pytest.raises(InputError, match="no length"):
        elevation_profile(store.maps, WindowQuery(), np.array([[0.5, 0.5], [0.5, 0.5]]), None)
    with pytest.raises(InputError, match="larger step_m"):
        elevation_profile(store.maps, WindowQuery(), np.array([[0.5, 0.5], [1e6, 0.5]]), None)
    with pytest.raises(ProductNotFoundError, match="around the line"):
        elevation_profile(store.maps, WindowQuery(), np.array([[50.0, 0.0], [51.0, 0.0]]), None)
