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
from cdff_common.interfaces.profile import load_profile
from cdff_common.process import run_service
from cdff_core.orchestration.request import parse_robot
from services.icu.unit import Faults, SimulatedIcu

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
    args = parser.parse_args(argv)

    def body(stop: threading.Event) -> None:
        profile = load_profile(args.profile)
        with Bus.open(args.connect, name="icu", wait_s=None, stop=stop) as bus:
            faults = Faults.of_text(args.faults)
            unit = SimulatedIcu(profile, lambda robot, event: _publish(bus, robot, event), faults)
            scopes = (*profile.robot_ids, keys.GROUND)
            for scope in scopes:
                for verb, handler, workers in (
                    ("modes", _modes, 4),
                    ("set_mode", _set_mode, 8),
                    ("fault", _fault, 4),
                ):
                    answer = partial(handler, unit)
                    bus.serve(keys.icu_rpc(scope, verb), answer, workers=workers, busy_limit_s=_BUSY_LIMIT_S)
            add_check(bus.loops.problem)
            for scope in scopes:
                bus.declare_alive(scope, "icu")
            logger.info("simulated instrument control unit of %s, %s", ", ".join(unit.robots), faults)
            stop.wait()
            unit.close()

    return run_service("icu", body)


def _publish(bus: Bus, robot: str, event: Mapping[str, object]) -> None:
    logger.info("sensor mode", extra={"robot": robot, **event})
    bus.publish_map(keys.event(robot, "sensor_mode"), event)


def _modes(unit: SimulatedIcu, request: Request) -> Reply:
    p = RobotParameters.parse(request.parameters)
    return Reply.of(unit.modes(parse_robot(p.robot, request.scope)))


def _set_mode(unit: SimulatedIcu, request: Request) -> Reply:
    p = ModeParameters.parse(request.parameters)
    return Reply.of(unit.set_mode(parse_robot(p.robot, request.scope), p.sensor, p.mode, p.holder))


def _fault(unit: SimulatedIcu, request: Request) -> Reply:
    p = FaultParameters.parse(request.parameters)
    robot = parse_robot(p.robot, request.scope)
    if p.lost:
        unit.lose(robot, p.sensor, p.lost)
    else:
        unit.recover(robot, p.sensor)
    return Reply.of({"robot": robot, "sensor": p.sensor, "lost": p.lost})


if __name__ == "__main__":
    raise SystemExit(main())
