# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Single acquisitions that plans demand and that are not made yet."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from cdff_core.orchestration.acquisition import Acquisition
from cdff_core.orchestration.reconciliation import Acquire, ObservedState
from cdff_core.orchestration.world import ProviderId, SensorId


@dataclass(slots=True)
class PendingAcquisitions:
    """Acquisitions by the holder of a lease."""

    _by_holder: dict[str, dict[SensorId, Acquisition]] = field(default_factory=dict)

    def set(self, holder: str, acquisitions: Mapping[SensorId, Acquisition]) -> None:
        """Replace the acquisitions of a holder."""
        self.remove(holder)
        if acquisitions:
            self._by_holder[holder] = dict(acquisitions)

    def remove(self, holder: str) -> None:
        """Remove the acquisitions of a holder."""
        self._by_holder.pop(holder, None)

    def end(self, holder: str, sensor: SensorId) -> None:
        """Remove an acquisition that was made."""
        self._by_holder.get(holder, {}).pop(sensor, None)

    def is_pending(self, holder: str, sensor: SensorId) -> bool:
        """Return True if an acquisition is not made yet."""
        return sensor in self._by_holder.get(holder, ())

    def due(
        self,
        held: Callable[[str], Collection[ProviderId]],
        uses: Mapping[ProviderId, frozenset[SensorId]],
        observed: ObservedState,
        now_s: float,
    ) -> list[Acquire]:
        """Return the acquisitions whose DFPCs are active and warm, at most one of each sensor.

        ``held`` returns the providers of a holder, ``uses`` are the sensors of each provider; ``now_s`` is
        monotonic.
        """
        due: dict[SensorId, Acquire] = {}
        for holder, acquisitions in self._by_holder.items():
            for sensor, acquisition in acquisitions.items():
                history = observed.failures.get(sensor)
                if history is not None and history.not_before_s > now_s:
                    continue
                users = [p for p in held(holder) if sensor in uses.get(p, ())]
                if all(p in observed.active and observed.warm_at_s.get(p, now_s) <= now_s for p in users):
                    due.setdefault(sensor, Acquire(sensor, holder, acquisition))
        return list(due.values())
