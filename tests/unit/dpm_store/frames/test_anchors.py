# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Anchors of sites on bodies: corrections, and searches across sites."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import ConfigurationError, ConflictError, InputError
from cdff_common.geodesy import Anchor, Body, body
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from dpm_store import Query, Store
from dpm_store.frames.frames import HistoryView
from tests.support.store_products import header, put

MARS = body("mars")
#: One degree of latitude on the sphere of Mars.
DEGREE_M = np.deg2rad(1.0) * MARS.axes_m[0]


def shift(x_m: float, y_m: float = 0.0) -> UncertainTransform:
    matrix = np.eye(4)
    matrix[:2, 3] = x_m, y_m
    return UncertainTransform(matrix)


def test_a_frame_below_an_anchored_site_has_longitude_and_latitude(store: Store) -> None:
    store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4))
    store.frames.set("mana/odom", "site", shift(0.0, DEGREE_M / 1000))
    location = store.anchors.of("mana/odom")
    assert location.body == MARS
    assert location.lonlat([[0.0, 0.0]])[0, :2] == pytest.approx([77.5, 18.401], abs=1e-8)
    assert location.frames_revision == 2


@pytest.mark.req("CDFF-SUP-080", "CDFF-SUP-081")
def test_a_corrected_anchor_is_one_revision_and_earlier_ones_can_be_queried(store: Store) -> None:
    first = store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4), sigma_m=5.0, sigma_deg=0.1)
    store.anchors.anchor("site", Anchor(MARS, 77.6, 18.4, -2500.0, 3.0), expected_revision=1)
    assert store.anchors.of("site").lonlat([[0, 0]])[0] == pytest.approx([77.6, 18.4, -2500.0], abs=1e-6)
    before = store.anchors.of("site", HistoryView(state=first.state))
    assert before.lonlat([[0, 0]])[0] == pytest.approx([77.5, 18.4, 0.0], abs=1e-6)
    assert [e.kind for e in store.events.since()] == ["body_defined", "reanchored", "reanchored"]


def test_an_equal_anchor_adds_no_revision_and_a_future_state_is_refused(store: Store) -> None:
    first = store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4), sigma_m=5.0)
    for expected_revision in (None, 1):
        again = store.anchors.anchor(
            "site", Anchor(MARS, 77.5, 18.4), sigma_m=5.0, expected_revision=expected_revision
        )
        assert again.state == first.state
    with pytest.raises(ConflictError, match="at revision 1, not 2"):
        store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4), sigma_m=5.0, expected_revision=2)
    assert store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4), sigma_m=6.0).revision == 2
    with pytest.raises(InputError, match="frames_revision=3: expected at most 2"):
        store.anchors.of("site", HistoryView(state=3))


@pytest.mark.req("CDFF-SUP-082")
def test_products_of_another_site_are_found_through_the_body(store: Store) -> None:
    store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4))
    store.anchors.anchor("site_b", Anchor(MARS, 77.5, 18.4 + 100.0 / DEGREE_M))
    put(store, header(1, frame="site_b", box_m=(-1, -1, 0, 1, 1, 1)))
    query = Query(region=parse_region("circle:0,100,2"), frame="site")
    assert [r.header.seq for r in store.search(query).items] == [1]
    store.anchors.anchor("site_b", Anchor(MARS, 77.5, 18.4 + 300.0 / DEGREE_M))
    assert store.search(query).items == ()
    assert store.search(Query(region=parse_region("circle:0,300,2"))).items


def test_the_distance_between_two_sites_has_the_covariance_of_their_anchors(store: Store) -> None:
    store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4), sigma_m=3.0)
    store.anchors.anchor("site_b", Anchor(MARS, 77.5, 18.401), sigma_m=4.0)
    T = store.poses.at(0, "site", "site_b")
    assert T.covariance is not None
    assert np.diag(T.covariance)[:3] == pytest.approx([25.0] * 3, rel=1e-6)


@pytest.mark.parametrize("sigma", [-1e-9, np.inf, np.nan])
@pytest.mark.parametrize("name", ["sigma_m", "sigma_deg"])
def test_an_anchor_with_an_infinite_or_negative_sigma_is_refused(
    store: Store, name: str, sigma: float
) -> None:
    with pytest.raises(InputError, match=r"sigma .* expected 0 or more"):
        store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4), **{name: sigma})
    assert store.frames.current() == ()


