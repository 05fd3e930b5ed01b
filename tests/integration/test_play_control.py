# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A player is paused, stepped, resumed and ended by calls and by keys."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.errors import InputError
from cdff_common.types import IMUSensors, Time
from cdff_dev.logs import open_log
from cdff_dev.logs.formats.infuse.writer import LogWriter
from cdff_dev.play.control import on_key, serve_control
from cdff_dev.play.player import Player
from tests.integration.conftest import Eventually

pytestmark = pytest.mark.integration

S = 1_000_000_000
COUNT = 200


@contextmanager
def playing(bus: Bus, log: Path) -> Iterator[tuple[Player, threading.Event]]:
    """A paused player in a thread."""
    stop = threading.Event()
    opened = open_log(log)
    player = Player(bus, opened, speed=1.0, is_paused=True)
    serve_control(bus, player, stop)
    thread = threading.Thread(target=player.run, args=(stop,), kwargs={"stay": False})
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
