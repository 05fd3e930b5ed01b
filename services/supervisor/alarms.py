# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of the supervisor: the only place that raises, clears and logs them."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass, field
from typing import Literal

from cdff_common.clock import wall_ns

logger = logging.getLogger(__name__)

Kind = Literal["hung_process", "crash_loop"]

#: Remedy for each kind of alarm.
REMEDIES: dict[Kind, str] = {
    "hung_process": "read the log of the process; it was killed and is started again",
    "crash_loop": "read the log of the process and correct the cause; it is started again at long intervals",
}


@dataclass(frozen=True, slots=True)
class ProcessAlarm:
    """An alarm about a process: its kind, source, first time (wall clock), detail and remedy."""

    kind: Kind
    source: str
    since_ns: int
    detail: str
    remedy: str


@dataclass(slots=True)
class ProcessAlarms:
    """Raised alarms by kind and process.

    Attributes
    ----------
    counts : dict of (kind, process) to int
        How often each alarm was raised.
    """

    counts: dict[tuple[Kind, str], int] = field(default_factory=dict)
    _raised: dict[tuple[Kind, str], ProcessAlarm] = field(default_factory=dict)

    def raised(self) -> list[ProcessAlarm]:
        """Return the alarms that are raised now, oldest first."""
        return sorted(self._raised.values(), key=lambda alarm: alarm.since_ns)

    def raise_alarm(self, kind: Kind, source: str, detail: str) -> None:
        """Raise an alarm; one that is raised already keeps its time and gets the new detail."""
        key = (kind, source)
        previous = self._raised.get(key)
        since_ns = wall_ns() if previous is None else previous.since_ns
        alarm = ProcessAlarm(kind, source, since_ns, detail, REMEDIES[kind])
        self._raised[key] = alarm
        self.counts[key] = self.counts.get(key, 0) + 1
        logger.error("alarm %s: %s", kind, detail, extra={"alarm": asdict(alarm)})

    def clear(self, source: str) -> None:
        """Clear the alarms of a process."""
        for key in [key for key in self._raised if key[1] == source]:
            alarm = self._raised.pop(key)
            logger.info("alarm %s of %s is over", alarm.kind, source, extra={"cleared": asdict(alarm)})
