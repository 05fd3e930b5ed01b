# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError, ProductNotFoundError, RefusedError
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfpcs.navigation_mapping.compound import NavigationMapping

T_NS = 1_700_000_000_000_000_000


def navigation(limits: dict[str, float] | None = None, **config: Any) -> NavigationMapping:
    result = NavigationMapping()
    result.configure({"size_m": 12.0, **config}, DfpcContext("mana", limits=limits or {}))
    return result


def patch(
    slope: float = 0.0, *, x0: float = -4.0, t_ns: int = T_NS, resolution_m: float = 0.05
) -> ElevationMap:
    g = GridGeometry.aligned("site", resolution_m, (x0, -4.0, x0 + 8.0, 4.0))
    x, y = (c.ravel() for c in g.centres_m())
    layers = CellStatistics.from_points(g, np.column_stack([x, y, slope * x]), stamps_ns=t_ns).to_layers(t_ns)
    return ElevationMap.from_layers(g, layers, t0_ns=t_ns - 1000, t1_ns=t_ns)


def step(
    node: NavigationMapping, dem: ElevationMap | None, quality: Quality | None = None, name: str = "p"
) -> list[Output]:
    return list(node.step(Sample("dem", T_NS, 0, dem, id=name, quality=quality or Quality())))


def classes_of(output: Output, radius_m: float = 3.0) -> np.ndarray:
    x, y = output.value.geometry.centres_m()
    return output.value.layer("class")[np.hypot(x, y) < radius_m]


@pytest.mark.req("CDFF-CORE-073")
def test_flat_ground_is_safe_and_unobserved_ground_unknown() -> None:
    out = step(navigation(), patch())[0]
    assert (classes_of(out) == 1).all()
    x, _ = out.value.geometry.centres_m()
    assert (out.value.layer("class")[np.abs(x) > 4.1] == 0).all()
    assert (out.frame, out.t0_ns, out.t1_ns, out.inputs) == ("site", T_NS - 1000, T_NS, ("p",))
    assert sum(out.quality.metrics.values()) == out.value.layer("class").size


@pytest.mark.parametrize(
    ("limits", "config", "expected"),
    [
        ({}, {}, 2),
        ({"max_slope_deg": 30.0}, {}, 1),
        ({"max_slope_deg": 10.0}, {}, 3),
        ({"max_slope_deg": 10.0}, {"traversability": {"max_slope_deg": 30.0}}, 1),
    ],
)
def test_limits_of_the_configuration_precede_those_of_the_profile_and_the_defaults(
    limits: dict[str, float], config: dict[str, Any], expected: int
) -> None:
    out = step(navigation(limits, **config), patch(np.tan(np.radians(18.0))))[0]
    assert (classes_of(out) == expected).all()


def test_the_cell_size_is_a_multiple_of_the_cell_size_of_the_patches() -> None:
    assert step(navigation(resolution_m=0.12), patch())[0].value.geometry.resolution_m == pytest.approx(0.1)
    assert step(navigation(resolution_m=0.1), patch(resolution_m=0.2))[0].value.geometry.resolution_m == 0.2


def test_adjacent_patches_form_one_map() -> None:
    node = navigation(size_m=20.0)
    step(node, patch(x0=-8.0))
    out = step(node, patch(x0=0.0, t_ns=T_NS + 5000), name="q")[0]
    x, y = out.value.geometry.centres_m()
    seam = (np.abs(x) < 1.0) & (np.abs(y) < 3.0)
    assert (out.value.layer("class")[seam] == 1).all()
    assert out.inputs == ("p", "q")
    assert (out.t0_ns, out.t1_ns) == (T_NS - 1000, T_NS + 5000)


def test_an_unchanged_map_is_not_published_again() -> None:
    node = navigation()
    assert len(step(node, patch())) == 1
    assert step(node, patch(t_ns=T_NS + 1000)) == []
    assert len(step(node, patch(0.3))) == 1


def test_an_overhang_observed_later_over_unchanged_ground_is_rated() -> None:
    node, new_node = (navigation({"height_m": 1.5}) for _ in range(2))
    first = step(node, patch())[0].value
    g = patch().geometry
    x, y = g.centres_m()
    overhang = np.where((np.abs(x - 2.0) < 0.2) & (np.abs(y) < 0.2), np.float32(1.1), np.float32(np.nan))
    layers = {name: patch().layer(name) for name in patch().layer_names} | {"overhang_m": overhang}
    with_overhang = ElevationMap.from_layers(g, layers, t0_ns=T_NS, t1_ns=T_NS + 1000)
    second = step(node, with_overhang)[0].value
    x, y = second.geometry.centres_m()
    below = (np.abs(x - 2.0) < 0.2) & (np.abs(y) < 0.2)
    assert (first.layer("class")[below] == 1).all()
    assert (second.layer("class")[below] == 3).all()
    whole_map = step(new_node, with_overhang)[0].value
    np.testing.assert_array_equal(second.layer("class"), whole_map.layer("class"))


