# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Leases of DFPCs and sensor modes, with linger times and priorities.

A provider is wanted while it has a holder, and for its linger time after the last release, so that it is not
deactivated between successive requests. A request that a stored product serves restarts the linger time. A
sensor is in one mode: a mode that serves all holders if there is one, otherwise a mode that serves the
holders of the highest priority; the others are displaced. A request may also take the providers of requests
of lower priority, for their memory and CPU; since a lingering provider keeps the priority of its last holder,
a request of lower priority gets them back only after the linger time. The caller passes times of the
monotonic clock.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cdff_common.contract.wiring import Source
from cdff_core.orchestration.request import DEFAULT_PRIORITY
from cdff_core.orchestration.shared_choice import SharedChoices
from cdff_core.orchestration.world import ProviderId, SensorId

#: Holder of the DFPCs with ``activation: always``; no request can take a sensor mode from it.
ALWAYS = "always"
ALWAYS_PRIORITY = 10


@dataclass(slots=True)
class _Lease:
    """Holders of a provider; without a holder, the end of its linger time. ``priority`` is the highest one of
    the holders, or of those before the linger time.
    """

    holders: set[str] = field(default_factory=set)
    linger_until_s: float | None = None
    priority: int = -1


@dataclass(slots=True)
class Leases:
    """Holders of providers and of sensor modes."""

    #: Time for which a provider stays wanted after the last release; default 0 s.
    linger_s: Mapping[ProviderId, float] = field(default_factory=dict)
    _provider_leases: dict[ProviderId, _Lease] = field(default_factory=dict)
    _modes: SharedChoices[SensorId] = field(default_factory=SharedChoices)
    _implementations: SharedChoices[ProviderId] = field(default_factory=SharedChoices)
    _settings: dict[ProviderId, dict[str, Mapping[str, float]]] = field(default_factory=dict)  # by holder
    #: Modes of the sensors that each wanted provider uses.
    _mode_of: dict[ProviderId, dict[SensorId, str]] = field(default_factory=dict)
    _chosen_sources: dict[ProviderId, Mapping[str, str]] = field(default_factory=dict)
    _held: dict[str, set[ProviderId]] = field(default_factory=dict)  # providers of each holder
    _priorities: dict[str, int] = field(default_factory=dict)  # of each holder
    _count: int = 0  # number of acquisitions

    def acquire(
        self,
        holder: str,
        providers: Iterable[ProviderId],
        modes: Mapping[SensorId, str],
        *,
        priority: int = DEFAULT_PRIORITY,
        accepts: Mapping[SensorId, Iterable[str]] | None = None,
        chosen_sources: Mapping[ProviderId, Mapping[str, str]] | None = None,
        uses: Mapping[ProviderId, Container[SensorId]] | None = None,
        implementations: Mapping[ProviderId, Sequence[str]] | None = None,
        settings: Mapping[ProviderId, Mapping[str, float]] | None = None,
    ) -> None:
        """Add providers and sensor modes to the lease of ``holder``.

        A sensor that cannot be shared is in the mode of the holder with the highest priority, among equals of
        the earliest holder. ``accepts`` lists all acceptable modes, by default only the one in ``modes``;
        ``chosen_sources`` are the selected sources of the ports of a provider, for all its holders. ``uses``
        are the sensors of each provider, whose modes stay wanted during its linger time; by default all
        sensors of its robot. ``implementations`` are the acceptable implementations of a provider, the
        planned one first, ``settings`` the adjusted parameters.
        """
        self._count += 1
        self._priorities[holder] = priority
        for provider in providers:
            self._held.setdefault(holder, set()).add(provider)
            lease = self._provider_leases.setdefault(provider, _Lease())
            lease.holders.add(holder)
            lease.linger_until_s = None
            lease.priority = max(self._priorities[h] for h in lease.holders)
            self._mode_of.setdefault(provider, {}).update(
                {
                    s: m
                    for s, m in modes.items()
                    if (s.robot == provider.robot if uses is None else s in uses[provider])
                }
            )
            if chosen_sources is not None and provider in chosen_sources:
                self._chosen_sources[provider] = dict(chosen_sources[provider])
        for sensor, mode in modes.items():
            self._modes.demand(sensor, holder, mode, (accepts or {}).get(sensor, ()), priority, self._count)
            self._pass_mode_on(sensor)
        for provider, names in (implementations or {}).items():
            self._implementations.demand(provider, holder, names[0], names, priority, self._count)
        for provider, values in (settings or {}).items():
            self._settings.setdefault(provider, {})[holder] = dict(values)

    def release(self, holder: str, now_s: float) -> None:
        """Release the lease of ``holder``; providers without another holder start to linger."""
        for provider in self._held.pop(holder, ()):
            lease = self._provider_leases.get(provider)
            if lease is not None and holder in lease.holders:
                lease.holders.discard(holder)
                if lease.holders:
                    lease.priority = max(self._priorities[h] for h in lease.holders)
                else:
                    lease.linger_until_s = now_s + self.linger_s.get(provider, 0.0)
        self._priorities.pop(holder, None)
        for sensor in self._modes.release(holder):
            self._pass_mode_on(sensor)
        self._implementations.release(holder)
        for provider in [p for p, held in self._settings.items() if holder in held]:
            del self._settings[provider][holder]
            if not self._settings[provider]:
                del self._settings[provider]

    def renew(self, provider: ProviderId, now_s: float) -> None:
        """Restart the linger time of a provider and of the DFPCs that provide its inputs.

        A provider with a holder is unaffected, and so is one that is not wanted.
        """
        pending, visited = [provider], set[ProviderId]()
        while pending:
            current = pending.pop()
            lease = self._provider_leases.get(current)
            if lease is None or current in visited:
                continue
            visited.add(current)
            if lease.linger_until_s is not None:
                lease.linger_until_s = now_s + self.linger_s.get(current, 0.0)
            sources = map(Source.parse, self.chosen_sources(current).values())
            pending += [ProviderId(current.robot, s.owner) for s in sources if s.kind == "product"]

    def takeable(self, provider: ProviderId, priority: int) -> int | None:
        """Return the priority of a provider that a request of some priority may stop; None if it may not.

        It may stop providers of requests of lower priority, and lingering ones of its own priority.
        """
        lease = self._provider_leases.get(provider)
        if lease is None or lease.priority > priority or (lease.holders and lease.priority == priority):
            return None
        return lease.priority

    def take(self, providers: Iterable[ProviderId], priority: int) -> None:
        """Remove the leases of those providers that a request of some priority may stop."""
        for provider in providers:
            if self.takeable(provider, priority) is not None:
                self._remove(provider)

    def taken(self, holder: str, providers: Iterable[ProviderId]) -> tuple[ProviderId, ...]:
        """Return the providers of a holder that were taken from it."""
        held = self._held.get(holder, set())
        return tuple(p for p in providers if p in held and holder not in self.holders(p))

    def _remove(self, provider: ProviderId) -> None:
        del self._provider_leases[provider]
        self._mode_of.pop(provider, None)
        self._chosen_sources.pop(provider, None)

    def expire(self, now_s: float, active: Container[ProviderId] | None = None) -> tuple[ProviderId, ...]:
        """Remove the providers with an expired linger time and return them.

        Of the lingering providers only ``active`` ones (default: all) stay wanted, so that none is started.
        """
        expired = tuple(
            provider
            for provider, lease in self._provider_leases.items()
            if not lease.holders
            and lease.linger_until_s is not None
            and (lease.linger_until_s <= now_s or (active is not None and provider not in active))
        )
        for provider in expired:
            self._remove(provider)
        return expired

    def remove_robot(self, robot: str) -> None:
        """Remove all leases of the DFPCs and sensors of a robot, also those with a holder."""
        for by_provider in (self._provider_leases, self._mode_of, self._chosen_sources, self._settings):
            for provider in [p for p in by_provider if p.robot == robot]:
                del by_provider[provider]
        self._modes.remove_robot(robot)
        self._implementations.remove_robot(robot)

    def held(self, holder: str) -> frozenset[ProviderId]:
        """Return the providers of a holder."""
        return frozenset(self._held.get(holder, ()))

    def is_holder(self, holder: str) -> bool:
        """Return whether a holder has a lease."""
        return holder in self._held

    def without(self, holder: str) -> Leases:
        """Return the leases of all other holders, in which the providers of ``holder`` do not linger."""
        return replace(
            self,
            _provider_leases={
                provider: self._lease_without(lease, holder)
                for provider, lease in self._provider_leases.items()
                if lease.holders != {holder}
            },
            _modes=self._modes.without(holder),
            _implementations=self._implementations.without(holder),
            _mode_of={},  # only for the modes of lingering providers
        )

    def _lease_without(self, lease: _Lease, holder: str) -> _Lease:
        if holder not in lease.holders:
            return lease
        others = lease.holders - {holder}
        return replace(lease, holders=others, priority=max(self._priorities[h] for h in others))

    def avoid(self, modes: Mapping[SensorId, Iterable[str]]) -> None:
        """Select these modes, which sensors do not reach now, only if no other mode serves the holders."""
        self._modes.avoid(modes)
        for sensor in modes.keys() & self._modes.selected.keys():
            self._pass_mode_on(sensor)

    @property
    def wanted(self) -> frozenset[ProviderId]:
        """Providers that shall be active: held or lingering."""
        return frozenset(self._provider_leases)

    def is_wanted(self, provider: ProviderId) -> bool:
        """Return whether a provider shall be active: held or lingering."""
        return provider in self._provider_leases

    def robots_of(self, holder: str) -> set[str]:
        """Return the robots of the providers of a holder."""
        return {provider.robot for provider in self._held.get(holder, ())}

    def effect(self, robots: Container[str]) -> tuple[object, ...]:
        """Return what the leases require of some robots; equal before and after a change without effect."""
        return (
            {
                p: (not lease.holders, lease.priority)
                for p, lease in self._provider_leases.items()
                if p.robot in robots
            },
            {s: mode for s, mode in self._modes.selected.items() if s.robot in robots},
            {p: name for p, name in self._implementations.selected.items() if p.robot in robots},
            {
                p: {h: dict(v) for h, v in held.items()}
                for p, held in self._settings.items()
                if p.robot in robots
            },
            {p: dict(ports) for p, ports in self._chosen_sources.items() if p.robot in robots},
        )

    def holders(self, provider: ProviderId) -> frozenset[str]:
        """Return the holders of a provider; empty while it lingers."""
        lease = self._provider_leases.get(provider)
        return frozenset() if lease is None else frozenset(lease.holders)

    def chosen_sources(self, provider: ProviderId) -> Mapping[str, str]:
        """Return the selected source of each port of a wanted provider."""
        return self._chosen_sources.get(provider, {})

    def held_mode(self, sensor: SensorId) -> str | None:
        """Return the held mode of a sensor; None if it may change: no holder, or lingering providers only."""
        return self._modes.selected.get(sensor)

    def serving_modes(self, sensor: SensorId, priority: int = -1) -> frozenset[str] | None:
        """Return the modes that serve all holders of at least ``priority``; None without a holder."""
        return self._modes.serving(sensor, priority)

    def implementation(self, provider: ProviderId) -> str | None:
        """Return the implementation that serves the holders of a provider; None if they have no choice."""
        return self._implementations.selected.get(provider)

    def serving_implementations(self, provider: ProviderId, priority: int = -1) -> frozenset[str] | None:
        """Return the implementations that serve all holders of at least ``priority``; None without any."""
        return self._implementations.serving(provider, priority)

    def settings(self, provider: ProviderId) -> list[Mapping[str, float]]:
        """Return the adjusted parameters that each holder of a provider requests."""
        return list(self._settings.get(provider, {}).values())

    def displaced(self, holder: str, sensors: Iterable[SensorId] | None = None) -> dict[SensorId, str]:
        """Return the sensors, by default of all, in a mode unacceptable to a holder, with this mode."""
        return self._modes.displaced(holder, sensors)

    def displaced_implementations(
        self, holder: str, providers: Iterable[ProviderId]
    ) -> dict[ProviderId, str]:
        """Return the providers that run in an implementation unacceptable to a holder, with this one."""
        return self._implementations.displaced(holder, providers)

    def wanted_modes(self) -> dict[SensorId, str]:
        """Return the wanted mode of each sensor that is held or used by lingering providers."""
        modes: dict[SensorId, str] = {}
        for provider, lease in sorted(self._provider_leases.items()):
            if not lease.holders:
                modes.update(self._mode_of.get(provider, {}))
        modes.update(sorted(self._modes.selected.items()))
        return modes

    @property
    def expiries_s(self) -> Iterator[tuple[str, float]]:
        """Ends of the linger times: robot, monotonic seconds."""
        for provider, lease in self._provider_leases.items():
            if not lease.holders and lease.linger_until_s is not None:
                yield provider.robot, lease.linger_until_s

    def describe(self) -> list[dict[str, Any]]:
        """Return the leases as plain data for job lists and the catalogue."""
        return [
            {"dfpc": str(provider), "holders": sorted(lease.holders), "lingering": not lease.holders}
            for provider, lease in sorted(self._provider_leases.items())
        ]

    def _pass_mode_on(self, sensor: SensorId) -> None:
        """Let lingering providers of the robot use the selected mode of a sensor."""
        mode = self._modes.selected.get(sensor)
        if mode is None:
            return
        for modes in self._mode_of.values():
            if sensor in modes:
                modes[sensor] = mode
