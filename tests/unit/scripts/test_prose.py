# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The prose check reports refused phrases and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from scripts import prose

RULES = yaml.safe_load(prose.RULES.read_text(encoding="utf-8"))


def phrases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str) -> list[tuple[int, str]]:
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    (tmp_path / name).write_text(text, encoding="utf-8")
    return [(finding.line, finding.phrase) for finding in prose.check_file(name, RULES)]


def test_docstrings_comments_and_messages_are_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (
        '"""What a module holds."""\n'
        "# nobody reads it\n"
        "nobody = 1\n"
        'message = f"{nobody} items were let go"\n'
        'key = "beside"\n'
    )
    result = phrases(tmp_path, monkeypatch, "a.py", text)
    assert sorted(result) == [(1, "What"), (2, "nobody"), (4, "let go")]


def test_code_on_pages_is_not_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "The field `nobody` is removed.\n```\necho nobody\n```\nIt stands beside\nthe other.\n"
    assert phrases(tmp_path, monkeypatch, "a.md", text) == [(5, "beside")]


def test_yaml_is_checked_and_names_of_interfaces_are_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert phrases(tmp_path, monkeypatch, "a.yaml", "doc: made anew\nkey: verdicts\n") == [(1, "anew")]


def test_long_lines_and_unformatted_statements_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    (tmp_path / "a.py").write_text("x = 1\n" * 3 + "#" * 111 + "\n", encoding="utf-8")
    limits = {"fmt_skip": 0, "long_lines": 0, "line_length": 110}
    assert [f.phrase for f in prose.check_layout(["a.py"], limits)] == ["1 long_lines"]
    assert list(prose.check_layout(["a.py"], {**limits, "long_lines": 1})) == []