def test_a_degraded_patch_degrades_the_map_and_a_failed_one_changes_nothing() -> None:
    node = navigation()
    out = step(node, patch(), Quality(status=Status.DEGRADED, reasons=("poses_degraded",)))[0]
    assert (out.quality.status, out.quality.reasons) == (Status.DEGRADED, ("dem_poses_degraded",))
    assert step(node, None, Quality(status=Status.FAILED)) == []


def test_a_patch_with_incompatible_cells_is_refused_with_the_reason() -> None:
    node = navigation()
    step(node, patch())
    out = step(node, patch(resolution_m=0.03))[0]
    assert out.value is None
    assert out.quality.status is Status.FAILED
    assert "do not fit" in out.quality.reasons[0]


def test_the_map_is_returned_on_request() -> None:
    node = navigation()
    with pytest.raises(ProductNotFoundError):
        node.call("get_map", {})
    with pytest.raises(ProductNotFoundError):
        node.store.get("navigation_map")
    out = step(node, patch())[0]
    assert node.call("get_map", {}) is node.store.get("navigation_map") is out.value


@pytest.mark.parametrize("config", [{"size_m": 0.0}, {"traversability": {"max_step": 1.0}}, {"slope": 3}])
def test_a_wrong_configuration_is_refused(config: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        navigation(**config)


def test_a_limit_of_the_profile_out_of_bounds_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="max_slope_deg"):
        navigation({"max_slope_deg": 120.0})


def rough(seed: int, x0: float = -4.0, *, t_ns: int = T_NS, lump_m: float = 0.0) -> ElevationMap:
    """Return a patch of hills with noise and a block of height ``lump_m`` at (1, 1)."""
    geometry = GridGeometry.aligned("site", 0.05, (x0, -4.0, x0 + 8.0, 4.0))
    x, y = (c.ravel() for c in geometry.centres_m())
    z = 0.3 * np.sin(x) * np.cos(0.7 * y) + np.random.default_rng(seed).normal(0.0, 0.01, x.shape)
    z += lump_m * (np.hypot(x - 1.0, y - 1.0) < 0.3)
    is_observed = np.hypot(x + 1.0, y - 2.0) > 0.6
    points = np.column_stack([x, y, z])[is_observed]
    layers = CellStatistics.from_points(
        geometry, points, stamps_ns=t_ns, height_variance_m2=np.full(len(points), 1e-4)
    ).to_layers(t_ns)
    return ElevationMap.from_layers(geometry, layers, t0_ns=t_ns - 1000, t1_ns=t_ns)


@pytest.mark.req("CDFF-CORE-073")
def test_incremental_rating_equals_rating_of_the_whole_map() -> None:
    patches = [rough(0), rough(1), rough(2, 1.0), rough(3, 1.5), rough(4, lump_m=0.4)]
    partial_patches = [
        patches[0],
        _observed_near(patches[1], 0.5),
        patches[2],
        _observed_near(patches[3], 2.0),
        _observed_near(patches[4], 1.0),
    ]
    node, whole_map = navigation(size_m=14.0), navigation(size_m=14.0)
    for partial_patch in partial_patches:
        step(node, partial_patch)
        whole_map._dem = None  # forces a new rating of the whole map
        step(whole_map, partial_patch)
        a, b = node.get_map(), whole_map.get_map()
        assert a.geometry == b.geometry
        np.testing.assert_array_equal(a.layer("class"), b.layer("class"))
        for name in ("slope_deg", "step_m", "roughness_m", "cost", "confidence"):
            np.testing.assert_allclose(a.layer(name), b.layer(name), rtol=1e-4, atol=1e-5, err_msg=name)


def _observed_near(dem: ElevationMap, half_m: float) -> ElevationMap:
    """Return the patch with only the cells within ``half_m`` of (1, 1) in x and y observed."""
    x, y = dem.geometry.centres_m()
    near = (np.abs(x - 1.0) < half_m) & (np.abs(y - 1.0) < half_m)
    layers = {n: np.where(near, dem.layer(n), 0.0 if n == "count" else np.nan) for n in dem.layer_names}
    return ElevationMap.from_layers(
        dem.geometry, {n: a.astype(np.float32) for n, a in layers.items()}, t0_ns=dem.t0_ns, t1_ns=dem.t1_ns
    )


