# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parser of commands that suggests similar words for unknown commands, options and values."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Sequence
from typing import NoReturn

_CHOICE = re.compile(r"invalid choice: '(?P<word>.*?)' \(choose from (?P<choices>.*)\)")
_UNKNOWN = re.compile(r"unrecognized arguments: (?P<word>--?[\w-]+)")


class CommandParser(argparse.ArgumentParser):
    """Parser whose usage errors end with "did you mean", as do those of the parsers of its commands."""

    def parse_command(self, args: Sequence[str]) -> argparse.Namespace:
        """Parse a command line; unknown options are compared with those of its command."""
        parsed, unknown = self.parse_known_args(args)
        if unknown:
            command = self._command_of(args)
            command.error(f"unrecognized arguments: {' '.join(unknown)}")
        return parsed

    def error(self, message: str) -> NoReturn:
        """Print the usage and the message with suggestions, and exit with 2."""
        super().error(message + self._suggestion(message))

    def _suggestion(self, message: str) -> str:
        if match := _CHOICE.search(message):
            return suggestion(match["word"], (word.strip(" '") for word in match["choices"].split(",")))
        if match := _UNKNOWN.search(message):
            return suggestion(match["word"], self._option_string_actions)
        return ""

    def _command_of(self, args: Sequence[str]) -> argparse.ArgumentParser:
        """Return the parser of the command that the words of a command line select."""
        parser: argparse.ArgumentParser = self
        for word in args:
            for action in parser._actions:
                if isinstance(action, argparse._SubParsersAction) and word in action.choices:
                    parser = action.choices[word]
        return parser


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return "; did you mean …?" with the known words that are similar; empty without one."""
    from difflib import get_close_matches

    similar = get_close_matches(word, list(known), n=2, cutoff=0.6)
    return f"; did you mean {' or '.join(similar)}?" if similar else ""
