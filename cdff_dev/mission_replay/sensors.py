# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The instrument control unit (ICU) of a mission replay: ``SimulatedIcu`` in virtual time."""

from __future__ import annotations

from collections.abc import Mapping

from cdff_common.bus import Reply, Request, keys
from cdff_common.contract.acquisition import NOW, AcquisitionParameters
from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.request import parse_robot
from cdff_dev.mission_replay.local_bus import LocalBus
from cdff_dev.mission_replay.virtual import Scheduler
from cdff_dev.play.gate import SensorGate
from services.icu.unit import SimulatedIcu


class ReplayedIcu:
    """ICU of all robots of a profile: it answers ``icu/@rpc/{modes|set_mode}`` and sets the sensor gate."""

    def __init__(self, bus: LocalBus, profile: Profile, scheduler: Scheduler, gate: SensorGate) -> None:
        self._bus, self._scheduler, self._gate = bus, scheduler, gate
        self._unit = SimulatedIcu(profile, self._on_mode, clock=lambda: scheduler.now_s)
        for robot in profile.robots:
            if robot.sensors:
                for name, sensor in self._unit.modes(robot.id)["sensors"].items():
                    gate.set(robot.id, name, sensor)
        for scope in (*profile.robot_ids, keys.GROUND):
            bus.serve(keys.icu_rpc(scope, "modes"), self._modes)
            bus.serve(keys.icu_rpc(scope, "set_mode"), self._set_mode)
            bus.declare_alive(scope, "icu")

    def _modes(self, request: Request) -> Reply:
        return Reply.of(self._unit.modes(parse_robot(request.parameters.get("robot"), request.scope)))

    def _set_mode(self, request: Request) -> Reply:
        """Set a mode and wait in virtual time until it is reached, unlike ``SimulatedIcu.set_mode``."""
        p = request.parameters
        robot = parse_robot(p.get("robot"), request.scope)
        parameters = AcquisitionParameters.parse(p.get("acquire", NOW)).to_dict()
        demanded = self._unit.demand(robot, p["sensor"], p["mode"], p.get("holder", ""), parameters)
        while (answer := self._unit.outcome(demanded)) is None:
            next_s = demanded.machine.next_s() or 0.0
            self._scheduler.sleep(max(next_s - self._scheduler.now_s, 0.001))
        return Reply.of(answer)

    def _on_mode(self, robot: str, event: Mapping[str, object]) -> None:
        self._gate.set(robot, str(event["sensor"]), event)
        self._bus.publish_map(keys.event(robot, "sensor_mode"), event)
