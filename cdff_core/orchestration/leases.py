# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Who needs what to stay on: holders of DFPCs and of sensor modes, with linger.

A resource (a DFPC, a sensor) is wanted while it has a holder, and for its linger time after the last one let go, so
that requests in a row do not switch it off and on. Time is the monotonic clock's, given by the caller.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_core.orchestration.world import MakerId, SensorId

#: Holder of what a profile keeps on from the start.
ALWAYS = "always"


@dataclass(slots=True)
class _Lease:
    holders: set[str] = field(default_factory=set)
    linger_until_s: float | None = None


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
    _modes: dict[SensorId, dict[str, str]] = field(default_factory=dict)
    _mode_of: dict[MakerId, dict[SensorId, str]] = field(default_factory=dict)

    def acquire(self, holder: str, makers: Iterable[MakerId], modes: Mapping[SensorId, str]) -> None:
        """Let ``holder`` keep makers on and sensors in modes, besides what it holds already.

        Modes stay with the makers of the same robot through their linger, since those run on what the sensors send.
        """
        for maker in makers:
            lease = self._makers.setdefault(maker, _Lease())
            lease.holders.add(holder)
            lease.linger_until_s = None
            self._mode_of.setdefault(maker, {}).update({s: m for s, m in modes.items() if s.robot == maker.robot})
        for sensor, mode in modes.items():
            self._modes.setdefault(sensor, {})[holder] = mode

    def release(self, holder: str, now_s: float) -> None:
        """Let go of everything ``holder`` has; what nobody else holds starts to linger."""
        for maker, lease in self._makers.items():
            if holder in lease.holders:
                lease.holders.discard(holder)
                if not lease.holders:
                    lease.linger_until_s = now_s + self.linger_s.get(maker, 0.0)
        for modes in self._modes.values():
            modes.pop(holder, None)

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
        return gone

    @property
    def wanted(self) -> frozenset[MakerId]:
        """Makers that are to be on: held or lingering."""
        return frozenset(self._makers)

    def holders(self, maker: MakerId) -> frozenset[str]:
        """Who holds a maker; empty while it lingers."""
        lease = self._makers.get(maker)
        return frozenset() if lease is None else frozenset(lease.holders)

    def held_mode(self, sensor: SensorId) -> str | None:
        """The mode somebody holds a sensor in; None where it may change (also while only lingering makers use it)."""
        return next(iter(self._modes.get(sensor, {}).values()), None)

    def wanted_modes(self) -> dict[SensorId, str]:
        """Sensors and the mode each is to be in: held ones, then those that lingering makers still use."""
        modes: dict[SensorId, str] = {}
        for maker in sorted(self._makers):
            modes.update(self._mode_of.get(maker, {}))
        for sensor in sorted(self._modes):
            held = self.held_mode(sensor)
            if held is not None:
                modes[sensor] = held
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
