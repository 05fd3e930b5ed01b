# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Remote control of a running player by calls on the bus, and keyboard control on a terminal."""

from __future__ import annotations

import math
import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.clock import NS_PER_S, parse_stamp
from cdff_common.errors import InputError
from cdff_dev.play.display import print_state

if TYPE_CHECKING:
    from cdff_dev.play.player import Player

#: Parameter of each verb that has one.
PARAMETERS = {"speed": "x", "seek": "to", "loop": "on"}
VERBS = ("status", "pause", "resume", "step", "speed", "seek", "loop", "stop")
HELP = "space or p: pause or resume, s or →: step, + and - or ↑ and ↓: speed, < and >: seek by 10 s, l: loop, q: end"
#: Limits of the speed, and of a position relative to the start of the log.
_MIN_SPEED, _MAX_SPEED = 0.001, 1000.0
_MAX_SEEK_S = 1e9
_SEEK_KEYS = {"<": "-10", ">": "+10"}
_SPEED_KEYS = {"+": 2.0, "-": 0.5}
#: Keys with the effect of the arrows: right, up, down (as those of ``ros2 bag play``).
_ARROWS = {"\x1b[C": "s", "\x1b[A": "+", "\x1b[B": "-", "\x1bOC": "s", "\x1bOA": "+", "\x1bOB": "-"}
_KEY = re.compile(r"\x1b[\[O][0-9;]*[A-Za-z~]|.", re.DOTALL)


def serve_control(bus: Bus, player: Player, stop: threading.Event) -> None:
    """Answer calls of ``player/@rpc/{verb}`` with the status of the player after the change."""

    def answer(request: Request) -> Reply:
        verb = request.key.rsplit("/", 1)[-1]
        if verb not in PARAMETERS:
            request.check_no_parameters()
        control(player, stop, verb, request.parameters.get(PARAMETERS.get(verb, ""), ""))
        return Reply.of(player.status())

    for verb in VERBS:
        bus.serve(keys.player_rpc(keys.GROUND, verb), answer, workers=1)


def control(player: Player, stop: threading.Event, verb: str, value: str = "") -> None:
    """Execute a verb with the value of its parameter; raises InputError if either is wrong."""
    if verb == "pause":
        player.pause()
    elif verb == "resume":
        player.resume()
    elif verb == "step":
        player.step()
    elif verb == "stop":
        stop.set()
    elif verb == "speed":
        player.set_speed(_speed(value))
    elif verb == "seek":
        player.seek(_position_ns(player, value))
    elif verb == "loop":
        player.set_loop(_is_on(value))
    elif verb != "status":
        raise InputError(f"{verb!r}: expected one of {', '.join(VERBS)}")


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not _MIN_SPEED <= speed <= _MAX_SPEED:
        raise InputError(f"x={text!r}: expected a speed from {_MIN_SPEED:g} to {_MAX_SPEED:g}")
    return speed


def _position_ns(player: Player, text: str) -> int:
    """Return the mission time of a position: a time, seconds after the first sample, or a signed change."""
    if "T" in text:
        return parse_stamp(text, "to")
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not abs(seconds) < _MAX_SEEK_S:
        raise InputError(
            f"to={text!r}: expected seconds after the first sample, a change such as +10 or -10, or a time "
            "such as 2026-01-01T00:00:00Z"
        )
    if text.lstrip()[0] in "+-":
        moved_ns = player.now_ns() + round(seconds * NS_PER_S)
        return min(max(moved_ns, player.start_ns), player.progress.t_end_ns)
    return player.start_ns + round(seconds * NS_PER_S)


def _is_on(text: str) -> bool:
    if text not in ("true", "false"):
        raise InputError(f"on={text!r}: expected true or false")
    return text == "true"


@contextmanager
def keyboard(player: Player, stop: threading.Event, *, is_stepping: bool = False) -> Iterator[None]:
    """Control the player by keys if standard input is a terminal and this process is in its foreground.

    The state after each key is printed. If ``is_stepping``, the space bar publishes the next sample.
    """
    if not _has_keyboard():
        yield
        return
    sys.stderr.write(f"{HELP}\n")
    settings = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    args = (player, stop, is_stepping)
    thread = threading.Thread(target=_read_keys, args=args, name="keys", daemon=True)
    thread.start()
    try:
        yield
    finally:
        with suppress(termios.error):  # the terminal was closed
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)


def _has_keyboard() -> bool:
    """Return whether keys can be read; a background process that changes its terminal is stopped by it."""
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (OSError, ValueError):  # no terminal of this session, or a closed standard input
        return False


def _read_keys(player: Player, stop: threading.Event, is_stepping: bool) -> None:
    """Execute the keys until ``stop`` is set or the terminal is closed."""
    descriptor = sys.stdin.fileno()
    while not stop.is_set():
        if not select.select([descriptor], [], [], 0.2)[0]:
            continue
        try:
            text = os.read(descriptor, 1024).decode("utf-8", "replace")
        except OSError:
            return
        if not text:
            return
        for key in keys_of(text):
            try:
                if on_key(player, stop, key, is_stepping=is_stepping):
                    print_state(player)
            except InputError as error:
                sys.stderr.write(f"{error}\n")


def keys_of(text: str) -> list[str]:
    """Return the keys of the characters that a terminal sends; an arrow is one key of three characters."""
    return [_ARROWS.get(key, key) for key in _KEY.findall(text)]


def on_key(player: Player, stop: threading.Event, key: str, *, is_stepping: bool = False) -> bool:
    """Execute the action of a key; return False if it has none."""
    status = player.status()
    if key == "s" or (key == " " and is_stepping):
        control(player, stop, "step")
    elif key in (" ", "p"):
        control(player, stop, "resume" if status["paused"] else "pause")
    elif key == "q":
        control(player, stop, "stop")
    elif key == "l":
        control(player, stop, "loop", "false" if status["loop"] else "true")
    elif key in _SEEK_KEYS:
        control(player, stop, "seek", _SEEK_KEYS[key])
    elif key in _SPEED_KEYS:
        changed = min(max(float(status["speed"]) * _SPEED_KEYS[key], _MIN_SPEED), _MAX_SPEED)
        control(player, stop, "speed", str(changed))
    else:
        return False
    return True
