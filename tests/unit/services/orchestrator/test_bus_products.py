# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Newest products of a robot that its orchestrator receives from the bus."""

from __future__ import annotations

from typing import Any

import pytest

from cdff_common.bus import keys
from cdff_common.clock import ManualClock
from cdff_common.codecs import encode_payload
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import TransformWithCovariance
from cdff_core.orchestration.world import ProviderId
from cdff_dev.mission_replay.local_bus import LocalBus
from services.orchestrator.bus_products import BusProducts
from tests.support.dpm_products import S, pose


class State:
    """State in which the port ``pose`` of each DFPC has the product pose."""

    def __init__(self) -> None:
        self.insertions: list[tuple[str, str]] = []

    def product_of(self, provider: ProviderId, port: str) -> str:
        return "pose" if provider.robot == "mana" and port == "pose" else ""

    def add_insertion(self, robot: str, product: str) -> None:
        self.insertions.append((robot, product))


class Robot:
    """Bus of robot mana, on which its DFPCs publish poses at ``(x, 0, 0)``, metres."""

    def __init__(self) -> None:
        self.bus, self.state = LocalBus(ManualClock(0)), State()
        self.products = BusProducts(self.bus, "mana", self.state)  # type: ignore[arg-type]
        self.products.start()

    def publish(self, dfpc: str, second: int, x: float, child: str = "mana/base", port: str = "pose") -> None:
        value: Any = pose(second, x)
        header = Header(
            id=product_id("mana", dfpc, port, second * S, 0, "c"),
            seq=0,
            t0_ns=second * S,
            t1_ns=second * S,
            frame="site",
            child=child,
            producer="test",
            config_hash="c",
        )
        payload, encoding = encode_payload(value, "uper")
        self.bus.publish(
            keys.product("mana", dfpc, port), payload, encoding=encoding, attachment=header.to_attachment()
        )

    def newest_x_m(self, child: str | None = None) -> float | None:
        stored = self.products.newest("pose", child)
        if stored is None:
            return None
        value = stored.value
        assert isinstance(value, TransformWithCovariance)
        assert (stored.robot, stored.manifest["product"]) == ("mana", "pose")
        return float(value.transform.matrix[0, 3])


@pytest.fixture
def robot() -> Robot:
    return Robot()


def test_the_newest_pose_of_a_frame_is_that_of_the_latest_capture(robot: Robot) -> None:
    assert robot.newest_x_m() is None
    robot.publish("odometry", 5, 1.0)
    robot.publish("slam", 3, 2.0)
    robot.publish("arm", 9, 3.0, child="mana/camera")
    assert robot.newest_x_m() == 3.0
    assert robot.newest_x_m("mana/base") == 1.0
    assert robot.newest_x_m("mana/camera") == 3.0
    assert robot.newest_x_m("mana/wheel") is None
    robot.publish("slam", 6, 4.0)
    assert robot.newest_x_m("mana/base") == 4.0


def test_other_ports_and_failed_products_are_ignored(robot: Robot) -> None:
    robot.publish("odometry", 5, 1.0, port="debug")
    robot.bus.publish(keys.product("mana", "odometry", "pose"), b"")
    assert robot.newest_x_m() is None
    assert robot.state.insertions == []


def test_a_product_counts_as_inserted_only_without_a_dpm(robot: Robot) -> None:
    robot.publish("odometry", 5, 1.0)
    assert robot.state.insertions == [("mana", "pose")]
    robot.bus.declare_alive(keys.GROUND, "dpm")
    robot.publish("odometry", 6, 1.0)
    assert robot.state.insertions == [("mana", "pose")]
    assert robot.newest_x_m() == 1.0
