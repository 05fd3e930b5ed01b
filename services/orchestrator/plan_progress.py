# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Progress of the plan of a job: its pending sensors and DFPCs, and failures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cdff_core.orchestration.world import ProviderId


@dataclass(frozen=True, slots=True)
class PlanProgress:
    """Progress of a plan.

    Attributes
    ----------
    inactive, dead : tuple of str
        Providers that are not active, and those without a process.
    pending_modes : tuple of str
        Sensors that are not in their mode.
    lost : tuple of str
        Reasons of lost sensors.
    displaced : tuple of str
        Reasons of sensors and providers lost to a request of higher priority.
    problems : mapping of ProviderId to str
        Providers without input, without good output or without process, and the reason.
    failures : mapping of str to (int, str)
        Consecutive failures of providers and sensors, and the last reason.
    """

    inactive: tuple[str, ...]
    dead: tuple[str, ...]
    pending_modes: tuple[str, ...]
    lost: tuple[str, ...]
    displaced: tuple[str, ...]
    problems: Mapping[ProviderId, str]
    failures: Mapping[str, tuple[int, str]]

    @property
    def pending(self) -> tuple[str, ...]:
        """Sensors and providers that the plan still waits for."""
        return (*self.pending_modes, *self.inactive)
