# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Progress of the plan of a job: its pending sensors and DFPCs, and failures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.planner import Plan
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.pending_acquisitions import PendingAcquisitions


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
    acquired_from_ns : int
        Start of the last single acquisition of the plan that has ended, mission time; 0 without any.
    """

    inactive: tuple[str, ...]
    dead: tuple[str, ...]
    pending_modes: tuple[str, ...]
    lost: tuple[str, ...]
    displaced: tuple[str, ...]
    problems: Mapping[ProviderId, str]
    failures: Mapping[str, tuple[int, str]]
    acquired_from_ns: int = 0

    @property
    def pending(self) -> tuple[str, ...]:
        """Sensors and providers that the plan still waits for."""
        return (*self.pending_modes, *self.inactive)


class LastProgress:
    """Progress of each plan at the last change of the system state, except for its problems, which depend on
    the time.
    """

    def __init__(self, observed: ObservedState, leases: Leases, acquisitions: PendingAcquisitions) -> None:
        self._state = observed, leases, acquisitions
        self._of: dict[str, tuple[int, Plan, PlanProgress]] = {}  # by holder

    def get(self, plan: Plan, holder: str, version: int, problems: Mapping[ProviderId, str]) -> PlanProgress:
        """Return the progress of the plan of a holder, determined once for each ``version`` of the state."""
        last = self._of.get(holder)
        if last is None or last[0] != version or last[1] is not plan:
            last = self._of[holder] = (version, plan, plan_progress(plan, holder, *self._state, problems))
        progress = last[2]
        return progress if progress.problems == problems else replace(progress, problems=problems)

    def remove(self, holder: str) -> None:
        """Remove a holder."""
        self._of.pop(holder, None)


def plan_progress(
    plan: Plan,
    holder: str,
    observed: ObservedState,
    leases: Leases,
    acquisitions: PendingAcquisitions,
    problems: Mapping[ProviderId, str],
) -> PlanProgress:
    """Return the progress of the plan of the holder of a lease; ``problems`` are those of its providers."""
    providers, modes = plan.order, plan.modes

    def is_pending(sensor: SensorId) -> bool:
        if sensor in plan.acquisitions:
            return acquisitions.is_pending(holder, sensor)
        return observed.modes.get(sensor) != (leases.held_mode(sensor) or modes[sensor])

    displaced_modes = sorted(leases.displaced(holder, modes).items())
    displaced_implementations = leases.displaced_implementations(holder, providers).items()
    return PlanProgress(
        inactive=tuple(str(p) for p in providers if p not in observed.active),
        dead=tuple(str(p) for p in providers if p not in observed.alive),
        pending_modes=tuple(str(s) for s in modes if s in observed.lost or is_pending(s)),
        lost=tuple(f"sensor {s} is lost: {observed.lost[s]}" for s in modes if s in observed.lost),
        displaced=(
            *(
                f"sensor {s} is in mode {mode} for a request of higher priority"
                for s, mode in displaced_modes
            ),
            *(
                f"{p} is stopped: a request of higher priority needs its budgets"
                for p in leases.taken(holder, providers)
            ),
            *(
                f"{p} runs as {name} for a request of higher priority"
                for p, name in displaced_implementations
            ),
        ),
        problems=problems,
        failures={
            str(x): (h.failures, h.reason)
            for x, h in observed.failures.items()
            if x in providers or x in modes
        },
        acquired_from_ns=acquisitions.begun_ns(holder),
    )
