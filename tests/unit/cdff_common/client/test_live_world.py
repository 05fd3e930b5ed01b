# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The world of a running system is that of the DPM at a time."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.client.live_world import retrieve_world
from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import se3
from cdff_common.interfaces.product import Header

S = 1_000_000_000
CLOUD = Header("00000000-0000-4000-8000-000000000001", 0, S, S, "mana/lidar", "lidar/cloud/1")


def pose_header(child: str, second: int) -> dict[str, Any]:
    header = Header(
        "00000000-0000-4000-8000-000000000002", second, 0, second * S, "site", "vo/x/1", child=child
    )
    names = {"robot": "mana", "dfpc": "vo", "port": child.split("/")[1]}
    return header.to_dict() | names | {"type_name": "TransformWithCovariance"}


class StoredDpm:
    """A DPM with two revisions of a mount, a moving base, an arm without a pose at that time, and a cloud."""

    def search(self, product: str, **_: object) -> list[dict[str, Any]]:
        if product == "pose":
            return [pose_header("mana/base", 3), pose_header("mana/arm", 1)]
        names = {"robot": "mana", "dfpc": "lidar", "port": "cloud", "type_name": "PointcloudLarge"}
        return [CLOUD.to_dict() | names]

    def get(self, product_id: str) -> Any:
        return SimpleNamespace(value=product_id)

    def call(self, verb: str, query: Mapping[str, object]) -> Any:
        if verb == "stat":
            return {"by_robot": {"mana": {"pose": 2, "pointcloud": 1}}, "now_ns": 9 * S}
        if verb == "pose":
            if query["child"] == "mana/arm":
                raise ExtrapolationError("site to mana/arm: 2 s outside")
            assert query["t"] == 3 * S
            return {"T": se3.transform(np.eye(3), [3.0, 0, 0]).tolist(), "covariance": np.eye(6).tolist()}
        newest = mount(2.0, valid_from_ns=5 * S, valid_until_ns=None)
        if "frame" in query:
            return {"revisions": [mount(1.0, valid_from_ns=None, valid_until_ns=5 * S), newest]}
        return {"frames": [newest]}


def mount(z_m: float, **validity: int | None) -> dict[str, Any]:
    T = se3.transform(np.eye(3), [0.0, 0.0, z_m]).tolist()
    return {"frame": "mana/lidar", "parent": "mana/base", "T": T, "covariance": None, **validity}


def test_fixed_frames_poses_and_newest_products_are_those_of_the_time() -> None:
    dpm = StoredDpm()
    world = retrieve_world(dpm, dpm.call, None, values=True)  # type: ignore[arg-type]
    assert world.stamp_ns == 3 * S  # of the newest pose
    np.testing.assert_allclose(world.transform("site", "mana/lidar").matrix[:3, 3], [3.0, 0.0, 1.0])
    assert world.omitted == {"site to mana/arm by /mana/vo.arm": "site to mana/arm: 2 s outside"}
    cloud = world.item("/mana/lidar.cloud")
    assert (cloud.type_name, cloud.frame, cloud.value) == ("Pointcloud", "mana/lidar", CLOUD.id)


def test_products_of_a_slow_dfpc_are_found_behind_a_full_page_of_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = {"robot": "mana", "port": "pose", "type_name": "TransformWithCovariance"}
    fast = pose_header("mana/base", 3) | names | {"dfpc": "position_manager"}
    slow = pose_header("mana/map", 1) | names | {"dfpc": "lidar_slam"}

    class BusyDpm(StoredDpm):
        def search(self, product: str, **parameters: object) -> list[dict[str, Any]]:
            if product != "pose":
                return []
            products_by_dfpc = {"": [fast, fast], "lidar_slam": [slow]}
            return products_by_dfpc.get(str(parameters.get("dfpc", "")), [])

    monkeypatch.setattr("cdff_common.client.live_world.MAX_PAGE", 2)
    dpm = BusyDpm()
    world = retrieve_world(dpm, dpm.call, 3 * S, values=False)  # type: ignore[arg-type]
    assert world.item("/mana/lidar_slam.pose").stamp_ns == S
    assert world.item("/mana/position_manager.pose").stamp_ns == 3 * S


def test_values_are_not_retrieved_unless_asked_for() -> None:
    dpm = StoredDpm()
    world = retrieve_world(dpm, dpm.call, 3 * S, values=False)  # type: ignore[arg-type]
    assert world.item("/mana/lidar.cloud").value is None
