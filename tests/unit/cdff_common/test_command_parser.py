# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Suggestions for unknown words, verbosity, styles and completion of the command line."""

from __future__ import annotations

import io
import logging
import os
import subprocess
import sys

import pytest

from cdff_common import cli
from cdff_common.command_parser import suggestion
from cdff_common.terminal import first_sentence, is_quiet, styled, table


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["requst"], "did you mean request"),
        (["eval", "trajectry", "a", "b"], "did you mean trajectory"),
        (["request", "pose", "--jsn"], "did you mean --json"),
        (["eval", "trajectory", "a", "b", "--align", "sim"], "did you mean sim3"),
    ],
)
def test_an_unknown_word_is_answered_with_a_similar_one(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments) == 2
    assert expected in capsys.readouterr().err


def test_a_word_without_a_similar_one_has_no_suggestion() -> None:
    assert suggestion("xyz", ["request", "run"]) == ""


@pytest.mark.parametrize(("before", "after", "steps"), [("-v", "", 1), ("", "-vv", 2), ("", "-q", -1)])
def test_the_verbosity_is_given_before_or_after_the_command(
    before: str, after: str, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_steps: list[int] = []
    monkeypatch.setattr(cli, "set_verbosity", set_steps.append)
    words = [before, "eval", "trajectory", "none", "none", after]
    assert cli.main([word for word in words if word]) == 1
    assert set_steps == [steps]


def test_quiet_is_the_level_of_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not is_quiet()
    monkeypatch.setattr(logging.getLogger(), "level", logging.ERROR)
    assert is_quiet()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_styles_are_for_terminals_without_no_color(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert styled("a", "red", Terminal()) == "\x1b[31ma\x1b[0m"
    assert styled("a", "red", io.StringIO()) == "a"
    monkeypatch.setenv("NO_COLOR", "1")
    assert styled("a", "red", Terminal()) == "a"


def test_columns_are_aligned_under_their_header() -> None:
    assert table(("name", "n"), [("a", 1), ("longer", 20)]) == ["name    n", "a       1", "longer  20"]


def test_the_first_sentence_ends_at_a_full_stop_before_a_space() -> None:
    assert first_sentence("Cells of 0.5 m.\n Second.") == "Cells of 0.5 m."
    assert first_sentence("no stop") == "no stop"


def test_a_shell_completes_commands_and_options() -> None:
    pytest.importorskip("argcomplete")

    def completions(line: str) -> set[str]:
        environment = {
            **os.environ,
            "_ARGCOMPLETE": "1",
            "COMP_LINE": line,
            "COMP_POINT": str(len(line)),
            "_ARGCOMPLETE_STDOUT_FILENAME": "/dev/stdout",
            "_ARGCOMPLETE_IFS": "\n",
        }
        command = [sys.executable, "-m", "cdff_common.cli"]
        result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        return {word.strip() for word in result.stdout.splitlines()}

    assert completions("cdff req") == {"request"}
    assert "--plot" in completions("cdff request pose --p")
