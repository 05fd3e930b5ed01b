# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line ``cdff``: a dispatcher to the entry points of the group ``cdff.commands``, one per noun.

An entry point is a function ``register(nouns)`` that adds parsers to ``nouns`` (the result of
``argparse.ArgumentParser.add_subparsers``) and sets ``run``, a function of the parsed arguments that returns
the exit code. Command modules import heavy libraries inside functions, so that ``cdff --help`` answers
quickly; if the first word is the name of an entry point, only that one is loaded.

Exit codes: 0 done, 1 known error (one line on standard error), 2 usage, 3 refused by the algorithm, 70 bug.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from typing import Any

from cdff_common.errors import CdffError, InputError, RefusedError

GROUP = "cdff.commands"

#: Modules that each extra of the distribution installs.
EXTRAS = {
    "core": [
        "cv2",
        "numba",
        "laspy",
        "lazrs",
        "lzf",
        "PIL",
        "psutil",
        "rasterio",
        "rtree",
        "scipy",
        "shapely",
        "small_gicp",
    ],
    "dpm": ["alembic", "cryptography", "fastapi", "pyproj", "sqlalchemy", "starlette", "uvicorn"],
    "logs": ["rosbags"],
    "plot": ["matplotlib"],
    "simulate": ["open3d"],
    "dev": ["evo", "jinja2"],
    "evaluate": ["gtsam", "kiss_icp", "kiss_matcher"],
}

EXIT_DONE = 0
EXIT_ERROR = 1
EXIT_USAGE = 2
EXIT_REFUSED = 3
EXIT_BUG = 70

Nouns = Any  # argparse._SubParsersAction is generic only for type checkers
Register = Callable[[Nouns], None]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code; installed as the script ``cdff``."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        parser = build_parser(arguments)
        parsed = parser.parse_args(arguments)
    except SystemExit as stop:  # argparse ends --help with 0 and usage errors with 2
        return stop.code if isinstance(stop.code, int) else EXIT_USAGE
    except CdffError as error:
        return _report(error)
    run: Callable[[argparse.Namespace], int] | None = getattr(parsed, "run", None)
    if run is None:
        (getattr(parsed, "help_parser", None) or parser).print_help(sys.stderr)
        return EXIT_USAGE
    return run_safely(lambda: run(parsed))


def run_safely(command: Callable[[], int]) -> int:
    """Call ``command`` and convert its exceptions to an exit code and, for known errors, one line."""
    try:
        code = command()
        sys.stdout.flush()
    except CdffError as error:
        return _report(error)
    except BrokenPipeError:
        # The reader of standard output has exited (``cdff log cat … | head``).
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_DONE
    except KeyboardInterrupt:
        return 130
    except Exception as error:  # noqa: BLE001  the outermost frame: a bug is reported with its traceback
        if hint := _missing_extra(error):
            return _report(CdffError(hint))
        import traceback

        traceback.print_exc()
        print(
            "cdff: this is a bug; please report the lines above with the command that caused it",
            file=sys.stderr,
        )
        return EXIT_BUG
    return code


def add_connect_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--connect``, the endpoint of the router."""
    parser.add_argument("--connect", help="endpoint of the router; CDFF_CONNECT, tcp/127.0.0.1:7447")


def add_profile_option(parser: argparse.ArgumentParser, *, required: bool = False) -> None:
    """Add ``--profile``, by default ``CDFF_PROFILE``."""
    profile = os.environ.get("CDFF_PROFILE") or None
    parser.add_argument(
        "--profile",
        default=profile,
        required=required and profile is None,
        help="mission profile, e.g. deploy/profiles/rover_traverse.yaml; CDFF_PROFILE",
    )


def key_values(items: Sequence[str], what: str, expected: str, *, empty: bool = False) -> dict[str, str]:
    """Return ``KEY=VALUE`` items as a mapping; raises InputError on a malformed or repeated one.

    ``what`` and ``expected`` are the name and the form of an item in messages; ``empty`` allows empty values.
    """
    mapping: dict[str, str] = {}
    for item in items:
        key, equals, value = item.partition("=")
        if not equals or not key or not (value or empty):
            raise InputError(f"{what} {item!r}: expected {expected}")
        if key in mapping:
            raise InputError(f"{what} {key} is given twice")
        mapping[key] = value
    return mapping


def extra_of(module: str) -> str | None:
    """Return the extra of the distribution that installs a module, None if no extra does."""
    top = module.partition(".")[0]
    return next((extra for extra, modules in EXTRAS.items() if top in modules), None)


def build_parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser with the noun of the first argument, or with all nouns."""
    parser = argparse.ArgumentParser(
        prog="cdff",
        description="Common Data Fusion Framework: fuse sensor data of robots, store and request products.",
        epilog="exit codes: 0 done, 1 known error, 2 usage, 3 the algorithm refused, 70 bug",
    )
    parser.add_argument("--version", action="version", version=f"cdff {distribution_version()}")
    nouns = parser.add_subparsers(title="commands", metavar="NOUN")
    commands = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    word = next((a for a in arguments if not a.startswith("-")), None)
    registered: set[str] = set()
    for entry in [e for e in commands if e.name == word]:
        _register(entry, nouns)
        registered.add(entry.value)
    if word is None or word not in nouns.choices:
        for entry in commands:
            # One function may be the entry point of several nouns.
            if entry.value not in registered:
                _register(entry, nouns, tolerant=True)
                registered.add(entry.value)
    return parser


def distribution_version() -> str:
    """Return the version of the installed distribution, ``unknown`` for a bare source tree."""
    try:
        return version("cdff")
    except PackageNotFoundError:
        return "unknown"


def _register(entry: EntryPoint, nouns: Nouns, *, tolerant: bool = False) -> None:
    """Load one entry point; a defect in it is an error, or a warning if ``tolerant``."""
    try:
        register: Register = entry.load()
    except (ImportError, AttributeError) as error:
        message = f"command {entry.name!r} ({entry.value}) did not load: {error}"
        if not tolerant:
            raise CdffError(message) from error
        print(f"cdff: {message}", file=sys.stderr)
        return
    register(nouns)


def _missing_extra(error: BaseException | None) -> str | None:
    """Return how to install the library that an import did not find, None for other errors."""
    if not isinstance(error, ModuleNotFoundError) or not error.name or not (extra := extra_of(error.name)):
        return None
    return f"{error.name} is not installed: pip install 'cdff[{extra}]'"


def _report(error: CdffError) -> int:
    message = _missing_extra(error.__cause__) or str(error)
    line = " ".join(message.split()) or type(error).__name__
    print(f"cdff: {line}", file=sys.stderr)
    return EXIT_REFUSED if isinstance(error, RefusedError) else EXIT_ERROR


if __name__ == "__main__":
    sys.exit(main())