def test_the_sigmas_of_an_anchor_are_those_of_its_edge(store: Store) -> None:
    store.anchors.anchor("site", Anchor(MARS, 77.5, 18.4), sigma_m=2.0, sigma_deg=0.5)
    store.anchors.anchor("site_b", Anchor(MARS, 77.5, 18.4))
    edges = {edge.frame: edge.T_parent_frame.covariance for edge in store.frames.current()}
    assert np.diag(edges["site"]) == pytest.approx([4.0] * 3 + [np.deg2rad(0.5) ** 2] * 3)
    assert not edges["site_b"].any()


def test_a_frame_that_is_not_connected_with_a_body_has_no_body(store: Store) -> None:
    assert store.anchors.of("site").body is None
    assert '"site"' in store.anchors.of("site").wkt


def test_a_target_has_a_body_and_no_longitude(store: Store) -> None:
    store.frames.set("servicer/base", "orbital_target", shift(10.0))
    location = store.anchors.of("servicer/base")
    assert location.body is not None
    assert location.body.kind == "target"
    assert location.anchor is None
    with pytest.raises(InputError, match="not anchored"):
        location.lonlat([[0, 0]])


def test_a_defined_body_has_revisions(store: Store, clock: ManualClock) -> None:
    assert (
        store.anchors.define(Body.from_dict({"name": "rock_7", "kind": "asteroid", "radii_m": [9, 8, 7]}))
        == 1
    )
    before_ns = clock.now_ns()
    clock.set_ns(before_ns + 10**9)
    better = Body.from_dict({"name": "rock_7", "kind": "asteroid", "radii_m": [10, 8, 7]})
    assert store.anchors.define(better) == store.anchors.define(better) == 2
    assert store.anchors.body("rock_7") == better
    assert store.anchors.body("rock_7", HistoryView(before_ns)).radii_m == (9.0, 8.0, 7.0)
    with pytest.raises(ConfigurationError, match="rock_8"):
        store.anchors.body("rock_8")


def test_a_frame_cannot_become_a_body(store: Store) -> None:
    store.frames.set("mana/odom", "rubble", shift(1.0))
    store.frames.set("rubble", "site", shift(1.0))
    with pytest.raises(InputError, match="below another"):
        store.anchors.define(Body("rubble", "asteroid"))


def test_a_robot_is_described_once_and_again_when_it_changes(store: Store, clock: ManualClock) -> None:
    assert store.robots.describe("mana", "first rover", {"limits": {"width_m": 0.9}})
    assert not store.robots.describe("mana", "first rover", {"limits": {"width_m": 0.9}})
    clock.set_ns(clock.now_ns() + 10**9)
    assert store.robots.describe("mana", "first rover", {"limits": {"width_m": 1.0}})
    (robot,) = store.robots.all()
    assert robot.description == {"limits": {"width_m": 1.0}}
    assert robot.updated_ns - robot.inserted_ns == 10**9
    assert [
        e.body["description"]["limits"]["width_m"] for e in store.events.since(kind="robot_described")
    ] == [0.9, 1]


@pytest.mark.parametrize("position_m", [(0.0, 0.0, 0.0), (1e12, 0.0, 0.0)], ids=["at the centre", "far out"])
def test_a_frame_that_is_not_near_the_surface_has_no_anchor(
    store: Store, position_m: tuple[float, ...]
) -> None:
    store.frames.set("site", "mars", UncertainTransform(se3.transform(np.eye(3), position_m)))
    location = store.anchors.of("site")
    assert location.body is not None
    assert location.body.name == "mars"
    assert location.anchor is None
    assert "ENGCRS" in location.wkt


@pytest.mark.parametrize("sigma_m", [None, 1e13])
def test_a_frame_beyond_the_largest_distance_is_refused(store: Store, sigma_m: float | None) -> None:
    far = se3.transform(np.eye(3), [1e300 if sigma_m is None else 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="expected at most 1e\\+12 m"):
        store.frames.set(
            "site", "mars", UncertainTransform(far, None if sigma_m is None else np.eye(6) * sigma_m**2)
        )
    assert store.frames.current() == ()
