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

from cdff_common.bus import Bus
from cdff_common.cli import add_connect_option, add_profile_option
from cdff_common.errors import ConfigurationError
from cdff_common.heartbeat import add_check
from cdff_common.interfaces.profile import DfpcEntry, Profile, Robot, load_profile
from cdff_common.interfaces.yaml_file import read_mapping
from cdff_common.process import cap_threads, run_service
from services.dfpc_host.wiring import parse_inputs, standalone_entry, with_inputs
from services.signing import sign_of_environment


def entries_of(
    profile: Profile, process: str | None, robot: str | None, dfpc: str | None
) -> list[tuple[Robot, DfpcEntry]]:
    """Return the DFPCs to host; raises ConfigurationError if the profile lacks the process or DFPC."""
    if process is not None:
        groups = profile.processes()
        if process not in groups:
            raise ConfigurationError(
                f"profile {profile.name} has no process {process!r}; it has {', '.join(groups)}"
            )
        return [(profile.robot(robot_id), entry) for robot_id, entry in groups[process]]
    if robot is None or dfpc is None:
        raise ConfigurationError("give --process NAME, or --robot ID and --dfpc NAME")
    return [(profile.robot(robot), profile.robot(robot).dfpc(dfpc))]


def selected_entries(args: argparse.Namespace) -> list[tuple[Robot, DfpcEntry]]:
    """Return the DFPCs selected by the arguments; raises ConfigurationError if they are incomplete."""
    inputs = parse_inputs(args.input)
    if args.profile:
        entries = entries_of(load_profile(args.profile), args.process, args.robot, args.dfpc)
        if inputs and args.dfpc is None:
            raise ConfigurationError("--input requires --dfpc NAME")
        return [(robot, with_inputs(entry, inputs)) for robot, entry in entries] if inputs else entries
    if args.robot is None or args.dfpc is None:
        raise ConfigurationError(
            "no profile: give --profile FILE, or --robot ID, --dfpc NAME and --input PORT=SOURCE"
        )
    return [standalone_entry(args.robot, args.dfpc, inputs)]


def main(argv: list[str] | None = None) -> int:
    """Host DFPCs until SIGTERM."""
    parser = argparse.ArgumentParser(prog="dfpc_host", description=__doc__)
    add_profile_option(parser)
    parser.add_argument("--process", default=os.environ.get("CDFF_PROCESS"))
    parser.add_argument("--robot")
    parser.add_argument("--dfpc")
    parser.add_argument("--config", help="YAML with parameters instead of the profile's; with --dfpc")
    parser.add_argument("--input", action="append", default=[], metavar="PORT=SOURCE", help="with --dfpc")
    add_connect_option(parser)
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        entries = selected_entries(args)
        signs = args.profile and load_profile(args.profile).sign
        sign = sign_of_environment() if signs else None
        if args.config:
            update = {"parameters": read_mapping(Path(args.config))}
            entries = [(robot, entry.model_copy(update=update)) for robot, entry in entries]
        with Bus.open(args.connect, name=args.process or args.dfpc, wait_s=None, stop=stop) as bus:
            from services.dfpc_host.host import DfpcHost  # heavy: after the thread caps

            host = DfpcHost(bus, entries, sign)
            add_check(host.problem)
            host.run(stop)

    return run_service(args.process or f"{args.robot}_{args.dfpc}", body)


if __name__ == "__main__":
    raise SystemExit(main())
