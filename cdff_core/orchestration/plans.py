# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Result of the planner: a plan, several plans as one, or the reasons why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cdff_core.orchestration.acquisition import Acquisition
from cdff_core.orchestration.world import ProviderId, SensorId


@dataclass(frozen=True, slots=True)
class Plan:
    """Providers to run and sensor modes to set."""

    provider: ProviderId  # provider of the product; in a plan for several robots, of the first robot
    port: str  # its output port
    order: tuple[ProviderId, ...]  # all providers, upstream ones first
    modes: Mapping[SensorId, str]  # required mode of each sensor
    cost: float
    omitted_inputs: tuple[str, ...] = ()  # omitted optional inputs, ``robot/dfpc.port``
    #: All acceptable modes of each sensor.
    accepts: Mapping[SensorId, tuple[str, ...]] = field(default_factory=dict)
    #: Selected source of each connected port, e.g. ``sensor/lidar/scan``.
    chosen_sources: Mapping[ProviderId, Mapping[str, str]] = field(default_factory=dict)
    ready_s: float = (
        0.0  # time until the product is reliable: mode switches and warm-ups in sequence, seconds
    )
    #: Providers of requests of lower priority that are stopped for their budgets.
    takes: tuple[ProviderId, ...] = ()
    #: Acceptable implementations of each provider with a choice, the selected one first.
    implementations: Mapping[ProviderId, tuple[str, ...]] = field(default_factory=dict)
    #: Parameters that the request adjusts, by provider.
    settings: Mapping[ProviderId, Mapping[str, float]] = field(default_factory=dict)

    #: Single acquisition of each sensor that makes one.
    acquisitions: Mapping[SensorId, Acquisition] = field(default_factory=dict)
    #: Implementation of the provider of the product.
    root_implementation: str = ""

    def has_same_root(self, other: Plan) -> bool:
        """Return True if the same implementation of the same DFPC provides the product."""
        return (self.provider, self.root_implementation) == (other.provider, other.root_implementation)

    def implementation(self, provider: ProviderId) -> str | None:
        """Return the selected implementation of a provider; None if there is no choice."""
        names = self.implementations.get(provider)
        return None if names is None else names[0]

    def describe(self) -> dict[str, object]:
        """Return plain data for the journal and for replies."""
        return {
            "provider": str(self.provider),
            "port": self.port,
            "order": [str(provider) for provider in self.order],
            "modes": {str(s): mode for s, mode in sorted(self.modes.items())},
            "cost": round(self.cost, 6),
            "omitted_inputs": list(self.omitted_inputs),
            "sources": {str(p): dict(ports) for p, ports in sorted(self.chosen_sources.items()) if ports},
            "ready_s": round(self.ready_s, 3),
            "takes": [str(provider) for provider in self.takes],
            "implementations": {str(p): names[0] for p, names in sorted(self.implementations.items())},
            "acquisitions": {str(s): a.describe() for s, a in sorted(self.acquisitions.items())},
            "settings": {str(p): dict(values) for p, values in sorted(self.settings.items())},
        }


def combine_plans(plans: Sequence[Plan]) -> Plan:
    """Return plans of different robots as one."""
    if len(plans) == 1:
        return plans[0]
    return Plan(
        provider=plans[0].provider,
        port=plans[0].port,
        order=tuple(provider for p in plans for provider in p.order),
        modes={sensor: mode for p in plans for sensor, mode in p.modes.items()},
        cost=sum(p.cost for p in plans),
        omitted_inputs=tuple(text for p in plans for text in p.omitted_inputs),
        accepts={sensor: modes for p in plans for sensor, modes in p.accepts.items()},
        chosen_sources={provider: ports for p in plans for provider, ports in p.chosen_sources.items()},
        ready_s=max(p.ready_s for p in plans),
        takes=tuple(provider for p in plans for provider in p.takes),
        root_implementation=plans[0].root_implementation,
        acquisitions={sensor: a for p in plans for sensor, a in p.acquisitions.items()},
        implementations={provider: names for p in plans for provider, names in p.implementations.items()},
        settings={provider: values for p in plans for provider, values in p.settings.items()},
    )


@dataclass(frozen=True, slots=True)
class NoPlan:
    """Reasons why no plan exists; ``nearest`` lists products that can be requested instead."""

    reasons: tuple[str, ...]
    nearest: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Reasons and available products as one line for the detail of an error."""
        line = "; ".join(self.reasons) or "no DFPC provides it"
        return line + (f"; available: {', '.join(self.nearest)}" if self.nearest else "")
