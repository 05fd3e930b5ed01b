# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Adjusted parameters and implementations of DFPCs that several requests share."""

from __future__ import annotations

import pytest

from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.adjustment import Adjustable, settings_for, union
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconciliation import Activate, Configuration, ObservedState, next_actions
from cdff_core.orchestration.world import ProviderId

CELL = Adjustable("resolution_m", "resolution_m", 0.05, 0.02, 1.0)
RANGE = Adjustable("max_range_m", "range_m", 12.0, 2.0, 40.0)
DEM = ProviderId("mana", "dem")


@pytest.mark.parametrize(
    ("requested", "settings"),
    [
        ({}, {}),
        ({"resolution_m": 0.05, "range_m": 12.0}, {}),
        ({"resolution_m": 0.1, "range_m": 5.0}, {}),
        ({"resolution_m": 0.03}, {"resolution_m": 0.03}),
        ({"resolution_m": 0.001}, {"resolution_m": 0.02}),
        ({"range_m": 100.0}, {"max_range_m": 40.0}),
        ({"range_m": 20.0, "resolution_m": 0.04}, {"max_range_m": 20.0, "resolution_m": 0.04}),
        ({"period_s": 1.0}, {}),
    ],
)
def test_a_request_that_the_configuration_does_not_fulfil_sets_a_parameter_within_its_bounds(
    requested: dict[str, float], settings: dict[str, float]
) -> None:
    assert settings_for([CELL, RANGE], requested) == settings


def test_users_share_the_finest_cells_and_the_largest_range_until_they_leave() -> None:
    leases = Leases()
    leases.acquire("a", [DEM], {}, settings={DEM: {"resolution_m": 0.03, "max_range_m": 15.0}})
    leases.acquire("b", [DEM], {}, settings={DEM: {"max_range_m": 25.0}})
    leases.acquire("c", [DEM], {})
    assert union([CELL, RANGE], leases.settings(DEM)) == {"max_range_m": 25.0, "resolution_m": 0.03}
    leases.release("b", 0.0)
    assert union([CELL, RANGE], leases.settings(DEM)) == {"max_range_m": 15.0, "resolution_m": 0.03}
    leases.release("a", 0.0)
    assert union([CELL, RANGE], leases.settings(DEM)) == {}


def test_of_a_parameter_that_is_no_longer_adjustable_the_smallest_value_holds() -> None:
    assert union([CELL], [{"memory": 3.0}, {"memory": 2.0}]) == {"memory": 2.0}


def test_an_implementation_serves_all_users_or_those_of_the_highest_priority() -> None:
    leases = Leases()
    leases.acquire("any", [DEM], {}, implementations={DEM: ("Fast", "Accurate")})
    assert leases.implementation(DEM) == "Fast"
    leases.acquire("exact", [DEM], {}, implementations={DEM: ("Accurate",)})
    assert leases.implementation(DEM) == "Accurate"
    assert leases.serving_implementations(DEM) == {"Accurate"}
    leases.acquire("quick", [DEM], {}, implementations={DEM: ("Fast",)}, priority=9)
    assert leases.implementation(DEM) == "Fast"
    assert leases.displaced_implementations("exact", [DEM]) == {DEM: "Fast"}
    assert leases.displaced_implementations("any", [DEM]) == {}
    leases.release("quick", 0.0)
    assert leases.implementation(DEM) == "Accurate"


def test_a_running_dfpc_is_configured_again_only_if_its_configuration_differs() -> None:
    def actions(wanted: Configuration, current: Configuration | None) -> list[object]:
        observed = ObservedState(alive={DEM}, active={DEM})
        if current is not None:
            observed.configurations[DEM] = current
        return list(next_actions([DEM], {}, {}, {}, observed, 0.0, configurations={DEM: wanted}))

    fine = Configuration(None, (("resolution_m", 0.03),))
    assert actions(fine, Configuration("Lidar", (("resolution_m", 0.03),))) == []
    assert actions(fine, Configuration("Lidar")) == [Activate(DEM, (), fine)]
    assert actions(Configuration(), Configuration("Lidar", fine.parameters)) == [
        Activate(DEM, (), Configuration())
    ]
    assert actions(Configuration("Fast"), Configuration("Accurate")) == [
        Activate(DEM, (), Configuration("Fast"))
    ]
    assert actions(fine, None) == [], "the status of a host that states no configuration"


def test_the_defaults_of_adjustable_parameters_are_those_of_the_configuration() -> None:
    registry = Registry.default()
    adjustable_dfpcs = [name for name in registry.dfpcs if registry.dfpc(name).adjustable]
    assert adjustable_dfpcs
    for name in adjustable_dfpcs:
        model = registry.make_dfpc(name).config_model()
        for adjustable in registry.dfpc(name).adjustable:
            assert adjustable.default == model.model_fields[adjustable.parameter].default, adjustable
            for value in (adjustable.least, adjustable.greatest):
                assert getattr(model(**{adjustable.parameter: value}), adjustable.parameter) == value
