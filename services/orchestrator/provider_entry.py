# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Observed state of a DFPC in the catalogue."""

from __future__ import annotations

from typing import Any

from cdff_core.orchestration.catalogue import ResourceUsage
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import ProviderId


def provider_entry(
    provider: ProviderId, observed: ObservedState, usage: ResourceUsage | None
) -> dict[str, Any]:
    """Return state, sources, configuration, failures and resource usage of a DFPC as plain data."""
    history = observed.failures.get(provider)
    configuration = observed.configurations.get(provider)
    entry: dict[str, Any] = {
        "state": observed.states.get(provider, "unknown"),
        "alive": provider in observed.alive,
        "active": provider in observed.active,
        "wired": dict(observed.wired.get(provider, {})),
        "adjusted": {} if configuration is None else dict(configuration.parameters),
        "failures": 0 if history is None else history.failures,
        "last_failure": "" if history is None else history.reason,
        "measured": None if usage is None else usage.describe(),
    }
    if configuration is not None and configuration.implementation:
        entry["implementation"] = configuration.implementation
    return entry
