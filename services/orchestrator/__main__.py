# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator as a process.

python -m services.orchestrator --profile FILE [--connect tcp/127.0.0.1:7447] [--data-dir DIR]
"""

from __future__ import annotations

import argparse
import threading

from cdff_common.bus import Bus, keys
from cdff_common.cli import add_connect_option, add_profile_option
from cdff_common.heartbeat import add_check
from cdff_common.interfaces.profile import load_profile, profile_of_scope, scopes_of
from cdff_common.memory import freeze_heap
from cdff_common.output import make_folder
from cdff_common.process import cap_threads, data_dir_of, lock_file, run_service
from services.alarm_reporter import AlarmReporter
from services.memory_budget import memory_budget_mb, memory_check
from services.orchestrator.leader import ProcessIdentity, claim
from services.orchestrator.service import CAPACITY, Orchestrator
from services.robot_roster import RobotRoster
from services.warming import load_formats


def main(argv: list[str] | None = None) -> int:
    """Serve requests until SIGTERM."""
    cap_threads(1)
    parser = argparse.ArgumentParser(prog="orchestrator", description=__doc__)
    add_profile_option(parser, required=True)
    add_connect_option(parser)
    parser.add_argument(
        "--data-dir", help="folder of the journal; default: CDFF_DATA_DIR, else ~/.local/share/cdff"
    )
    parser.add_argument(
        "--capacity",
        type=int,
        default=CAPACITY,
        help=f"largest number of open requests; default: {CAPACITY}",
    )
    parser.add_argument(
        "--scope",
        default="",
        metavar="ROBOT|ground",
        help="robot of this orchestrator, or ground if robots have their own; default: all robots and ground",
    )
    args = parser.parse_args(argv)

    def body(stop: threading.Event) -> None:
        profile = profile_of_scope(load_profile(args.profile), args.scope)
        load_formats()
        with Bus.open(args.connect, name="orchestrator", wait_s=None, stop=stop) as bus:
            name = "_".join(("orchestrator", args.scope)) if args.scope else "orchestrator"
            folder = make_folder(data_dir_of(args.data_dir) / name)
            # Before the journal is opened: the current leader may write it.
            owner = str(ProcessIdentity.own())
            lock_file(
                folder / "lock", owner, lambda other: f"{folder} belongs to another orchestrator, {other}"
            )
            claim(
                bus, (keys.GROUND,) if args.scope == keys.GROUND else scopes_of(profile.robot_ids, args.scope)
            )
            orchestrator = Orchestrator(
                bus, profile, folder / "journal.jsonl", args.capacity, scope=args.scope
            )
            add_check(orchestrator.loops.problem)
            add_check(bus.loops.problem)
            alarms, loop = orchestrator.alarms, orchestrator.loops.add("alarms")
            checks = (
                memory_check(alarms, "orchestrator", memory_budget_mb()),
                orchestrator.mode_alarms.update,
            )
            reporter = AlarmReporter(bus, args.scope or keys.GROUND, "orchestrator", alarms, loop, checks)
            roster = RobotRoster(bus, profile, orchestrator, orchestrator.loops)
            try:
                orchestrator.start()
                roster.start()
                freeze_heap()
                stop.wait()
            finally:
                roster.close()
                reporter.close()
                orchestrator.close()

    return run_service("orchestrator", body)


if __name__ == "__main__":
    raise SystemExit(main())
