# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Modes of sensors that the instrument control unit refused or did not confirm, each for a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from cdff_core.orchestration.world import SensorId


@dataclass(slots=True)
class RefusedModes:
    """Refused modes with the end of the refusal, monotonic seconds, and the reason."""

    _refused: dict[tuple[SensorId, str], tuple[float, str]] = field(default_factory=dict)

    def add(self, sensor: SensorId, mode: str, until_s: float, reason: str) -> None:
        """Add a refused mode."""
        self._refused[sensor, mode] = (until_s, reason)

    def at(self, now_s: float) -> dict[SensorId, dict[str, str]]:
        """Return the modes that are refused at a time, with the reason, by sensor."""
        refusals: dict[SensorId, dict[str, str]] = {}
        for (sensor, mode), (until_s, reason) in self._refused.items():
            if until_s > now_s:
                refusals.setdefault(sensor, {})[mode] = reason
        return refusals

    def remove_robot(self, robot: str) -> None:
        """Remove the refusals of a robot."""
        self._refused = {key: value for key, value in self._refused.items() if key[0].robot != robot}

    @property
    def ends_s(self) -> Iterator[tuple[str, float]]:
        """Ends of the refusals: robot, monotonic seconds."""
        return ((sensor.robot, until_s) for (sensor, _), (until_s, _) in self._refused.items())
