# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reconciliation of the running system with the wanted one, repeated until there are no more actions.

Sensor modes are set before the activations that need them; upstream providers are configured, active and warm
before the providers that use their products; deactivations follow the reverse order. Failed actions are
repeated after a back-off. A provider in error is configured again before its activation, and cleaned up if it
is not wanted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cdff_core.orchestration.acquisition import Acquisition
from cdff_core.orchestration.world import ProviderId, SensorId

#: Back-off of a failed activation or mode change: first wait in seconds, factor, longest wait in seconds.
BACK_OFF_S = (0.5, 2.0, 10.0)


@dataclass(frozen=True, slots=True)
class Configuration:
    """Implementation of a DFPC, by default that of the profile, and adjusted parameters, sorted by name."""

    implementation: str | None = None
    parameters: tuple[tuple[str, float], ...] = ()

    def is_met_by(self, observed: Configuration) -> bool:
        """Return True if a DFPC that runs in the ``observed`` configuration need not change."""
        same = self.implementation in (None, observed.implementation)
        return same and self.parameters == observed.parameters


@dataclass(frozen=True, slots=True)
class SetMode:
    """Set the mode of a sensor through the instrument control unit."""

    sensor: SensorId
    mode: str


@dataclass(frozen=True, slots=True)
class Acquire:
    """Let a sensor make a single acquisition for the holder of a lease."""

    sensor: SensorId
    holder: str
    acquisition: Acquisition


@dataclass(frozen=True, slots=True)
class Configure:
    """Configure a DFPC that is unconfigured or in error."""

    provider: ProviderId


@dataclass(frozen=True, slots=True)
class Activate:
    """Activate a DFPC, or change the sources of an active one.

    ``inputs`` holds the planned sources, ``((port, source), …)``; other ports use the profile.
    ``configuration`` is None for a DFPC without a choice of implementations and without adjustable
    parameters.
    """

    provider: ProviderId
    inputs: tuple[tuple[str, str], ...] = ()
    configuration: Configuration | None = None


@dataclass(frozen=True, slots=True)
class CleanUp:
    """Clean up a DFPC in error that is not wanted."""

    provider: ProviderId


@dataclass(frozen=True, slots=True)
class Deactivate:
    """Deactivate a DFPC."""

    provider: ProviderId


Action = SetMode | Acquire | Configure | Activate | Deactivate | CleanUp


@dataclass(slots=True)
class FailureHistory:
    """Number of consecutive failures, the last reason, and the time of the next attempt (monotonic s)."""

    failures: int = 0
    reason: str = ""
    not_before_s: float = 0.0

    def add(self, reason: str, now_s: float) -> None:
        """Count a failure and set the time of the next attempt."""
        first_s, factor, longest_s = BACK_OFF_S
        self.not_before_s = now_s + min(first_s * factor**self.failures, longest_s)
        self.failures += 1
        self.reason = reason


@dataclass(slots=True)
class ObservedState:
    """Observed state of the system."""

    alive: set[ProviderId] = field(default_factory=set)  # providers with a running process
    active: set[ProviderId] = field(default_factory=set)  # active providers
    #: Providers activated by this orchestrator; it deactivates no others.
    owned: set[ProviderId] = field(default_factory=set)
    modes: dict[SensorId, str] = field(default_factory=dict)  # confirmed modes
    lost: dict[SensorId, str] = field(default_factory=dict)  # unavailable sensors with the reason
    #: Parameters of the last single acquisition of each sensor.
    acquired: dict[SensorId, Mapping[str, float]] = field(default_factory=dict)
    #: Last reported states: unconfigured, inactive, active or error.
    states: dict[ProviderId, str] = field(default_factory=dict)
    #: Time when the output of an active provider becomes reliable, monotonic seconds; default: at once.
    warm_at_s: dict[ProviderId, float] = field(default_factory=dict)
    #: Current source of each port of active providers.
    wired: dict[ProviderId, Mapping[str, str]] = field(default_factory=dict)
    #: Current configuration of active providers.
    configurations: dict[ProviderId, Configuration] = field(default_factory=dict)
    #: Failures of providers and sensors.
    failures: dict[ProviderId | SensorId, FailureHistory] = field(default_factory=dict)

    @property
    def implementations(self) -> dict[ProviderId, str | None]:
        """Current implementation of active providers."""
        return {p: c.implementation for p, c in self.configurations.items()}

    def add_failure(self, subject: ProviderId | SensorId, reason: str, now_s: float) -> None:
        """Count a failure of a provider or sensor."""
        self.failures.setdefault(subject, FailureHistory()).add(reason, now_s)

    def clear_failures(self, subject: ProviderId | SensorId) -> None:
        """Clear the failures of a provider or sensor."""
        self.failures.pop(subject, None)


