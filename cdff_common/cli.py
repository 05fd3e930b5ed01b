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
import errno
import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from pathlib import Path
from typing import Any, TextIO

from cdff_common.command_parser import CommandParser
from cdff_common.command_table import GROUPS, SUMMARIES
from cdff_common.completion import complete, is_completing
from cdff_common.errors import CdffError, FaultsError, InputError, RefusedError, StorageError
from cdff_common.extras import missing_extra
from cdff_common.terminal import set_verbosity, styled

GROUP = "cdff.commands"

_DESCRIPTION = "Common Data Fusion Framework: fuse sensor data of robots, store and request products."
_EXIT_CODES = "exit codes: 0 done, 1 known error, 2 usage, 3 the algorithm refused, 70 bug"

EXIT_DONE = 0
EXIT_ERROR = 1
EXIT_USAGE = 2
EXIT_REFUSED = 3
EXIT_BUG = 70

#: Errors of the operating system that are no bugs: permissions, full or damaged disks, too many files.
_FAULTS_OF_THE_MACHINE = frozenset(
    (
        errno.EACCES,
        errno.EPERM,
        errno.EROFS,
        errno.ENOSPC,
        errno.EDQUOT,
        errno.EFBIG,
        errno.EIO,
        errno.ENODEV,
        errno.ESTALE,
        errno.ELOOP,
        errno.ENAMETOOLONG,
        errno.EMFILE,
        errno.ENFILE,
    )
)

Nouns = Any  # argparse._SubParsersAction is generic only for type checkers
Register = Callable[[Nouns], None]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code; installed as the script ``cdff``."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if is_completing():
        complete(build_parser)
    try:
        if not arguments or arguments[0] in ("-h", "--help"):
            (sys.stdout if arguments else sys.stderr).write(
                help_text(sys.stdout if arguments else sys.stderr)
            )
            return EXIT_DONE if arguments else EXIT_USAGE
        parser = build_parser(arguments)
        parsed = parser.parse_command(arguments)
    except SystemExit as stop:  # argparse ends --help with 0 and usage errors with 2
        return stop.code if isinstance(stop.code, int) else EXIT_USAGE
    except CdffError as error:
        return _report(error)
    run: Callable[[argparse.Namespace], int] | None = getattr(parsed, "run", None)
    if run is None:
        (getattr(parsed, "help_parser", None) or parser).print_help(sys.stderr)
        return EXIT_USAGE
    set_verbosity((parsed.verbose or 0) - (1 if parsed.quiet else 0))
    return run_safely(lambda: run(parsed))


def help_text(stream: TextIO) -> str:
    """Return the help of ``cdff``: the commands by purpose; only commands without a summary are imported."""
    entries = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    others = _summaries([entry for entry in entries if entry.name not in SUMMARIES])
    groups = GROUPS | {"other commands": others}
    lines = ["usage: cdff COMMAND …", "", _DESCRIPTION]
    for title, commands in groups.items():
        if commands:
            lines += ["", styled(title, "bold", stream)]
            lines += [f"  {name:13} {summary}" for name, summary in commands.items()]
    lines += ["", "cdff COMMAND --help shows its options; -v and -q set the amount of text.", _EXIT_CODES]
    return "\n".join(lines) + "\n"


def _summaries(entries: Sequence[EntryPoint]) -> dict[str, str]:
    """Return the commands of entry points with their summaries, from their parsers."""
    nouns = argparse.ArgumentParser().add_subparsers()
    for entry in entries:
        _register(entry, nouns, tolerant=True)
    return {action.dest: action.help or "" for action in nouns._choices_actions}


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
        if _is_interruption(error):
            return 130
        if hint := missing_extra(error):
            return _report(CdffError(hint))
        if isinstance(error, OSError) and error.errno in _FAULTS_OF_THE_MACHINE:
            return _report(StorageError(f"{error.filename or 'a file'}: {error.strerror}"))
        import traceback

        traceback.print_exc()
        print(
            "cdff: this is a bug; please report the lines above with the command that caused it",
            file=sys.stderr,
        )
        return EXIT_BUG
    return code


def _is_interruption(error: BaseException | None) -> bool:
    """Return whether Ctrl-C caused an error: a compiled kernel reports it as a SystemError."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


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


def add_plot_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--plot``, a picture of the value."""
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the value: .png or .svg")


def key_values(items: Sequence[str], subject: str, expected: str, *, empty: bool = False) -> dict[str, str]:
    """Return ``KEY=VALUE`` items as a mapping; raises InputError on a malformed or repeated one.

    ``subject`` and ``expected`` are the name and the form of an item in messages; ``empty`` allows empty values.
    """
    mapping: dict[str, str] = {}
    for item in items:
        key, equals, value = item.partition("=")
        if not equals or not key or not (value or empty):
            raise InputError(f"{subject} {item!r}: expected {expected}")
        if key in mapping:
            raise InputError(f"{subject} {key} is given twice")
        mapping[key] = value
    return mapping


def repeated_key_values(items: Sequence[str], subject: str, expected: str) -> dict[str, list[str]]:
    """Return ``KEY=VALUE`` items as lists by key; raises InputError on a malformed one."""
    mapping: dict[str, list[str]] = {}
    for item in items:
        for key, value in key_values([item], subject, expected).items():
            mapping.setdefault(key, []).append(value)
    return mapping


def build_parser(arguments: Sequence[str]) -> CommandParser:
    """Return the parser with the noun of the first argument, or with all nouns."""
    parser = CommandParser(prog="cdff", description=_DESCRIPTION, epilog=_EXIT_CODES)
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    _add_verbosity(parser, default=None)
    nouns = parser.add_subparsers(title="commands", metavar="NOUN")
    commands = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    word = next((a for a in arguments if not a.startswith("-")), None)
    registered: set[str] = set()
    for entry in [e for e in commands if e.name == word]:
        _register(entry, nouns)
        registered.add(entry.value)
    if word in nouns.choices:
        _add_verbosity_to_commands(nouns.choices[word])
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


class _Version(argparse.Action):
    """Print the version: it is read from the distribution only if requested."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"cdff {distribution_version()}")
        parser.exit()


def _add_verbosity(parser: argparse.ArgumentParser, default: Any) -> None:
    """Add ``-v`` and ``-q`` to a parser that has no such options; hidden unless ``default`` is None."""
    if {"-v", "-q"} & set(parser._option_string_actions):
        return
    hidden = None if default is None else argparse.SUPPRESS
    parser.add_argument(
        "-v", "--verbose", action="count", default=default, help=hidden or "more log lines; -vv for all"
    )
    parser.add_argument(
        "-q",
        "--quiet",
        action="store_true",
        default=default,
        help=hidden or "errors only, without warnings and progress",
    )


def _add_verbosity_to_commands(parser: argparse.ArgumentParser) -> None:
    """Accept ``-v`` and ``-q`` after the words of a command, too."""
    _add_verbosity(parser, argparse.SUPPRESS)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                _add_verbosity_to_commands(child)


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


def _report(error: CdffError) -> int:
    message = missing_extra(error.__cause__) or str(error)
    # One line for each fault of a profile, one for every other error.
    texts = [str(fault) for fault in error.faults] if isinstance(error, FaultsError) else [message]
    for text in texts:
        line = " ".join(text.split()) or type(error).__name__
        print(f"{styled('cdff:', 'red', sys.stderr)} {line}", file=sys.stderr)
    return EXIT_REFUSED if isinstance(error, RefusedError) else EXIT_ERROR


if __name__ == "__main__":
    sys.exit(main())
