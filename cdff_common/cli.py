# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The ``cdff`` command: a thin dispatcher; every noun comes from an entry point of the group ``cdff.commands``.

An entry point names a function ``register(nouns)`` that adds one or more parsers to ``nouns`` (the result of
``argparse.ArgumentParser.add_subparsers``) and sets ``run``, a function of the parsed arguments that returns the exit
code. Modules with commands import nothing heavy at module level, so that ``cdff --help`` answers at once; where the
first word names an entry point only that one is loaded.

Exit codes: 0 done, 1 known error (one line on standard error), 2 usage, 3 the algorithm refused, 70 bug.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from typing import Any

from cdff_common.errors import CdffError, RefusedError

GROUP = "cdff.commands"

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
        return _known(error)
    run: Callable[[argparse.Namespace], int] | None = getattr(parsed, "run", None)
    if run is None:
        (getattr(parsed, "parser", None) or parser).print_help(sys.stderr)
        return EXIT_USAGE
    return run_safely(lambda: run(parsed))


def run_safely(command: Callable[[], int]) -> int:
    """Call ``command`` and turn what it raises into an exit code and, for known errors, one line."""
    try:
        code = command()
        sys.stdout.flush()
    except CdffError as error:
        return _known(error)
    except BrokenPipeError:
        # The reader of our output went away (``cdff log cat … | head``); nothing more may be written.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_DONE
    except KeyboardInterrupt:
        return 130
    except Exception:  # noqa: BLE001  the outermost frame: a bug is reported whole, with its own exit code
        import traceback

        traceback.print_exc()
        print("cdff: this is a bug; please report the lines above with the command that led to it", file=sys.stderr)
        return EXIT_BUG
    return code


def build_parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser with the nouns that ``arguments`` may need: one where the first word names it, else all."""
    parser = argparse.ArgumentParser(
        prog="cdff",
        description="Common Data Fusion Framework: fuse, store and ask for what robots see.",
        epilog="exit codes: 0 done, 1 known error, 2 usage, 3 the algorithm refused, 70 bug",
    )
    parser.add_argument("--version", action="version", version=f"cdff {distribution_version()}")
    nouns = parser.add_subparsers(title="commands", metavar="NOUN")
    known = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    word = next((a for a in arguments if not a.startswith("-")), None)
    done: set[str] = set()
    for entry in [e for e in known if e.name == word]:
        _register(entry, nouns)
        done.add(entry.value)
    if word is None or word not in nouns.choices:
        for entry in known:
            # One function may stand under each of the nouns that it registers.
            if entry.value not in done:
                _register(entry, nouns, tolerant=True)
                done.add(entry.value)
    return parser


def distribution_version() -> str:
    """Version of the installed distribution, ``unknown`` when run from a tree that is not installed."""
    try:
        return version("cdff")
    except PackageNotFoundError:
        return "unknown"


def _register(entry: EntryPoint, nouns: Nouns, *, tolerant: bool = False) -> None:
    """Load one entry point; a broken one is an error where it was asked for and a warning where it was not."""
    try:
        register: Register = entry.load()
    except (ImportError, AttributeError) as error:
        message = f"command {entry.name!r} ({entry.value}) did not load: {error}"
        if not tolerant:
            raise CdffError(message) from error
        print(f"cdff: {message}", file=sys.stderr)
        return
    register(nouns)


def _known(error: CdffError) -> int:
    line = " ".join(str(error).split()) or type(error).__name__
    print(f"cdff: {line}", file=sys.stderr)
    return EXIT_REFUSED if isinstance(error, RefusedError) else EXIT_ERROR


if __name__ == "__main__":
    sys.exit(main())
