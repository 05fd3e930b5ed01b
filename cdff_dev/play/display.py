# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State and progress of a player on standard error."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from cdff_common.clock import NS_PER_S
from cdff_common.terminal import is_quiet

if TYPE_CHECKING:
    from cdff_dev.play.player import Player

#: Seconds between updates on a terminal, and between lines elsewhere.
_ON_TERMINAL_S, _LINES_S = 0.5, 10.0
_CLEARED = "\r\x1b[K"


def print_state(player: Player) -> None:
    """Print the state as a line."""
    sys.stderr.write(f"{_CLEARED if sys.stderr.isatty() else ''}{_state(player)}\n")
    sys.stderr.flush()


@contextmanager
def shown_progress(player: Player) -> Iterator[None]:
    """Show position, end and number of samples: on a terminal always, elsewhere in a line every 10 s."""
    if is_quiet():
        yield
        return
    ended = threading.Event()
    thread = threading.Thread(target=_show, args=(player, ended), name="progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _show(player: Player, ended: threading.Event) -> None:
    """Write the progress of a player until it has ended."""
    is_terminal = sys.stderr.isatty()
    with suppress(OSError):  # the terminal was closed
        while not ended.wait(_ON_TERMINAL_S if is_terminal else _LINES_S):
            sys.stderr.write(
                f"{_CLEARED}{progress_text(player)}" if is_terminal else f"{progress_text(player)}\n"
            )
            sys.stderr.flush()
        if is_terminal:
            sys.stderr.write(_CLEARED)
            sys.stderr.flush()


def progress_text(player: Player) -> str:
    """Return state, position, end and number of samples."""
    status = player.status()
    end = "" if status["loop"] else f" of {(status['t_end_ns'] - status['start_ns']) / NS_PER_S:.3f} s"
    state, _, options = _state(player).partition(",")
    dropped = f", {status['dropped']} dropped as too late" if status["dropped"] else ""
    return f"{state}{end},{options}, {status['published']} samples{dropped}"


def _state(player: Player) -> str:
    status = player.status()
    state = "ended" if status["ended"] else "paused" if status["paused"] else "playing"
    position_s = (status["now_ns"] - status["start_ns"]) / NS_PER_S
    loop = ", loop" if status["loop"] else ""
    return f"{state} at {position_s:.3f} s, speed {status['speed']:g}{loop}"