@pytest.mark.req("CDFF-CORE-073")
def test_a_route_goes_around_a_hazard_with_its_cost() -> None:
    node = navigation()
    step(node, rough(0, lump_m=0.5))
    route = node.call("get_route", {"from_x_m": "-2.5", "from_y_m": "-1.5", "to_x_m": "2.8", "to_y_m": "2.2"})
    result = node.get_map()
    x, y = route.matrices[:, 0, 3], route.matrices[:, 1, 3]
    row, col, inside = result.geometry.cells_of(x, y)
    assert inside.all()
    assert np.isin(result.layer("class")[row, col], (1, 2)).all()
    length_m = np.hypot(np.diff(x), np.diff(y)).sum()
    cost_m = 1e-9 * (route.stamps_ns[-1] - route.stamps_ns[0])
    assert length_m > np.hypot(5.3, 3.7) - 0.2
    assert length_m <= cost_m <= 5.0 * length_m
    assert (route.parent_frame, route.child_frame) == ("site", "mana/base")
    reach = node.call("get_reachable", {"x_m": "-2.5", "y_m": "-1.5"})
    assert reach.layer("travel_cost_m")[row[-1], col[-1]] == pytest.approx(cost_m, abs=1e-3)
    blocked = ~np.isin(result.layer("class"), (1, 2))
    assert np.isnan(reach.layer("travel_cost_m")[blocked]).all()


@pytest.mark.parametrize("kind", ["free", "passable", "hazard", "blocked"])
@pytest.mark.parametrize("tolerance_m", ["0.0", "0.2"])
def test_outlines_contain_the_cells_of_their_kind_and_are_conservative(kind: str, tolerance_m: str) -> None:
    import shapely

    node = navigation()
    step(node, rough(0, lump_m=0.5))
    result = node.call("get_polygons", {"kind": kind, "tolerance_m": tolerance_m})
    polygons = [shapely.Polygon(outer, holes) for outer, *holes in result.polygons]
    assert all(polygon.is_valid and polygon.exterior.is_ccw for polygon in polygons)
    np.testing.assert_allclose(result.data.areas, [polygon.area for polygon in polygons], rtol=1e-9)
    area = shapely.union_all(polygons)
    navigation_map = node.get_map()
    number, classes = {
        "free": (1, (1,)),
        "passable": (4, (1, 2)),
        "hazard": (3, (3,)),
        "blocked": (5, (0, 3)),
    }[kind]
    assert set(result.data.kinds) == {number}
    assert (result.frame, result.t0_ns, result.t1_ns) == (
        navigation_map.frame,
        navigation_map.t0_ns,
        navigation_map.t1_ns,
    )
    assert (result.metadata.resolution, result.metadata.tolerance) == (
        navigation_map.geometry.resolution_m,
        float(tolerance_m),
    )
    x, y = navigation_map.geometry.centres_m()
    inside, is_kind = shapely.contains_xy(area, x, y), np.isin(navigation_map.layer("class"), classes)
    if tolerance_m == "0.0":
        np.testing.assert_array_equal(inside, is_kind)
        assert result.data.areas.sum() == pytest.approx(
            is_kind.sum() * navigation_map.geometry.resolution_m**2
        )
    elif kind in ("free", "passable"):
        assert not (inside & ~is_kind).any()
    else:
        assert not (is_kind & ~inside).any()


def test_blocked_or_outside_points_and_unknown_kinds_are_refused() -> None:
    node = navigation()
    step(node, rough(0, lump_m=0.5))
    with pytest.raises(RefusedError, match="start"):
        node.call("get_reachable", {"x_m": "1.0", "y_m": "1.0"})
    with pytest.raises(InputError, match="goal"):
        node.call("get_route", {"from_x_m": "0", "from_y_m": "0", "to_x_m": "90", "to_y_m": "0"})
    with pytest.raises(InputError, match="swamp"):
        node.call("get_polygons", {"kind": "swamp"})
    with pytest.raises(InputError, match=r"tolerance_m -0\.1"):
        node.call("get_polygons", {"tolerance_m": "-0.1"})


def test_outlines_of_all_kinds_cover_the_observed_area_once() -> None:
    node = navigation()
    step(node, rough(0, lump_m=0.5))
    result, navigation_map = node.call("get_polygons", {}), node.get_map()
    counts = np.bincount(navigation_map.layer("class").ravel(), minlength=4)
    for kind in (1, 2, 3):
        cells = result.data.areas[result.data.kinds == kind].sum() / navigation_map.geometry.resolution_m**2
        assert cells == pytest.approx(counts[kind])
    assert sorted(set(result.data.kinds)) == [1, 2, 3]
    assert node.call("get_polygons", {"kind": "free", "tolerance_m": "50"}).polygons == []
