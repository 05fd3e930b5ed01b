# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff up`` and ``cdff service``."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from cdff_common.cli import add_connect_option, add_profile_option

DEFAULT_HTTP = "127.0.0.1:8080"
MAX_WORKERS = 64
SERVICES = (
    "router",
    "dpm",
    "orchestrator",
    "icu",
    "map_merging",
    "gateway_ccsds",
    "gateway_dds",
    "gateway_ros1",
    "gateway_ros2",
    "gateway_rock",
    "gateway_yarp",
)


def register_up(nouns: Any) -> None:
    """Add ``cdff up``."""
    parser = nouns.add_parser("up", help="run every service of a profile on this machine until Ctrl-C")
    add_profile_option(parser)
    add_connect_option(parser)
    parser.add_argument("--http", default=DEFAULT_HTTP, help="host:port of the DPM's HTTP server")
    parser.add_argument("--data-dir", default=None, help="CDFF_DATA_DIR, ~/.local/share/cdff")
    parser.add_argument(
        "--new", action="store_true", help="create an empty store although there are payloads; see `dpm`"
    )
    parser.add_argument(
        "--dpm-workers",
        type=int,
        default=0,
        metavar="N",
        help="further processes that answer on the HTTP address of the DPM; needs CDFF_STORE on a server",
    )
    parser.add_argument(
        "--log-dir", default=None, help="one log file per process there; default: standard error"
    )
    parser.add_argument(
        "--scopes",
        nargs="+",
        metavar="ID",
        help="scopes whose services run: robots, and ground for the shared services; default: all",
    )
    parser.add_argument(
        "--uplink",
        metavar="ENDPOINT",
        help="remote router, such as that of ground, to which the local one links",
    )
    parser.add_argument(
        "--secure",
        metavar="FOLDER",
        default=None,
        help="folder of `cdff keys`: the bus and HTTP use TLS, and accept known identities only",
    )
    parser.set_defaults(run=run_up)


def run_up(args: argparse.Namespace) -> int:
    """Run the services of a profile; 0 after SIGTERM or Ctrl-C."""
    from cdff_common.bus.session import DEFAULT_ENDPOINT, SECURE_ENDPOINT, check_endpoint
    from cdff_common.errors import ConfigurationError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.output import make_folder
    from cdff_common.process import data_dir_of, run_service
    from cdff_common.resources import resolve
    from cdff_common.terminal import styled
    from services.supervisor.plan import first_scope, plan
    from services.supervisor.profile_link import SupervisorLink, served_profiles
    from services.supervisor.readiness import expected_tokens, ready_line
    from services.supervisor.supervisor import Supervisor
    from services.supervisor.vacancy import check_joins, check_vacant

    if not args.profile:
        raise ConfigurationError(
            "no profile: give --profile FILE or set CDFF_PROFILE, as deploy/profiles/rover_traverse.yaml"
        )
    path = resolve("profiles", args.profile)
    profile = load_profile(path, complete=True)
    data_dir = make_folder(data_dir_of(args.data_dir))
    log_dir = None if args.log_dir is None else make_folder(Path(args.log_dir))
    default = SECURE_ENDPOINT if args.secure else DEFAULT_ENDPOINT
    connect = args.connect or os.environ.get("CDFF_CONNECT") or default
    check_endpoint(connect, is_secure=args.secure is not None)
    specs = plan(
        profile,
        path,
        connect=connect,
        http=args.http,
        data_dir=data_dir,
        scopes=args.scopes or (),
        uplink=args.uplink,
        dpm_options=("--new",) if args.new else (),
        dpm_workers=_checked_workers(args.dpm_workers),
        secrets=None if args.secure is None else Path(args.secure),
    )
    has_dpm = any(spec.name == "dpm" for spec in specs)
    check_vacant(connect, args.http if has_dpm else None, data_dir)
    os.environ.update(specs[0].environment)  # this process connects to the bus as the router's scope
    scopes = args.scopes or ()
    link = SupervisorLink(
        specs[0].environment["CDFF_CONNECT"],
        first_scope(profile, scopes),
        served_profiles(profile, scopes),
        None if args.secure is None else Path(args.secure),
    )
    if args.uplink:
        check_joins(args.uplink, expected_tokens(specs), link.profiles)
    line = ready_line(specs, link.connect, args.http, is_secure=args.secure is not None)

    def announce() -> None:
        print(styled(line, "green", sys.stdout), flush=True)

    return run_service("supervisor", Supervisor(specs, log_dir, link=link, on_ready=announce).run)


def _checked_workers(count: int) -> int:
    """Return a number of workers; raises ConfigurationError if the store cannot be shared."""
    from cdff_common.errors import ConfigurationError

    if not 0 <= count <= MAX_WORKERS:
        raise ConfigurationError(f"--dpm-workers {count}: expected 0 to {MAX_WORKERS}")
    store = os.environ.get("CDFF_STORE", "")
    if count and "payloads=" not in store:
        raise ConfigurationError(
            f"--dpm-workers {count}: expected CDFF_STORE=postgresql+psycopg://…?payloads=s3://…, a store "
            "that several processes open"
        )
    return count


def register_service(nouns: Any) -> None:
    """Add ``cdff service NAME``."""
    parser = nouns.add_parser("service", help="run one service in the foreground")
    parser.add_argument("name", choices=SERVICES)
    parser.add_argument(
        "options",
        nargs=argparse.REMAINDER,
        help="options of the service; `cdff service NAME --help` lists them",
    )
    parser.set_defaults(run=run_one)


def run_one(args: argparse.Namespace) -> int:
    """Replace this process by the service, so that signals and the exit code are those of the service."""
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", f"services.{args.name}", *args.options])
