# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A sensor's modes as the instrument control unit runs them: steady in one, switching to another, or lost.

Which mode may follow which, and how long that takes, is declared in the profile (``Sensor.transitions``). Time is given
by the caller (monotonic seconds), so that a simulated unit, a real one's proxy and replay share it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cdff_common.errors import DeniedError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.profile import Sensor

#: (state, what happens) -> state of a sensor. ``demand`` is asked for, the others happen.
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
    """The modes of one sensor.

    Attributes
    ----------
    sensor : Sensor
        Entry of the profile: modes, what may follow what and when, refused modes.
    mode : str
        Last confirmed mode.
    target : str or None
        Mode it is switching to.
    steps : tuple of (str, float)
        Modes still to pass on the way to the target, and when each is reached, monotonic seconds.
    holder : str
        Who asked last.
    refusal : str
        Why the last switch was refused on its way; empty where it was not.
    lost : str
        Why the sensor cannot be had; empty where it can.
    """

    name: str
    sensor: Sensor
    mode: str = ""
    target: str | None = None
    steps: tuple[tuple[str, float], ...] = ()
    holder: str = ""
    refusal: str = ""
    lost: str = ""

    def __post_init__(self) -> None:
        self.mode = self.mode or self.sensor.initial_mode

    @property
    def state(self) -> str:
        """``steady``, ``switching`` or ``lost``."""
        if self.lost:
            return "lost"
        return "steady" if self.target is None else "switching"

    @property
    def ready_at_s(self) -> float:
        """When the switch is over, monotonic seconds; 0 where none is under way."""
        return self.steps[-1][1] if self.steps else 0.0

    def demand(self, mode: str, holder: str, now_s: float, slowness: float = 1.0) -> bool:
        """Ask for a mode; returns whether a switch is under way afterwards.

        Parameters
        ----------
        mode, holder : str
        now_s : float
            Monotonic clock, seconds.
        slowness : float
            What the declared times are multiplied by: a simulated unit varies them.

        Raises
        ------
        ProductNotFoundError
            If the sensor has no such mode.
        DeniedError
            If it refuses it, or has no way to it from the mode it is in.
        UnavailableError
            If it is lost.
        """
        if mode not in self.sensor.modes:
            known = ", ".join(self.sensor.modes)
            raise ProductNotFoundError(f"sensor {self.name} has no mode {mode!r}; it has {known}")
        if self.lost:
            raise UnavailableError(f"sensor {self.name} is lost: {self.lost}")
        if mode in self.sensor.refuses:
            raise DeniedError(f"sensor {self.name} refuses mode {mode!r} now; it stays in {self.mode}")
        self.refusal = ""
        if mode == self.target or (mode == self.mode and self.target is None):
            self.holder = holder
            return self.target is not None
        way = self.sensor.way(self.mode, mode)
        if way is None:
            raise DeniedError(f"sensor {self.name} has no way from mode {self.mode} to {mode}; it stays in {self.mode}")
        # Turning back on the way takes as long as a change does.
        at_s, steps = now_s, []
        for step, takes_s in way or ((mode, self.sensor.switch_s),):
            at_s += slowness * takes_s
            steps.append((step, at_s))
        self.holder, self.target, self.steps = holder, mode, tuple(steps)
        return True

    def settle(self, now_s: float) -> bool:
        """Confirm the next mode on the way whose time has come; returns whether the mode changed just now."""
        if not self.steps or now_s < self.steps[0][1]:
            return False
        (self.mode, _), *rest = self.steps
        self.steps = tuple(rest)
        if not rest:
            self.target = None
        return True

    def refuse(self, reason: str) -> None:
        """End a switch where it is: the sensor stays in the last confirmed mode."""
        if self.target is not None:
            self.target, self.steps, self.refusal = None, (), reason

    def fail(self, reason: str) -> None:
        """Lose the sensor: no mode of it can be relied on."""
        self.target, self.steps, self.lost = None, (), reason

    def recover(self) -> None:
        """Have it back, in its initial mode."""
        self.lost, self.mode = "", self.sensor.initial_mode

    def describe(self) -> dict[str, object]:
        """Plain data for ``icu/@rpc/modes``."""
        return {
            **self.event(),
            "target": self.target,
            "holder": self.holder,
            "switch_s": self.sensor.switch_s,
            "modes": {name: mode.model_dump() for name, mode in self.sensor.modes.items()},
            "transitions": {mode: self.sensor.following(mode) for mode in self.sensor.modes},
        }

    def event(self) -> dict[str, object]:
        """Body of ``event/sensor_mode``."""
        current = self.sensor.modes[self.mode].model_dump(exclude={"doc"})
        body = {"sensor": self.name, "mode": self.mode, "state": self.state, **current, "reason": self.lost}
        return body | ({"on": False} if self.lost else {})
