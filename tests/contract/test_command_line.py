# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import argparse
import re
from collections.abc import Iterator

import pytest

from cdff_common import cli
from cdff_common.command_table import SUMMARIES


def _parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                yield child
                yield from _parsers(child)


def test_every_command_has_a_summary_in_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    help_text = capsys.readouterr().out
    for action in cli.build_parser([])._actions:
        if isinstance(action, argparse._SubParsersAction):
            for choice in action._choices_actions:
                assert re.search(rf"^  {choice.dest}\s+\S", help_text, re.MULTILINE), choice.dest
                assert SUMMARIES.get(choice.dest) == choice.help, (
                    f"cdff {choice.dest}: cdff_common/command_table.py and its parser differ"
                )


def test_help_of_every_command_can_be_printed() -> None:
    for parser in _parsers(cli.build_parser([])):
        assert parser.format_help()


def test_every_command_without_subcommands_has_a_run_function() -> None:
    for parser in _parsers(cli.build_parser([])):
        has_subcommands = any(isinstance(a, argparse._SubParsersAction) for a in parser._actions)
        assert has_subcommands or callable(parser.get_default("run")), parser.prog


NOUNS = """
check demo dfn dfpc doctor dpm generate log new orchestrator replay request run service simulate up
"""


@pytest.mark.parametrize("noun", NOUNS.split())
def test_every_command_of_the_public_interface_exists(noun: str) -> None:
    assert cli.main([noun, "--help"]) == 0
