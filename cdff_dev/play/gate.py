# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gate of recorded sensors: they obey the Instrument Control Unit like real ones."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.errors import InputError

#: A sample may be early by this fraction of a period: stamps are rounded and jitter.
_EARLY_FRACTION = 0.1


@dataclass(frozen=True, slots=True)
class SensorState:
    """Mode of a sensor: ``on``, and ``rate_hz`` if the mode limits it."""

    on: bool = True
    rate_hz: float | None = None


class SensorGate:
    """Passes or holds back samples; a sensor without a mode is on. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._states: dict[tuple[str, str], SensorState] = {}
        self._passed_ns: dict[tuple[str, str, str], int] = {}

    def set(self, robot: str, sensor: str, body: Mapping[str, Any]) -> None:
        """Take a mode, ``on`` and ``rate_hz`` as ``event/sensor_mode`` has them; raises InputError on another
        body.
        """
        on, rate_hz = body.get("on"), body.get("rate_hz")
        if not isinstance(on, bool) or not (rate_hz is None or isinstance(rate_hz, int | float)):
            raise InputError(
                f"mode of {robot}/{sensor}: {dict(body)!r}, expected on: bool and rate_hz: number or none"
            )
        with self._lock:
            self._states[robot, sensor] = SensorState(on, None if rate_hz is None else float(rate_hz))

    def is_on(self, robot: str, sensor: str) -> bool:
        """Return True if a sensor delivers samples now."""
        with self._lock:
            state = self._states.get((robot, sensor), SensorState())
        return state.on and state.rate_hz != 0.0

    def passes(self, robot: str, sensor: str, stream: str, stamp_ns: int) -> bool:
        """Return True, and store the stamp, if the sample of ``stamp_ns`` is delivered."""
        key = (robot, sensor, stream)
        with self._lock:
            state = self._states.get((robot, sensor), SensorState())
            if not state.on or state.rate_hz == 0.0:
                return False
            last_ns = self._passed_ns.get(key)
            if state.rate_hz is not None and last_ns is not None:
                period_ns = 1e9 / state.rate_hz
                if stamp_ns - last_ns < period_ns * (1.0 - _EARLY_FRACTION):
                    return False
            self._passed_ns[key] = stamp_ns
            return True
