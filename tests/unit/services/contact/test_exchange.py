# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The exchange between the store of a robot and that of the ground, over real sessions and a lossy link."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.clock import wall_ns
from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.contact_plan import ContactPlan, ContactWindow, load_contact_plan
from cdff_common.interfaces.profile import Exchange
from cdff_common.mission_clock import MissionClock
from cdff_dev.contact.generated_products import product
from cdff_dev.contact.simulated_link import Direction, SimulatedLink
from cdff_dev.ports import free_udp_port as free_port
from dpm_store import open_store
from services.contact.estimate import USED_SHARE, Waiting, estimate
from services.contact.ground_end import GroundEnd
from services.contact.robot_end import RobotEnd
from services.dpm.operations.dpm import Dpm

POSES, MAP, CLOUD = range(20), 20, 21


def window(start_s: float, end_s: float, rate_bit_s: float = 4e6, **fields: Any) -> ContactWindow:
    """Return a window of mana, seconds from now."""
    now = datetime.now(UTC)
    start, end = (now + timedelta(seconds=s) for s in (start_s, end_s))
    return ContactWindow(robot="mana", start=start, end=end, rate_bit_s=rate_bit_s, **fields)


def wait_until(condition: Callable[[], Any], timeout_s: float = 30.0) -> None:
    """Wait for a condition; fails after the time limit."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, "the condition does not become true"
        time.sleep(0.02)


class Ends:
    """Two stores and a link; the ends are started and closed by the test."""

    def __init__(self, folder: Path) -> None:
        port = free_port()
        self.ground_address = f"udp/127.0.0.1:{port}"
        self._robot_store = open_store(f"sqlite:///{folder}/robot", MissionClock())
        self._ground_store = open_store(f"sqlite:///{folder}/ground", MissionClock())
        self.robot, self.ground = Dpm(self._robot_store), Dpm(self._ground_store)
        self.link = SimulatedLink(
            ("127.0.0.1", port), Direction(4e6, 0.01, 0.02), Direction(1e6, 0.01, 0.02), seed=1
        )

    def start_robot(self, plan: ContactPlan, **exchange: Any) -> closing[RobotEnd]:
        """Start the end of the robot; it answers requests with the first map."""

        def execute(_: dict[str, str], __: float) -> dict[str, Any]:
            return {"id": product(1, MAP).header.id}

        address = f"udp/127.0.0.1:{self.link.port}"
        return closing(RobotEnd("mana", self.robot, plan, address, Exchange(**exchange), execute))

    def start_ground(self, plan: ContactPlan) -> closing[GroundEnd]:
        """Start the end of the ground."""
        return closing(GroundEnd(self.ground, plan, self.ground_address, Exchange()))

    def close(self) -> None:
        """Close the stores."""
        self._robot_store.close()
        self._ground_store.close()


@pytest.fixture
def ends(tmp_path: Path) -> Iterator[Ends]:
    """Two stores and a link with a loss of 2 %."""
    both = Ends(tmp_path)
    with both.link:
        yield both
    both.close()


def is_at_ground(ends: Ends, *numbers: int) -> bool:
    """Return whether products are at the ground."""
    ids = [product(1, n).header.id for n in numbers]
    return ends.ground.store.live(ids) == set(ids)


def test_products_alarms_and_frames_of_the_robot_are_at_the_ground_after_a_window(ends: Ends) -> None:
    numbers = (*POSES, MAP, CLOUD)
    ends.robot.store.put_all([product(1, n) for n in numbers])
    ends.robot.store.events.append("mana", "alarm", {"alarm": "slip", "active": True})
    T = UncertainTransform(se3.transform(np.eye(3), [1.0, 2.0, 3.0]), np.eye(6) * 0.01)
    original = ends.robot.store.frames.set("mana/lidar", "mana/base", T, producer="calibration")
    plan = ContactPlan(windows=(window(0, 100),))

    with ends.start_ground(plan), ends.start_robot(plan) as robot:
        wait_until(lambda: is_at_ground(ends, *numbers) and not robot.status()["backlog"])

    for n in numbers:
        made = product(1, n).header
        assert replace(ends.ground.store.get(made.id).header, sha256=None, box_m=None) == made
        assert ends.ground.store.payload(made.id) == ends.robot.store.payload(made.id)
    (alarm,) = ends.ground.store.events.since(kind="alarm", scope="mana")
    assert alarm.body["alarm"] == "slip"
    (revision,) = ends.ground.store.frames.revisions("mana/lidar")
    names = ("parent", "T", "covariance", "producer", "revision")
    assert [revision.to_dict()[n] for n in names] == [original.to_dict()[n] for n in names]


def test_nothing_is_sent_outside_a_window(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, 0)])
    plan = ContactPlan(windows=(window(2.0, 60.0),))
    start_s = time.monotonic()
    with ends.start_ground(plan), ends.start_robot(plan):
        wait_until(lambda: is_at_ground(ends, 0))
        assert time.monotonic() - start_s > 1.5


def test_a_transfer_continues_at_the_offset_at_which_both_sides_were_ended(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, CLOUD)])
    size = len(product(1, CLOUD).payload)
    plan = ContactPlan(windows=(window(0, 100),))
    with ends.start_ground(plan) as ground, ends.start_robot(plan):
        wait_until(lambda: ground.status()["mana"]["bytes_received"] > size // 3)
        received = ground.status()["mana"]["bytes_received"]
    assert not is_at_ground(ends, CLOUD), "the transfer was faster than the test"
    with ends.start_ground(plan), ends.start_robot(plan) as robot:
        wait_until(lambda: is_at_ground(ends, CLOUD))
        assert robot.status()["bytes_sent"] < 1.1 * (size - received) + 40_000


def test_a_pose_that_is_made_during_the_transfer_of_a_cloud_arrives_before_it(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, CLOUD)])
    plan = ContactPlan(windows=(window(0, 100),))
    with ends.start_ground(plan) as ground, ends.start_robot(plan, budget_bit_s=1e6):
        wait_until(lambda: ground.status()["mana"]["bytes_received"] > 20_000)
        ends.robot.store.put_all([product(1, 0)])
        wait_until(lambda: is_at_ground(ends, 0))
        assert not is_at_ground(ends, CLOUD)


def test_the_ground_knows_what_is_missing_and_when_it_will_arrive(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, MAP), product(1, CLOUD)])
    plan = ContactPlan(windows=(window(0, 4.0, 1e6), window(1000, 1100)))
    with ends.start_ground(plan) as ground, ends.start_robot(plan, budget_bit_s=4e5):
        cloud = product(1, CLOUD).header.id
        wait_until(lambda: [item["id"] for item in ground.estimate("mana")["items"]] == [cloud])
        assert is_at_ground(ends, MAP)
        (item,) = ground.estimate("mana")["items"]
        assert 0 < item["missing"] <= item["size"] == len(product(1, CLOUD).payload)
        wait_until(lambda: wall_ns() > plan.windows[0].end_ns)
        answer = ground.estimate("mana")
    assert answer["complete_ns"] == answer["items"][0]["arrives_ns"]
    assert plan.windows[1].start_ns < answer["complete_ns"] < plan.windows[1].start_ns + 5_000_000_000


def test_a_request_is_kept_until_the_contact_and_answered_with_a_product(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, n) for n in (MAP, CLOUD)])
    plan = ContactPlan(windows=(window(1.5, 60.0),))
    with ends.start_ground(plan) as ground, ends.start_robot(plan):
        kept = ground.requests.add("mana", {"type": "dem"}, 50.0, "r1")
        assert kept["state"] == "kept"
        wait_until(lambda: ground.requests.get("r1")["state"] == "answered")
        assert ground.requests.get("r1")["result"] == {"id": product(1, MAP).header.id}
        assert is_at_ground(ends, MAP)


def test_a_request_that_cannot_be_sent_in_time_expires_with_the_reason(ends: Ends) -> None:
    plan = ContactPlan(windows=(window(1000.0, 1060.0),))
    with ends.start_ground(plan) as ground:
        ground.requests.add("mana", {"type": "dem"}, 0.2, "r1")
        wait_until(lambda: ground.requests.get("r1")["state"] == "expired")
        assert "no window of mana before" in ground.requests.get("r1")["result"]["error"]
        with pytest.raises(InputError, match="windows of mana"):
            ground.requests.add("minnie", {"type": "dem"})


def test_the_estimate_fills_the_windows_in_the_order_of_the_items() -> None:
    windows = (window(10.0, 20.0, 1e6, delay_s=1.0), window(100.0, 200.0, 1e6))
    now_ns = windows[0].start_ns - 10_000_000_000
    fits = int(USED_SHARE * 1e6 / 8 * 5)
    items = [Waiting(str(n), 0, fits, fits) for n in range(3)]
    first, second, third = estimate(items, windows, now_ns)
    assert first.arrives_ns is not None
    assert second.arrives_ns is not None
    assert third.arrives_ns is not None
    assert first.arrives_ns - windows[0].start_ns == pytest.approx(6e9, rel=1e-3)
    assert second.arrives_ns - windows[0].start_ns == pytest.approx(11e9, rel=1e-3)
    assert third.arrives_ns - windows[1].start_ns == pytest.approx(5e9, rel=1e-3)
    assert estimate([Waiting("large", 0, 10**9, 10**9)], windows, now_ns)[0].arrives_ns is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("windows: []", "at least 1 item"),
        (
            "windows: [{robot: m, start: 2026-01-01T00:00:00, end: 2026-01-02T00:00:00Z, rate_bit_s: 1e6}]",
            "offset",
        ),
        (
            "windows: [{robot: m, start: 2026-01-02T00:00:00Z, end: 2026-01-01T00:00:00Z, rate_bit_s: 1e6}]",
            "before",
        ),
        (
            "windows: [{robot: m, start: 2026-01-01T00:00:00Z, end: 2026-01-02T00:00:00Z, rate_bit_s: 0}]",
            "greater",
        ),
    ],
)
def test_a_wrong_contact_plan_is_refused_with_the_place(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=f"plan.yaml: windows.*{reason}"):
        load_contact_plan(path)
