# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dfn list|show``, ``cdff dfpc list|show|run``, ``cdff call``: what is installed, and one DFPC run or asked."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any


def register(nouns: Any) -> None:
    """Add ``cdff dfn`` and ``cdff dfpc``."""
    for kind in ("dfn", "dfpc"):
        noun = nouns.add_parser(kind, help=f"{kind.upper()}s that are installed: descriptions, implementations, faults")
        verbs = noun.add_subparsers(title="verbs", metavar="VERB", required=True)
        listing = verbs.add_parser("list", help="all of them, and what did not load and why")
        listing.add_argument("--json", action="store_true", help="for machines")
        listing.set_defaults(run=run_list, kind=kind)
        show = verbs.add_parser("show", help="one description with the parameters of its implementations")
        show.add_argument("name", help="folder, class name or alias")
        show.add_argument("--json", action="store_true", help="for machines")
        show.set_defaults(run=run_show, kind=kind)
        if kind == "dfpc":
            run = verbs.add_parser("run", help="one DFPC as a service, in the foreground")
            run.add_argument("name", help="folder, class name or alias")
            run.add_argument("--robot", required=True, help="robot id")
            run.add_argument("--config", help="YAML with parameters, instead of the profile's")
            run.add_argument(
                "--input",
                action="append",
                default=[],
                metavar="PORT=SOURCE",
                help="what feeds a port: sensor/navcam/pair, product/position_manager/pose; needed without a profile, "
                "else instead of its wiring; may be repeated",
            )
            run.add_argument(
                "--profile",
                default=os.environ.get("CDFF_PROFILE"),
                help="wiring, mounts and limits from deploy/profiles/*.yaml; CDFF_PROFILE",
            )
            run.add_argument("--connect", help="endpoint of the router; CDFF_CONNECT, tcp/127.0.0.1:7447")
            run.set_defaults(run=run_service)


def register_call(nouns: Any) -> None:
    """Add ``cdff call``."""
    parser = nouns.add_parser(
        "call",
        help="an operation of a running DFPC: a route, a transform, a pin, …",
        description="Run an operation of a DFPC and print its value as JSON. Without an operation: those that it has.",
    )
    parser.add_argument("robot", help="robot id")
    parser.add_argument("dfpc", help="folder, class name or alias, as position_manager")
    parser.add_argument("operation", nargs="?", help="as get_transform; without it they are listed")
    parser.add_argument("parameters", nargs="*", default=[], metavar="KEY=VALUE", help="parameters of the operation")
    parser.add_argument("--out", type=Path, help="file for a value that is a product; its ending says the format")
    parser.add_argument("--timeout-s", type=float, default=10.0, help="how long to wait (default 10)")
    parser.add_argument("--connect", help="endpoint of the router; CDFF_CONNECT, tcp/127.0.0.1:7447")
    parser.add_argument("--json", action="store_true", help="on one line")
    parser.set_defaults(run=run_call)


def run_list(args: argparse.Namespace) -> int:
    """Print every description; exit 1 if one did not load."""
    from cdff_common.interfaces.registry import Registry

    registry = Registry.default()
    found = registry.dfns if args.kind == "dfn" else registry.dfpcs
    rows = [
        {
            "name": folder,
            "class": f.description.name,
            "implementations": [getattr(i, "name", i) for i in f.description.implementations],
            "aliases": list(f.description.aliases),
            "doc": " ".join(f.description.doc.split()),
        }
        for folder, f in found.items()
    ]
    if args.json:
        print(json.dumps({f"{args.kind}s": rows, "failures": registry.failures}, indent=1, ensure_ascii=False))
    else:
        width = max((len(r["name"]) for r in rows), default=0)
        for row in rows:
            print(f"{row['name']:{width}}  {', '.join(row['implementations'])}")
        for folder, reason in sorted(registry.failures.items()):
            print(f"cdff: {folder} did not load: {' '.join(reason.split())}", file=sys.stderr)
    return 1 if registry.failures else 0


