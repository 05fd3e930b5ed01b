# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of the DPM and of other services, and their acknowledgement."""

from __future__ import annotations

import hashlib
import itertools
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from cdff_common.bus import Request
from cdff_common.errors import CodecError, DeniedError, ProductNotFoundError, StorageError
from dpm_store import open_store
from dpm_store.history.events import Actor, acting
from services.alarms import Alarm, Alarms, Severity
from services.dpm.bus.alarms import acknowledge
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.alarm_board import KEPT_S, AlarmBoard
from services.dpm.operations.condition_monitor import ConditionMonitor, check_conditions
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings
from services.identity_alarm import IdentityAlarm
from tests.support.dpm_products import cloud, put_arguments

CRASH = Alarm("crash_loop", "lidar_slam", Severity.CRITICAL, 5, "it ended 5 times", "read its log")
OPERATOR = Actor("olaf", "operator", "http")


class Seconds:
    """Monotonic seconds, set by tests."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def kinds(dpm: Dpm) -> list[tuple[str, str]]:
    return [(alarm["kind"], alarm["source"]) for alarm in dpm.alarm_board.active()]


def test_an_alarm_of_another_service_is_in_list_readiness_and_metrics(dpm: Dpm, http: TestClient) -> None:
    dpm.alarm_board.report("ground", "supervisor", [CRASH.to_dict()])
    (item,) = http.get("/api/v1/alarms").json()["items"]
    assert (item["kind"], item["source"], item["acknowledged_by"]) == ("crash_loop", "lidar_slam", None)
    assert "crash_loop of lidar_slam: it ended 5 times; read its log" in http.get("/readyz").text
    labels = 'kind="crash_loop",source="lidar_slam",severity="critical",acknowledged="false"'
    assert f"cdff_alarm{{{labels}}} 1" in http.get("/metrics").text


def test_a_service_that_falls_silent_has_no_alarms(dpm: Dpm) -> None:
    now = Seconds()
    board = AlarmBoard(Alarms(), dpm.store, now)
    board.report("ground", "supervisor", [CRASH.to_dict()])
    now.now_s = 9.0
    assert len(board.active()) == 1
    now.now_s = 11.0
    assert board.active() == []


@pytest.mark.parametrize(
    "items",
    [
        "none",
        [{"kind": "x"}],
        [CRASH.to_dict() | {"severity": "fatal"}],
        [CRASH.to_dict() | {"what": "x" * 5000}],
        [CRASH.to_dict() | {"since_ns": "now"}],
        [CRASH.to_dict()] * 101,
    ],
)
def test_malformed_reports_are_refused(dpm: Dpm, items: Any) -> None:
    with pytest.raises(CodecError, match="expected"):
        dpm.alarm_board.report("ground", "supervisor", items)
    assert dpm.alarm_board.active() == []


def test_an_acknowledgement_survives_a_restart_while_its_alarm_persists(dpm: Dpm) -> None:
    now = Seconds()
    alarms = Alarms()
    alarms.set("disk_full", "dpm", Severity.CRITICAL, "0 bytes are free", "free space")
    with acting(OPERATOR):
        acknowledged = AlarmBoard(alarms, dpm.store, now).acknowledge("disk_full", "dpm")
    assert acknowledged["acknowledged_by"] == "http/operator/olaf"

    restarted = AlarmBoard(alarms, dpm.store, now)
    restarted.drop_old_acknowledgements()
    assert restarted.active() == [acknowledged]
    now.now_s = KEPT_S + 1.0
    restarted.drop_old_acknowledgements()
    assert restarted.active() == [acknowledged], "the alarm persists"

    alarms.clear("disk_full", "dpm")
    now.now_s += KEPT_S + 1.0
    restarted.drop_old_acknowledgements()
    alarms.set("disk_full", "dpm", Severity.CRITICAL, "0 bytes are free", "free space")
    for board in (restarted, AlarmBoard(alarms, dpm.store, now)):
        assert board.active()[0]["acknowledged_by"] is None, "it is a new alarm"


def test_the_first_acknowledgement_counts(dpm: Dpm) -> None:
    dpm.alarm_board.report("ground", "supervisor", [CRASH.to_dict()])
    for name in ("olaf", "olga"):
        with acting(Actor(name, "operator", "http")):
            assert dpm.acknowledge("crash_loop", "lidar_slam")["acknowledged_by"] == "http/operator/olaf"


def test_an_acknowledgement_by_another_process_is_adopted_from_the_history(dpm: Dpm) -> None:
    other = AlarmBoard(Alarms(), dpm.store)
    dpm.events.listen(other.follow)
    for board in (dpm.alarm_board, other):
        board.report("ground", "supervisor", [CRASH.to_dict()])
    with acting(OPERATOR):
        acknowledged = dpm.acknowledge("crash_loop", "lidar_slam")
    assert acknowledged["acknowledged_by"] == "http/operator/olaf"
    assert other.active() == [acknowledged]


def test_an_alarm_is_acknowledged_although_the_disk_is_full(
    dpm: Dpm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise StorageError("the disk is full")

    monkeypatch.setattr(dpm.store, "write_note", fail)
    dpm.alarm_board.report("ground", "supervisor", [CRASH.to_dict()])
    assert dpm.alarm_board.acknowledge("crash_loop", "lidar_slam")["acknowledged_by"] == "local"


def test_operators_acknowledge_over_http_and_robots_may_not(dpm: Dpm, tmp_path: Path) -> None:
    file = tmp_path / "keys"
    lines = [f"{hashlib.sha256(role.encode()).hexdigest()} {role} mana" for role in ("robot", "operator")]
    file.write_text("\n".join(lines))
    app = create_app(Context(dpm, Settings(tmp_path, keys_file=file)))
    dpm.alarm_board.report("ground", "supervisor", [CRASH.to_dict()])
    body = {"kind": "crash_loop", "source": "lidar_slam"}
    with TestClient(app, base_url="http://127.0.0.1:8080") as client:

        def post(role: str, body: dict[str, str]) -> Any:
            headers = {"Authorization": f"Bearer {role}"}
            return client.post("/api/v1/alarms/acknowledge", json=body, headers=headers)

        assert post("robot", body).status_code == 403
        assert post("operator", body | {"kind": "clock"}).status_code == 404
        answer = post("operator", body)
    assert answer.json()["acknowledged_by"] == "http/operator/mana"
    assert dpm.alarm_board.active()[0]["acknowledged_ns"] == int(answer.json()["acknowledged_ns"])
    event = dpm.store.events.since(0, kind="alarm")[-1]
    assert event.body["acknowledged_by"] == "http/operator/mana"


def test_acknowledgements_over_zenoh_need_the_scope_of_ground(dpm: Dpm) -> None:
    dpm.alarm_board.report("ground", "supervisor", [CRASH.to_dict()])
    parameters = {"kind": "crash_loop", "source": "lidar_slam"}
    with acting(Actor("mana", "robot", "zenoh")), pytest.raises(DeniedError):
        acknowledge(dpm, Request("cdff/@v1/mana/dpm/@rpc/acknowledge", parameters, b"", "", b""))
    reply = acknowledge(dpm, Request("cdff/@v1/ground/dpm/@rpc/acknowledge", parameters, b"", "", b""))
    assert reply.body()["acknowledged_by"] == "local"
    with pytest.raises(ProductNotFoundError, match="'clock' of 'dpm'"):
        dpm.acknowledge("clock", "dpm")


def test_a_corrupt_payload_raises_an_alarm_until_it_is_repaired(dpm: Dpm, tmp_path: Path) -> None:
    arguments = put_arguments(cloud(5000), "pointcloud")
    _, header = dpm.writer.put(*arguments)
    (path,) = [path for path in (tmp_path / "blobs").glob("??/*") if path.is_file()]
    payload = bytearray(path.read_bytes())
    payload[100] ^= 1
    path.write_bytes(payload)
    with pytest.raises(StorageError):
        dpm.retrieval.payload(header.id)
    check_conditions(dpm)
    assert ("corrupt_payload", "dpm") in kinds(dpm)
    names, *rest = put_arguments(cloud(5000), "pointcloud", 1)
    dpm.writer.put(names, arguments[1], *rest[1:])
    check_conditions(dpm)
    assert kinds(dpm) == []
    assert dpm.retrieval.payload(header.id)[1]


def test_a_database_without_acknowledged_changes_raises_an_alarm(tmp_path: Path) -> None:
    directory = tmp_path / "damaged"
    with open_store(f"sqlite:///{directory}") as store:
        Dpm(store).writer.put(*put_arguments(cloud(), "pointcloud"))
    for path in directory.glob("store.sqlite*"):
        path.unlink()
    with open_store(f"sqlite:///{directory}", new=True) as store:
        dpm = Dpm(store)
        check_conditions(dpm)
        assert kinds(dpm) == [("database_damaged", "dpm")]


def test_conditions_are_checked_again_until_the_monitor_is_closed(
    dpm: Dpm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.dpm.operations.condition_monitor.PERIOD_S", 0.01)
    calls, has_repeated = itertools.count(1), threading.Event()
    monitor = ConditionMonitor(dpm, [lambda: next(calls) >= 3 and has_repeated.set()])
    assert has_repeated.wait(20.0)
    monitor.close()
    monitor._thread.join(20.0)
    assert not monitor._thread.is_alive()


def test_callers_with_unknown_keys_raise_an_alarm_until_it_is_quiet(
    dpm: Dpm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "keys"
    file.write_text(f"{hashlib.sha256(b'key').hexdigest()} reader anna")
    app = create_app(Context(dpm, Settings(tmp_path, keys_file=file)))
    with TestClient(app, base_url="http://127.0.0.1:8080") as client:
        assert client.get("/api/v1/status").status_code == 401
        assert kinds(dpm) == [], "a page without a key is no intruder"
        for _ in range(2):
            headers = {"Authorization": "Bearer guessed"}
            assert client.get("/api/v1/status", headers=headers).status_code == 401
    (alarm,) = dpm.alarm_board.active()
    assert (alarm["kind"], alarm["source"]) == ("refused_identity", "http")
    assert alarm["what"].startswith("2 refused")
    check_conditions(dpm)
    assert kinds(dpm) == [("refused_identity", "http")]
    monkeypatch.setattr("services.identity_alarm.QUIET_S", 0.0)
    check_conditions(dpm)
    assert kinds(dpm) == []


def test_each_entrance_has_an_alarm_of_its_own(dpm: Dpm) -> None:
    IdentityAlarm(dpm.alarms, "router").refuse("CN=mana put below minnie")
    IdentityAlarm(dpm.alarms, "http").refuse("an unknown key")
    assert kinds(dpm) == [("refused_identity", "router"), ("refused_identity", "http")]


def test_labels_of_metrics_are_escaped(dpm: Dpm, http: TestClient) -> None:
    dpm.alarm_board.report("ground", "supervisor", [CRASH.to_dict() | {"source": 'a"b\nc'}])
    assert 'source="a\\"b\\nc"' in http.get("/metrics").text


def test_loops_are_in_the_status(dpm: Dpm, http: TestClient, inserted_id: Callable[[str], str]) -> None:
    loop = dpm.loops.add("conditions")
    with pytest.raises(KeyError):
        loop.run(lambda: {}["nothing"], print)
    assert http.get("/api/v1/status").json()["loops"]["conditions"]["problem"] == "loop conditions has ended"
