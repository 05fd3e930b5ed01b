# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated unit: mode machines of all sensors of some robots, one lock, switches that take their time.

It says of itself that it is simulated. How far its switches stray from the declared times, and how often one is refused
on its way, are ``Faults``, drawn from a seed: each sensor has a sequence of its own, so that one's draws do not depend
on when another is asked.
"""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.clock import monotonic_s
from cdff_common.errors import ConflictError, DeniedError, InputError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.modes import ModeMachine

#: Called with robot and event body when a mode is confirmed, a sensor lost or back.
OnMode = Callable[[str, Mapping[str, object]], None]


@dataclass(frozen=True, slots=True)
class Faults:
    """What a simulated unit does beside what is declared.

    Attributes
    ----------
    seed : int
    spread : float
        Times are multiplied by a lognormal factor of this standard deviation of its logarithm.
    refuses : float
        Part of the switches, 0 to 1, that are refused when they should be confirmed.
    """

    seed: int = 0
    spread: float = 0.0
    refuses: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Faults:
        """Read ``seed=1,spread=0.2,refuses=0.05``; raises InputError."""
        given: dict[str, float] = {}
        for part in filter(None, text.split(",")):
            name, _, value = part.partition("=")
            if name not in ("seed", "spread", "refuses"):
                raise InputError(f"faults {part!r}: expected seed=, spread= or refuses=")
            try:
                given[name] = float(value)
            except ValueError as error:
                raise InputError(f"faults {part!r}: expected a number") from error
        faults = cls(int(given.get("seed", 0)), given.get("spread", 0.0), given.get("refuses", 0.0))
        if not (0.0 <= faults.spread <= 2.0 and 0.0 <= faults.refuses <= 1.0):
            raise InputError(f"faults {text!r}: expected spread from 0 to 2, refuses from 0 to 1")
        return faults


class SimulatedIcu:
    """Sensor modes of every robot of a profile.

    Parameters
    ----------
    profile : Profile
    on_mode : callable
        Told of every confirmed change, and of sensors lost and back.
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
        self._machines = {
            (robot.id, name): ModeMachine(name, sensor)
            for robot in profile.robots
            for name, sensor in robot.sensors.items()
        }
        self.faults = faults or Faults()
        self._random = {key: random.Random(f"{self.faults.seed}/{key[0]}/{key[1]}") for key in self._machines}
        self._will_refuse: set[tuple[str, str]] = set()
        self._on_mode = on_mode
        self._now_s = clock
        self._changed = threading.Condition()
        self._closed = False

    def modes(self, robot: str) -> dict[str, Any]:
        """Every sensor of a robot: its mode, whether it switches, the modes it has."""
        self._settle()
        with self._changed:
            found = {name: m.describe() for (owner, name), m in self._machines.items() if owner == robot}
        if not found:
            raise ProductNotFoundError(f"no robot {robot!r} with sensors; there are {', '.join(self.robots)}")
        return {"robot": robot, "simulated": True, "sensors": found}

    @property
    def robots(self) -> tuple[str, ...]:
        """Robots with sensors."""
        return tuple(sorted({robot for robot, _ in self._machines}))

    def set_mode(self, robot: str, sensor: str, mode: str, holder: str) -> dict[str, Any]:
        """Set a mode and return once it is confirmed.

        Raises
        ------
        ProductNotFoundError
            If there is no such sensor or mode.
        DeniedError
            If the sensor refuses the mode.
        ConflictError
            If somebody demanded another mode before this one was reached.
        UnavailableError
            If the sensor is lost, or the unit shuts down meanwhile.
        """
        machine = self.demand(robot, sensor, mode, holder)
        while True:
            self._settle()
            with self._changed:
                if self._closed:
                    raise UnavailableError("the instrument control unit is shutting down")
                if machine.lost:
                    raise UnavailableError(f"sensor {sensor} is lost: {machine.lost}")
                if machine.target is None and machine.refusal:
                    raise DeniedError(f"sensor {sensor}: {machine.refusal}; it stays in {machine.mode}")
                if machine.target is None and machine.mode == mode:
                    return {"robot": robot, "confirmed": True, **machine.event()}
                if machine.target != mode:
                    raise ConflictError(
                        f"sensor {sensor}: {machine.holder or 'somebody'} demanded another mode meanwhile"
                    )
                self._changed.wait(max(machine.steps[0][1] - self._now_s(), 0.001))

    def demand(self, robot: str, sensor: str, mode: str, holder: str) -> ModeMachine:
        """Begin a switch; the machine that runs it. Raises as ``set_mode``."""
        key = (robot, sensor)
        with self._changed:
            machine = self._machine(*key)
            before, r = machine.steps, self._random[key]
            slowness = r.lognormvariate(0.0, self.faults.spread) if self.faults.spread else 1.0
            under_way = machine.demand(mode, holder, self._now_s(), slowness)
            if under_way and machine.steps != before:
                (self._will_refuse.add if r.random() < self.faults.refuses else self._will_refuse.discard)(key)
            self._changed.notify_all()
        return machine

    def lose(self, robot: str, sensor: str, reason: str) -> None:
        """Lose a sensor, as by a fault of its power or its link."""
        self._happens(robot, sensor, lambda machine: machine.fail(reason))

    def recover(self, robot: str, sensor: str) -> None:
        """Have a lost sensor back, in its initial mode."""
        self._happens(robot, sensor, lambda machine: machine.recover())

    def close(self) -> None:
        """Let every waiting call go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _machine(self, robot: str, sensor: str) -> ModeMachine:
        machine = self._machines.get((robot, sensor))
        if machine is None:
            known = ", ".join(name for owner, name in self._machines if owner == robot)
            raise ProductNotFoundError(f"no sensor {sensor!r} on {robot}; it has {known or 'none'}")
        return machine

    def _happens(self, robot: str, sensor: str, what: Callable[[ModeMachine], None]) -> None:
        with self._changed:
            machine = self._machine(robot, sensor)
            what(machine)
            body = machine.event()
            self._changed.notify_all()
        self._on_mode(robot, body)

    def _settle(self) -> None:
        """Confirm (or refuse) the switches whose time is over, and tell."""
        now_s = self._now_s()
        done = []
        with self._changed:
            for key, machine in self._machines.items():
                while machine.steps and now_s >= machine.steps[0][1]:
                    if key in self._will_refuse:
                        self._will_refuse.discard(key)
                        machine.refuse(f"simulated refusal of mode {machine.target}")
                    elif machine.settle(now_s):
                        done.append((key[0], machine.event()))
            self._changed.notify_all()
        for robot, body in done:
            self._on_mode(robot, body)
