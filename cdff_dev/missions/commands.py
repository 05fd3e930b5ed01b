# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff mission`` and ``cdff drive``."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path
from typing import Any

#: Where missions lie in a checkout; they run from one.
DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


def register(nouns: Any) -> None:
    """Add ``cdff mission`` and ``cdff drive``."""
    parser = nouns.add_parser("mission", help="run a simulated mission: rovers that are told where to go, and a score")
    parser.add_argument("mission", help="a shipped mission's name (long_traverse_navigation) or a mission file (.yaml)")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write a page of what came out, as mission.html")
    parser.add_argument("--seed", type=int, help="replaces the scenario's seed: other ground, other errors")
    parser.add_argument("--speed", type=float, metavar="X", help="mission seconds per second (default: the mission's)")
    parser.add_argument("--http", default="127.0.0.1:8080", metavar="HOST:PORT")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", help="endpoint of the router")
    parser.add_argument("--data-dir", help="keep the products there; default: a fresh folder, removed at the end")
    parser.add_argument("--json", action="store_true", help="say the score as JSON")
    parser.set_defaults(run=_mission, parser=parser)
    parser = nouns.add_parser("drive", help="simulate rovers that take orders, with the mission clock")
    parser.add_argument("scenario", help="a shipped scenario's name or a scenario file (.yaml)")
    parser.add_argument("--seed", type=int, help="replaces the scenario's seed")
    parser.add_argument("--speed", type=float, default=1.0, metavar="X", help="mission seconds per second (default 1)")
    parser.add_argument(
        "--patience", type=float, metavar="S", help="hold the clock while a DFPC is S mission seconds behind"
    )
    parser.add_argument("--truth", type=Path, metavar="LOG", help="write the true poses there, a folder")
    parser.add_argument("--connect", help="the router's endpoint (default: CDFF_CONNECT)")
    parser.set_defaults(run=_drive, parser=parser)


def _mission(args: argparse.Namespace) -> int:
    import json
    import signal

    from cdff_common.errors import ConfigurationError
    from cdff_common.output import check_file, make_folder
    from cdff_dev.missions.run import run
    from cdff_dev.missions.script import load_mission

    shipped = DEPLOY / "missions"
    path = Path(args.mission) if args.mission.endswith((".yaml", ".yml")) else shipped / f"{args.mission}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in shipped.glob("*.yaml")))
        raise ConfigurationError(f"mission {args.mission!r}: no file {path}; shipped are {known}")
    mission = load_mission(path)
    if args.speed is not None and not 0.0 < args.speed <= 100.0:
        raise ConfigurationError(f"--speed {args.speed:g}: expected above 0, at most 100")
    if args.report is not None:
        check_file(args.report)
    data_dir = None if args.data_dir is None else make_folder(Path(args.data_dir))
    if data_dir is not None and any(data_dir.iterdir()):
        raise ConfigurationError(f"--data-dir {data_dir}: expected an empty folder")
    # Both Ctrl-C and SIGTERM interrupt whatever the main thread does, and the stage is left in order.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    say = (lambda _text: None) if args.json else (lambda text: print(text, flush=True))
    result = run(mission, DEPLOY, (args.connect, args.http, data_dir), args.seed, args.speed, say)
    faults = result.faults()
    for line in (*result.score.lines(), *result.remarks, *(f"FAIL {fault}" for fault in faults)):
        say(line)
    if args.json:
        told = {"mission": path.stem, "guided": mission.judged.guided, "faults": faults, "remarks": result.remarks}
        print(json.dumps(told | {"score": result.score.to_dict()}, allow_nan=False))
    if args.report is not None:
        from cdff_dev.missions.report import write

        write(args.report, path.stem, result)
        say(f"the report is in {args.report}")
    return int(bool(faults))


def _drive(args: argparse.Namespace) -> int:
    from contextlib import ExitStack

    from cdff_common.bus import Bus
    from cdff_common.output import make_folder
    from cdff_common.process import run_service
    from cdff_dev.logs import LogWriter
    from cdff_dev.missions import orders
    from cdff_dev.missions.driven import Driven
    from cdff_dev.play.player import Player
    from cdff_dev.simulate.scenario import load_scenario
    from cdff_dev.simulate.world import make_world

    def body(stop: threading.Event) -> None:
        world = make_world(load_scenario(args.scenario, args.seed))
        with ExitStack() as stack:
            truth = None if args.truth is None else stack.enter_context(LogWriter(make_folder(args.truth)))
            driven = Driven(world, truth)
            bus = stack.enter_context(Bus.open(args.connect, name="simulator"))
            orders.serve(bus, driven)
            player = Player(
                bus, driven, args.speed, None, args.patience, ready_ns=driven.ready_ns, ahead_bytes=driven.ahead_bytes
            )
            try:
                player.run(stop)
            finally:
                driven.close()

    return run_service("simulator", body)
