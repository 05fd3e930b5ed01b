# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Commands ``cdff dfn list|show``, ``cdff dfpc list|show|run`` and ``cdff call``."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

from cdff_common.cli import add_connect_option, add_plot_option, add_profile_option, key_values


def register(nouns: Any) -> None:
    """Add ``cdff dfn`` and ``cdff dfpc``."""
    for kind in ("dfn", "dfpc"):
        noun = nouns.add_parser(
            kind, help=f"{kind.upper()}s that are installed: descriptions, implementations, faults"
        )
        verbs = noun.add_subparsers(title="verbs", metavar="VERB", required=True)
        listing = verbs.add_parser("list", help="list all, and those that failed to load with the reason")
        listing.set_defaults(run=run_list, kind=kind)
        show = verbs.add_parser("show", help="show a description with the parameters of its implementations")
        show.add_argument("name", help="folder, class name or alias")
        show.set_defaults(run=run_show, kind=kind)
        for verb in (listing, show):
            verb.add_argument("--json", action="store_true", help="JSON output")
        if kind == "dfpc":
            run = verbs.add_parser("run", help="run one DFPC as a service, in the foreground")
            run.add_argument("name", help="folder, class name or alias")
            run.add_argument("--robot", required=True, help="robot id")
            run.add_argument("--config", help="YAML with parameters, instead of the profile's")
            run.add_argument(
                "--input",
                action="append",
                default=[],
                metavar="PORT=SOURCE",
                help="source of a port: sensor/navcam/pair, product/position_manager/pose; replaces wiring "
                "of the profile; required without a profile; may be repeated",
            )
            add_profile_option(run)
            add_connect_option(run)
            run.set_defaults(run=run_service)


def register_call(nouns: Any) -> None:
    """Add ``cdff call``."""
    parser = nouns.add_parser(
        "call",
        help="call an operation of a running DFPC: a route, a transform, a pin, …",
        description="Call an operation of a DFPC and print its value in words; without one, list them.",
    )
    parser.add_argument("robot", help="robot id")
    parser.add_argument("dfpc", help="folder, class name or alias, as position_manager")
    parser.add_argument("operation", nargs="?", help="name, e.g. get_transform; default: list the operations")
    parser.add_argument(
        "parameters", nargs="*", default=[], metavar="KEY=VALUE", help="parameters of the operation"
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="file for a value that is a product; its suffix selects the format; - for standard output",
    )
    add_plot_option(parser)
    parser.add_argument("--timeout-s", type=float, default=10.0, help="timeout in seconds (default 10)")
    add_connect_option(parser)
    parser.add_argument("--json", action="store_true", help="the whole value as JSON on one line")
    parser.set_defaults(run=run_call)


def run_list(args: argparse.Namespace) -> int:
    """Print every description; exit 1 if one did not load."""
    from cdff_common.interfaces.registry import Registry
    from cdff_common.terminal import first_sentence, print_table

    registry = Registry.default()
    registry.load_plugins()
    packages = registry.dfns if args.kind == "dfn" else registry.dfpcs
    rows = [
        {
            "name": folder,
            "class": d.name,
            "implementations": [getattr(i, "name", i) for i in d.implementations],
            "aliases": list(d.aliases),
            "doc": " ".join(d.doc.split()),
        }
        for folder, d in ((folder, package.description) for folder, package in packages.items())
    ]
    if args.json:
        print(
            json.dumps({f"{args.kind}s": rows, "failures": registry.failures}, indent=1, ensure_ascii=False)
        )
    else:
        print_table(
            ("name", "implementations", "summary"),
            [
                (row["name"], ", ".join(row["implementations"]), first_sentence(row["doc"]))
                for row in sorted(rows, key=lambda row: row["name"])
            ],
        )
        for folder, reason in sorted(registry.failures.items()):
            print(f"cdff: {folder} did not load: {' '.join(reason.split())}", file=sys.stderr)
    return 1 if registry.failures else 0


