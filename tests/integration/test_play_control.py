# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A player is paused, stepped, resumed and ended by calls and by keys."""

from __future__ import annotations

import json
import subprocess
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.errors import InputError
from cdff_common.interfaces.product import Header
from cdff_common.types import IMUSensors, Time
from cdff_dev.logs import open_log
from cdff_dev.logs.formats.infuse.writer import LogWriter
from cdff_dev.play.control import on_key, serve_control
from cdff_dev.play.http_control import served
from cdff_dev.play.looped_log import LoopedLog
from cdff_dev.play.player import Player
from tests.integration.conftest import Eventually

pytestmark = pytest.mark.integration

S = 1_000_000_000
COUNT = 200


@contextmanager
def playing(bus: Bus, log: Path, *, stay: bool = False) -> Iterator[tuple[Player, threading.Event]]:
    """A paused player in a thread."""
    stop = threading.Event()
    opened = LoopedLog(open_log(log), is_repeated=False)
    player = Player(bus, opened, speed=1.0, is_paused=True)
    serve_control(bus, player, stop)
    thread = threading.Thread(target=player.run, args=(stop,), kwargs={"stay": stay})
    thread.start()
    try:
        yield player, stop
    finally:
        stop.set()
        thread.join(10)
        opened.close()
        assert not thread.is_alive()


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "a.msg"
    with LogWriter(path) as writer:
        for n in range(COUNT):
            t_ns = 100 * S + n * S // 10
            sample = IMUSensors(Time.from_ns(t_ns), np.ones(3), np.zeros(3), np.zeros(3))
            writer.write("/mana/imu.sample", sample, t_ns)
    return path


def test_calls_step_change_the_speed_resume_and_end(
    router: subprocess.Popen[bytes], endpoint: str, log: Path, eventually: Eventually
) -> None:
    with (
        Bus.open(endpoint, name="player", wait_s=10) as bus,
        Bus.open(endpoint, name="operator", wait_s=10) as operator,
        playing(bus, log) as (player, stop),
    ):

        def call(verb: str, **parameters: object) -> dict[str, object]:
            body = operator.call(keys.player_rpc("ground", verb), parameters, timeout_s=5).body()
            assert isinstance(body, dict)
            return body

        eventually(lambda: player.progress.published == 1)  # the first sample is at the start
        for n in range(2, 5):
            assert call("step")["paused"] is True
            eventually(lambda n=n: player.progress.published == n)
        assert call("status")["now_ns"] == 100 * S + 3 * S // 10
        assert call("speed", x=50)["speed"] == 50.0
        with pytest.raises(InputError, match="expected a speed"):
            call("speed", x="fast")
        assert call("resume")["paused"] is False
        eventually(lambda: player.progress.ended)
        assert player.progress.published == COUNT
        call("stop")
        assert stop.is_set()


def test_keys_pause_step_and_change_the_speed(
    router: subprocess.Popen[bytes], endpoint: str, log: Path, eventually: Eventually
) -> None:
    with Bus.open(endpoint, name="player", wait_s=10) as bus, playing(bus, log) as (player, stop):
        eventually(lambda: player.progress.published == 1)
        on_key(player, stop, "s")
        eventually(lambda: player.progress.published == 2)
        on_key(player, stop, "+")
        assert player.status()["speed"] == 2.0
        on_key(player, stop, " ")
        eventually(lambda: player.progress.published > 2)
        on_key(player, stop, " ")
        assert player.status()["paused"] is True
        on_key(player, stop, "q")
        assert stop.is_set()


def test_seeking_forwards_and_backwards_publishes_the_same_samples_again(
    router: subprocess.Popen[bytes], endpoint: str, log: Path, eventually: Eventually
) -> None:
    with (
        Bus.open(endpoint, name="player", wait_s=10) as bus,
        Bus.open(endpoint, name="operator", wait_s=10) as operator,
        playing(bus, log, stay=True) as (player, _),
    ):
        received: list[Message] = []
        operator.subscribe("cdff/@v1/*/sensor/**", received.append, depth=COUNT)

        def call(verb: str, **parameters: object) -> dict[str, object]:
            body = operator.call(keys.player_rpc("ground", verb), parameters, timeout_s=40).body()
            assert isinstance(body, dict)
            return body

        eventually(lambda: player.progress.published == 1)
        for to, position_s in ((12.05, 12.05), ("+3", 15.05), (2.05, 2.05), ("-10", 0.0), (12.05, 12.05)):
            status = call("seek", to=to)
            assert (status["now_ns"], status["paused"]) == (100 * S + round(position_s * S), True)
        received.clear()
        call("step")
        eventually(lambda: len(received) == 1)
        call("seek", to="1970-01-01T00:01:52.05Z")
        call("step")
        eventually(lambda: len(received) == 2)
        assert received[0].payload == received[1].payload
        assert received[0].attachment == received[1].attachment
        assert Header.from_attachment(received[0].attachment).t1_ns == 112 * S + S // 10
        for to in (50, "nan", "soon", ""):
            with pytest.raises(InputError):
                call("seek", to=to)
        call("seek", to=19.5)
        call("resume")
        eventually(lambda: player.progress.ended)
        call("pause")
        assert call("seek", to=0)["ended"] is False
        eventually(lambda: received[-1].payload and Header.from_attachment(received[-1].attachment).seq == 0)


def test_repetition_is_switched_on_and_off_while_the_log_is_played(
    router: subprocess.Popen[bytes], endpoint: str, log: Path, eventually: Eventually
) -> None:
    with Bus.open(endpoint, name="player", wait_s=10) as bus, playing(bus, log, stay=True) as (player, stop):
        player.set_speed(50.0)
        player.resume()
        eventually(lambda: player.progress.ended)
        assert player.progress.published == COUNT
        on_key(player, stop, "l")
        assert player.status()["loop"] is True
        eventually(lambda: player.progress.published > COUNT)
        on_key(player, stop, "l")
        eventually(lambda: player.progress.ended)
        assert player.progress.published % COUNT == 0
        assert player.progress.dropped == 0


def test_programs_on_this_machine_control_the_player_by_http(
    router: subprocess.Popen[bytes], endpoint: str, log: Path, eventually: Eventually
) -> None:
    with (
        Bus.open(endpoint, name="player", wait_s=10) as bus,
        playing(bus, log) as (player, stop),
        served(player, stop, 0) as url,
    ):

        def call(path: str, method: str = "POST", **headers: str) -> dict[str, object]:
            request = urllib.request.Request(f"{url}/{path}", method=method, headers=headers)
            with urllib.request.urlopen(request, timeout=40) as answer:
                body: dict[str, object] = json.load(answer)
                return body

        with urllib.request.urlopen(url, timeout=10) as page:
            assert b"<title>CDFF player</title>" in page.read()
        eventually(lambda: player.progress.published == 1)
        assert call("status", "GET")["paused"] is True
        assert call("seek?to=5")["now_ns"] == 105 * S
        assert call("speed?x=2")["speed"] == 2.0
        assert call("loop?on=true")["loop"] is True
        for path, headers, code in (
            ("seek?to=soon", {}, 422),
            ("pause?x=1", {}, 422),
            ("jump", {}, 422),
            ("pause", {"Origin": "http://elsewhere.example"}, 403),
            ("pause", {"Host": "elsewhere.example"}, 421),
        ):
            with pytest.raises(urllib.error.HTTPError) as refused:
                call(path, **headers)
            refused.value.close()
            assert refused.value.code == code
        call("stop")
        assert stop.is_set()
