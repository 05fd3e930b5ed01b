# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cli.md``: all commands, from their parsers; the page does not depend on the Python version."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from cdff_common import cli
from cdff_dev.generate.python_source import render


@dataclass(frozen=True, slots=True)
class Command:
    """A command: its words, its description, and ``(syntax, default, help)`` of its arguments."""

    words: str
    doc: str
    arguments: tuple[tuple[str, str, str], ...]


def page() -> str:
    """Return the page of all installed commands."""
    with _without_settings():
        parser = cli.build_parser([])
    return render("cli.md.j2", commands=list(_commands(parser, "cdff", "")))


@contextmanager
def _without_settings() -> Iterator[None]:
    """Remove the environment variables ``CDFF_*``, which change defaults, while the block runs."""
    removed = {name: os.environ.pop(name) for name in list(os.environ) if name.startswith("CDFF_")}
    try:
        yield
    finally:
        os.environ.update(removed)


def _commands(parser: argparse.ArgumentParser, words: str, doc: str) -> Iterator[Command]:
    """Yield the commands of a parser and its sub-parsers."""
    nested = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not nested:
        yield Command(
            words, parser.description or doc, tuple(_argument(a) for a in parser._actions if _is_shown(a))
        )
    for action in nested:
        docs = {choice.dest: choice.help or "" for choice in action._choices_actions}
        for name, child in sorted(action.choices.items()):
            yield from _commands(child, f"{words} {name}", docs.get(name, ""))


def _is_shown(action: argparse.Action) -> bool:
    return action.help != argparse.SUPPRESS and not isinstance(action, argparse._HelpAction)


def _argument(action: argparse.Action) -> tuple[str, str, str]:
    """Return syntax, default and help of an argument."""
    value = action.metavar or (
        f"{{{','.join(map(str, action.choices))}}}" if action.choices else action.dest.upper()
    )
    value = " ".join(value) if isinstance(value, tuple) else value
    if action.option_strings:
        syntax = ", ".join(action.option_strings) + ("" if action.nargs == 0 else f" {value}")
    else:
        syntax = {"*": f"[{value} …]", "+": f"{value} …", "?": f"[{value}]"}.get(str(action.nargs), value)
    return (
        syntax,
        _default(action),
        " ".join((action.help or "").split()) % vars(action) if action.help else "",
    )


def _default(action: argparse.Action) -> str:
    """Return the default as text; empty if there is none, or if it is a folder of this machine."""
    default = action.default
    if default in (None, False, True, [], argparse.SUPPRESS):
        return ""
    if isinstance(default, Path) and default.is_absolute():
        return ""
    return str(default)
