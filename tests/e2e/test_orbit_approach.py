# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An approach in orbit with processes: OG2 asks where the client is; the DPM holds tracks without a site."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from typing import Any
from urllib.parse import quote
from urllib.request import urlopen

import pytest

from cdff_dev.missions.tracks import http_json
from tests.support.approach import Approach, run_approach

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def approach() -> Iterator[Approach]:
    with run_approach("orbit_approach") as approach:
        yield approach


def found(http: str, query: str) -> list[dict[str, Any]]:
    return http_json(http, f"products?type=track&limit=1000&{query}", timeout_s=20.0)["items"]


def payload(http: str, product: str, form: str) -> bytes:
    with urlopen(f"http://{http}/api/v1/products/{product}/payload?format={form}", timeout=20.0) as answer:
        return bytes(answer.read())


def test_og2_is_told_when_the_answer_becomes_range_as_well_as_bearing(
    approach: Approach,
) -> None:
    outcomes = approach.outcomes
    assert [outcome.faults for outcome in outcomes] == [()] * 4
    answers = {(o.request.frame, o.request.observable): o.summary for o in outcomes}
    assert "range unobservable" in answers["inertial", "bearing"]
    for frame in ("inertial", "servicer/lvlh"):
        assert "range unobservable" not in answers[frame, "range"]
        assert re.search(r" ± \d+ m(, | \(range between \d+ and \d+ m: )", answers[frame, "range"])


def test_tracks_are_found_by_time_and_id_in_frames_without_a_site(
    approach: Approach,
) -> None:
    http = approach.http
    every = [item for item in found(http, "robot=servicer") if item["quality"]["status"] != "FAILED"]
    assert {item["frame"] for item in every} == {"inertial", "servicer/lvlh"}
    middle_ns = sorted(int(item["t1_ns"]) for item in every)[len(every) // 2]
    early = found(http, f"t1={middle_ns}")
    assert early
    assert all(int(item["t0_ns"]) <= middle_ns for item in early)
    one = http_json(http, f"products/{quote(every[0]['id'])}", timeout_s=20.0)
    assert one["id"] == every[0]["id"]
    assert "csv" in one["formats"]


def test_a_track_comes_as_csv_and_json_and_the_frames_agree(approach: Approach) -> None:
    http = approach.http
    newest: dict[str, dict[str, Any]] = {}
    every = found(http, "robot=servicer")
    answered_ns = max(int(i["t1_ns"]) for i in every if i.get("box_m") is not None)
    for frame in ("inertial", "servicer/lvlh"):
        # An image before the last request, whose objects are all stored.
        ranged = [i for i in every if i["frame"] == frame and i.get("box_m") is not None]
        item = max((i for i in ranged if int(i["t1_ns"]) < answered_ns), key=lambda i: int(i["t1_ns"]))
        header, row = payload(http, item["id"], "csv").decode().strip().splitlines()[:2]
        assert header.startswith("stamp_ns,id,u_px,v_px,")
        assert int(row.split(",")[0]) == int(item["t1_ns"]) // 1000 * 1000
        content = json.loads(payload(http, item["id"], "json"))
        assert (content["frame"], content["label"]) == (frame, "target")
        newest[frame] = content["states"][-1]
        assert str(newest[frame]["stamp_ns"]) == row.split(",")[0]
    # The client is ahead on the orbit: azimuth and elevation in the axes of the orbit are small.
    lvlh, inertial = newest["servicer/lvlh"], newest["inertial"]
    assert math.hypot(lvlh["azimuth_rad"], lvlh["elevation_rad"]) < math.radians(1.0)
    assert 100.0 < lvlh["range_m"] == inertial["range_m"]
    assert lvlh["sigma_range_m"] == inertial["sigma_range_m"] > 0.0
    assert lvlh["id"] == inertial["id"]


def test_stac_items_of_tracks_have_no_geometry(approach: Approach) -> None:
    http = approach.http
    with urlopen(f"http://{http}/stac/collections/track/items?limit=10", timeout=20.0) as answer:
        features = json.loads(answer.read())["features"]
    assert features
    assert all(feature["geometry"] is None and "bbox" not in feature for feature in features)
    assert {feature["properties"]["cdff:frame"] for feature in features} == {"inertial", "servicer/lvlh"}
