# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Queries in the frame of one robot for products of another, before and after corrections of frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import TransformWithCovariance
from services.dpm.operations.dpm import Dpm
from services.dpm.queries.bodies import FrameEdge

from .conftest import S, elevation, put_arguments


def set_frame(dpm: Dpm, name: str, x: float, y: float, sigma_m: float = 0.1) -> int:
    """Set the pose of a frame in the site; return the revision of the frame tree."""
    T = se3.transform(np.eye(3), [x, y, 0.0])
    covariance = np.diag([sigma_m**2] * 3 + [1e-12] * 3)
    edge = FrameEdge(parent="site", T=T.tolist(), covariance=covariance.tolist())
    return int(dpm.frames.set_frame(name, edge, "test")["frames_revision"])


def drive(dpm: Dpm, robot: str, x0: float) -> None:
    """Insert poses of a robot in its odometry frame at 2 and 4 s, 1 m apart, with a sigma of 0.2 m."""
    for second in (2, 4):
        T = UncertainTransform(se3.transform(np.eye(3), [x0 + second / 2.0, 0.0, 0.0]), np.eye(6) * 0.04)
        value = TransformWithCovariance.from_transform(
            T, parent=f"{robot}/odom", child=f"{robot}/base", stamp_ns=second * S
        )
        dpm.writer.put(
            *put_arguments(value, "pose", second, robot=robot, frame=f"{robot}/odom", child=f"{robot}/base")
        )


def found_x_m(http: TestClient, **parameters: Any) -> list[float]:
    """Return the smallest x of each map that a search finds, sorted."""
    answer = http.get("/api/v1/products", params={"type": "dem", **parameters})
    assert answer.status_code == 200, answer.text
    return sorted(item["box_m"][0] for item in answer.json()["items"])


@pytest.mark.req("CDFF-SUP-082")
def test_a_search_along_a_path_finds_products_in_other_frames(http: TestClient, dpm: Dpm) -> None:
    for seq in range(8):
        dpm.writer.put(
            *put_arguments(elevation(10.0 * seq), "dem", seq, resolution_m=0.1)
        )  # maps of 2 m by 2 m in the site
    first_revision = set_frame(dpm, "mana/odom", 100.0, 0.0)
    path = {"region": "path:1.5,-80,1,-60,1,-60,-9", "region_frame": "mana/odom"}
    assert found_x_m(http, **path) == [20.0, 30.0, 40.0]
    assert found_x_m(http, **path | {"region": "path:0.5,-85,4,-60,4"}) == []
    assert found_x_m(http, **path, order="nearest", point="-80,1", limit="1") == [20.0]
    set_frame(dpm, "mana/odom", 130.0, 0.0)  # a correction after a loop closure
    assert found_x_m(http, **path) == [50.0, 60.0, 70.0]
    assert found_x_m(http, **path, frames_revision=str(first_revision)) == [20.0, 30.0, 40.0]


@pytest.mark.req("CDFF-SUP-085")
def test_a_pose_in_the_frame_of_another_robot_has_the_covariance_of_the_chain(
    http: TestClient, dpm: Dpm
) -> None:
    first_revision = set_frame(dpm, "mana/odom", 0.0, 0.0)
    set_frame(dpm, "minnie/odom", 0.0, 50.0)
    drive(dpm, "mana", 0.0)
    drive(dpm, "minnie", 10.0)
    parameters = {"robot": "minnie", "frame": "mana/base", "t": str(3 * S)}
    (pose,) = http.get("/api/v1/poses", params=parameters).json()["items"]
    np.testing.assert_allclose(np.array(pose["T"])[:3, 3], [10.0, 50.0, 0.0], atol=1e-9)
    # Variances of two odometry frames and two poses; the heading sigma of mana, 0.2 rad, gives 10 m at 50 m.
    variance = np.array(pose["covariance"])[0, 0]
    assert variance == pytest.approx(2 * 0.1**2 + 2 * 0.04 + 0.04 * 50.0**2, rel=1e-3)
    revision_before_correction = dpm.store.frames.state()
    set_frame(dpm, "minnie/odom", 0.0, 60.0)
    (corrected,) = http.get("/api/v1/poses", params=parameters).json()["items"]
    assert corrected["T"][1][3] == pytest.approx(60.0)
    (earlier,) = http.get(
        "/api/v1/poses", params=parameters | {"frames_revision": str(revision_before_correction)}
    ).json()["items"]
    assert earlier["T"] == pose["T"]
    assert (
        http.get("/api/v1/poses", params=parameters | {"frames_revision": str(first_revision)}).status_code
        == 404
    )
    late = http.get("/api/v1/poses", params=parameters | {"t": str(9 * S)})
    assert late.status_code == 404
    assert "outside" in late.json()["detail"]


def test_a_region_near_an_unknown_frame_is_refused_with_its_name(http: TestClient) -> None:
    answer = http.get("/api/v1/products?region=near:ghost/base,5")
    assert answer.status_code == 404
    assert "ghost/base" in answer.json()["detail"]


@pytest.mark.req("CDFF-SUP-083")
def test_changes_of_several_products_are_atomic(http: TestClient, dpm: Dpm) -> None:
    ids = [
        dpm.writer.put(*put_arguments(elevation(10.0 * seq), "dem", seq, resolution_m=0.1))[1].id
        for seq in range(5)
    ]
    tagging = [{"do": "update", "id": i, "if_match": 0, "changes": {"tags": ["north"]}} for i in ids[:3]]
    answer = http.post("/api/v1/transactions", json=[*tagging, *({"do": "delete", "id": i} for i in ids[3:])])
    assert answer.status_code == 200, answer.text
    assert found_x_m(http) == found_x_m(http, tag="north") == [0.0, 10.0, 20.0]
    stale = [
        {"do": "delete", "id": ids[0]},
        {"do": "update", "id": ids[1], "if_match": 0, "changes": {"tags": []}},
    ]
    assert http.post("/api/v1/transactions", json=stale).status_code == 409
    assert found_x_m(http, tag="north") == [0.0, 10.0, 20.0]
