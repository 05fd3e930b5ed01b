# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated unit: mode machines of all sensors of some robots, one lock, switches that take their time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

from cdff_common.clock import monotonic_s
from cdff_common.errors import ConflictError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.modes import ModeMachine

#: Called with robot and event body when a mode is confirmed.
OnMode = Callable[[str, Mapping[str, object]], None]


class SimulatedIcu:
    """Sensor modes of every robot of a profile.

    Parameters
    ----------
    profile : Profile
    on_mode : callable
        Told of every confirmed change.
    """

    def __init__(self, profile: Profile, on_mode: OnMode) -> None:
        self._machines = {
            (robot.id, name): ModeMachine(name, sensor)
            for robot in profile.robots
            for name, sensor in robot.sensors.items()
        }
        self._on_mode = on_mode
        self._changed = threading.Condition()
        self._closed = False

    def modes(self, robot: str) -> dict[str, Any]:
        """Every sensor of a robot: its mode, whether it switches, the modes it has."""
        self._settle()
        with self._changed:
            found = {name: m.describe() for (owner, name), m in self._machines.items() if owner == robot}
        if not found:
            raise ProductNotFoundError(f"no robot {robot!r} with sensors; there are {', '.join(self.robots)}")
        return {"robot": robot, "sensors": found}

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
            If the unit shuts down meanwhile.
        """
        machine = self._machines.get((robot, sensor))
        if machine is None:
            known = ", ".join(name for owner, name in self._machines if owner == robot)
            raise ProductNotFoundError(f"no sensor {sensor!r} on {robot}; it has {known or 'none'}")
        with self._changed:
            machine.demand(mode, holder, monotonic_s())
            self._changed.notify_all()
        while True:
            self._settle()
            with self._changed:
                if self._closed:
                    raise UnavailableError("the instrument control unit is shutting down")
                if machine.target is None and machine.mode == mode:
                    return {"robot": robot, "confirmed": True, **machine.event()}
                if machine.target != mode:
                    raise ConflictError(
                        f"sensor {sensor}: {machine.holder or 'somebody'} demanded another mode meanwhile"
                    )
                self._changed.wait(max(machine.ready_at_s - monotonic_s(), 0.001))

    def close(self) -> None:
        """Let every waiting call go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _settle(self) -> None:
        """Confirm the switches whose time is over, and tell."""
        with self._changed:
            done = [(robot, m.event()) for (robot, _), m in self._machines.items() if m.settle(monotonic_s())]
            if done:
                self._changed.notify_all()
        for robot, body in done:
            self._on_mode(robot, body)
