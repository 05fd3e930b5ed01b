# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keys of a terminal, from the characters that it sends to the changes of a player."""

from __future__ import annotations

import os
import pty
import sys
import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

from cdff_dev.play.control import keyboard, keys_of, on_key
from cdff_dev.play.display import progress_text


class _Player:
    """A player without a bus, which notes its calls."""

    start_ns, progress = 0, SimpleNamespace(t_end_ns=100_000_000_000)

    def __init__(self) -> None:
        self.calls: list[Any] = []
        self.is_paused, self.speed = False, 1.0

    def status(self) -> dict[str, Any]:
        state = {"paused": self.is_paused, "speed": self.speed, "loop": False, "ended": False}
        counts = {"published": 7, "dropped": 0, "t_end_ns": self.progress.t_end_ns}
        return state | counts | {"now_ns": self.now_ns(), "start_ns": 0}

    def now_ns(self) -> int:
        return 50_000_000_000

    def pause(self) -> None:
        self.is_paused = True

    def resume(self) -> None:
        self.is_paused = False

    def step(self) -> None:
        self.calls.append("step")

    def set_speed(self, speed: float) -> None:
        self.speed = speed

    def seek(self, stamp_ns: int) -> None:
        self.calls.append(stamp_ns)

    def set_loop(self, is_repeated: bool) -> None:
        self.calls.append(is_repeated)


def test_arrows_are_one_key_and_unknown_sequences_none() -> None:
    assert keys_of("s\x1b[C\x1b[A\x1b[B\x1bOC+") == ["s", "s", "+", "-", "s", "+"]
    assert keys_of("") == []
    player, stop = _Player(), threading.Event()
    for key in keys_of("\x1b[D\x1b[5~\x1b[1;5C?\n\x1b"):
        assert not on_key(player, stop, key)  # type: ignore[arg-type]
    assert player.calls == []


def test_each_key_has_its_effect() -> None:
    player, stop = _Player(), threading.Event()
    for key in ("s", "<", ">", "l", "-", "-", "+", " "):
        assert on_key(player, stop, key)  # type: ignore[arg-type]
    assert player.calls == ["step", 40_000_000_000, 60_000_000_000, True]
    assert (player.speed, player.is_paused) == (0.5, True)
    on_key(player, stop, "p")  # type: ignore[arg-type]
    assert not player.is_paused
    on_key(player, stop, " ", is_stepping=True)  # type: ignore[arg-type]
    assert player.calls[-1] == "step"
    assert not stop.is_set()
    on_key(player, stop, "q")  # type: ignore[arg-type]
    assert stop.is_set()


def test_progress_states_position_end_and_samples() -> None:
    text = progress_text(_Player())  # type: ignore[arg-type]
    assert text == "playing at 50.000 s of 100.000 s, speed 1, 7 samples"


def test_the_end_of_a_terminal_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    end, other = pty.openpty()
    with os.fdopen(other, "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(os, "tcgetpgrp", lambda _: os.getpgrp())
        player, stop = _Player(), threading.Event()
        with keyboard(player, stop):  # type: ignore[arg-type]
            thread = next(t for t in threading.enumerate() if t.name == "keys")
            os.write(end, b"ss")
            deadline_s = time.monotonic() + 30.0
            while player.calls != ["step", "step"] and time.monotonic() < deadline_s:
                time.sleep(0.01)
            os.close(end)
            thread.join(30.0)
            assert not thread.is_alive()
        assert player.calls == ["step", "step"]
        assert player.speed == 1.0
        assert not stop.is_set()


def test_a_process_in_the_background_leaves_its_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    end, other = pty.openpty()
    with os.fdopen(other, "r") as stdin, os.fdopen(end, "wb"):
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(os, "tcgetpgrp", lambda _: os.getpgrp() + 1)
        with keyboard(_Player(), threading.Event()):  # type: ignore[arg-type]
            assert not any(thread.name == "keys" for thread in threading.enumerate())