def run_show(args: argparse.Namespace) -> int:
    """Print one description and the parameters of its implementations."""
    from cdff_common.errors import ConfigurationError
    from cdff_common.interfaces.registry import Registry

    registry = Registry.default()
    description: Any = registry.dfn(args.name) if args.kind == "dfn" else registry.dfpc(args.name)
    nodes = (
        {implementation: registry.make_dfn(args.name, implementation) for implementation in description.implementations}
        if args.kind == "dfn"
        else {description.name: registry.make_dfpc(args.name)}
    )
    if not nodes:
        raise ConfigurationError(f"{args.name} has no implementation")
    print_description(description, nodes, as_json=args.json)
    return 0


def print_description(description: Any, nodes: dict[str, Any], *, as_json: bool) -> None:
    """Write a description and the parameter rows of its configured classes to standard output."""
    from dataclasses import asdict

    from cdff_common.interfaces.parameters import parameter_rows

    parameters = {name: [asdict(row) for row in parameter_rows(type(node).Config)] for name, node in nodes.items()}
    data = description.model_dump(mode="json") | {"configuration": parameters}
    if as_json:
        print(json.dumps(data, indent=1, ensure_ascii=False))
        return
    print(f"{description.name} ({description.folder}), version {description.version}")
    print(" ".join(description.doc.split()))
    for title, ports in (("inputs", description.input_ports), ("outputs", description.output_ports)):
        print(f"\n{title}")
        for port in ports:
            print(f"  {port.attribute}: {port.type_name}{' (optional)' if port.optional else ''}  {port.doc}")
    for name, rows in parameters.items():
        print(f"\nparameters of {name}" + ("" if rows else ": none"))
        for row in rows:
            bounds = f" {row['bounds']}" if row["bounds"] else ""
            print(f"  {row['name']} = {row['default']}  ({row['type']}{bounds})  {row['doc']}")


def run_service(args: argparse.Namespace) -> int:
    """Become the host process, so that signals and the exit code are its own."""
    from cdff_common.interfaces.registry import Registry
    from services.dfpc_host.wiring import bare, parse_inputs

    folder = Registry.default().dfpc(args.name).folder
    inputs = parse_inputs(args.input)
    if not args.profile:
        bare(args.robot, folder, inputs)  # what is wrong with the wiring is said here, in one line
    options = ["--robot", args.robot, "--dfpc", folder]
    for option in ("profile", "config", "connect"):
        if getattr(args, option):
            options += [f"--{option}", getattr(args, option)]
    for port, source in inputs.items():
        options += ["--input", f"{port}={source}"]
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "services.dfpc_host", *options])
    return 1


def run_call(args: argparse.Namespace) -> int:
    """Run an operation of a DFPC, and print or write what comes back."""
    from cdff_common.client import Client
    from cdff_common.errors import InputError
    from cdff_common.interfaces.registry import Registry
    from cdff_common.output import check_file, write_file
    from services.dfpc_host.calling import file_of, format_of, parameters_of, told

    indent = None if args.json else 1
    description = Registry.default().dfpc(args.dfpc)
    operations = {operation.name: operation for operation in description.operations}
    if args.operation is None:
        listed = [operation.model_dump(mode="json", exclude_none=True) for operation in operations.values()]
        print(json.dumps(listed, indent=indent, ensure_ascii=False))
        return 0
    if args.operation not in operations:
        known = ", ".join(operations) or "none"
        raise InputError(f"{description.folder} has no operation {args.operation!r}; it has {known}")
    parameters, form = parameters_of(args.parameters), None
    if args.out is not None:
        form = format_of(args.out, operations[args.operation].output_type)
        check_file(args.out)
    with Client(args.connect, name="cdff call") as client:
        value, provenance = client.call(
            args.robot, description.folder, args.operation, parameters, timeout_s=args.timeout_s
        )
    shown = told(value, provenance)
    if form is not None:
        data = file_of(value, form)
        write_file(args.out, data)
        shown = {"type": type(value).__name__, "bytes": len(data), "file": str(args.out)}
    print(json.dumps(shown, indent=indent, ensure_ascii=False))
    return 0
