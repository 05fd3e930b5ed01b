# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated unit: the mode machines of all sensors of some robots.

Its replies state that it is simulated. ``Faults`` define the variation of the switching times and the rate of
refusals, drawn from a seed: each sensor has its own random sequence, independent of the others.
"""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from cdff_common.cli import key_values
from cdff_common.clock import monotonic_s
from cdff_common.contract.parameters import Number, Parameters, Whole
from cdff_common.errors import ConflictError, DeniedError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.profile import Profile, Robot
from cdff_core.orchestration.modes import AcquisitionRun, ModeMachine

#: Called with robot and event body when a mode is confirmed, or a sensor is lost or recovered.
OnMode = Callable[[str, Mapping[str, object]], None]


class Faults(Parameters):
    """Deviations of a simulated unit from its declaration.

    Attributes
    ----------
    seed : int
    spread : float
        Standard deviation of the logarithm of the lognormal factor on switching times.
    refuses : float
        Fraction of the switches that are refused, 0 to 1.
    """

    seed: Whole = 0
    spread: Annotated[Number, Field(ge=0, le=2)] = 0.0
    refuses: Annotated[Number, Field(ge=0, le=1)] = 0.0

    @classmethod
    def of_text(cls, text: str) -> Faults:
        """Return the faults in ``seed=1,spread=0.2,refuses=0.05``; raises InputError."""
        return cls.parse(
            key_values([x for x in text.split(",") if x], "faults", "seed=, spread= or refuses=")
        )


@dataclass(frozen=True, slots=True)
class DemandedMode:
    """A demanded mode with the machine of its sensor, its acquisition if it has one, and its start (monotonic
    seconds).
    """

    robot: str
    sensor: str
    mode: str
    machine: ModeMachine
    acquisition: AcquisitionRun | None
    started_s: float


class SimulatedIcu:
    """Sensor modes of every robot of a profile.

    Parameters
    ----------
    profile : Profile
    on_mode : callable
        Called at every confirmed change, and when a sensor is lost or recovered.
    faults : Faults
    clock : callable
        Monotonic seconds.
    """

    def __init__(
        self,
        profile: Profile,
        on_mode: OnMode,
        faults: Faults | None = None,
        clock: Callable[[], float] = monotonic_s,
    ) -> None:
        self.faults = faults or Faults()
        self._machines: dict[tuple[str, str], ModeMachine] = {}
        self._random: dict[tuple[str, str], random.Random] = {}
        self._will_refuse: set[tuple[str, str]] = set()
        self._on_mode = on_mode
        self._now_s = clock
        self._changed = threading.Condition()
        self._closed = False
        for robot in profile.robots:
            self.set_robot(robot)

    def set_robot(self, robot: Robot) -> None:
        """Add or replace the sensors of a robot; sensors with the same description keep their mode."""
        with self._changed:
            machines = {}
            for name, sensor in robot.sensors.items():
                key = (robot.id, name)
                machine = self._machines.get(key)
                is_same = machine is not None and machine.sensor == sensor
                machines[key] = machine if machine is not None and is_same else ModeMachine(name, sensor)
                self._random.setdefault(key, random.Random(f"{self.faults.seed}/{robot.id}/{name}"))
            # A new table: others iterate over the present one.
            others = {key: m for key, m in self._machines.items() if key[0] != robot.id}
            self._machines = {**others, **machines}
            self._changed.notify_all()

    def remove_robot(self, robot: str) -> None:
        """Remove the sensors of a robot."""
        with self._changed:
            self._machines = {key: m for key, m in self._machines.items() if key[0] != robot}
            self._random = {key: r for key, r in self._random.items() if key[0] != robot}
            self._changed.notify_all()

    def modes(self, robot: str) -> dict[str, Any]:
        """Return the sensors of a robot with their state and modes."""
        self._settle()
        with self._changed:
            sensors = {name: m.describe() for (owner, name), m in self._machines.items() if owner == robot}
        if not sensors:
            raise ProductNotFoundError(f"no robot {robot!r} with sensors; there are {', '.join(self.robots)}")
        return {"robot": robot, "simulated": True, "sensors": sensors}

    @property
    def robots(self) -> tuple[str, ...]:
        """Ids of the robots with sensors."""
        return tuple(sorted({robot for robot, _ in self._machines}))

    def set_mode(
        self, robot: str, sensor: str, mode: str, holder: str, parameters: Mapping[str, float] | None = None
    ) -> dict[str, Any]:
        """Set a mode and return once it is confirmed; a single acquisition, once it has ended.

        Raises
        ------
        ProductNotFoundError
            If there is no such sensor or mode.
        DeniedError
            If the sensor refuses the mode.
        ConflictError
            If another mode was demanded before this one was reached.
        UnavailableError
            If the sensor is lost, an acquisition is interrupted, or the unit shuts down.
        """
        demanded = self.demand(robot, sensor, mode, holder, parameters)
        while True:
            self._settle()
            with self._changed:
                answer = self._answer(demanded)
                if answer is not None:
                    return answer
                self._wait(demanded.machine)

    def outcome(self, demanded: DemandedMode) -> dict[str, Any] | None:
        """Return the answer to a demand; None while the sensor switches or acquires.

        Raises like ``set_mode``.
        """
        self._settle()
        with self._changed:
            return self._answer(demanded)

    def _answer(self, demanded: DemandedMode) -> dict[str, Any] | None:
        robot, sensor, mode = demanded.robot, demanded.sensor, demanded.mode
        machine, acquisition = demanded.machine, demanded.acquisition
        if self._closed:
            raise UnavailableError("the instrument control unit is shutting down")
        if self._machines.get((robot, sensor)) is not machine:
            raise UnavailableError(f"sensor {sensor}: its description was replaced; repeat the demand")
        if acquisition is not None and acquisition.is_done:
            return _acquired(demanded, self._now_s() - demanded.started_s)
        if machine.lost:
            raise UnavailableError(f"sensor {sensor} is lost: {machine.lost}")
        if machine.target is None and machine.refusal:
            raise DeniedError(f"sensor {sensor}: {machine.refusal}; it stays in {machine.mode}")
        if acquisition is not None:
            if machine.acquisition is not acquisition:
                raise UnavailableError(f"sensor {sensor}: the acquisition was interrupted; repeat it")
            return None
        if machine.target is None and machine.mode == mode:
            return {"robot": robot, "confirmed": True, **machine.event()}
        if machine.target != mode:
            raise ConflictError(
                f"sensor {sensor}: {machine.holder or 'another client'} demanded another mode"
            )
        return None

    def _wait(self, machine: ModeMachine) -> None:
        """Wait for a change, at most until the next one of a sensor is due."""
        next_s = machine.next_s()
        if next_s is not None:
            self._changed.wait(max(next_s - self._now_s(), 0.001))

    def demand(
        self, robot: str, sensor: str, mode: str, holder: str, parameters: Mapping[str, float] | None = None
    ) -> DemandedMode:
        """Start a switch or an acquisition. Raises like ``set_mode``."""
        key = (robot, sensor)
        with self._changed:
            machine = self._machine(*key)
            before, rng = machine.steps, self._random[key]
            slowness = rng.lognormvariate(0.0, self.faults.spread) if self.faults.spread else 1.0
            is_switching = machine.demand(mode, holder, self._now_s(), slowness, parameters or {})
            if is_switching and machine.steps != before:
                (self._will_refuse.add if rng.random() < self.faults.refuses else self._will_refuse.discard)(
                    key
                )
            self._changed.notify_all()
            return DemandedMode(robot, sensor, mode, machine, machine.acquisition, self._now_s())

    def lose(self, robot: str, sensor: str, reason: str) -> None:
        """Mark a sensor as lost, as by a fault of its power or link."""
        self._apply(robot, sensor, lambda machine: machine.fail(reason))

    def recover(self, robot: str, sensor: str) -> None:
        """Recover a lost sensor, in its initial mode."""
        self._apply(robot, sensor, lambda machine: machine.recover())

    def close(self) -> None:
        """End all waiting calls."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _machine(self, robot: str, sensor: str) -> ModeMachine:
        machine = self._machines.get((robot, sensor))
        if machine is None:
            known = ", ".join(name for owner, name in self._machines if owner == robot)
            raise ProductNotFoundError(f"no sensor {sensor!r} on {robot}; it has {known or 'none'}")
        return machine

    def _apply(self, robot: str, sensor: str, event: Callable[[ModeMachine], None]) -> None:
        with self._changed:
            machine = self._machine(robot, sensor)
            event(machine)
            body = machine.event()
            self._changed.notify_all()
        self._on_mode(robot, body)

    def _settle(self) -> None:
        """Confirm or refuse the completed switches, and publish events."""
        now_s = self._now_s()
        events = []
        with self._changed:
            for key, machine in self._machines.items():
                while (due_s := machine.next_s()) is not None and now_s >= due_s:
                    if machine.steps and key in self._will_refuse:
                        self._will_refuse.discard(key)
                        machine.refuse(f"simulated refusal of mode {machine.target}")
                    elif machine.settle(now_s):
                        events.append((key[0], machine.event()))
            self._changed.notify_all()
        for robot, body in events:
            self._on_mode(robot, body)


def _acquired(demanded: DemandedMode, duration_s: float) -> dict[str, Any]:
    """Return the answer to the demand of an acquisition that has ended."""
    declared = demanded.machine.sensor.modes[demanded.mode]
    return {
        "robot": demanded.robot,
        "confirmed": True,
        **demanded.machine.event(),
        "mode": demanded.mode,
        "duration_s": round(duration_s, 3),
        "energy_j": round(declared.acquisition_j(duration_s), 3),
    }
