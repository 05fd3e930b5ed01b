# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start of a DPM with a changed profile on the data of an earlier one."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.profile import Profile
from services.dpm.bus.joined_robots import enter_profile
from services.dpm.operations.dpm import Dpm
from services.dpm.operations.profile_entry import enter

from .conftest import S, pose, put_arguments


def profile(lidar_m: float = 0.85, start_m: float = 0.0, lidar: dict[str, Any] | None = None) -> Profile:
    frames = [
        {"parent": "site", "child": "mana/odom", "translation_m": [start_m, 0.0, 0.0]},
        {"parent": "mana/base", "child": "mana/mast", "translation_m": [0.1, 0.0, 0.5]},
        {"parent": "mana/mast", "child": "mana/lidar", "translation_m": [0.0, 0.0, lidar_m]} | (lidar or {}),
    ]
    return Profile.model_validate({"name": "changed", "robots": [{"id": "mana", "frames": frames}]})


def height_m(dpm: Dpm, stamp_s: float) -> float:
    """Return the height of the lidar above the mast for data of a time."""
    return float(dpm.store.poses.at(int(stamp_s * S), "mana/mast", "mana/lidar").matrix[2, 3])


def test_a_changed_mount_is_one_revision_for_later_data_and_is_reported(
    dpm: Dpm, caplog: pytest.LogCaptureFixture
) -> None:
    enter(dpm.store, profile(0.85))
    dpm.writer.put(*put_arguments(pose(50, 0.0), "pose", 50, frame="site", child="mana/base"))
    with caplog.at_level(logging.WARNING):
        assert enter(dpm.store, profile(0.95)) == ()
        assert enter(dpm.store, profile(0.95)) == ()
    revisions = dpm.store.frames.revisions("mana/lidar")
    assert [r.revision for r in revisions] == [1, 2]
    assert [r.revision for r in dpm.store.frames.revisions("mana/mast")] == [1]
    assert height_m(dpm, 50) == pytest.approx(0.85)
    assert height_m(dpm, 50.1) == pytest.approx(0.95)
    (message,) = caplog.messages
    assert "frame mana/lidar: revision 2 for data after 1970-01-01T00:00:50" in message
    assert "moved by 0.1000 m and 0.000° in mana/mast; earlier data keep revision 1" in message
    enter(dpm.store, profile(0.85))
    assert len(dpm.store.frames.revisions("mana/lidar")) == 3


def test_a_change_of_parent_or_standard_deviation_is_a_revision(
    dpm: Dpm, caplog: pytest.LogCaptureFixture
) -> None:
    enter(dpm.store, profile())
    enter(dpm.store, profile(lidar={"sigma_m": 0.01}))
    assert "with another standard deviation below mana/mast" in caplog.text
    enter(dpm.store, profile(lidar={"parent": "mana/base"}))
    assert "its parent is mana/base, not mana/mast" in caplog.text
    assert [r.parent for r in dpm.store.frames.revisions("mana/lidar")] == ["mana/mast"] * 2 + ["mana/base"]


def test_a_correction_of_a_mount_by_others_is_kept_while_the_profile_is_the_same(dpm: Dpm) -> None:
    enter(dpm.store, profile())
    corrected = UncertainTransform.exact(se3.transform(np.eye(3), [0.0, 0.0, 0.86]))
    dpm.store.frames.set("mana/lidar", "mana/mast", corrected, producer="calibration")
    assert enter(dpm.store, profile()) == ()
    assert len(dpm.store.frames.revisions("mana/lidar")) == 2
    assert height_m(dpm, 1) == pytest.approx(0.86)


def test_another_start_pose_is_an_alarm_and_moves_no_products(dpm: Dpm) -> None:
    enter_profile(dpm, profile())
    assert dpm.alarms.active() == []
    enter_profile(dpm, profile(start_m=7.0))
    (alarm,) = dpm.alarms.active()
    assert (alarm.kind, alarm.source) == ("frame_differs", "mana/odom")
    assert "moved by 7.0000 m and 0.000° in site" in alarm.what
    assert dpm.store.poses.at(0, "site", "mana/odom").matrix[0, 3] == 0.0
    set_by_operator = UncertainTransform.exact(se3.transform(np.eye(3), [7.0, 0.0, 0.0]))
    dpm.store.frames.set("mana/odom", "site", set_by_operator, producer="operator")
    assert enter(dpm.store, profile(start_m=7.0)) == ()


def test_the_pose_of_a_robot_that_stands_is_no_mount(dpm: Dpm) -> None:
    def lander(x_m: float, lidar_m: float) -> Profile:
        frames = [
            {"parent": "site", "child": "lander/base", "translation_m": [x_m, 0.0, 0.0]},
            {"parent": "lander/base", "child": "lander/lidar", "translation_m": [0.0, 0.0, lidar_m]},
        ]
        return Profile.model_validate({"name": "lander", "robots": [{"id": "lander", "frames": frames}]})

    enter(dpm.store, lander(0.0, 1.0))
    (difference,) = enter(dpm.store, lander(3.0, 1.5))
    assert difference.frame == "lander/base"
    revisions = {f: len(dpm.store.frames.revisions(f)) for f in ("lander/base", "lander/lidar")}
    assert revisions == {"lander/base": 1, "lander/lidar": 2}


def test_a_mount_changes_after_data_that_are_newer_than_the_clock(dpm: Dpm) -> None:
    enter(dpm.store, profile(0.85))
    stamp_s = dpm.store.clock.now_ns() // S + 30
    dpm.writer.put(*put_arguments(pose(stamp_s, 0.0), "pose", stamp_s, frame="site", child="mana/base"))
    enter(dpm.store, profile(0.95))
    assert height_m(dpm, stamp_s) == pytest.approx(0.85)
    assert height_m(dpm, stamp_s + 1) == pytest.approx(0.95)


def test_an_exchange_of_parent_and_child_is_reported_and_the_store_is_served(dpm: Dpm) -> None:
    enter(dpm.store, profile())
    frames = [
        {"parent": "mana/lidar", "child": "mana/mast"},
        {"parent": "mana/mast", "child": "mana/base"},
    ]
    exchanged = Profile.model_validate({"name": "exchanged", "robots": [{"id": "mana", "frames": frames}]})
    differences = {difference.frame: difference.text for difference in enter(dpm.store, exchanged)}
    assert differences.keys() == {"mana/base", "mana/mast"}
    assert "mana/mast is below mana/base: the edge would close a loop" in differences["mana/base"]
