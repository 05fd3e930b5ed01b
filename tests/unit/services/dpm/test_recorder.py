# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recording of sensor samples in the DPM by the history policies of the profile."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Message
from cdff_common.clock import ManualClock
from cdff_common.codecs import decode, encode, encoding_string
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.profile import History, Profile
from cdff_common.types import IMUSensors, LidarScan, Time
from dpm_store import Query
from services.dpm.bus.recorder import Recorder, rules_of_history
from services.dpm.operations.dpm import Dpm

from .conftest import S, cloud, put_arguments

SENSORS = {
    "lidar": {"kind": "lidar", "frame": "mana/lidar", "streams": {"scan": "LidarScan"}},
    "imu": {"kind": "imu", "frame": "mana/imu", "streams": {"sample": "IMUSensors"}},
}


class SubscriptionBus:
    """Bus double that records subscriptions."""

    def __init__(self) -> None:
        self.keys: list[str] = []

    def subscribe(self, key: str, _callback: Callable[[Message], None], *, depth: int) -> Any:
        self.keys.append(key)
        return type("Subscription", (), {"dropped": 0})


def recorder(dpm: Dpm, *policies: History) -> Recorder:
    profile = Profile.model_validate(
        {
            "name": "test",
            "robots": [{"id": "mana", "sensors": SENSORS}],
            "history": [p.model_dump() for p in policies],
        }
    )
    return Recorder(SubscriptionBus(), dpm, profile)  # type: ignore[arg-type]  # subscribes only


def message(value: Any, sensor: str, stream: str, seq: int, t1_ns: int) -> Message:
    header = Header(
        id=product_id("mana", sensor, stream, t1_ns, seq, ""),
        seq=seq,
        t0_ns=t1_ns,
        t1_ns=t1_ns,
        frame=f"mana/{sensor}",
        producer=sensor,
    )
    encoding = encoding_string(type(value).__name__, "uper")
    return Message(
        f"cdff/@v1/mana/sensor/{sensor}/{stream}", encode(value, "uper"), encoding, header.to_attachment()
    )


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
def test_every_nth_sample_is_stored_and_searchable_like_a_product(dpm: Dpm) -> None:
    recording = recorder(dpm, History(sensor="lidar", stream="scan", every_n=3))
    for seq in range(9):
        recording.record(scan(seq, seq * 0.5))
    result = dpm.retrieval.find(Query(types=("scan",), robot="mana", dfpc="lidar", port="scan")).items
    assert [record.header.seq for record in result] == [6, 3, 0]
    assert result[0].header.box_m is not None
    expected = {"kept": 3, "skipped": 6, "refused": 0, "retired": 0, "dropped": 0, "waiting": 0}
    assert recording.counters == expected
    assert dpm.reports.status()["history"]["kept"] == 3


def test_samples_are_stored_at_least_the_stated_interval_apart(dpm: Dpm) -> None:
    recording = recorder(dpm, History(sensor="lidar", stream="scan", every_s=2.0))
    for seq in range(10):
        recording.record(scan(seq, seq * 0.5))
    assert [r.header.t1_ns for r in dpm.retrieval.find(Query(types=("scan",))).items] == [4 * S, 2 * S, 0]


