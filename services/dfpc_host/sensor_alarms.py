# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of sensors that disagree with each other or with the profile."""

from __future__ import annotations

from collections.abc import Sequence

from cdff_core.consistency.finding import Finding
from services.alarms import Alarms, Severity


class SensorAlarms:
    """Alarms of the findings of one DFPC; the source of each is ``robot/sensor``.

    Parameters
    ----------
    alarms : Alarms
        Alarms of the process.
    robot, dfpc : str
        Owner of the sensors, and the DFPC that compares them.
    """

    def __init__(self, alarms: Alarms, robot: str, dfpc: str) -> None:
        self._alarms, self._robot, self._dfpc = alarms, robot, dfpc
        self._active: set[tuple[str, str]] = set()

    def update(self, findings: Sequence[Finding]) -> None:
        """Begin the alarms of new findings, and end those of findings that no longer exist."""
        present = set()
        for finding in findings:
            key = (finding.kind, f"{self._robot}/{finding.name}")
            present.add(key)
            problem = f"{finding.what} (found by {self._dfpc})"
            self._alarms.set(*key, Severity.WARNING, problem, finding.remedy)
        for key in self._active - present:
            self._alarms.clear(*key)
        self._active = present
