# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of request parameters to store queries: every parameter has an effect."""

from __future__ import annotations

import pytest

from cdff_common.contract.queries import (
    CloudParameters,
    NavigationWindowParameters,
    ProfileParameters,
    SearchParameters,
    WindowParameters,
)
from services.dpm.queries.store_queries import cloud_query, search_query, window_query

NOW_NS = 100_000_000_000
WINDOW = {
    "as_of": 5000,
    "frames_revision": 3,
    "robot": "mana",
    "region": "circle:0,0,1",
    "frame": "odom",
    "resolution_m": 0.5,
    "t1": 7000,
    "newest_after": 6000,
    "max_age_s": 1,
}
SEARCH = {
    **{name: WINDOW[name] for name in ("as_of", "frames_revision", "robot", "region", "frame", "t1")},
    "t0": 1000,
    "dfpc": "a",
    "port": "b",
    "status": "OK",
    "region_frame": "site_b",
    "child": "c",
    "type": "dem",
    "resolution_max_m": 2,
    "after": 9,
    "tag": "x",
    "superseded": "only",
    "order": "nearest",
    "quality": "inliers>=3",
    "covariance_kind": "formal",
    "limit": 7,
    "cursor": "z",
}


@pytest.mark.parametrize("name", [*SEARCH, "point"])
def test_each_search_parameter_changes_the_query(name: str) -> None:
    # A point needs an order by distance, and that order a region or a point.
    required = {"order": {"region": "circle:9,9,1"}, "point": {"region": "circle:9,9,1", "order": "nearest"}}
    others = required.get(name, {})
    value = "1,2" if name == "point" else SEARCH[name]
    with_parameter = SearchParameters.parse({**others, name: value})
    assert search_query(with_parameter) != search_query(SearchParameters.parse(others))


def test_every_search_parameter_is_covered() -> None:
    assert {*SEARCH, "point"} == set(SearchParameters.model_fields)


@pytest.mark.parametrize("name", WINDOW)
@pytest.mark.parametrize("model", [WindowParameters, NavigationWindowParameters])
def test_each_window_parameter_changes_the_query(
    model: type[WindowParameters | NavigationWindowParameters], name: str
) -> None:
    changed = window_query(model.parse({name: WINDOW[name]}), NOW_NS)
    assert changed != window_query(model.parse({}), NOW_NS)


def test_fusion_rules_apply_to_their_type_of_map_only() -> None:
    elevation = window_query(WindowParameters.parse({"disagreement": "newest"}), NOW_NS)
    newest = window_query(ProfileParameters.parse({"path": "0,0,1,1", "choice": "newest"}), NOW_NS)
    worst = window_query(NavigationWindowParameters.parse({"choice": "worst"}), NOW_NS)
    plain = window_query(WindowParameters.parse({}), NOW_NS)
    assert (elevation.disagreement, newest.choice, worst.navigation_choice) == ("newest", "newest", "worst")
    assert (worst.choice, elevation.navigation_choice) == ("pooled", plain.navigation_choice)
    assert (plain.choice, elevation.choice) == ("weighted", "pooled")


def test_the_age_limit_is_relative_to_the_mission_time() -> None:
    with_both_limits = WindowParameters.parse({"max_age_s": 1, "newest_after": NOW_NS})
    assert window_query(WindowParameters.parse({"max_age_s": 1}), NOW_NS).newest_after_ns == NOW_NS - 10**9
    assert window_query(with_both_limits, NOW_NS).newest_after_ns == NOW_NS


def test_a_cloud_of_any_robot_is_not_restricted_to_one_robot() -> None:
    query = cloud_query(CloudParameters.parse({"robot": "any", "t0": 1000, "points": 5}))
    assert (query.robot, query.t0_ns, query.limit) == (None, 1000, 100)
