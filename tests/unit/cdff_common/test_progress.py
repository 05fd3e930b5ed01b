# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Progress of long commands."""

from __future__ import annotations

import io
import threading

import pytest

from cdff_common import progress
from cdff_common.progress import Progress, counted, elapsed, progress_of


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time in seconds, as the only element."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_without_a_terminal_there_is_a_line_every_ten_seconds(clock: list[float]) -> None:
    out = io.StringIO()
    bar = Progress(100, "sweeps", out)
    for _ in range(50):
        clock[0] += 0.5
        bar.advance()
    bar.close()
    assert out.getvalue().splitlines() == [
        "20/100 sweeps, 2.0/s, 40 s left",
        "40/100 sweeps, 2.0/s, 30 s left",
    ]


def test_on_a_terminal_the_bar_is_removed_at_the_end(clock: list[float]) -> None:
    out = _Terminal()
    bar = Progress(4, "pairs", out)
    for _ in range(2):
        clock[0] += 1.0
        bar.advance()
    assert f"[{'#' * 15}{' ' * 15}] 2/4 pairs, 1.0/s, 2 s left" in out.getvalue()
    bar.close()
    assert out.getvalue().endswith("\r\x1b[K")


def test_without_a_total_only_count_and_rate_are_shown(clock: list[float]) -> None:
    out = io.StringIO()
    bar = Progress(0, "samples", out)
    clock[0] = 10.0
    bar.advance()
    assert out.getvalue() == "1 samples, 0.1/s\n"


def test_a_callback_of_numbers_shows_progress_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = io.StringIO()
    monkeypatch.setattr("sys.stderr", lines)
    monkeypatch.setattr("cdff_common.progress._LINES_S", 0.0)
    report = progress_of("scans")
    for completed in (1, 2):
        report(completed, 2)
    assert [line.split(",")[0] for line in lines.getvalue().splitlines()] == ["1/2 scans", "2/2 scans"]


def test_items_are_counted_while_they_are_used(clock: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    lines = io.StringIO()
    monkeypatch.setattr("sys.stderr", lines)
    for _ in counted(range(4), 4, "samples"):
        clock[0] += 6.0
    assert lines.getvalue().splitlines() == ["2/4 samples, 0.2/s, 12 s left", "4/4 samples, 0.2/s, 0 s left"]


@pytest.mark.parametrize(("out", "text"), [(io.StringIO(), "export: 0 s\n"), (_Terminal(), "\rexport: 0 s")])
def test_the_time_of_work_without_a_count_is_shown(
    out: io.StringIO, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = threading.Event()
    monkeypatch.setattr(out, "flush", shown.set, raising=False)
    for name in ("_SILENT_S", "_LINES_S"):
        monkeypatch.setattr(f"cdff_common.progress.{name}", 0.01)
    with elapsed("export", out):
        assert shown.wait(10.0)
    assert out.getvalue().startswith(text)
    assert out.getvalue().endswith("\n" if text.endswith("\n") else "\r\x1b[K")


def test_quick_work_shows_nothing() -> None:
    out = io.StringIO()
    with elapsed("export", out):
        pass
    assert out.getvalue() == ""
