# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Remote control of a running player by calls on the bus, and keyboard control on a terminal."""

from __future__ import annotations

import math
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.clock import NS_PER_S, parse_stamp
from cdff_common.errors import InputError

if TYPE_CHECKING:
    from cdff_dev.play.player import Player

#: Parameter of each verb that has one.
PARAMETERS = {"speed": "x", "seek": "to", "loop": "on"}
VERBS = ("status", "pause", "resume", "step", "speed", "seek", "loop", "stop")
HELP = "space: pause or resume, s: step, + and -: speed, < and >: seek by 10 s, l: loop, q: end"
_MIN_SPEED, _MAX_SPEED = 0.001, 1000.0
_MAX_SEEK_S = 1e9
_SEEK_KEYS = {"<": "-10", ">": "+10"}


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
def keyboard(player: Player, stop: threading.Event) -> Iterator[None]:
    """Control the player by keys if standard input is a terminal."""
    if not sys.stdin.isatty():
        yield
        return
    sys.stderr.write(f"{HELP}\n")
    settings = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    thread = threading.Thread(target=_read_keys, args=(player, stop), name="keys", daemon=True)
    thread.start()
    try:
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)


def _read_keys(player: Player, stop: threading.Event) -> None:
    while not stop.is_set():
        if select.select([sys.stdin], [], [], 0.2)[0]:
            try:
                on_key(player, stop, sys.stdin.read(1))
            except InputError as error:
                sys.stderr.write(f"{error}\n")


def on_key(player: Player, stop: threading.Event, key: str) -> None:
    """Execute the action of a key, if it has one."""
    status = player.status()
    speed = float(status["speed"])
    if key == " ":
        control(player, stop, "resume" if status["paused"] else "pause")
    elif key == "s":
        control(player, stop, "step")
    elif key == "q":
        control(player, stop, "stop")
    elif key == "l":
        control(player, stop, "loop", "false" if status["loop"] else "true")
    elif key in _SEEK_KEYS:
        control(player, stop, "seek", _SEEK_KEYS[key])
    elif key in "+-":
        changed = min(max(speed * (2.0 if key == "+" else 0.5), _MIN_SPEED), _MAX_SPEED)
        control(player, stop, "speed", str(changed))
