# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Progress of long commands on standard error: a bar on a terminal, otherwise a line every 10 seconds."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import TextIO, TypeVar

from cdff_common.terminal import is_quiet

_Item = TypeVar("_Item")

_BAR_WIDTH = 30
#: Seconds between updates on a terminal, and between lines elsewhere.
_ON_TERMINAL_S, _LINES_S = 0.2, 10.0
#: Time after which a terminal shows the elapsed time of work without a count, seconds.
_SILENT_S = 2.0


class Progress:
    """Counter with rate and remaining time.

    Parameters
    ----------
    total : int
        Number of items; 0 if unknown.
    unit : str
        Name of the items, such as "sweeps".
    out : TextIO, optional
        By default standard error.
    """

    def __init__(self, total: int, unit: str, out: TextIO | None = None) -> None:
        self._total, self._unit = total, unit
        self._out = sys.stderr if out is None else out
        self._is_terminal, self._is_quiet = self._out.isatty(), is_quiet()
        self._start_s = self._shown_s = time.monotonic()
        self._count = 0

    def advance(self) -> None:
        """Count an item."""
        self._count += 1
        if self._is_quiet:
            return
        now_s = time.monotonic()
        if now_s - self._shown_s >= (_ON_TERMINAL_S if self._is_terminal else _LINES_S):
            self._shown_s = now_s
            self._out.write(
                f"\r{self._bar()}{self._line(now_s)}  " if self._is_terminal else f"{self._line(now_s)}\n"
            )
            self._out.flush()

    def advance_to(self, count: int) -> None:
        """Set the number of items that are done."""
        self._count = count - 1
        self.advance()

    def close(self) -> None:
        """Remove the bar."""
        if self._is_terminal and not self._is_quiet:
            self._out.write("\r\x1b[K")
            self._out.flush()

    def _bar(self) -> str:
        if not self._total:
            return ""
        filled_width = min(_BAR_WIDTH, _BAR_WIDTH * self._count // self._total)
        return f"[{'#' * filled_width}{' ' * (_BAR_WIDTH - filled_width)}] "

    def _line(self, now_s: float) -> str:
        rate = self._count / max(now_s - self._start_s, 1e-9)
        line = f"{self._count}{f'/{self._total}' if self._total else ''} {self._unit}, {rate:.1f}/s"
        if self._total:
            line += f", {max(0, self._total - self._count) / rate:.0f} s left"
        return line


def counted(items: Iterable[_Item], total: int, unit: str) -> Generator[_Item]:
    """Yield items and show their progress; ``total`` is 0 if it is unknown."""
    progress = Progress(total, unit)
    try:
        for item in items:
            yield item
            progress.advance()
    finally:
        progress.close()


@contextmanager
def elapsed(work: str, out: TextIO | None = None) -> Iterator[None]:
    """Show the elapsed time of work whose steps cannot be counted; nothing may be printed meanwhile.

    Parameters
    ----------
    work : str
        Name of the work, such as "verification".
    out : TextIO, optional
        By default standard error.
    """
    stream, ended = sys.stderr if out is None else out, threading.Event()
    if is_quiet():
        yield
        return
    is_terminal, start_s = stream.isatty(), time.monotonic()

    def show() -> None:
        """Write the elapsed time until the work has ended."""
        if ended.wait(_SILENT_S if is_terminal else _LINES_S):
            return
        while True:
            line = f"{work}: {time.monotonic() - start_s:.0f} s"
            stream.write(f"\r{line}" if is_terminal else f"{line}\n")
            stream.flush()
            if ended.wait(1.0 if is_terminal else _LINES_S):
                break
        if is_terminal:
            stream.write("\r\x1b[K")
            stream.flush()

    thread = threading.Thread(target=show, name="elapsed", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def progress_of(unit: str) -> Callable[[int, int], None]:
    """Return a callback of numbers of items, done and in total, that shows their progress."""
    progress: list[Progress] = []

    def report(done: int, total: int) -> None:
        if not progress:
            progress.append(Progress(total, unit))
        progress[0].advance_to(done)
        if done == total:
            progress.pop().close()

    return report
