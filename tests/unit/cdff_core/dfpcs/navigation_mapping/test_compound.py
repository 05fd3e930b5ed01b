# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, ProductNotFoundError
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfpcs.navigation_mapping.compound import NavigationMapping

T_NS = 1_700_000_000_000_000_000


def navigation(limits: dict[str, float] | None = None, **config: Any) -> NavigationMapping:
    made = NavigationMapping()
    made.configure({"size_m": 12.0, **config}, DfpcContext("mana", limits=limits or {}))
    return made


def patch(slope: float = 0.0, *, x0: float = -4.0, t_ns: int = T_NS, resolution_m: float = 0.05) -> ElevationMap:
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
def test_flat_ground_is_safe_and_what_no_patch_reached_is_unknown() -> None:
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
def test_limits_come_from_the_configuration_else_the_profile_else_the_defaults(
    limits: dict[str, float], config: dict[str, Any], expected: int
) -> None:
    out = step(navigation(limits, **config), patch(np.tan(np.radians(18.0))))[0]
    assert (classes_of(out) == expected).all()


def test_cells_are_those_asked_for_in_multiples_of_the_patches() -> None:
    assert step(navigation(resolution_m=0.12), patch())[0].value.geometry.resolution_m == pytest.approx(0.1)
    assert step(navigation(resolution_m=0.1), patch(resolution_m=0.2))[0].value.geometry.resolution_m == 0.2


def test_patches_side_by_side_make_one_map() -> None:
    node = navigation(size_m=20.0)
    step(node, patch(x0=-8.0))
    out = step(node, patch(x0=0.0, t_ns=T_NS + 5000), name="q")[0]
    x, y = out.value.geometry.centres_m()
    seam = (np.abs(x) < 1.0) & (np.abs(y) < 3.0)
    assert (out.value.layer("class")[seam] == 1).all()
    assert out.inputs == ("p", "q")
    assert (out.t0_ns, out.t1_ns) == (T_NS - 1000, T_NS + 5000)


def test_a_patch_that_changes_nothing_is_not_published_again() -> None:
    node = navigation()
    assert len(step(node, patch())) == 1
    assert step(node, patch(t_ns=T_NS + 1000)) == []
    assert len(step(node, patch(0.3))) == 1


def test_a_degraded_patch_degrades_the_map_and_a_failed_one_changes_nothing() -> None:
    node = navigation()
    out = step(node, patch(), Quality(status=Status.DEGRADED, reasons=("poses_degraded",)))[0]
    assert (out.quality.status, out.quality.reasons) == (Status.DEGRADED, ("dem_poses_degraded",))
    assert step(node, None, Quality(status=Status.FAILED)) == []


def test_a_patch_whose_cells_do_not_fit_is_refused_with_a_reason() -> None:
    node = navigation()
    step(node, patch())
    out = step(node, patch(resolution_m=0.03))[0]
    assert out.value is None
    assert out.quality.status is Status.FAILED
    assert "do not fit" in out.quality.reasons[0]


def test_the_map_can_be_asked_for() -> None:
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
