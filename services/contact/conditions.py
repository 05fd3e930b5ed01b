# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of the exchange: a full disk, a clock that differs, a window without contact, a refused product."""

from __future__ import annotations

from cdff_common.clock import Clock, format_stamp
from cdff_common.interfaces.contact_plan import ContactPlan
from services.alarms import Alarms, Severity

#: Difference of the clocks, in addition to the one-way delay, from which on an alarm is raised, seconds.
CLOCK_LIMIT_S = 10.0


class ExchangeAlarms:
    """Sets and clears the alarms of one end of the exchange.

    Parameters
    ----------
    alarms : Alarms
    plan : ContactPlan
    clock : Clock
        Mission clock; a window that started before now does not count as missed.
    """

    def __init__(self, alarms: Alarms, plan: ContactPlan, clock: Clock) -> None:
        self._alarms, self._plan, self._clock = alarms, plan, clock
        self._start_ns = clock.now_ns()

    def storage_failed(self, source: str, error: Exception) -> None:
        """Set the alarm of a failed write: of received data, or of the state of the exchange."""
        self._alarms.set(
            "contact_storage",
            source,
            Severity.CRITICAL,
            str(error),
            "free disk space; the exchange then continues",
        )

    def storage_works(self, source: str) -> None:
        """Clear the alarm of a failed write."""
        self._alarms.clear("contact_storage", source)

    def compare_clock(self, robot: str, robot_ns: int, delay_s: float) -> None:
        """Set the alarm of a clock that differs, from the mission time in a packet of a robot, or clear it."""
        difference_s = (robot_ns - self._clock.now_ns()) / 1e9 + delay_s
        if abs(difference_s) <= CLOCK_LIMIT_S:
            self._alarms.clear("contact_clock", robot)
            return
        what = (
            f"the clock of {robot} differs by {difference_s:+.0f} s from that of the ground: "
            "it uses other times than the contact plan"
        )
        self._alarms.set("contact_clock", robot, Severity.WARNING, what, "synchronise the clock of the robot")

    def check_windows(self, robot: str, heard_ns: int | None) -> None:
        """Set the alarm of a missed window if the robot sent no packet in its last window, or clear it."""
        now_ns = self._clock.now_ns()
        ended = [
            window
            for window in self._plan.of(robot)
            if self._start_ns <= window.start_ns and window.end_ns <= now_ns
        ]
        if not ended or (heard_ns is not None and heard_ns >= ended[-1].start_ns):
            self._alarms.clear("contact_missed", robot)
            return
        last = ended[-1]
        what = (
            f"no packet of {robot} in the window {format_stamp(last.start_ns)} to {format_stamp(last.end_ns)}"
        )
        remedy = "check the link, the process on the robot and its clock"
        self._alarms.set("contact_missed", robot, Severity.WARNING, what, remedy)

    def product_refused(self, robot: str, error: Exception) -> None:
        """Set the alarm of a product that the store refuses permanently."""
        self._alarms.set(
            "contact_refused",
            robot,
            Severity.WARNING,
            str(error),
            "get the product from the store of the robot",
        )
