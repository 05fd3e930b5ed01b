# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The backlog of DFPCs from their status, and a clock that is paused."""

import threading

from cdff_dev.play.backlog import Backlog
from cdff_dev.play.mission_clock import Pace

S = 1_000_000_000


def test_the_largest_backlog_determines_the_clock() -> None:
    backlog = Backlog()
    assert backlog.lag_s(10 * S) == 0.0
    backlog.on_status("a", {"state": "active", "oldest_ns": 9 * S})
    backlog.on_status("b", {"state": "active", "oldest_ns": 4 * S})
    assert backlog.lag_s(10 * S) == 6.0
    backlog.on_status("b", {"state": "active", "oldest_ns": None})
    assert backlog.lag_s(10 * S) == 1.0
    assert backlog.lag_s(8 * S) == 0.0


def test_an_inactive_dfpc_is_not_waited_for() -> None:
    backlog = Backlog()
    backlog.on_status("a", {"state": "active", "oldest_ns": 1 * S})
    backlog.on_status("a", {"state": "error", "oldest_ns": 1 * S})
    assert backlog.lag_s(10 * S) == 0.0


def test_a_held_clock_continues_from_its_last_time() -> None:
    pace, stop = Pace(5 * S, speed=100.0), threading.Event()
    assert pace.now_ns() == 5 * S
    pace.start()
    assert pace.wait_until(6 * S, stop)
    pace.hold()
    stopped_ns = pace.now_ns()
    assert not stop.wait(0.02)
    assert (pace.now_ns(), pace.rate) == (stopped_ns, 0.0)
    assert pace.held_s > 0.0
    pace.resume()
    assert pace.wait_until(stopped_ns + S, stop)
    assert pace.late_s(stopped_ns) > 0.0
    stop.set()
    assert not pace.wait_until(stopped_ns + 100 * S, stop)
