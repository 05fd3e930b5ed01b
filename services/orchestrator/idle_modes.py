# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Return of sensors to their initial modes after the last use."""

from __future__ import annotations

from collections.abc import Collection

from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.catalogue import sensors_used
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import SensorId, World


def idle_modes(
    profile: Profile, changed: Collection[SensorId], world: World, leases: Leases, observed: ObservedState
) -> dict[SensorId, str]:
    """Return the initial modes of those changed sensors that no active DFPC without a holder uses.

    ``world`` has the providers of the robots of the ``changed`` sensors, none of which is leased.
    """
    if not changed:
        return {}
    users = {p for p in observed.active | leases.wanted if not leases.holders(p)}
    sensors = sensors_used(world, {p: observed.wired[p] for p in users if observed.wired.get(p)})
    sensors_in_use = {s for p in users & sensors.keys() for s in sensors[p]}
    return {
        s: profile.robot(s.robot).sensors[s.sensor].initial_mode for s in changed if s not in sensors_in_use
    }
