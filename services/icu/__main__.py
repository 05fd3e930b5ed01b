# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Process of the simulated Instrument Control Unit: ``icu/@rpc/{modes|set_mode|fault}`` for all robots.

python -m services.icu --profile FILE [--connect tcp/127.0.0.1:7447] [--faults seed=1,spread=0.2,refuses=0.05]
"""

from __future__ import annotations

import argparse
import logging
import os
import threading
from collections.abc import Mapping
from functools import partial

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.cli import add_connect_option, add_profile_option
from cdff_common.contract.queries import FaultParameters, ModeParameters, RobotParameters
from cdff_common.heartbeat import add_check
from cdff_common.interfaces.profile import load_profile, profile_of_scope, scopes_of
from cdff_common.interfaces.robot_profile import RobotProfile
from cdff_common.process import run_service
from cdff_core.orchestration.request import parse_robot
from services.icu.unit import Faults, SimulatedIcu
from services.robot_roster import RobotRoster

logger = logging.getLogger(__name__)

#: Time after which a call counts as hung, seconds: longer than a sensor needs to change its mode.
_BUSY_LIMIT_S = 900.0


def main(argv: list[str] | None = None) -> int:
    """Serve sensor modes until SIGTERM."""
    parser = argparse.ArgumentParser(prog="icu", description=__doc__)
    add_profile_option(parser, required=True)
    add_connect_option(parser)
    parser.add_argument(
        "--faults",
        default=os.environ.get("CDFF_ICU_FAULTS", ""),
        metavar="seed=N,spread=X,refuses=P",
        help="seed, relative spread of the switching times, and probability of refusal",
    )
    parser.add_argument(
        "--scope", default="", metavar="ROBOT", help="only the sensors of one robot; default: of all robots"
    )
    args = parser.parse_args(argv)

    def body(stop: threading.Event) -> None:
        profile = profile_of_scope(load_profile(args.profile), args.scope)
        with Bus.open(args.connect, name="icu", wait_s=None, stop=stop) as bus:
            faults = Faults.of_text(args.faults)
            unit = SimulatedIcu(profile, lambda robot, event: _publish(bus, robot, event), faults)
            service = _Service(bus, unit, args.scope)
            scopes = scopes_of(profile.robot_ids, args.scope)
            for scope in scopes:
                service.serve(scope)
            add_check(bus.loops.problem)
            for scope in scopes:
                bus.declare_alive(scope, "icu")
            logger.info("simulated instrument control unit of %s, %s", ", ".join(unit.robots), faults)
            roster = RobotRoster(bus, profile, service, bus.loops)
            roster.start()
            stop.wait()
            roster.close()
            unit.close()

    return run_service("icu", body)


class _Service:
    """Calls of the unit under each scope; robots may join and leave."""

    def __init__(self, bus: Bus, unit: SimulatedIcu, scope: str) -> None:
        self._bus, self._unit, self._scope = bus, unit, scope
        self._scopes: set[str] = set()

    def serve(self, scope: str) -> None:
        """Answer the calls under a scope."""
        self._scopes.add(scope)
        for verb, handler, workers in (
            ("modes", _modes, 4),
            ("set_mode", _set_mode, 8),
            ("fault", _fault, 4),
        ):
            answer = partial(handler, self._unit)
            key = keys.icu_rpc(scope, verb)
            self._bus.serve(key, answer, workers=workers, busy_limit_s=_BUSY_LIMIT_S)

    def set_robot(self, joined: RobotProfile) -> None:
        """Simulate the sensors of a robot that has joined or changed, unless it has a unit of its own."""
        robot = joined.robot.id
        if self._scope not in ("", robot):
            return
        token = keys.alive(robot, "icu")
        if not self._bus.has_token(token) and token in self._bus.alive(token):
            logger.info("robot %s has an instrument control unit of its own", robot)
            return
        self._unit.set_robot(joined.robot)
        if robot not in self._scopes:
            self.serve(robot)
        self._bus.declare_alive(robot, "icu")

    def remove_robot(self, robot: str) -> None:
        """Remove the sensors of a robot that has left."""
        self._unit.remove_robot(robot)
        self._bus.withdraw_token(keys.alive(robot, "icu"))


def _publish(bus: Bus, robot: str, event: Mapping[str, object]) -> None:
    logger.info("sensor mode", extra={"robot": robot, **event})
    bus.publish_map(keys.event(robot, "sensor_mode"), event)


def _modes(unit: SimulatedIcu, request: Request) -> Reply:
    p = RobotParameters.parse(request.parameters)
    return Reply.of(unit.modes(parse_robot(p.robot, request.scope)))


def _set_mode(unit: SimulatedIcu, request: Request) -> Reply:
    parameters = ModeParameters.parse(request.parameters)
    robot = parse_robot(parameters.robot, request.scope)
    return Reply.of(
        unit.set_mode(
            robot, parameters.sensor, parameters.mode, parameters.holder, parameters.acquire.to_dict()
        )
    )


def _fault(unit: SimulatedIcu, request: Request) -> Reply:
    parameters = FaultParameters.parse(request.parameters)
    robot = parse_robot(parameters.robot, request.scope)
    if parameters.lost:
        unit.lose(robot, parameters.sensor, parameters.lost)
    else:
        unit.recover(robot, parameters.sensor)
    return Reply.of({"robot": robot, "sensor": parameters.sensor, "lost": parameters.lost})


if __name__ == "__main__":
    raise SystemExit(main())
