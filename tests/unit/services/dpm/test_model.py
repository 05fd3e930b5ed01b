# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies, places, revisions of the frame tree, transactions and purges, over HTTP."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.profile import Profile
from cdff_common.types import Pointcloud
from services.dpm.operations.dpm import Dpm
from services.dpm.operations.profile_entry import enter
from services.dpm.queries.bodies import FrameEdge

from .conftest import S, TestClient, elevation, pose, put_arguments

SITE = {"body": "mars", "lon_deg": 77.5, "lat_deg": 18.4}


def item_ids(answer: Any) -> list[str]:
    assert answer.status_code == 200, answer.text
    return [item["id"] for item in answer.json()["items"]]


@pytest.mark.req("CDFF-SUP-080", "CDFF-SUP-081")
def test_a_site_is_anchored_and_corrected_and_its_earlier_location_can_be_queried(http: TestClient) -> None:
    assert http.get("/api/v1/places/site").json()["body"] is None
    first = http.put("/api/v1/places/site", json=SITE).json()
    http.put(
        "/api/v1/places/site", json=SITE | {"lon_deg": 77.6, "azimuth_deg": 10.0, "expected_revision": 1}
    )
    current = http.get("/api/v1/places/site").json()
    assert current["anchor"]["lon_deg"] == pytest.approx(77.6)
    assert current["body"]["crs"] == "IAU_2015:49900"
    earlier = http.get("/api/v1/places/site", params={"frames_revision": first["frames_revision"]}).json()
    assert earlier["anchor"]["lon_deg"] == pytest.approx(77.5)
    assert earlier["frames_revision"] == first["frames_revision"]
    outdated = http.put("/api/v1/places/site", json=SITE | {"expected_revision": 1})
    assert outdated.status_code == 409


@pytest.mark.parametrize(
    "wrong",
    [
        {"body": "vulcan"},
        {"lat_deg": 91},
        {"lon_deg": "east"},
        {"height_m": -4e6},
        {"sigma_m": -1},
        {"colour": "red"},
        {"body": "orbital_target"},
    ],
)
def test_an_invalid_anchor_is_refused(http: TestClient, wrong: dict[str, Any]) -> None:
    answer = http.put("/api/v1/places/site", json=SITE | wrong)
    assert 400 <= answer.status_code < 500
    assert http.get("/api/v1/frames").json()["items"] == []


def test_a_body_is_defined_and_listed(http: TestClient) -> None:
    assert http.get("/api/v1/bodies/phobos").json()["naif_id"] == 401
    new = {"name": "rock_7", "kind": "asteroid", "radii_m": [9, 8, 7], "source": "own survey"}
    assert http.post("/api/v1/bodies", json=new).json()["revision"] == 1
    assert [b["name"] for b in http.get("/api/v1/bodies").json()["items"]] == ["rock_7"]
    assert http.post("/api/v1/bodies", json=new | {"crs": "nonsense"}).status_code == 422
    assert 400 <= http.get("/api/v1/bodies/vulcan").status_code < 500


@pytest.mark.req("CDFF-SUP-081", "CDFF-SUP-082")
def test_a_search_before_a_re_anchoring_can_be_repeated_with_its_frames_revision(
    http: TestClient, dpm: Dpm, inserted_id: Callable[[str], str]
) -> None:
    dpm.frames.set_frame("mana/odom", FrameEdge(parent="site", T=np.eye(4).tolist()), "test")
    in_odom = Pointcloud.from_points(
        np.random.default_rng(1).normal(0, 2, (9, 3)), frame="mana/odom", stamp_ns=S
    )
    dpm.writer.put(*put_arguments(in_odom, "pointcloud", 50, frame="mana/odom"))
    search = {"type": "pointcloud", "region": "circle:0,0,3"}
    before = http.get("/api/v1/products", params=search).json()
    assert len(before["items"]) == 2
    moved = FrameEdge(parent="site", T=se3.transform(np.eye(3), [500, 0, 0]).tolist())
    dpm.frames.set_frame("mana/odom", moved, "test")
    assert len(item_ids(http.get("/api/v1/products", params=search))) == 1
    repeated = http.get(
        "/api/v1/products", params=search | {"frames_revision": before["frames_revision"]}
    ).json()
    assert [i["id"] for i in repeated["items"]] == [i["id"] for i in before["items"]]
    kinds = [e.kind for e in dpm.store.events.since()]
    assert kinds.count("reanchored") == 2


