# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Single acquisitions that plans demand, with those that are made already."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cdff_core.orchestration.acquisition import Acquisition
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconciliation import Acquire, ObservedState
from cdff_core.orchestration.world import SensorId


@dataclass(slots=True)
class _Demand:
    """Acquisitions of a plan that are not made yet, and the mission time at which the last one began."""

    pending: dict[SensorId, Acquisition]
    begun_ns: int = 0


@dataclass(slots=True)
class PendingAcquisitions:
    """Acquisitions by the holder of a lease."""

    _by_holder: dict[str, _Demand] = field(default_factory=dict)

    def set(self, holder: str, acquisitions: Mapping[SensorId, Acquisition]) -> None:
        """Replace the acquisitions of a holder."""
        self.remove(holder)
        if acquisitions:
            self._by_holder[holder] = _Demand(dict(acquisitions))

    def remove(self, holder: str) -> None:
        """Remove the acquisitions of a holder."""
        self._by_holder.pop(holder, None)

    def end(self, holder: str, sensor: SensorId, begun_ns: int) -> None:
        """Mark an acquisition as made; it began at a mission time."""
        demand = self._by_holder.get(holder)
        if demand is not None and demand.pending.pop(sensor, None) is not None:
            demand.begun_ns = max(demand.begun_ns, begun_ns)

    def is_pending(self, holder: str, sensor: SensorId) -> bool:
        """Return True if an acquisition is not made yet."""
        return holder in self._by_holder and sensor in self._by_holder[holder].pending

    def begun_ns(self, holder: str) -> int:
        """Return the mission time at which the last acquisition of a holder began; 0 without any."""
        return self._by_holder[holder].begun_ns if holder in self._by_holder else 0

    def due(self, leases: Leases, observed: ObservedState, now_s: float) -> list[Acquire]:
        """Return the acquisitions for which all DFPCs of the plan on the robot are active and warm, at most
        one of each sensor; ``now_s`` is monotonic.
        """
        due: dict[SensorId, Acquire] = {}
        for holder, demand in self._by_holder.items():
            providers = leases.held(holder)
            if leases.taken(holder, providers):
                continue
            for sensor, acquisition in demand.pending.items():
                history = observed.failures.get(sensor)
                if history is not None and history.not_before_s > now_s:
                    continue
                users = [p for p in providers if p.robot == sensor.robot]
                if all(p in observed.active and observed.warm_at_s.get(p, now_s) <= now_s for p in users):
                    due.setdefault(sensor, Acquire(sensor, holder, acquisition))
        return list(due.values())
