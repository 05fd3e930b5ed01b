# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Windows and profiles: every patch once, in any frame, in the present and in earlier states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from cdff_common.raster import CellStatistics
from cdff_common.raster.cell_selection import Choice, Disagreement
from dpm_store import Store
from dpm_store.maps import elevation
from dpm_store.maps.profile import elevation_profile
from dpm_store.maps.windows import WindowQuery
from tests.support.map_products import S, ground, put_patch, put_patch_with_all_layers

WHOLE = parse_region("bbox:0,0,10,10")


def put_random_patches(store: Store, rng: np.random.Generator, count: int) -> tuple[list[str], np.ndarray]:
    ids, points = [], []
    for seq in range(1, count + 1):
        x, y = rng.uniform(0.0, 8.0, 2)
        robot = "minnie" if seq % 3 == 0 else "mana"
        patch_id, patch_points = put_patch(store, rng, (x, y, x + 2.0, y + 2.0), seq, robot, n=800)
        ids.append(patch_id)
        points.append(patch_points)
    return ids, np.vstack(points)


@pytest.mark.parametrize(("cell_m", "delivered_m"), [(None, 0.1), (0.05, 0.1), (0.25, 0.2), (1.0, 1.0)])
def test_a_window_counts_every_point_of_every_robot_once(
    store: Store, rng: np.random.Generator, cell_m: float | None, delivered_m: float
) -> None:
    ids, points = put_random_patches(store, rng, 40)
    window = store.maps.elevation_window(WindowQuery(WHOLE, cell_m))
    geometry = window.map.geometry
    assert geometry.resolution_m == pytest.approx(delivered_m)
    direct = CellStatistics.from_points(geometry, points, stamps_ns=0).to_layers(0)
    for name in ("mean", "variance", "min", "max", "count"):
        np.testing.assert_allclose(window.map.layer(name), direct[name], rtol=2e-4, atol=2e-6, err_msg=name)
    assert sorted(window.patches) == sorted(ids)
    assert (window.robots, window.robot) == (("mana", "minnie"), "ground")
    assert (window.oldest_ns, window.newest_ns) == (1 * S, 40 * S)


def test_a_window_can_be_of_one_robot(store: Store, rng: np.random.Generator) -> None:
    put_random_patches(store, rng, 9)
    assert store.maps.elevation_window(WindowQuery(WHOLE, robot="minnie")).robots == ("minnie",)


def test_a_window_of_two_robots_has_the_auxiliary_layers_of_their_patches(
    store: Store, rng: np.random.Generator
) -> None:
    first = put_patch_with_all_layers(store, rng, (0.0, 0.0, 4.0, 4.0), 1, "mana", overhang_m=1.5)
    second = put_patch_with_all_layers(store, rng, (2.0, 0.0, 6.0, 4.0), 2, "minnie")
    window = store.maps.elevation_window(WindowQuery(parse_region("bbox:0,0,6,4")))
    assert window.map.layer_names[:6] == ("mean", "variance", "min", "max", "count", "age_s")
    assert set(window.map.layer_names[6:]) == {
        "pose_variance",
        "error_variance",
        "first_age_s",
        "intensity",
        "overhang_m",
    }
    x, _ = window.map.geometry.centres_m()
    is_observed = np.isfinite(window.map.layer("mean"))
    for name in ("pose_variance", "error_variance", "first_age_s", "intensity"):
        np.testing.assert_array_equal(np.isfinite(window.map.layer(name)), is_observed, err_msg=name)
    np.testing.assert_allclose(window.map.layer("intensity")[is_observed & (x < 2.0)], 10.0)
    np.testing.assert_allclose(window.map.layer("first_age_s")[is_observed & (x < 2.0)], 1.5)
    n1, n2 = (np.nan_to_num(m.layer("count")) for m in (first, second))
    both, n1, n2 = is_observed[:, 20:40], n1[:, 20:], n2[:, :20]
    np.testing.assert_allclose(
        window.map.layer("pose_variance")[:, 20:40][both],
        ((0.01 * n1 + 0.02 * n2)[both] / (n1 + n2)[both]),
        rtol=1e-5,
    )
    assert not np.isfinite(window.map.layer("overhang_m")[x > 4.0]).any()
    assert np.all(
        window.map.layer("error_variance")[is_observed] > window.map.layer("pose_variance")[is_observed]
    )


