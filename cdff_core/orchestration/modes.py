# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State machine of the modes of a sensor: steady, switching or lost.

The profile declares the allowed transitions and their duration (``Sensor.transitions``). The caller passes
the time (monotonic seconds), so that the simulated unit and replay share the machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cdff_common.errors import DeniedError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.sensor_profile import Sensor

#: (state, event) -> state of a sensor. ``demand`` is a call, the others are events.
MODE_TRANSITIONS: Mapping[tuple[str, str], str] = {
    ("steady", "demand"): "switching",
    ("switching", "demand"): "switching",
    ("switching", "pass"): "switching",
    ("switching", "confirm"): "steady",
    ("switching", "refuse"): "steady",
    ("steady", "fail"): "lost",
    ("switching", "fail"): "lost",
    ("lost", "recover"): "steady",
}


@dataclass(slots=True)
class ModeMachine:
    """State machine of the modes of one sensor."""

    name: str
    sensor: Sensor  # entry of the profile: modes, transitions, refused modes
    mode: str = ""  # last confirmed mode
    target: str | None = None  # target mode of the current switch
    #: Remaining modes up to the target with the time when each is reached, monotonic seconds.
    steps: tuple[tuple[str, float], ...] = ()
    holder: str = ""  # client of the last demand
    refusal: str = ""  # reason why the last switch was refused; empty otherwise
    lost: str = ""  # reason why the sensor is unavailable; empty otherwise

    def __post_init__(self) -> None:
        self.mode = self.mode or self.sensor.initial_mode

    @property
    def state(self) -> str:
        """``steady``, ``switching`` or ``lost``."""
        if self.lost:
            return "lost"
        return "steady" if self.target is None else "switching"

    def demand(self, mode: str, holder: str, now_s: float, slowness: float = 1.0) -> bool:
        """Demand a mode; return whether a switch is in progress afterwards.

        ``slowness`` is a factor on the declared durations, which a simulated unit varies. Raises
        ProductNotFoundError for an unknown mode, DeniedError if the sensor refuses it or cannot reach it from
        the current mode, UnavailableError if the sensor is lost.
        """
        if mode not in self.sensor.modes:
            mode_names = ", ".join(self.sensor.modes)
            raise ProductNotFoundError(f"sensor {self.name} has no mode {mode!r}; it has {mode_names}")
        if self.lost:
            raise UnavailableError(f"sensor {self.name} is lost: {self.lost}")
        if mode in self.sensor.refuses:
            raise DeniedError(f"sensor {self.name} refuses mode {mode!r} now; it stays in {self.mode}")
        self.refusal = ""
        if mode == self.target or (mode == self.mode and self.target is None):
            self.holder = holder
            return self.target is not None
        path = self.sensor.mode_path(self.mode, mode)
        if path is None:
            raise DeniedError(
                f"sensor {self.name} cannot switch from mode {self.mode} to {mode}; it stays in {self.mode}"
            )
        # The reversal of an unfinished switch (an empty path) takes as long as a switch.
        at_s, steps = now_s, []
        for step, duration_s in path or ((mode, self.sensor.switch_s),):
            at_s += slowness * duration_s
            steps.append((step, at_s))
        self.holder, self.target, self.steps = holder, mode, tuple(steps)
        return True

    def settle(self, now_s: float) -> bool:
        """Confirm the next mode if its time is reached; return whether the mode changed."""
        if not self.steps or now_s < self.steps[0][1]:
            return False
        (self.mode, _), *remaining_steps = self.steps
        self.steps = tuple(remaining_steps)
        if not remaining_steps:
            self.target = None
        return True

    def refuse(self, reason: str) -> None:
        """End a switch with a reason; the sensor stays in the last confirmed mode."""
        if self.target is not None:
            self.target, self.steps, self.refusal = None, (), reason

    def fail(self, reason: str) -> None:
        """Mark the sensor as lost for a reason."""
        self.target, self.steps, self.lost = None, (), reason

    def recover(self) -> None:
        """Mark the sensor as available, in its initial mode."""
        self.lost, self.mode = "", self.sensor.initial_mode

    def describe(self) -> dict[str, object]:
        """Return plain data for ``icu/@rpc/modes``."""
        return {
            **self.event(),
            "target": self.target,
            "holder": self.holder,
            "switch_s": self.sensor.switch_s,
            "modes": {name: mode.model_dump() for name, mode in self.sensor.modes.items()},
            "transitions": {mode: self.sensor.transitions_from(mode) for mode in self.sensor.modes},
        }

    def event(self) -> dict[str, object]:
        """Return the body of ``event/sensor_mode``."""
        current = self.sensor.modes[self.mode].model_dump(exclude={"doc"})
        body = {"sensor": self.name, "mode": self.mode, "state": self.state, **current, "reason": self.lost}
        return body | ({"on": False} if self.lost else {})
