# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Worlds of the planner that requests share for a short time."""

from __future__ import annotations

import math
from collections.abc import Collection

from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_core.orchestration.world import World

#: Selection of a world: optimistic, priority, robots and single acquisition.
WorldKey = tuple[bool, int, frozenset[str], AcquisitionParameters | None]


class Worlds:
    """Worlds of the last requests, each until a change of one of its robots, or for ``LONGEST_S``: resource
    usage and refused modes change without a signal.
    """

    LONGEST_S = 2.0

    def __init__(self) -> None:
        self._worlds: dict[WorldKey, tuple[float, World]] = {}

    def get(self, key: WorldKey, now_s: float) -> World | None:
        """Return a world that is valid now."""
        made_s, world = self._worlds.get(key, (-math.inf, None))
        return world if now_s - made_s <= self.LONGEST_S else None

    def add(self, key: WorldKey, world: World, now_s: float) -> None:
        """Add a world, and remove old ones."""
        self._worlds = {k: w for k, w in self._worlds.items() if now_s - w[0] <= self.LONGEST_S}
        self._worlds[key] = (now_s, world)

    def clear(self, robots: Collection[str]) -> None:
        """Remove the worlds with one of these robots, or all."""
        changed = frozenset(robots)
        self._worlds = {k: w for k, w in self._worlds.items() if changed and not changed & k[2]}
