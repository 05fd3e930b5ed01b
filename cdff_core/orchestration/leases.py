# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Who needs what to stay on: holders of DFPCs and of sensor modes, with linger and priorities.

A resource (a DFPC, a sensor) is wanted while it has a holder, and for its linger time after the last one let go, so
that requests in a row do not switch it off and on. A sensor is in one mode: one that serves all its holders if there is
any, else one that serves those of the highest priority; the others have lost it (``displaced``). Time is the monotonic
clock's, given by the caller.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from cdff_core.orchestration.world import MakerId, SensorId

#: Holder of what a profile keeps on from the start; no request takes anything from it.
ALWAYS = "always"
ALWAYS_PRIORITY = 10
DEFAULT_PRIORITY = 5


@dataclass(slots=True)
class _Lease:
    holders: set[str] = field(default_factory=set)
    linger_until_s: float | None = None


class _Demand(NamedTuple):
    """What a holder wants of a sensor: the mode it planned with, all that serve it, how much it matters."""

    mode: str
    accepts: frozenset[str]
    priority: int
    number: int


@dataclass(slots=True)
class Leases:
    """Holders of makers and of sensor modes.

    Attributes
    ----------
    linger_s : mapping of MakerId to float
        How long a maker stays wanted after its last holder; absent ones 0 s.
    """

    linger_s: Mapping[MakerId, float] = field(default_factory=dict)
    _makers: dict[MakerId, _Lease] = field(default_factory=dict)
    _demands: dict[SensorId, dict[str, _Demand]] = field(default_factory=dict)
    _mode: dict[SensorId, str] = field(default_factory=dict)
    _mode_of: dict[MakerId, dict[SensorId, str]] = field(default_factory=dict)
    _feeding: dict[MakerId, Mapping[str, str]] = field(default_factory=dict)
    _count: int = 0

    def acquire(
        self,
        holder: str,
        makers: Iterable[MakerId],
        modes: Mapping[SensorId, str],
        *,
        priority: int = DEFAULT_PRIORITY,
        accepts: Mapping[SensorId, Iterable[str]] | None = None,
        feeding: Mapping[MakerId, Mapping[str, str]] | None = None,
    ) -> None:
        """Let ``holder`` keep makers on and sensors in modes, besides what it holds already.

        Modes stay with the makers of the same robot through their linger, since those run on what the sensors send.

        Parameters
        ----------
        holder : str
        makers : iterable of MakerId
        modes : mapping of SensorId to str
        priority : int
            Where two holders cannot share a sensor, the higher has it; of equals, the earlier.
        accepts : mapping of SensorId to iterable of str, optional
            All modes that serve; by default the one of ``modes`` alone.
        feeding : mapping of MakerId to mapping of str to str, optional
            What feeds the ports of the makers from now on, for all their holders.
        """
        self._count += 1
        for maker in makers:
            lease = self._makers.setdefault(maker, _Lease())
            lease.holders.add(holder)
            lease.linger_until_s = None
            self._mode_of.setdefault(maker, {}).update({s: m for s, m in modes.items() if s.robot == maker.robot})
            if feeding is not None and maker in feeding:
                self._feeding[maker] = dict(feeding[maker])
        for sensor, mode in modes.items():
            serve = frozenset({mode, *(accepts or {}).get(sensor, ())})
            self._demands.setdefault(sensor, {})[holder] = _Demand(mode, serve, priority, self._count)
            self._settle(sensor)

    def release(self, holder: str, now_s: float) -> None:
        """Let go of everything ``holder`` has; what nobody else holds starts to linger."""
        for maker, lease in self._makers.items():
            if holder in lease.holders:
                lease.holders.discard(holder)
                if not lease.holders:
                    lease.linger_until_s = now_s + self.linger_s.get(maker, 0.0)
        for sensor in [s for s, demands in self._demands.items() if holder in demands]:
            del self._demands[sensor][holder]
            self._settle(sensor)

    def expire(self, now_s: float) -> tuple[MakerId, ...]:
        """Drop makers whose linger is over and return them."""
        gone = tuple(
            m
            for m, lease in self._makers.items()
            if not lease.holders and lease.linger_until_s is not None and lease.linger_until_s <= now_s
        )
        for maker in gone:
            del self._makers[maker]
            self._mode_of.pop(maker, None)
            self._feeding.pop(maker, None)
        return gone

    @property
    def wanted(self) -> frozenset[MakerId]:
        """Makers that are to be on: held or lingering."""
        return frozenset(self._makers)

    def holders(self, maker: MakerId) -> frozenset[str]:
        """Who holds a maker; empty while it lingers."""
        lease = self._makers.get(maker)
        return frozenset() if lease is None else frozenset(lease.holders)

    def feeding(self, maker: MakerId) -> Mapping[str, str]:
        """What feeds the ports of a wanted maker, as wiring; ports that no plan chose are absent."""
        return self._feeding.get(maker, {})

    def held_mode(self, sensor: SensorId) -> str | None:
        """The mode somebody holds a sensor in; None where it may change (also while only lingering makers use it)."""
        return self._mode.get(sensor)

    def held_modes(self, holder: str) -> dict[SensorId, str]:
        """Sensors that a holder has, in the mode it planned with."""
        return {s: demands[holder].mode for s, demands in self._demands.items() if holder in demands}

    def serving(self, sensor: SensorId, priority: int = -1) -> frozenset[str] | None:
        """Modes that serve every holder of at least ``priority`` that has the sensor; None where there is none."""
        served = [d.accepts for d in self._served(sensor) if d.priority >= priority]
        return None if not served else frozenset.intersection(*served)

    def displaced(self, holder: str) -> dict[SensorId, str]:
        """Sensors that a holder lost to one of higher priority, and the mode each is in instead."""
        return {
            s: self._mode[s]
            for s, demands in self._demands.items()
            if holder in demands and self._mode[s] not in demands[holder].accepts
        }

    def wanted_modes(self) -> dict[SensorId, str]:
        """Sensors and the mode each is to be in: held ones, then those that lingering makers still use."""
        modes: dict[SensorId, str] = {}
        for maker in sorted(self._makers):
            modes.update(self._mode_of.get(maker, {}))
        modes.update(sorted(self._mode.items()))
        return modes

    def next_expiry_s(self) -> float | None:
        """When the next linger ends; None where nothing lingers."""
        times = [x.linger_until_s for x in self._makers.values() if not x.holders and x.linger_until_s is not None]
        return min(times, default=None)

    def describe(self) -> list[dict[str, Any]]:
        """Plain data for job lists and the catalogue."""
        return [
            {"dfpc": str(m), "holders": sorted(x.holders), "lingering": not x.holders}
            for m, x in sorted(self._makers.items())
        ]

    def describe_modes(self) -> list[dict[str, Any]]:
        """The same of sensors: the mode each is held in, and by whom."""
        return [
            {"sensor": str(s), "mode": mode, "holders": sorted(self._demands[s])}
            for s, mode in sorted(self._mode.items())
        ]

    def _served(self, sensor: SensorId) -> list[_Demand]:
        """Demands that go together, the most important first; those that do not fit to them are left out."""
        common: frozenset[str] | None = None
        served = []
        for demand in sorted(self._demands.get(sensor, {}).values(), key=lambda d: (-d.priority, d.number)):
            both = demand.accepts if common is None else common & demand.accepts
            if both:
                common = both
                served.append(demand)
        return served

    def _settle(self, sensor: SensorId) -> None:
        """Choose the mode: as it is if it serves, else as the last one planned it, else any that serves."""
        served = self._served(sensor)
        if not served:
            del self._demands[sensor]
            self._mode.pop(sensor, None)
            return
        common = frozenset.intersection(*(d.accepts for d in served))
        if self._mode.get(sensor) not in common:
            planned = [d.mode for d in sorted(served, key=lambda d: -d.number) if d.mode in common]
            self._mode[sensor] = planned[0] if planned else min(common)
        # Lingering makers of this robot go on with what their sensor sends now.
        for modes in self._mode_of.values():
            if sensor in modes:
                modes[sensor] = self._mode[sensor]
