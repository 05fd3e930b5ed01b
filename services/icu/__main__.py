# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated Instrument Control Unit as a process: ``icu/@rpc/{modes|set_mode|fault}`` for every robot of a profile.

python -m services.icu --profile FILE [--connect tcp/127.0.0.1:7447] [--faults seed=1,spread=0.2,refuses=0.05]
"""

from __future__ import annotations

import argparse
import logging
import os
import threading
from collections.abc import Mapping
from pathlib import Path

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import load_profile
from cdff_common.process import run_service
from cdff_core.orchestration.request import parse_robot
from services.icu.unit import Faults, SimulatedIcu

logger = logging.getLogger(__name__)


def main(argv: list[str] | None = None) -> int:
    """Serve sensor modes until SIGTERM."""
    parser = argparse.ArgumentParser(prog="icu", description=__doc__)
    parser.add_argument(
        "--profile", type=Path, default=os.environ.get("CDFF_PROFILE"), required="CDFF_PROFILE" not in os.environ
    )
    parser.add_argument("--connect", default=None)
    parser.add_argument(
        "--faults",
        default=os.environ.get("CDFF_ICU_FAULTS", ""),
        metavar="seed=N,spread=X,refuses=P",
        help="how far switches stray from their declared times, and how many are refused: simulated, from a seed",
    )
    args = parser.parse_args(argv)

    def body(stop: threading.Event) -> None:
        profile = load_profile(args.profile)
        with Bus.open(args.connect, name="icu", wait_s=None, stop=stop) as bus:
            faults = Faults.parse(args.faults)
            unit = SimulatedIcu(profile, lambda robot, event: _tell(bus, robot, event), faults)
            for scope in (*profile.robot_ids, keys.GROUND):
                bus.serve(keys.icu_rpc(scope, "modes"), lambda r: _modes(unit, r))
                bus.serve(keys.icu_rpc(scope, "set_mode"), lambda r: _set_mode(unit, r), workers=8)
                bus.serve(keys.icu_rpc(scope, "fault"), lambda r: _fault(unit, r))
            for scope in (*profile.robot_ids, keys.GROUND):
                bus.declare_alive(scope, "icu")
            logger.info("simulated instrument control unit of %s, %s", ", ".join(unit.robots), faults)
            stop.wait()
            unit.close()

    return run_service("icu", body)


def _tell(bus: Bus, robot: str, event: Mapping[str, object]) -> None:
    logger.info("sensor mode", extra={"robot": robot, **event})
    bus.publish_map(keys.event(robot, "sensor_mode"), event)


def _modes(unit: SimulatedIcu, request: Request) -> Reply:
    _check(request, {"robot"}, set())
    return Reply.of(unit.modes(parse_robot(request.parameters.get("robot"), request.scope)))


def _set_mode(unit: SimulatedIcu, request: Request) -> Reply:
    _check(request, {"robot", "sensor", "mode", "holder"}, {"sensor", "mode"})
    p = request.parameters
    robot = parse_robot(p.get("robot"), request.scope)
    return Reply.of(unit.set_mode(robot, p["sensor"], p["mode"], p.get("holder", "")))


def _fault(unit: SimulatedIcu, request: Request) -> Reply:
    """Lose a sensor, or have it back: what only a simulated unit can be asked for."""
    _check(request, {"robot", "sensor", "lost"}, {"sensor"})
    p = request.parameters
    robot = parse_robot(p.get("robot"), request.scope)
    if p.get("lost"):
        unit.lose(robot, p["sensor"], p["lost"])
    else:
        unit.recover(robot, p["sensor"])
    return Reply.of({"robot": robot, "sensor": p["sensor"], "lost": p.get("lost", "")})


def _check(request: Request, known: set[str], required: set[str]) -> None:
    unknown, missing = sorted(set(request.parameters) - known), sorted(required - set(request.parameters))
    if unknown:
        raise InputError(f"unknown parameter {unknown[0]!r}; known are {', '.join(sorted(known))}")
    if missing:
        raise InputError(f"parameter {missing[0]!r} is missing")


if __name__ == "__main__":
    raise SystemExit(main())