def run_show(args: argparse.Namespace) -> int:
    """Print one description and the parameters of its implementations."""
    from cdff_common.errors import ConfigurationError
    from cdff_common.interfaces.registry import Registry

    registry = Registry.default()
    description: Any = registry.dfn(args.name) if args.kind == "dfn" else registry.dfpc(args.name)
    models = (
        {
            implementation: type(registry.make_dfn(args.name, implementation)).Config
            for implementation in description.implementations
        }
        if args.kind == "dfn"
        else {description.name: registry.make_dfpc(args.name).config_model()}
    )
    if not models:
        raise ConfigurationError(f"{args.name} has no implementation")
    print_description(description, models, as_json=args.json)
    return 0


def print_description(description: Any, models: dict[str, Any], *, as_json: bool) -> None:
    """Write a description and the parameter rows of its configuration models to standard output."""
    from dataclasses import asdict

    from cdff_common.interfaces.parameters import parameter_rows

    parameters = {name: [asdict(row) for row in parameter_rows(model)] for name, model in models.items()}
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
    """Replace this process by the host process, so that signals and the exit code are those of the host."""
    from cdff_common.interfaces.registry import Registry
    from services.dfpc_host.wiring import parse_inputs, standalone_entry

    folder = Registry.default().dfpc(args.name).folder
    inputs = parse_inputs(args.input)
    if not args.profile:
        standalone_entry(args.robot, folder, inputs)  # reports an error in the wiring in one line
    options = ["--robot", args.robot, "--dfpc", folder]
    for option in ("profile", "config", "connect"):
        if getattr(args, option):
            options += [f"--{option}", getattr(args, option)]
    for port, source in inputs.items():
        options += ["--input", f"{port}={source}"]
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "services.dfpc_host", *options])


def run_call(args: argparse.Namespace) -> int:
    """Call an operation of a DFPC, and print or write the value."""
    from cdff_common.client import Client
    from cdff_common.errors import InputError
    from cdff_common.interfaces.registry import Registry
    from cdff_common.output import check_file, is_standard_output, write_output
    from services.dfpc_host.operation_calls import file_bytes, file_format, printable, text

    indent = None if args.json else 1
    description = Registry.default().dfpc(args.dfpc)
    operations = {operation.name: operation for operation in description.operations}
    if args.operation is None:
        descriptions = [
            operation.model_dump(mode="json", exclude_none=True) for operation in operations.values()
        ]
        print(json.dumps(descriptions, indent=indent, ensure_ascii=False))
        return 0
    if args.operation not in operations:
        known = ", ".join(operations) or "none"
        raise InputError(f"{description.folder} has no operation {args.operation!r}; it has {known}")
    parameters = key_values(args.parameters, "parameter", "KEY=VALUE, as child=mana/base", empty=True)
    if invalid_key := next((key for key in parameters if not key.isidentifier()), None):
        raise InputError(f"parameter name {invalid_key!r}: expected letters, digits and underscores")
    form = None
    if args.out is not None:
        form = file_format(args.out, operations[args.operation].output_type)
        check_file(args.out)
    if args.plot is not None:
        from cdff_common.plots import check_plot_file, figure_of, write_figure

        check_plot_file(args.plot)
    with Client(args.connect, name="cdff call") as client:
        value, provenance = client.call(
            args.robot, description.folder, args.operation, parameters, timeout_s=args.timeout_s
        )
    if args.plot is not None:
        write_figure(args.plot, figure_of({args.operation: value}))
    if form is not None:
        data = file_bytes(value, form)
        write_output(args.out, data)
        if is_standard_output(args.out):
            return 0
        result = {"type": type(value).__name__, "bytes": len(data), "file": str(args.out)}
        print(json.dumps(result, indent=indent, ensure_ascii=False))
    elif args.json:
        print(json.dumps(printable(value, provenance), ensure_ascii=False))
    else:
        print(text(value, provenance))
    return 0