def test_a_window_in_strips_equals_the_window_as_a_whole(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_patch_with_all_layers(store, rng, (0.0, 0.0, 4.0, 4.0), 1, "mana", overhang_m=1.5)
    put_patch(store, rng, (0.0, 0.0, 2.0, 4.0), 2, offset_m=0.5)
    query = WindowQuery(parse_region("circle:2,2,2"))
    whole_window = store.maps.elevation_window(query)
    monkeypatch.setattr(elevation, "STRIP_CELLS", 200)
    strips = store.maps.elevation_window(query)
    assert strips.map.layer_names == whole_window.map.layer_names
    for name in whole_window.map.layer_names:
        # cells without neighbours have the typical relief of their strip
        share = 0.05 if name == "error_variance" else 0.0
        differs = ~np.isclose(strips.map.layer(name), whole_window.map.layer(name), rtol=1e-5, equal_nan=True)
        assert np.mean(differs) <= share, name
    assert strips.manifest() == whole_window.manifest()
    assert strips.header.inputs == whole_window.header.inputs


def test_a_window_of_patches_without_auxiliary_layers_has_six_layers(
    store: Store, rng: np.random.Generator
) -> None:
    put_patch_with_all_layers(store, rng, (0.0, 0.0, 2.0, 2.0), 1)
    put_patch(store, rng, (4.0, 0.0, 6.0, 2.0), 2)
    without = store.maps.elevation_window(WindowQuery(parse_region("bbox:4,0,6,2")))
    assert without.map.layer_names == ("mean", "variance", "min", "max", "count", "age_s")


@pytest.mark.req("CDFF-SUP-180")
def test_disagreeing_cells_are_counted_and_can_be_omitted(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 4.0, 4.0), 1)
    put_patch(store, rng, (0.0, 0.0, 2.0, 4.0), 2, offset_m=0.5)
    region = parse_region("bbox:0,0,4,4")
    window = store.maps.elevation_window(WindowQuery(region))
    assert 300 < window.disagreeing <= 800
    consistent = store.maps.elevation_window(WindowQuery(region, disagreement=Disagreement.DROP))
    assert consistent.coverage == pytest.approx(window.coverage - window.disagreeing / 1600)
    assert consistent.header.id != window.header.id
    newest = store.maps.elevation_window(WindowQuery(region, choice=Choice.NEWEST))
    x, y = newest.map.geometry.centres_m()
    error_m = np.asarray(newest.map.layer("mean")) - ground(x, y)
    assert np.nanmedian(error_m[x < 2.0]) == pytest.approx(0.5, abs=0.02)
    assert np.nanmedian(error_m[x > 2.0]) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("strip_cells", [1 << 20, 400])
def test_a_weighted_window_follows_the_robot_with_the_smaller_error(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, strip_cells: int
) -> None:
    monkeypatch.setattr(elevation, "STRIP_CELLS", strip_cells)
    put_patch_with_all_layers(store, rng, (0.0, 0.0, 4.0, 4.0), 1, "mana", offset_m=0.02)
    put_patch_with_all_layers(store, rng, (0.0, 0.0, 4.0, 4.0), 90, "minnie", offset_m=1.0)
    query = WindowQuery(parse_region("bbox:0.5,0.5,3.5,3.5"), choice=Choice.WEIGHTED)
    window = store.maps.elevation_window(query)
    x, y = window.map.geometry.centres_m()
    assert np.nanmedian(window.map.layer("mean") - ground(x, y)) == pytest.approx(0.02, abs=0.02)
    (agreement,) = window.manifest()["agreement"]
    assert window.disagreeing > 0.9 * agreement["cells"]
    assert (agreement["robot"], agreement["references"]) == ("minnie", ["mana"])
    assert agreement["difference_m"] == pytest.approx(0.98, abs=0.05)
    assert agreement["registration"]["T"][2][3] == pytest.approx(-0.98, abs=0.05)
    alone = store.maps.elevation_window(replace(query, robot="mana"))
    pooled = store.maps.elevation_window(replace(query, robot="mana", choice=Choice.POOLED))
    np.testing.assert_array_equal(alone.map.layer("mean"), pooled.map.layer("mean"))


def anchor(store: Store, dx_m: float, yaw_deg: float = 0.0) -> None:
    T = se3.transform(se3.exp_so3([0.0, 0.0, np.radians(yaw_deg)]), [dx_m, 0.0, 0.0])
    store.frames.set("mana/odom", "site", UncertainTransform(T))


@pytest.mark.req("CDFF-SUP-180")
def test_a_patch_of_a_corrected_frame_is_in_its_present_or_earlier_location(
    store: Store, rng: np.random.Generator, clock: ManualClock
) -> None:
    anchor(store, 0.0)
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1, frame="mana/odom")
    before = store.maps.elevation_window(WindowQuery(WHOLE))
    state, before_ns = before.frames_revision, clock.now_ns()
    clock.set_ns(clock.now_ns() + S)
    anchor(store, 5.0, yaw_deg=90.0)
    after = store.maps.elevation_window(WindowQuery(WHOLE))
    columns = np.flatnonzero(np.isfinite(np.asarray(after.map.layer("mean"))).any(axis=0))
    assert (columns[0], columns[-1]) == (30, 49)
    assert after.resampled == {"mana/odom": 1}
    assert after.header.id != before.header.id
    for query in (WindowQuery(WHOLE, frames_revision=state), WindowQuery(WHOLE, as_of_ns=before_ns)):
        earlier = store.maps.elevation_window(query)
        np.testing.assert_array_equal(earlier.map.layer("mean"), before.map.layer("mean"))


