# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Relocalisation in a map that was resumed after a restart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_core.keyframe_graph.checkpoint_schedule import is_power_of_two

if TYPE_CHECKING:
    from cdff_core.dfpcs.lidar_slam.keyframe_mapper import KeyframeMapper

#: Number of sweeps that are compared at least: then a relocalised position is precise enough.
_MIN_SEARCH_SWEEPS = 16


class Relocaliser:
    """Search for the position after a restart.

    After 1, 2, 4, … sweeps, the sweeps since the restart are compared with the ``max_keyframes`` keyframes
    nearest to the last position: more sweeps make the registration more reliable and more precise. The
    search ends when the current keyframe is linked and at least ``_MIN_SEARCH_SWEEPS`` sweeps were compared.
    """

    def __init__(self, max_keyframes: int) -> None:
        self._max_keyframes = max_keyframes
        self.clear()

    def clear(self) -> None:
        """End the search."""
        self._last_position: tuple[int, NDArray[np.float64]] | None = None
        self._sweeps = 0

    @property
    def last_position(self) -> tuple[int, NDArray[np.float64]] | None:
        """Keyframe and ``T_keyframe_lidar`` before the restart; None outside a search."""
        return self._last_position

    @property
    def is_uncertain(self) -> bool:
        """True while only one sweep has been compared with the map: the position is not yet published."""
        return self._last_position is not None and self._sweeps == 1

    def resume(self, key: int, T_keyframe_lidar: NDArray[np.float64]) -> None:
        """Start the search at the last position in a resumed map."""
        self.clear()
        self._last_position = (key, T_keyframe_lidar)

    def update(self, mapper: KeyframeMapper) -> bool:
        """Count a sweep and, if due, compare the sweeps with the map; return whether a loop was found."""
        if self._last_position is None or mapper.current is None:
            return False
        self._sweeps += 1
        if not is_power_of_two(self._sweeps):
            return False
        is_linked = mapper.current in mapper.keyframes.linked
        nearest = self._nearest_keyframes(mapper, is_linked=is_linked)
        mapper.update_cloud(with_descriptor=False)
        loops = mapper.closer.relocalise(mapper.keyframes, mapper.current, nearest)
        if is_linked and self._sweeps >= _MIN_SEARCH_SWEEPS:
            self.clear()
        if loops:
            mapper.replace_loops(loops)
        return bool(loops)

    def _nearest_keyframes(self, mapper: KeyframeMapper, *, is_linked: bool) -> list[int]:
        """Return the imported keyframes nearest to the current position or, while it is unknown, to the last
        position.
        """
        assert self._last_position is not None  # in a search
        assert mapper.current is not None
        key, T_keyframe_lidar = self._last_position
        T_map = mapper.keyframes.poses
        position_m = (T_map[mapper.current] if is_linked else T_map[key] @ T_keyframe_lidar)[:3, 3]
        distance = mapper.keyframes.distance_m
        return sorted(mapper.imported, key=lambda k: (distance(k, position_m), k))[: self._max_keyframes]
