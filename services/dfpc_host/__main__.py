# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DFPC host process.

python -m services.dfpc_host --profile FILE --process NAME      the DFPCs that a profile puts in one process
python -m services.dfpc_host --profile FILE --robot ID --dfpc NAME    one DFPC of a profile
python -m services.dfpc_host --robot ID --dfpc NAME --input PORT=SOURCE…    one DFPC without a profile
"""

from __future__ import annotations

import argparse
import os
import threading
from pathlib import Path
from typing import Any

import yaml

from cdff_common.bus import Bus
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.profile import DfpcEntry, Profile, Robot, load_profile
from cdff_common.process import cap_threads, run_service
from services.dfpc_host.wiring import bare, parse_inputs, rewired


def entries_of(
    profile: Profile, process: str | None, robot: str | None, dfpc: str | None
) -> list[tuple[Robot, DfpcEntry]]:
    """Return what to host; raises ConfigurationError where the profile has no such process or DFPC."""
    if process is not None:
        groups = profile.processes()
        if process not in groups:
            raise ConfigurationError(f"profile {profile.name} has no process {process!r}; it has {', '.join(groups)}")
        return [(profile.robot(robot_id), entry) for robot_id, entry in groups[process]]
    if robot is None or dfpc is None:
        raise ConfigurationError("give --process NAME, or --robot ID and --dfpc NAME")
    return [(profile.robot(robot), profile.robot(robot).dfpc(dfpc))]


def hosted(args: argparse.Namespace) -> list[tuple[Robot, DfpcEntry]]:
    """What the arguments say; raises ConfigurationError where they say too little."""
    inputs = parse_inputs(args.input)
    if args.profile:
        entries = entries_of(load_profile(args.profile), args.process, args.robot, args.dfpc)
        if inputs and args.dfpc is None:
            raise ConfigurationError("--input goes with --dfpc NAME, not with a process of several")
        return [(robot, rewired(entry, inputs)) for robot, entry in entries] if inputs else entries
    if args.robot is None or args.dfpc is None:
        raise ConfigurationError("no profile: give --profile FILE, or --robot ID, --dfpc NAME and --input PORT=SOURCE")
    return [bare(args.robot, args.dfpc, inputs)]


def read_parameters(path: str) -> dict[str, Any]:
    """Return the mapping in a YAML file; raises ConfigurationError where it holds none."""
    try:
        data = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    if not isinstance(data, dict):
        raise ConfigurationError(f"{path}: holds a {type(data).__name__}, expected a mapping of parameters")
    return data


def main(argv: list[str] | None = None) -> int:
    """Host until SIGTERM."""
    parser = argparse.ArgumentParser(prog="dfpc_host", description=__doc__)
    parser.add_argument("--profile", default=os.environ.get("CDFF_PROFILE"))
    parser.add_argument("--process", default=os.environ.get("CDFF_PROCESS"))
    parser.add_argument("--robot")
    parser.add_argument("--dfpc")
    parser.add_argument("--config", help="YAML with parameters instead of the profile's; with --dfpc")
    parser.add_argument("--input", action="append", default=[], metavar="PORT=SOURCE", help="with --dfpc")
    parser.add_argument("--connect", default=None, help="router, as tcp/127.0.0.1:7447 (default: CDFF_CONNECT)")
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        entries = hosted(args)
        if args.config:
            entries = [
                (robot, entry.model_copy(update={"parameters": read_parameters(args.config)}))
                for robot, entry in entries
            ]
        with Bus.open(args.connect, name=args.process or args.dfpc, wait_s=None, stop=stop) as bus:
            from services.dfpc_host.host import DfpcHost  # heavy: after the thread caps

            DfpcHost(bus, entries).run(stop)

    return run_service(args.process or f"{args.robot}_{args.dfpc}", body)


if __name__ == "__main__":
    raise SystemExit(main())
