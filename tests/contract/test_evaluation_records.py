# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every evaluation record names the code that it was made with: a commit in the history, without changes."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
RECORDS = sorted((ROOT / "docs" / "evaluation").glob("*.json"))
#: Commit of the oldest record, which a repository with the whole history contains.
_FIRST_RECORDED = "4ca50e4caaf14ba5c03db59f1252a4e7f6945d49"


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.stem)
def test_a_record_names_a_commit_in_the_history_and_a_clean_tree(record: Path) -> None:
    for part, origin in _origins(json.loads(record.read_text(encoding="utf-8"))["provenance"]):
        assert not origin["tree_differs"], f"{record.name}{part}: recorded with uncommitted changes"
        assert origin["commit"] in _history(), (
            f"{record.name}{part}: {origin['commit']} is not in the history"
        )


def _origins(provenance: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    yield "", provenance
    for part, origin in provenance.get("parts", {}).items():
        yield f", part {part}", origin


@cache
def _history() -> frozenset[str]:
    """Return the commits that HEAD descends from; skips the test in a tree without the whole history."""
    try:
        shallow = _git("rev-parse", "--is-shallow-repository")
        commits = _git("rev-list", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git repository")
    history = frozenset(commits.split())
    if shallow.strip() != "false" or _FIRST_RECORDED not in history:
        pytest.skip("the repository does not contain the whole history")
    return history


def _git(*arguments: str) -> str:
    command = ["git", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
