# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A sensor's modes as the instrument control unit runs them: steady in one, switching to another, or refusing.

Time is given by the caller (monotonic seconds), so that a simulated unit, a real one's proxy and replay share it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cdff_common.errors import DeniedError, ProductNotFoundError
from cdff_common.interfaces.profile import Sensor, SensorMode

#: (state, what happens) -> state of a sensor.
MODE_TRANSITIONS: Mapping[tuple[str, str], str] = {
    ("steady", "demand"): "switching",
    ("switching", "demand"): "switching",
    ("switching", "confirm"): "steady",
}


@dataclass(slots=True)
class ModeMachine:
    """The modes of one sensor.

    Attributes
    ----------
    sensor : Sensor
        Entry of the profile: modes, time to switch, refused modes.
    mode : str
        Last confirmed mode.
    target : str or None
        Mode it is switching to.
    ready_at_s : float
        When the switch is over, monotonic seconds.
    holder : str
        Who asked last.
    """

    name: str
    sensor: Sensor
    mode: str = ""
    target: str | None = None
    ready_at_s: float = 0.0
    holder: str = ""

    def __post_init__(self) -> None:
        self.mode = self.mode or self.sensor.initial_mode

    @property
    def state(self) -> str:
        """``steady`` or ``switching``."""
        return "steady" if self.target is None else "switching"

    def demand(self, mode: str, holder: str, now_s: float) -> bool:
        """Ask for a mode; returns whether a switch is under way afterwards.

        Raises
        ------
        ProductNotFoundError
            If the sensor has no such mode.
        DeniedError
            If it refuses it.
        """
        if mode not in self.sensor.modes:
            known = ", ".join(self.sensor.modes)
            raise ProductNotFoundError(f"sensor {self.name} has no mode {mode!r}; it has {known}")
        if mode in self.sensor.refuses:
            raise DeniedError(f"sensor {self.name} refuses mode {mode!r} now; it stays in {self.mode}")
        self.holder = holder
        if mode == self.target:
            return True
        if mode == self.mode and self.target is None:
            return False
        self.target = mode
        self.ready_at_s = now_s + self.sensor.switch_s
        return True

    def settle(self, now_s: float) -> bool:
        """Confirm a switch whose time is over; returns whether the mode changed just now."""
        if self.target is None or now_s < self.ready_at_s:
            return False
        self.mode, self.target = self.target, None
        return True

    def describe(self) -> dict[str, object]:
        """Plain data for ``icu/@rpc/modes``."""
        current = self.sensor.modes[self.mode]
        return {
            "sensor": self.name,
            "mode": self.mode,
            "target": self.target,
            "state": self.state,
            "on": current.on,
            "rate_hz": current.rate_hz,
            "holder": self.holder,
            "switch_s": self.sensor.switch_s,
            "modes": {name: _mode_map(mode) for name, mode in self.sensor.modes.items()},
        }

    def event(self) -> dict[str, object]:
        """Body of ``event/sensor_mode``."""
        current: SensorMode = self.sensor.modes[self.mode]
        return {"sensor": self.name, "mode": self.mode, "on": current.on, "rate_hz": current.rate_hz}


def _mode_map(mode: SensorMode) -> dict[str, object]:
    return {"on": mode.on, "rate_hz": mode.rate_hz, "doc": mode.doc}
