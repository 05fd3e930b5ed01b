# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff simulate``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any


def register(nouns: Any) -> None:
    """Add ``cdff simulate`` to the command line."""
    parser = nouns.add_parser("simulate", help="simulate a scenario to a log")
    parser.add_argument(
        "scenario",
        help="a shipped scenario's name (rover_traverse, orbit_approach) or a scenario file (.yaml)",
    )
    parser.add_argument(
        "--out",
        required=True,
        type=Path,
        metavar="LOG",
        help="folder of the log, or NAME.msg for chunk files NAME_000000000.msg, …",
    )
    parser.add_argument("--seed", type=int, help="replaces the scenario's seed")
    parser.add_argument("--force", action="store_true", help="replace LOG and do not use the cache")
    parser.add_argument(
        "--workers",
        type=int,
        default=2,
        help="number of processes that cast rays (the log does not depend on it)",
    )
    parser.add_argument("--json", action="store_true", help="print a summary as JSON")
    parser.set_defaults(run=_run, parser=parser)


def _run(args: argparse.Namespace) -> int:
    """Simulate a scenario and write its log; return the exit code."""
    from cdff_common.output import make_folder, storage_errors
    from cdff_common.progress import progress_of
    from cdff_dev.simulate.scenario_files import load_any_scenario
    from cdff_dev.simulate.store import cache_folder, check_free, deliver, simulated_log

    scenario = load_any_scenario(args.scenario, args.seed)
    check_free(args.out, args.force)
    make_folder(args.out.parent)  # an error is reported now, not after minutes of simulation
    with storage_errors(cache_folder()):
        log = simulated_log(scenario, max(args.workers, 0), progress_of("images and scans"), fresh=args.force)
    with storage_errors(args.out):
        deliver(log, args.out, args.force)
    robots = list(scenario.robots)
    if args.json:
        summary = {"log": str(args.out), "scenario": scenario.name, "seed": scenario.seed, "robots": robots}
        print(json.dumps({**summary, "duration_s": scenario.duration_s, "scenario_digest": scenario.digest}))
    else:
        print(
            f"{args.out}: {scenario.name}, seed {scenario.seed}, {scenario.duration_s:g} s of "
            f"{', '.join(robots)}"
        )
    return 0