@pytest.mark.req("CDFF-SUP-084")
def test_inertial_samples_are_stored_as_spans_that_list_their_ids(dpm: Dpm) -> None:
    recording = recorder(dpm, History(sensor="imu", stream="sample", span_s=1.0))
    for seq in range(25):
        recording.record(inertial(seq, seq * 0.1))
    recording.flush()
    result = dpm.retrieval.find(Query(types=("imu_span",))).items[::-1]
    assert [(r.header.t0_ns, r.header.t1_ns) for r in result] == [
        (0, 9 * S // 10),
        (S, 19 * S // 10),
        (2 * S, 24 * S // 10),
    ]
    span = decode("ImuSpan", dpm.store.payload(result[1].id), "uper")
    assert span.frame == "mana/imu"
    assert np.array_equal(span.stamps_ns, np.arange(10, 20) * S // 10)
    assert span.data.gyro[0] == pytest.approx([0.1] * 3)
    assert len(result[1].header.inputs) == 10


@pytest.mark.req("CDFF-SUP-084")
def test_expired_samples_are_deleted_unless_a_product_was_derived_from_them(dpm: Dpm) -> None:
    clock = dpm.clock
    assert isinstance(clock, ManualClock)
    recording = recorder(dpm, History(sensor="lidar", stream="scan", keep_s=60.0))
    start_s = clock.now_ns() // S
    for seq in range(3):
        recording.record(scan(seq, start_s))
    source = dpm.retrieval.find(Query(types=("scan",))).items[0]
    dpm.writer.put(*put_arguments(cloud(), "pointcloud", start_s, inputs=(source.id,)))
    clock.set_ns((start_s + 100) * S)
    recording.record(scan(9, start_s + 100))
    stored = dpm.retrieval.find(Query(types=("scan",))).items
    assert [r.header.seq for r in stored] == [9, source.header.seq]
    assert recording.counters["retired"] == 2


def test_an_unreadable_sample_is_counted_and_not_stored(dpm: Dpm) -> None:
    recording = recorder(dpm, History(sensor="lidar", stream="scan"))
    valid = scan(1, 1.0)
    recording.record(Message(valid.key, valid.payload[:40], valid.encoding, valid.attachment))
    recording.record(Message(valid.key, valid.payload, valid.encoding, b"nothing"))
    assert recording.counters["refused"] == 2
    assert dpm.retrieval.find(Query(types=("scan",))).items == ()


def test_a_policy_of_an_unknown_stream_is_refused() -> None:
    with pytest.raises(ValueError, match="radar/echo"):
        Profile.model_validate(
            {"name": "test", "robots": [{"id": "mana"}], "history": [{"sensor": "radar", "stream": "echo"}]}
        )


def test_a_policy_with_a_limited_age_is_converted_to_a_retention_rule() -> None:
    profile = Profile.model_validate(
        {
            "name": "test",
            "robots": [{"id": "mana", "sensors": SENSORS}],
            "history": [
                {"sensor": "lidar", "stream": "scan", "keep_s": 60},
                {"sensor": "imu", "stream": "sample"},
            ],
        }
    )
    (rule,) = rules_of_history(profile)
    assert (rule.product, rule.robot, rule.dfpc, rule.port, rule.max_age_s) == (
        "scan",
        "mana",
        "lidar",
        "scan",
        60.0,
    )


def test_samples_ahead_of_the_mission_clock_are_stored_when_it_reaches_them(
    dpm: Dpm, clock: ManualClock
) -> None:
    recording = recorder(dpm, History(sensor="lidar", stream="scan"))
    for seq in range(3):
        recording.record(scan(seq, 1000.0 + seq))
    assert (recording.counters["kept"], recording.counters["waiting"]) == (0, 3)
    clock.set_ns(1000 * S)
    recording.record(scan(3, 1003.0))
    assert (recording.counters["kept"], recording.counters["waiting"], recording.counters["refused"]) == (
        4,
        0,
        0,
    )


def test_waiting_samples_survive_the_end_of_the_process(dpm: Dpm, clock: ManualClock) -> None:
    policy = History(sensor="lidar", stream="scan")
    ended = recorder(dpm, policy)
    for seq in range(3):
        ended.record(scan(seq, 1000.0 + seq))
    folder = dpm.store.directory / "waiting"
    damaged = sorted(folder.iterdir())[0]
    damaged.write_bytes(damaged.read_bytes()[:-1] + b"?")
    (folder / "notes.sample").write_text("of somebody else")

    recording = recorder(dpm, policy)
    assert recording.counters["waiting"] == 3
    recording.store_waiting()
    assert recording.counters["waiting"] == 2, "the clock has not reached them"
    clock.set_ns(1000 * S)
    recording.store_waiting()
    counters = recording.counters
    assert (counters["kept"], counters["refused"], counters["waiting"]) == (2, 1, 0)
    stored = dpm.store.search(Query(types=("scan",))).items
    assert sorted(record.header.t1_ns for record in stored) == [1001 * S, 1002 * S]
    assert [path.name for path in folder.iterdir()] == ["notes.sample"]


def test_samples_wait_in_memory_while_the_disk_takes_no_files(
    dpm: Dpm, clock: ManualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = recorder(dpm, History(sensor="lidar", stream="scan"))
    with monkeypatch.context() as patch:
        patch.setattr(dpm.store.disk_space, "_low_water", 1 << 62)
        recording.record(scan(0, 1000.0))
        assert recording.counters["waiting"] == 1
        assert not (dpm.store.directory / "waiting").exists()
        clock.set_ns(1000 * S)
        recording.store_waiting()
        assert recording.counters["waiting"] == 1, "there is no space for it"
    recording.store_waiting()
    assert (recording.counters["kept"], recording.counters["waiting"]) == (1, 0)


def test_the_space_of_waiting_samples_is_bounded(dpm: Dpm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.dpm.bus.recorder.CAPACITY_BYTES", 2500)
    recording = recorder(dpm, History(sensor="lidar", stream="scan"))
    for seq in range(8):
        recording.record(scan(seq, 1000.0 + seq))
    counters = recording.counters
    assert counters["waiting"] + counters["refused"] == 8
    assert 1 <= counters["waiting"] <= 4
    files = list((dpm.store.directory / "waiting").iterdir())
    assert len(files) == counters["waiting"]
    assert sum(path.stat().st_size for path in files) <= 2500
