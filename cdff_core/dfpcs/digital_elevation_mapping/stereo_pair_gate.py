# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of the stereo pairs that are processed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig

#: Shortest time between processed pairs, seconds.
_MIN_PERIOD_S = 0.5


class StereoPairGate:
    """Selects pairs by motion and time since the last selected one."""

    def __init__(self, config: DigitalElevationMappingConfig) -> None:
        self._config = config
        self._last: tuple[int, NDArray[np.float64]] | None = None

    def reset(self) -> None:
        """Select the next pair in any case."""
        self._last = None

    def is_due(self, stamp_ns: int, position_m: NDArray[np.float64]) -> bool:
        """Return True if a pair is to be processed, and store its time and position (3,) in that case."""
        if self._last is not None:
            last_ns, last_m = self._last
            elapsed_s, moved_m = (stamp_ns - last_ns) / 1e9, float(np.linalg.norm(position_m - last_m))
            c = self._config
            is_idle = moved_m < c.stereo_distance_m and elapsed_s < c.stereo_period_s
            if is_idle or elapsed_s < _MIN_PERIOD_S:
                return False
        self._last = (stamp_ns, position_m)
        return True
