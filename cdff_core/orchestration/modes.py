# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State machine of the modes of a sensor: steady, switching or lost.

The profile declares the allowed transitions and their duration (``Sensor.transitions``). The caller passes
the time (monotonic seconds), so that the simulated unit and replay share the machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from cdff_common.errors import (
    ConflictError,
    DeniedError,
    InputError,
    ProductNotFoundError,
    UnavailableError,
)
from cdff_common.interfaces.sensor_profile import Sensor

#: Properties of a mode that its events do not repeat.
_NOT_IN_EVENTS = {"doc", "power_w", "heat_w", "data_mb_h", "acquire_s", "energy_j", "parameters"}
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
class AcquisitionRun:
    """A demanded single acquisition, from the demand to the return to the previous mode.

    Attributes
    ----------
    duration_s : float
        Seconds from the mode of the acquisition to its end.
    return_mode : str
        Mode before it.
    end_s : float or None
        When it ends, monotonic seconds; None before it has begun.
    is_done : bool
        True once it has ended as demanded.
    """

    duration_s: float
    return_mode: str
    end_s: float | None = None
    is_done: bool = False


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
    acquisitions: int = 0  # number of single acquisitions that have begun
    parameters: dict[str, float] = field(default_factory=dict)  # of the last acquisition
    #: Single acquisition that is demanded and has not ended; None without one.
    acquisition: AcquisitionRun | None = None

    def __post_init__(self) -> None:
        self.mode = self.mode or self.sensor.initial_mode

    @property
    def state(self) -> str:
        """``steady``, ``switching`` or ``lost``."""
        if self.lost:
            return "lost"
        return "steady" if self.target is None else "switching"

    def demand(
        self,
        mode: str,
        holder: str,
        now_s: float,
        slowness: float = 1.0,
        parameters: Mapping[str, float] = MappingProxyType({}),
    ) -> bool:
        """Demand a mode; return whether a switch is in progress afterwards.

        ``slowness`` is a factor on the declared durations, which a simulated unit varies. ``parameters`` are
        those of a mode for single acquisitions: each demand of such a mode is another acquisition. Raises
        InputError for parameters that the mode does not have, ConflictError during an acquisition,
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
        acquires = self.sensor.modes[mode].acquires is not None
        fault = self.sensor.modes[mode].acquisition_fault(parameters) if acquires or parameters else ""
        if fault:
            raise InputError(f"sensor {self.name} mode {mode}: {fault}")
        if self.is_acquiring:
            raise ConflictError(f"sensor {self.name} acquires for {self.holder}; repeat the demand")
        self.refusal = ""
        if acquires:
            return self._demand_acquisition(mode, holder, now_s, slowness, parameters)
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

    @property
    def is_acquiring(self) -> bool:
        """True from the demand of a single acquisition to the return to the previous mode."""
        return self.acquisition is not None

    def _demand_acquisition(
        self, mode: str, holder: str, now_s: float, slowness: float, parameters: Mapping[str, float]
    ) -> bool:
        path = self.sensor.mode_path(self.mode, mode)
        if path is None:
            raise DeniedError(
                f"sensor {self.name} cannot switch from mode {self.mode} to {mode}; it stays in {self.mode}"
            )
        at_s, steps = now_s, []
        for step, duration_s in path or ((mode, 0.0),):
            at_s += slowness * duration_s
            steps.append((step, at_s))
        declared = self.sensor.modes[mode]
        duration_s = slowness * declared.acquisition_s(parameters, self.parameters)
        values = {name: p.initial for name, p in declared.parameters.items()}
        self.parameters = {**values, **parameters}
        self.acquisition = AcquisitionRun(duration_s, self.mode)
        self.holder, self.target, self.steps = holder, mode, tuple(steps)
        return True

    def next_s(self) -> float | None:
        """Return the time of the next change, monotonic seconds; None in a steady state."""
        if self.steps:
            return self.steps[0][1]
        return None if self.acquisition is None else self.acquisition.end_s

    def settle(self, now_s: float) -> bool:
        """Confirm the next mode if its time is reached; return whether the mode changed."""
        at_s = self.next_s()
        if at_s is None or now_s < at_s:
            return False
        if not self.steps and self.acquisition is not None:
            self.mode, self.acquisition.is_done, self.acquisition = self.acquisition.return_mode, True, None
            return True
        (self.mode, _), *remaining_steps = self.steps
        self.steps = tuple(remaining_steps)
        if not remaining_steps:
            self.target = None
            if self.acquisition is not None:
                self.acquisitions += 1
                self.acquisition.end_s = at_s + self.acquisition.duration_s
        return True

    def refuse(self, reason: str) -> None:
        """End a switch with a reason; the sensor stays in the last confirmed mode."""
        if self.target is not None:
            self.target, self.steps, self.acquisition, self.refusal = None, (), None, reason

    def fail(self, reason: str) -> None:
        """Mark the sensor as lost for a reason."""
        self.target, self.steps, self.acquisition, self.lost = None, (), None, reason

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
        current = self.sensor.modes[self.mode].model_dump(exclude=_NOT_IN_EVENTS)
        if current.pop("acquires") is not None:
            current |= {"acquires": self.sensor.modes[self.mode].acquires, "acquisition": self.acquisitions}
            current |= {"parameters": dict(self.parameters)}
        body = {"sensor": self.name, "mode": self.mode, "state": self.state, **current, "reason": self.lost}
        return body | ({"on": False} if self.lost else {})