def next_actions(
    wanted: Sequence[ProviderId],
    wanted_modes: Mapping[SensorId, str],
    uses: Mapping[ProviderId, frozenset[SensorId]],
    upstream: Mapping[ProviderId, frozenset[ProviderId]],
    observed: ObservedState,
    now_s: float,
    chosen_sources: Mapping[ProviderId, Mapping[str, str]] | None = None,
    configurations: Mapping[ProviderId, Configuration] | None = None,
) -> list[Action]:
    """Return the actions that are possible now; empty if all is as wanted or must wait.

    ``wanted`` lists the wanted providers, upstream ones first; ``wanted_modes`` are the modes that they need,
    ``uses`` and ``upstream`` the sensors and providers from which each provider takes samples, and
    ``chosen_sources`` the planned source of each of its ports, and ``configurations`` the implementation and
    parameters of those that requests configure. ``now_s`` is monotonic.
    """

    def is_due(subject: ProviderId | SensorId) -> bool:
        history = observed.failures.get(subject)
        return history is None or history.not_before_s <= now_s

    # No provider waits for a lost sensor, since it may work without this sensor.
    pending = {
        sensor
        for sensor, mode in wanted_modes.items()
        if observed.modes.get(sensor) != mode and sensor not in observed.lost
    }
    actions: list[Action] = [SetMode(s, wanted_modes[s]) for s in sorted(pending) if is_due(s)]
    wanted_set = set(wanted)
    # No provider waits for a failed or missing upstream provider, since the input may be optional.
    starting = {p for p in wanted_set & observed.alive - observed.active if p not in observed.failures}
    starting |= {p for p in wanted_set & observed.active if observed.warm_at_s.get(p, now_s) > now_s}
    visited: set[ProviderId] = set()
    for provider in wanted:
        if provider not in observed.alive or not is_due(provider):
            visited.add(provider)
            continue
        inputs = tuple(sorted((chosen_sources or {}).get(provider, {}).items()))
        # A provider waits only for providers earlier in the order, so that a loop cannot block itself.
        waits = (uses.get(provider, frozenset()) & pending) or (
            upstream.get(provider, frozenset()) & starting & visited
        )
        visited.add(provider)
        configuration = (configurations or {}).get(provider)
        if provider in observed.active:
            wired = observed.wired.get(provider, {})
            current = observed.configurations.get(provider)
            is_rewired = any(wired.get(port, source) != source for port, source in inputs)
            is_as_wanted = configuration is None or current is None or configuration.is_met_by(current)
            if is_rewired or not is_as_wanted:
                actions.append(Activate(provider, inputs, configuration))
        elif observed.states.get(provider) in ("unconfigured", "error"):
            actions.append(Configure(provider))
        elif not waits:
            actions.append(Activate(provider, inputs, configuration))
    surplus = (observed.active & observed.alive & observed.owned) - wanted_set
    for provider in sorted(surplus):
        in_use = any(provider in upstream.get(other, frozenset()) for other in surplus)
        if not in_use and is_due(provider):
            actions.append(Deactivate(provider))
    in_error = {
        p for p in (observed.alive & observed.owned) - wanted_set if observed.states.get(p) == "error"
    }
    actions.extend(CleanUp(provider) for provider in sorted(in_error) if is_due(provider))
    return actions


def dependency_order(
    providers: Sequence[ProviderId], upstream: Mapping[ProviderId, frozenset[ProviderId]]
) -> list[ProviderId]:
    """Return the providers, upstream ones first; a loop of optional inputs is cut at its first name."""
    order: list[ProviderId] = []
    members, visited_providers = frozenset(providers), set[ProviderId]()

    def visit(provider: ProviderId) -> None:
        if provider in visited_providers:
            return
        visited_providers.add(provider)
        for source in sorted(upstream.get(provider, frozenset()) & members):
            visit(source)
        order.append(provider)

    for provider in sorted(providers):
        visit(provider)
    return order
