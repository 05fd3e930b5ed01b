# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gate of recorded sensors: it passes samples by the modes that the instrument control unit sets."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.errors import InputError

#: Tolerance of a period, as a fraction of it: stamps are rounded and have jitter.
_EARLY_FRACTION = 0.1


@dataclass(frozen=True, slots=True)
class SensorState:
    """State of a sensor: whether it is on, the rate limit of its mode, if any, and the samples of a single
    acquisition with its number.
    """

    on: bool = True
    rate_hz: float | None = None
    acquires: int | None = None
    acquisition: int = 0


class SensorGate:
    """Passes or withholds samples by the mode of their sensor; a sensor without a mode is on. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._states: dict[tuple[str, str], SensorState] = {}
        self._passed_ns: dict[tuple[str, str, str], int] = {}
        #: By stream: number of its last acquisition, and number of samples of that acquisition.
        self._acquired: dict[tuple[str, str, str], tuple[int, int]] = {}

    def set(self, robot: str, sensor: str, body: Mapping[str, Any]) -> None:
        """Set the mode of a sensor from the body of ``event/sensor_mode``.

        Raises InputError if it is malformed.
        """
        on, rate_hz = body.get("on"), body.get("rate_hz")
        if not isinstance(on, bool) or not (rate_hz is None or isinstance(rate_hz, int | float)):
            raise InputError(
                f"mode of {robot}/{sensor}: {dict(body)!r}, expected on: bool and rate_hz: number or none"
            )
        acquires, acquisition = body.get("acquires"), body.get("acquisition", 0)
        if not (acquires is None or isinstance(acquires, int)) or not isinstance(acquisition, int):
            raise InputError(
                f"mode of {robot}/{sensor}: {dict(body)!r}, expected acquires, acquisition: integers"
            )
        with self._lock:
            self._states[robot, sensor] = SensorState(
                on, None if rate_hz is None else float(rate_hz), acquires, acquisition
            )

    def clear_times(self) -> None:
        """Clear the times of the rate limits, after a jump of mission time."""
        with self._lock:
            self._passed_ns.clear()

    def is_on(self, robot: str, sensor: str) -> bool:
        """Return True if a sensor currently delivers samples."""
        with self._lock:
            state = self._states.get((robot, sensor), SensorState())
        return state.on and state.rate_hz != 0.0

    def passes(self, robot: str, sensor: str, stream: str, stamp_ns: int) -> bool:
        """Return True if a sample passes; its stamp is then the reference of the rate limit."""
        key = (robot, sensor, stream)
        with self._lock:
            state = self._states.get((robot, sensor), SensorState())
            if not state.on or state.rate_hz == 0.0:
                return False
            if state.acquires is not None:
                number, count = self._acquired.get(key, (0, 0))
                count = count if number == state.acquisition else 0
                if count >= state.acquires:
                    return False
                self._acquired[key] = (state.acquisition, count + 1)
                return True
            last_ns = self._passed_ns.get(key)
            if state.rate_hz is not None and last_ns is not None:
                period_ns = 1e9 / state.rate_hz
                if stamp_ns - last_ns < period_ns * (1.0 - _EARLY_FRACTION):
                    return False
            self._passed_ns[key] = stamp_ns
            return True
