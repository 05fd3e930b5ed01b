# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff replay LOG --dfpc NAME --sweep FILE``: one replay for each combination of parameter values."""

from __future__ import annotations

import argparse
import copy
import itertools
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from cdff_common.errors import InputError, RefusedError
from cdff_common.extras import import_extra
from cdff_common.interfaces.yaml_file import read_mapping
from cdff_dev.campaign.runner import TABLE, run_campaign, write_table
from cdff_dev.campaign.units import Unit

#: Names in a sweep that are options of the replay, not parameters of the DFPC.
_OPTIONS = ("seed", "implementation", "start", "duration")
#: Options of the command that are passed to each replay: values, files, and lists of files.
_SHARED = ("robot", "implementation", "start", "duration", "seed", "until")
_FILES = ("profile", "guess", "poses", "calibration")
_LISTS = ("map", "mask", "model")
MAX_UNITS = 10_000


def run_sweep(args: argparse.Namespace) -> int:
    """Run a replay for each combination of parameter values and write the table of results; return 0.

    Raises
    ------
    InputError
        If the file is malformed, or ``--dfpc`` or ``--out`` is missing.
    RefusedError
        If a replay failed.
    CdffError
        If pyarrow, which writes the table, is not installed.
    """
    if args.dfpc is None or args.out is None:
        raise InputError("--sweep: expected --dfpc NAME and --out DIR")
    import_extra("pyarrow")  # before the replays, whose results it writes
    folder = Path(args.out)
    values = read_mapping(Path(args.sweep))
    base = {} if args.config is None else read_mapping(Path(args.config))
    units = list(units_of(args, values, base, folder))

    def report(result: Mapping[str, Any]) -> None:
        reason = f": {result['error'].splitlines()[-1]}" if result["exit_code"] and result["error"] else ""
        text = f"{result['name']}: exit code {result['exit_code']}, {result['wall_s']:.1f} s{reason}\n"
        sys.stdout.write(text)
        sys.stdout.flush()

    results = run_campaign(units, folder, dask=args.dask, on_result=report)
    write_table(results, folder / TABLE)
    sys.stdout.write(f"wrote {folder / TABLE}\n")
    if failed := [result["name"] for result in results if result["exit_code"]]:
        raise RefusedError(f"{len(failed)} of {len(results)} replays failed, the first is {failed[0]}")
    return 0


def units_of(
    args: argparse.Namespace, values: Mapping[str, Any], base: Mapping[str, Any], folder: Path
) -> Iterator[Unit]:
    """Write a configuration file for each combination of values to ``folder``, and yield its replay.

    Parameters
    ----------
    values : mapping of str to list
        Values of parameters of the DFPC (``group.name``), or of the options ``seed``, ``implementation``,
        ``start`` and ``duration``.
    base : mapping
        Parameters of the DFPC that are the same in all replays.

    Raises
    ------
    InputError
        If a value is not a list, there are more than ``MAX_UNITS`` combinations, or the folder contains
        another sweep.
    """
    for name, choices in values.items():
        if not isinstance(choices, list) or not choices:
            raise InputError(f"sweep: {name}: {choices!r}, expected a list of values")
    combinations = list(itertools.product(*values.values()))
    if len(combinations) > MAX_UNITS:
        raise InputError(f"sweep: {len(combinations)} combinations, expected at most {MAX_UNITS}")
    configurations = folder / "configurations"
    configurations.mkdir(parents=True, exist_ok=True)
    for number, combination in enumerate(combinations):
        labels = dict(zip(values, combination, strict=True))
        parameters = {name: value for name, value in labels.items() if name not in _OPTIONS}
        name = f"replay_{number:04d}"
        path = configurations / f"{name}.yaml"
        text = yaml.safe_dump(_merged(base, parameters))
        record = json.dumps([vars_of(args, labels), text])
        stated = configurations / f"{name}.json"
        if stated.exists() and stated.read_text(encoding="utf-8") != record:
            raise InputError(f"{folder} contains another sweep ({name} differs): name a new folder")
        path.write_text(text, encoding="utf-8")
        stated.write_text(record, encoding="utf-8")
        arguments = ["-m", "cdff_common.cli", "replay", str(Path(args.log).resolve()), "--dfpc", args.dfpc]
        arguments += ["--config", str(path.resolve())] if base or parameters else []
        for option, value in vars_of(args, labels).items():
            arguments += [text for item in value for text in (f"--{option}", str(item))]
        yield Unit(name, (*arguments, "--out", "{out}"), labels)


def vars_of(args: argparse.Namespace, labels: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return the options of the replay with ``labels``, each with a list of values."""
    options = {name: [getattr(args, name)] for name in _SHARED if getattr(args, name) is not None}
    options |= {name: [_absolute(getattr(args, name))] for name in _FILES if getattr(args, name) is not None}
    options |= {name: [_absolute(v) for v in getattr(args, name)] for name in _LISTS if getattr(args, name)}
    return options | {name: [value] for name, value in labels.items() if name in _OPTIONS}


def _absolute(value: str | Path) -> str:
    """Return the absolute path of an existing file, because workers run in other folders; else the value."""
    return str(Path(value).resolve()) if Path(value).exists() else str(value)


def _merged(base: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with the parameters replaced; the name of a parameter is ``group.name``."""
    merged: dict[str, Any] = copy.deepcopy(dict(base))
    for name, value in parameters.items():
        *groups, last = name.split(".")
        target = merged
        for group in groups:
            target = target.setdefault(group, {})
            if not isinstance(target, dict):
                raise InputError(f"sweep: {name}: {group} is a value, not a group")
        target[last] = value
    return merged