@pytest.mark.req("CDFF-SUP-082")
def test_products_are_ordered_by_distance_over_all_pages(http: TestClient, dpm: Dpm) -> None:
    for i, x0 in enumerate((10.0, 0.0, 30.0, 20.0)):
        dpm.writer.put(*put_arguments(elevation(x0), "dem", i, resolution_m=0.1))
    search = {"type": "dem", "order": "nearest", "point": "21,1", "limit": "2"}
    first_page = http.get("/api/v1/products", params=search).json()
    assert [item["box_m"][0] for item in first_page["items"]] == [20.0, 30.0]
    assert first_page["distances_m"] == pytest.approx([0.0, 9.0])
    second_page = http.get(first_page["links"]["next"]).json()
    assert [item["box_m"][0] for item in second_page["items"]] == [10.0, 0.0]
    assert second_page["cursor"] is None


def test_products_are_found_by_quality_and_along_a_path(http: TestClient, dpm: Dpm) -> None:
    for i, inliers in enumerate((10.0, 40.0)):
        names, payload, encoding, attachment = put_arguments(elevation(20.0 * i), "dem", i, resolution_m=0.1)
        header = msgpack.unpackb(attachment)
        header["quality"] |= {"metrics": {"inliers": inliers}, "covariance_kind": "formal"}
        dpm.writer.put(names, payload, encoding, msgpack.packb(header))
    good = http.get("/api/v1/products", params={"quality": "inliers>=30", "covariance_kind": "formal"}).json()
    assert [item["box_m"][0] for item in good["items"]] == [20.0]
    path = {"region": "path:1,0,3,19,3,19,-5"}
    assert http.get("/api/v1/products", params=path).json()["items"][0]["box_m"][0] == 20.0
    assert len(item_ids(http.get("/api/v1/products", params=path))) == 2


@pytest.mark.parametrize(
    "wrong",
    [
        {"quality": "inliers"},
        {"quality": "inliers>=many"},
        {"quality": "inliers>=nan"},
        {"order": "best"},
        {"order": "nearest"},
        {"point": "1,2"},
        {"order": "nearest", "point": "1"},
        {"order": "nearest", "point": "nan,1"},
        {"covariance_kind": "good"},
        {"frames_revision": "-1"},
        {"region": "path:1,2,3"},
        {"cursor": "AAAA"},
    ],
)
def test_a_malformed_search_is_refused(http: TestClient, wrong: dict[str, str]) -> None:
    assert http.get("/api/v1/products", params=wrong).status_code == 422


@pytest.mark.req("CDFF-SUP-083")
def test_a_transaction_of_many_changes_is_atomic(
    http: TestClient, dpm: Dpm, inserted_id: Callable[[str], str]
) -> None:
    names, payload, encoding, attachment = put_arguments(elevation(5.0), "dem", 70, resolution_m=0.1)
    new = {"do": "insert", **names, "encoding": encoding, "attachment": attachment, "payload": payload}
    new_id = msgpack.unpackb(attachment)["id"]
    changes: list[dict[str, Any]] = [
        new,
        {"do": "supersede", "id": inserted_id("dem"), "by": new_id, "if_match": 0},
        {"do": "pin", "id": new_id},
        {"do": "update", "id": new_id, "changes": {"tags": ["merged"]}},
        {"do": "delete", "id": inserted_id("navigation_map")},
        {
            "do": "reanchor",
            "frame": "mana/odom",
            "parent": "site",
            "T": np.eye(4).tolist(),
            "valid_from_ns": "0",
        },
    ]
    packed = {"content-type": "application/msgpack"}
    answer = http.post("/api/v1/transactions", content=msgpack.packb(changes), headers=packed)
    assert answer.status_code == 200, answer.text
    results = answer.json()["items"]
    assert results[0] == {"result": "inserted"}
    assert results[1]["superseded_by"] == new_id
    assert results[4] == {"deleted": True}
    assert results[5]["revision"] == 1
    last_event = dpm.store.events.last_ordinal()
    refused = http.post(
        "/api/v1/transactions", json=[{"do": "unpin", "id": new_id}, {"do": "delete", "id": "f" * 36}]
    )
    assert refused.status_code == 404
    assert dpm.store.annotations.get(new_id).pinned
    assert all(e.kind == "refused" for e in dpm.store.events.since(last_event))


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[]",
        b"{}",
        b"[1]",
        b'[{"do":"burn"}]',
        b'[{"do":"delete"}]',
        b'[{"do":"delete","id":"x","by":"y"}]',
        b'[{"do":"delete","id":"x","if_match":"soon"}]',
        b'[{"do":"update","id":"x","changes":1}]',
        b'[{"do":"insert","robot":"mana"}]',
        b'[{"do":"reanchor","frame":"a","parent":"b","T":[[1]]}]',
        b'[{"do":"delete","id":"x","if_match":"9e99"}]',
    ],
)
def test_a_malformed_transaction_is_refused(http: TestClient, body: bytes) -> None:
    answer = http.post("/api/v1/transactions", content=body, headers={"content-type": "application/json"})
    assert answer.status_code == 422, answer.text


