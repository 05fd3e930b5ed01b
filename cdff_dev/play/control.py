# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Control of a running player: by calls on the bus, and by keys on a terminal."""

from __future__ import annotations

import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.errors import InputError

if TYPE_CHECKING:
    from cdff_dev.play.player import Player

VERBS = ("status", "pause", "resume", "step", "speed", "stop")
HELP = "space: pause or resume, s: step, + and -: speed, q: end"
_MIN_SPEED, _MAX_SPEED = 0.001, 1000.0


def serve_control(bus: Bus, player: Player, stop: threading.Event) -> None:
    """Answer calls of ``player/@rpc/{verb}`` with the status of the player after the change."""

    def answer(request: Request) -> Reply:
        verb = request.key.rsplit("/", 1)[-1]
        if verb != "speed":
            request.check_no_parameters()
        control(player, stop, verb, request.parameters.get("x", ""))
        return Reply.of(player.status())

    for verb in VERBS:
        bus.serve(keys.player_rpc(keys.GROUND, verb), answer, workers=1)


def control(player: Player, stop: threading.Event, verb: str, x: str = "") -> None:
    """Execute a verb; raises InputError for an unknown one, or a speed out of range."""
    if verb == "pause":
        player.pause()
    elif verb == "resume":
        player.resume()
    elif verb == "step":
        player.step()
    elif verb == "stop":
        stop.set()
    elif verb == "speed":
        player.set_speed(_speed(x))
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
            on_key(player, stop, sys.stdin.read(1))


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
    elif key in "+-":
        changed = min(max(speed * (2.0 if key == "+" else 0.5), _MIN_SPEED), _MAX_SPEED)
        control(player, stop, "speed", str(changed))
