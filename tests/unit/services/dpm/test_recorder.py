# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor samples become products, as the profile's policy says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Message
from cdff_common.clock import ManualClock
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.profile import History, Profile
from cdff_common.types import IMUSensors, LidarScan, Time
from dpm_store import Query
from services.dpm.operations import Dpm
from services.dpm.recorder import Recorder, rules_of_history

S = 1_000_000_000
SENSORS = {
    "lidar": {"kind": "lidar", "frame": "mana/lidar", "streams": {"scan": "LidarScan"}},
    "imu": {"kind": "imu", "frame": "mana/imu", "streams": {"sample": "IMUSensors"}},
}


class NoBus:
    """Keeps what is subscribed to; nothing comes from it."""

    def __init__(self) -> None:
        self.keys: list[str] = []

    def subscribe(self, key: str, _callback: Callable[[Message], None], *, depth: int) -> Any:
        self.keys.append(key)
        return type("Subscription", (), {"dropped": 0})


def recorder(dpm: Dpm, *policies: History) -> Recorder:
    profile = Profile.model_validate(
        {"name": "test", "robots": [{"id": "mana", "sensors": SENSORS}], "history": [p.model_dump() for p in policies]}
    )
    return Recorder(NoBus(), dpm, profile)  # type: ignore[arg-type]  # subscribes only


def message(value: Any, sensor: str, stream: str, seq: int, t1_ns: int) -> Message:
    header = Header(
        id=product_id("mana", sensor, stream, t1_ns, seq, ""), seq=seq, t0_ns=t1_ns, t1_ns=t1_ns,
        frame=f"mana/{sensor}", producer=sensor,
    )  # fmt: skip
    encoding = encoding_string(type(value).__name__, "uper")
    return Message(f"cdff/@v1/mana/sensor/{sensor}/{stream}", encode(value, "uper"), encoding, header.to_attachment())


def scan(seq: int, second: float) -> Message:
    t_ns = int(second * S)
    points = np.random.default_rng(seq).normal(0, 3, (50, 3)).astype(np.float32)
    value = LidarScan.from_arrays(points, np.zeros(50, np.uint32), frame="mana/lidar", t0_ns=t_ns, t1_ns=t_ns)
    return message(value, "lidar", "scan", seq, t_ns)


def inertial(seq: int, second: float) -> Message:
    t_ns = int(second * S)
    value = IMUSensors(Time.from_ns(t_ns), np.array([0, 0, 9.81]), np.full(3, seq / 100), np.zeros(3))
    return message(value, "imu", "sample", seq, t_ns)


@pytest.mark.req("CDFF-SUP-084")
def test_each_nth_sample_is_kept_and_found_like_any_product(dpm: Dpm) -> None:
    kept = recorder(dpm, History(sensor="lidar", stream="scan", every_n=3))
    for seq in range(9):
        kept.take(scan(seq, seq * 0.5))
    found = dpm.search(Query(types=("scan",), robot="mana", dfpc="lidar", port="scan")).items
    assert [record.header.seq for record in found] == [6, 3, 0]
    assert found[0].header.box_m is not None
    assert kept.counters == {"kept": 3, "skipped": 6, "refused": 0, "retired": 0, "dropped": 0}
    assert dpm.status()["history"]["kept"] == 3


def test_samples_are_kept_no_denser_than_the_policy_says(dpm: Dpm) -> None:
    kept = recorder(dpm, History(sensor="lidar", stream="scan", every_s=2.0))
    for seq in range(10):
        kept.take(scan(seq, seq * 0.5))
    assert [r.header.t1_ns for r in dpm.search(Query(types=("scan",))).items] == [4 * S, 2 * S, 0]


@pytest.mark.req("CDFF-SUP-084")
def test_inertial_samples_are_kept_as_spans_that_name_them(dpm: Dpm) -> None:
    kept = recorder(dpm, History(sensor="imu", stream="sample", span_s=1.0))
    for seq in range(25):
        kept.take(inertial(seq, seq * 0.1))
    kept.flush()
    found = dpm.search(Query(types=("imu_span",))).items[::-1]
    assert [(r.header.t0_ns, r.header.t1_ns) for r in found] == [
        (0, 9 * S // 10), (S, 19 * S // 10), (2 * S, 24 * S // 10),
    ]  # fmt: skip
    span = decode("ImuSpan", dpm.store.payload(found[1].id), "uper")
    assert span.frame == "mana/imu"
    assert np.array_equal(span.stamps_ns, np.arange(10, 20) * S // 10)
    assert span.data.gyro[0] == pytest.approx([0.1] * 3)
    assert len(found[1].header.inputs) == 10


@pytest.mark.req("CDFF-SUP-084")
def test_what_was_kept_long_enough_goes_but_for_what_a_product_was_made_from(dpm: Dpm) -> None:
    clock = dpm.clock
    assert isinstance(clock, ManualClock)
    kept = recorder(dpm, History(sensor="lidar", stream="scan", keep_s=60.0))
    first = clock.now_ns() // S
    for seq in range(3):
        kept.take(scan(seq, first))
    clock.set_ns((first + 100) * S)
    kept.take(scan(9, first + 100))
    assert [r.header.seq for r in dpm.search(Query(types=("scan",))).items] == [9]
    assert kept.counters["retired"] == 3


def test_a_sample_that_cannot_be_read_is_counted_and_not_kept(dpm: Dpm) -> None:
    kept = recorder(dpm, History(sensor="lidar", stream="scan"))
    good = scan(1, 1.0)
    kept.take(Message(good.key, good.payload[:40], good.encoding, good.attachment))
    kept.take(Message(good.key, good.payload, good.encoding, b"nothing"))
    assert kept.counters["refused"] == 2
    assert dpm.search(Query(types=("scan",))).items == ()


def test_a_policy_of_a_stream_that_no_robot_has_is_refused() -> None:
    with pytest.raises(ValueError, match="radar/echo"):
        Profile.model_validate(
            {"name": "test", "robots": [{"id": "mana"}], "history": [{"sensor": "radar", "stream": "echo"}]}
        )


def test_the_policy_becomes_rules_of_retention() -> None:
    profile = Profile.model_validate(
        {"name": "test", "robots": [{"id": "mana", "sensors": SENSORS}],
         "history": [{"sensor": "lidar", "stream": "scan", "keep_s": 60}, {"sensor": "imu", "stream": "sample"}]}
    )  # fmt: skip
    (rule,) = rules_of_history(profile)
    assert (rule.product, rule.robot, rule.dfpc, rule.port, rule.max_age_s) == ("scan", "mana", "lidar", "scan", 60.0)