def test_only_a_deleted_product_can_be_purged(http: TestClient, inserted_id: Callable[[str], str]) -> None:
    url = f"/api/v1/products/{inserted_id('pointcloud')}"
    assert http.delete(f"{url}/payload").status_code == 409
    http.delete(url)
    assert http.delete(f"{url}/payload").json()["bytes"] > 0
    assert http.delete(f"{url}/payload").json()["bytes"] == 0


@pytest.mark.req("CDFF-SUP-085")
def test_poses_can_be_queried_in_an_earlier_state_and_up_to_a_time_difference(
    http: TestClient, dpm: Dpm, clock: ManualClock
) -> None:
    dpm.writer.put(*put_arguments(pose(1, 1.0), "pose", 1, child="mana/base"))
    earlier_ns = clock.now_ns()
    clock.set_ns(earlier_ns + S)
    dpm.writer.put(*put_arguments(pose(3, 5.0), "pose", 3, child="mana/base"))
    query = {"robot": "mana", "t": str(2 * S)}
    (result,) = http.get("/api/v1/poses", params=query).json()["items"]
    assert result["T"][0][3] == pytest.approx(3.0)
    assert result["limit_s"] == 0.2
    outside_limit = http.get("/api/v1/poses", params=query | {"as_of": str(earlier_ns)})
    assert outside_limit.status_code == 404
    assert "outside" in outside_limit.json()["detail"]
    within_limit = http.get("/api/v1/poses", params=query | {"as_of": str(earlier_ns), "limit_s": "2"}).json()
    assert within_limit["items"][0]["T"][0][3] == 1.0
    series = http.get("/api/v1/poses", params={"robot": "mana", "as_of": str(earlier_ns)}).json()
    assert len(series["items"]) == 1


def test_a_profile_anchors_its_sites_and_describes_its_robots(dpm: Dpm, tmp_path: Path) -> None:
    profile = Profile.model_validate(
        {
            "name": "test",
            "body": {
                "name": "moon",
                "site_lon_deg": 10.0,
                "site_lat_deg": -80.0,
                "site_azimuth_deg": 5.0,
                "sites": {"crater": {"lon_deg": 10.1, "lat_deg": -80.0, "sigma_m": 3.0}},
            },
            "robots": [
                {"id": "mana", "doc": "first", "frames": [{"parent": "crater", "child": "mana/odom"}]}
            ],
        }
    )
    for _ in range(2):
        enter(dpm.store, profile)
    assert dpm.store.anchors.of("mana/odom").lonlat([[0, 0]])[0, :2] == pytest.approx([10.1, -80.0])
    T = dpm.store.poses.at(0, "site", "crater")
    assert isinstance(T, UncertainTransform)
    distance_m = np.deg2rad(0.1) * 1737400 * np.cos(np.deg2rad(80))
    assert np.linalg.norm(T.matrix[:3, 3]) == pytest.approx(distance_m, rel=1e-3)
    assert [r.revision for r in dpm.store.frames.current()] == [1, 1, 1]
    assert dpm.store.robots.all()[0].doc == "first"
