# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff keys``: the authority, certificates and access-control lists of a mission."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from cdff_common.cli import add_profile_option
from cdff_common.errors import InputError

DEFAULT_FOLDER = "secrets"
_ISSUED = {
    "robot": "a robot: it publishes and answers below its own scope",
    "operator": "a person, with a role",
    "client": "an autonomy framework: it asks, and publishes nothing",
    "player": "a program that plays or simulates the sensors of all robots",
}


def register(nouns: Any) -> None:
    """Add ``cdff keys``."""
    parser = nouns.add_parser("keys", help="identities of a mission: certificates and access control")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)

    init = _verb(
        verbs, "init", "create the authority and the identity of the ground; repeat it for a new profile"
    )
    add_profile_option(init, required=True)
    _add_host_option(init)
    init.set_defaults(run=_init)

    for kind, owner in _ISSUED.items():
        issue = _verb(verbs, kind, f"issue a certificate for {owner}; repeat it to rotate")
        issue.add_argument("name", metavar="ID" if kind == "robot" else "NAME")
        issue.add_argument("--days", type=int, default=365, help="validity (default 365)")
        if kind == "robot":
            _add_host_option(issue)
            add_profile_option(issue)
        if kind == "operator":
            roles = ("reader", "operator", "admin")
            issue.add_argument("--role", choices=roles, default="operator", help="default operator")
        issue.set_defaults(run=_issue, kind=kind)

    revoke = _verb(verbs, "revoke", "refuse the certificates of a name from now on")
    revoke.add_argument("name", metavar="NAME")
    revoke.add_argument("--previous", action="store_true", help="all but the newest, after a rotation")
    revoke.set_defaults(run=_revoke)

    command = _verb(verbs, "command", "write a key for the commands of a ground segment")
    command.add_argument("key", metavar="FILE", type=Path)
    command.set_defaults(run=_command_key)

    seal = _verb(verbs, "seal", "write a command of a ground segment with its key, in hexadecimal digits")
    seal.add_argument("key", metavar="FILE", type=Path)
    seal.add_argument("robot", metavar="ID")
    seal.add_argument("function", choices=("request", "send", "cancel"))
    seal.add_argument("arguments", nargs="*", metavar="NAME=VALUE")
    seal.add_argument("--out", type=Path, help="file for the command as bytes, for a CFDP put")
    seal.set_defaults(run=_seal)

    listing = _verb(verbs, "list", "list the certificates")
    listing.add_argument("--json", action="store_true", help="as JSON")
    listing.set_defaults(run=_list)


def _verb(verbs: Any, name: str, description: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(name, help=description, description=description)
    parser.add_argument(
        "--folder",
        type=Path,
        default=Path(os.environ.get("CDFF_SECRETS") or DEFAULT_FOLDER),
        help="folder of all identities; CDFF_SECRETS, secrets",
    )
    return parser


def _add_host_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--host",
        action="append",
        default=[],
        help="name or address under which others reach its router (repeatable); loopback always works",
    )


def _init(args: argparse.Namespace) -> int:
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.resources import resolve
    from services.keys.mission_keys import MissionKeys

    keys = MissionKeys.create(args.folder, load_profile(resolve("profiles", args.profile)), args.host)
    print(f"identities of {keys.profile} in {args.folder}; keep {args.folder}/ca on this machine")
    return 0


def _issue(args: argparse.Namespace) -> int:
    from services.keys.access_control import Kind
    from services.keys.mission_keys import MissionKeys

    if args.days < 1:
        raise InputError(f"--days {args.days}: expected at least 1")
    keys = MissionKeys.read(args.folder)
    if getattr(args, "profile", None):
        from cdff_common.interfaces.profile import load_profile
        from cdff_common.resources import resolve

        keys.add_robots(load_profile(resolve("profiles", args.profile)))
    issued = keys.issue(
        args.name,
        Kind(args.kind),
        role=getattr(args, "role", ""),
        hosts=getattr(args, "host", ()),
        days=args.days,
    )
    print(f"{args.folder / args.name}: {issued.kind} {issued.common_name}, valid until {issued.expires}")
    return 0


def _revoke(args: argparse.Namespace) -> int:
    from services.keys.mission_keys import MissionKeys

    revoked = MissionKeys.read(args.folder).revoke(args.name, previous=args.previous)
    print(f"revoked: {', '.join(certificate.common_name for certificate in revoked)}")
    return 0


def _list(args: argparse.Namespace) -> int:
    from services.keys.mission_keys import MissionKeys

    rows = MissionKeys.read(args.folder).to_list()
    if args.json:
        print(json.dumps(rows))
        return 0
    for row in rows:
        print(
            f"{row['common_name']:24} {row['kind']:9} {row['role']:9} {row['state']:8} until {row['expires']}"
        )
    return 0


def _command_key(args: argparse.Namespace) -> int:
    from services.gateway_ccsds.authentication import CommandKey

    CommandKey.write(args.key)
    print(f"key in {args.key}: copy it to the gateway and to where commands are written, over a safe channel")
    return 0


def _seal(args: argparse.Namespace) -> int:
    from cdff_common.clock import wall_ns
    from cdff_common.output import write_output
    from services.gateway_ccsds.authentication import Command, CommandKey, Function

    if wrong := [text for text in args.arguments if not text.partition("=")[1]]:
        raise InputError(f"{wrong[0]!r}: expected NAME=VALUE")
    arguments = {name: value for name, _, value in (text.partition("=") for text in args.arguments)}
    command = Command(Function[args.function.upper()], wall_ns() // 1000, arguments)
    data = CommandKey.read(args.key).seal(args.robot, command)
    if args.out is None:
        print(data.hex())
    else:
        write_output(args.out, data)
    return 0
