# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every parameter of a search or window reaches the store."""

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
    given = {"region": "circle:9,9,1", "order": "nearest"} if name == "point" else {}
    value = {"point": "1,2", "order": "nearest"}.get(name, SEARCH.get(name))
    given |= {"region": "circle:9,9,1"} if name == "order" else {}
    plain, changed = SearchParameters.parse(given), SearchParameters.parse({**given, name: value})
    assert search_query(changed) != search_query(plain)


def test_every_search_parameter_is_covered() -> None:
    assert {*SEARCH, "point"} == set(SearchParameters.model_fields)


@pytest.mark.parametrize("name", WINDOW)
@pytest.mark.parametrize("model", [WindowParameters, NavigationWindowParameters])
def test_each_window_parameter_changes_the_query(
    model: type[WindowParameters | NavigationWindowParameters], name: str
) -> None:
    changed = window_query(model.parse({name: WINDOW[name]}), NOW_NS)
    assert changed != window_query(model.parse({}), NOW_NS)


def test_choices_belong_to_their_kind_of_map() -> None:
    elevation = window_query(WindowParameters.parse({"disagreement": "newest"}), NOW_NS)
    newest = window_query(ProfileParameters.parse({"path": "0,0,1,1", "choice": "newest"}), NOW_NS)
    worst = window_query(NavigationWindowParameters.parse({"choice": "worst"}), NOW_NS)
    plain = window_query(WindowParameters.parse({}), NOW_NS)
    assert (elevation.disagreement, newest.choice, worst.navigation_choice) == ("newest", "newest", "worst")
    assert (worst.choice, elevation.navigation_choice) == (plain.choice, plain.navigation_choice)


def test_the_age_limit_counts_back_from_the_mission_time() -> None:
    both = WindowParameters.parse({"max_age_s": 1, "newest_after": NOW_NS})
    assert window_query(WindowParameters.parse({"max_age_s": 1}), NOW_NS).newest_after_ns == NOW_NS - 10**9
    assert window_query(both, NOW_NS).newest_after_ns == NOW_NS


def test_a_cloud_of_any_robot_is_not_restricted_to_one() -> None:
    query = cloud_query(CloudParameters.parse({"robot": "any", "t0": 1000, "points": 5}))
    assert (query.robot, query.t0_ns, query.limit) == (None, 1000, 100)
