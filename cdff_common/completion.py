# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Completion of command lines in bash, zsh and fish, by argcomplete."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

from cdff_common.command_table import SUMMARIES
from cdff_common.extras import import_extra

SHELLS = ("bash", "zsh", "fish")


def register(nouns: Any) -> None:
    """Add ``cdff completion``."""
    parser = nouns.add_parser(
        "completion",
        help=SUMMARIES["completion"],
        description='Print the completion script of a shell. bash: eval "$(cdff completion bash)" in '
        "~/.bashrc; zsh: the same in ~/.zshrc after compinit; fish: cdff completion fish > "
        "~/.config/fish/completions/cdff.fish.",
    )
    parser.add_argument("shell", choices=SHELLS)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    sys.stdout.write(import_extra("argcomplete").shellcode(["cdff"], shell=args.shell) + "\n")
    return 0


def is_completing() -> bool:
    """Return whether the shell runs this process to complete a command line."""
    return "_ARGCOMPLETE" in os.environ


def complete(build_parser: Callable[[Sequence[str]], argparse.ArgumentParser]) -> None:
    """Write the completions of the command line of the shell and end the process.

    ``build_parser`` returns the parser for the words of the line.
    """
    words = os.environ.get("COMP_LINE", "").split()[1:]
    import_extra("argcomplete").autocomplete(build_parser(words))