def test_a_window_of_an_earlier_state_has_its_patches(
    store: Store, rng: np.random.Generator, clock: ManualClock
) -> None:
    deleted_id, _ = put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1)
    before_ns = clock.now_ns()
    clock.set_ns(clock.now_ns() + S)
    store.delete(deleted_id)
    newer, _ = put_patch(store, rng, (4.0, 0.0, 6.0, 2.0), 2)
    assert store.maps.elevation_window(WindowQuery(WHOLE)).patches == (newer,)
    assert store.maps.elevation_window(WindowQuery(WHOLE, as_of_ns=before_ns)).patches == (deleted_id,)


def test_frames_that_are_not_connected_are_listed(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1)
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 2, frame="elsewhere")
    tilted = UncertainTransform(se3.exp_se3([0.0, 0.0, 0.0, np.radians(45.0), 0.0, 0.0]))
    store.frames.set("mana/odom", "site", tilted)
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 3, frame="mana/odom")
    window = store.maps.elevation_window(WindowQuery(WHOLE))
    assert (window.skipped_frames, window.unplaced_frames) == (("mana/odom",), ("elsewhere",))
    assert len(window.patches) == 1


def test_windows_without_patches_or_too_large_are_refused(store: Store, rng: np.random.Generator) -> None:
    with pytest.raises(ProductNotFoundError, match="no dem patch in bbox"):
        store.maps.elevation_window(WindowQuery(WHOLE))
    put_patch(store, rng, (0.0, 0.0, 1.0, 1.0), 1)
    with pytest.raises(InputError, match="ask for a smaller region"):
        store.maps.elevation_window(WindowQuery(parse_region("bbox:-1000,-1000,1000,1000")))
    with pytest.raises(ProductNotFoundError, match="expected"):
        store.maps.elevation_window(WindowQuery(WHOLE, newest_after_ns=S + 1))
    assert len(store.maps.elevation_window(WindowQuery(WHOLE, newest_after_ns=S)).patches) == 1


@pytest.mark.req("CDFF-SUP-182")
def test_a_profile_reads_the_cell_under_each_sample(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 4.0, 2.0), 1, n=30_000)
    path = np.array([[0.55, 0.55], [3.55, 0.55], [3.55, 5.0]])
    result = elevation_profile(store.maps, WindowQuery(), path, 0.1)
    assert result.distance_m[0] == 0.0
    assert result.distance_m[-1] == pytest.approx(3.0 + 4.45)
    assert np.all(np.diff(result.distance_m) > 0.0)
    is_observed = result.count > 0
    assert is_observed[result.points_m[:, 1] < 1.99].all()
    assert not is_observed[result.points_m[:, 1] > 2.01].any()
    x, y = result.points_m[is_observed].T
    np.testing.assert_allclose(result.mean_m[is_observed], ground(x, y), atol=0.06)
    assert np.isnan(result.sigma_m[~is_observed]).all()
    assert 0.005 < np.nanmedian(result.sigma_m) < 0.05


def test_a_long_profile_agrees_with_the_window(store: Store, rng: np.random.Generator) -> None:
    for seq in range(1, 31):
        put_patch(store, rng, (2.0 * seq - 2.0, 0.0, 2.0 * seq + 0.5, 1.0), seq, n=4000)
    result = elevation_profile(store.maps, WindowQuery(), np.array([[0.05, 0.55], [59.0, 0.55]]), 0.1)
    window = store.maps.elevation_window(WindowQuery(parse_region("bbox:0,0,60,1")))
    rows, cols, _ = window.map.geometry.cells_of(result.points_m[:, 0], result.points_m[:, 1])
    np.testing.assert_allclose(
        result.mean_m, np.asarray(window.map.layer("mean"))[rows, cols], rtol=1e-5, atol=1e-6
    )


def test_a_repeated_corner_of_a_profile_is_one_sample(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 4.0, 2.0), 1)
    path = np.array([[0.5, 0.5], [1.5, 0.5], [1.5, 0.5], [1.5, 1.0]])
    result = elevation_profile(store.maps, WindowQuery(), path, 0.5)
    np.testing.assert_allclose(result.distance_m, [0.0, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(result.points_m, [[0.5, 0.5], [1.0, 0.5], [1.5, 0.5], [1.5, 1.0]])


def test_profiles_without_length_or_end_are_refused(store: Store, rng: np.random.Generator) -> None:
    put_patch(store, rng, (0.0, 0.0, 1.0, 1.0), 1)
    with pytest.raises(InputError, match="no length"):
        elevation_profile(store.maps, WindowQuery(), np.array([[0.5, 0.5], [0.5, 0.5]]), None)
    with pytest.raises(InputError, match="larger step_m"):
        elevation_profile(store.maps, WindowQuery(), np.array([[0.5, 0.5], [1e6, 0.5]]), None)
    with pytest.raises(ProductNotFoundError, match="around the line"):
        elevation_profile(store.maps, WindowQuery(), np.array([[50.0, 0.0], [51.0, 0.0]]), None)
