# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to a ground segment as a process, with a real mission control system: Yamcs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import keys
from cdff_common.clock import wall_ns
from cdff_common.errors import CdffError
from cdff_common.types import Pointcloud
from services.alarms import Alarm, Severity
from services.gateway_ccsds.authentication import Command, CommandKey, Function
from tests.support.dpm_products import elevation
from tests.support.yamcs import Yamcs, missing

from .conftest import Eventually, Spawn
from .test_dpm import System

pytestmark = [pytest.mark.integration, pytest.mark.slow]

_ROOT = Path(__file__).resolve().parents[2]
_PAGE = (_ROOT / "docs" / "how-to" / "ground-segment.md").read_text(encoding="utf-8")
_SETTINGS = _PAGE.partition("```yaml\n")[2].partition("```")[0]
S = 1_000_000_000


@pytest.fixture
def yamcs(tmp_path: Path) -> Iterator[Yamcs]:
    """A running Yamcs."""
    if missing():
        pytest.skip(missing())
    server = Yamcs(tmp_path)
    yield server
    server.close()


def cloud(seq: int) -> Pointcloud:
    return Pointcloud.from_points(np.eye(3) * seq, frame="site", stamp_ns=seq * S)


def sealed(key: CommandKey, function: Function, **arguments: object) -> bytes:
    return key.seal("mana", Command(function, wall_ns() // 1000, arguments))


class Station:
    """A DPM with a gateway whose ground segment is a Yamcs."""

    def __init__(
        self, yamcs: Yamcs, spawn: Spawn, eventually: Eventually, endpoint: str, tmp_path: Path
    ) -> None:
        def patiently(condition: Callable[[], object], timeout_s: float, what: str) -> None:
            eventually(condition, 5 * timeout_s, what)  # Yamcs starts at the same time

        self.system = System(spawn, patiently, endpoint, tmp_path)
        settings = _SETTINGS.replace("  - {type: dem, format: tif}", "  - {type: dem, format: msgpack}")
        ports = {"tm": 10015, "tc": 10025, "cfdp_down": 10016, "cfdp_up": 10026}
        for name, port in ports.items():
            settings = settings.replace(f":{port}", f":{getattr(yamcs, name)}")
        path = tmp_path / "ground.yaml"
        path.write_text(settings.replace("contact_plan: plan.yaml\n", ""))
        CommandKey.write(tmp_path / "command.key")
        self.key = CommandKey.read(tmp_path / "command.key")
        self._start = lambda: spawn("services.gateway_ccsds", "--settings", str(path))
        self.gateway = self._start()
        eventually(lambda: self.state().get("position") is not None, 120, "the gateway reads the events")

    def restart(self) -> None:
        """Kill the gateway, and start it again."""
        self.gateway.kill()
        self.gateway.wait()
        self.gateway = self._start()

    def state(self) -> dict[str, Any]:
        """Return the status of the gateway; empty without one."""
        with suppress(CdffError):
            return dict(self.system.bus.call(keys.gateway_status("mana", "gateway_ccsds")).body())
        return {}


@pytest.fixture
def station(
    yamcs: Yamcs, spawn: Spawn, eventually: Eventually, endpoint: str, tmp_path: Path
) -> Iterator[Station]:
    """A running system."""
    station = Station(yamcs, spawn, eventually, endpoint, tmp_path)
    yield station
    station.system.bus.close()


def test_yamcs_receives_a_map_in_spite_of_a_kill_and_shows_status_and_alarms(
    yamcs: Yamcs, station: Station, eventually: Eventually
) -> None:
    system = station.system
    # A map of three files, with a kill of the gateway in the second one.
    large = system.put(elevation(0.0, t1_ns=S, cells=330), "dem", 1)
    eventually(lambda: any(name.endswith(".001") for name in yamcs.objects()), 120, "the first file")
    station.restart()
    sidecar_name = f"mana-dem-1-{large}.sidecar.json"
    eventually(lambda: yamcs.object(sidecar_name), 120, "the sidecar")
    sidecar = json.loads(yamcs.object(sidecar_name) or b"")
    parts = [yamcs.object(file["name"]) or b"" for file in sidecar["files"]]
    assert len(parts) >= 3
    assert max(map(len, parts)) <= 1_000_000
    payload = b"".join(parts)
    assert hashlib.sha256(payload).hexdigest() == sidecar["sha256"]
    assert payload == system.call("get", id=large, format="msgpack").payload
    assert (sidecar["id"], sidecar["robot"], sidecar["product"]) == (large, "mana", "dem")
    assert sidecar["product_sha256"] == system.call("get", id=large).attachment["sha256"]

    # Status and alarms.
    alarm = Alarm("disk_full", "mana/dpm", Severity.CRITICAL, wall_ns(), "1 MB is free", "remove files")
    system.bus.publish_map(keys.event("mana", "alarm"), alarm.to_event(is_active=True))
    expected = ("CRITICAL", "disk_full of mana/dpm: 1 MB is free")
    eventually(lambda: expected in yamcs.events(), 120, "the event of the alarm")
    # Files that were delivered since the kill.
    eventually(lambda: int(yamcs.parameter("delivered_files") or 0) >= 1, 120, "housekeeping")
    assert int(yamcs.parameter("services")) >= 2
    assert int(yamcs.parameter("waiting_products")) == 0


def test_commands_of_yamcs_are_executed_once_and_forged_ones_refused(
    yamcs: Yamcs, station: Station, eventually: Eventually
) -> None:
    system, key = station.system, station.key
    small = system.put(cloud(2), "pointcloud", 2)
    body = sealed(key, Function.SEND, id=small)
    command = yamcs.perform(body)
    eventually(
        lambda: yamcs.verifications(command).get("Verifier_Complete_Status") == "OK", 120, "completion"
    )
    assert yamcs.verifications(command)["Verifier_Accepted_Status"] == "OK"
    eventually(
        lambda: any(small in name and name.endswith(".sidecar.json") for name in yamcs.objects()), 120, "file"
    )
    for refused in (body, body[:-1] + bytes([body[-1] ^ 1])):
        again = yamcs.perform(refused)
        eventually(
            lambda c=again: yamcs.verifications(c).get("Verifier_Accepted_Status") == "NOK", 120, "refusal"
        )
    unknown = yamcs.perform(sealed(key, Function.SEND, id="7b0b7d3c-0000-5000-8000-000000000000"))
    wrong = yamcs.perform(sealed(key, Function.REQUEST, type="dem", deadline_ms="abc"))
    for failed in (unknown, wrong):
        eventually(
            lambda c=failed: yamcs.verifications(c).get("Verifier_Complete_Status") == "NOK", 120, "failure"
        )
    text = "InputError: deadline_ms='abc': expected a number"
    eventually(lambda: ("WARNING", f"command_failed of request: {text}") in yamcs.events(), 120, "the reason")

    # A command file by CFDP.
    asked = system.put(cloud(3), "pointcloud", 3)
    yamcs.upload("send.command", sealed(key, Function.SEND, id=asked))
    eventually(
        lambda: any(asked in name and name.endswith(".sidecar.json") for name in yamcs.objects()), 120, "file"
    )
    expected = {"accepted": 4, "refused": 2, "executed": 2, "failed": 2}
    # The status is published periodically; the last commands are counted in the next one.
    eventually(lambda: station.state()["commands"] == expected, 60, "the counts of the status")
