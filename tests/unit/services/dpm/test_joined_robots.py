# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frames, recordings, scope and history of robots that join the DPM, change and leave."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from unittest.mock import Mock

from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.robot_profile import RobotProfile
from services.dpm.bus.joined_robots import JoinedRobots
from services.dpm.bus.recorder import Recorder
from services.dpm.bus.service_monitor import ServiceMonitor
from services.dpm.operations.dpm import Dpm

GROUND = Profile.model_validate({"name": "ground", "robots": [{"id": "mana"}]})


class SubscriptionBus:
    """Bus double with the keys of the open subscriptions and the withdrawn tokens."""

    def __init__(self) -> None:
        self.keys: list[str] = []
        self.withdrawn: list[str] = []

    def subscribe(self, key: str, _callback: Callable[..., None], *, depth: int) -> Any:
        self.keys.append(key)
        return Mock(dropped=0, close=lambda: self.keys.remove(key))

    def watch_alive(self, key: str, callback: Callable[[str, bool], None]) -> None:
        pass

    def withdraw_token(self, key: str) -> None:
        self.withdrawn.append(key)


def nano(x_m: float = 0.0, stream: str = "sample") -> RobotProfile:
    robot = {
        "id": "nano",
        "frames": [{"parent": "nano/base", "child": "nano/imu", "translation_m": [x_m, 0.0, 0.0]}],
        "sensors": {"imu": {"kind": "imu", "frame": "nano/imu", "streams": {stream: "IMUSensors"}}},
    }
    history = [{"sensor": "imu", "stream": stream, "keep_s": 60.0}]
    profile = Profile.model_validate({"name": "own", "robots": [robot], "history": history})
    return RobotProfile.of(profile, "nano")


def test_a_robot_joins_changes_and_leaves(dpm: Dpm) -> None:
    bus, served = SubscriptionBus(), list[str]()
    monitor = ServiceMonitor(bus, dpm)  # type: ignore[arg-type]  # double
    recorder = Recorder(bus, dpm, GROUND)  # type: ignore[arg-type]  # double
    first_keys = list(bus.keys)
    joined = JoinedRobots(bus, dpm, GROUND, monitor, recorder, served.append)  # type: ignore[arg-type]
    joined.set_robot(nano())
    assert bus.keys == [*first_keys, "cdff/@v1/nano/sensor/imu/sample"]
    assert monitor.revision("nano") == nano().revision
    assert [row["stream"] for row in monitor.overview()["streams"]] == ["sample"]
    joined.set_robot(nano(x_m=0.2, stream="fast"))
    assert bus.keys == [*first_keys, "cdff/@v1/nano/sensor/imu/fast"]
    assert [r.T_parent_frame.matrix[0, 3] for r in dpm.store.frames.revisions("nano/imu")] == [0.0, 0.2]
    joined.remove_robot("nano")
    assert bus.keys == first_keys
    assert bus.withdrawn == ["cdff/@v1/nano/@alive/dpm"]
    assert monitor.has_left("nano")
    assert monitor.overview()["streams"] == []
    assert served == ["nano", "nano"]
    changes = [e.body["change"] for e in dpm.store.events.since(0) if e.kind == "robot"]
    assert changes == ["joined", "changed", "left"]


def test_a_robot_that_cannot_join_is_an_alarm_until_it_is_corrected(dpm: Dpm) -> None:
    joined = JoinedRobots(Mock(), dpm, GROUND, Mock(), Mock(), Mock())
    joined.refuse("nano", "body.name is 'mars'")
    (alarm,) = dpm.alarms.active()
    assert (alarm.kind, alarm.source, alarm.what) == ("robot_refused", "nano", "body.name is 'mars'")
    joined.refuse("nano", "")
    assert dpm.alarms.active() == []
