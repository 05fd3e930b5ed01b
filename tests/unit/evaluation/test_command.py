# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from pathlib import Path

import pytest

from cdff_common.cli import run_safely
from evaluation import __main__ as command
from evaluation import record


def test_every_evaluation_module_is_found() -> None:
    assert {"icp_localisation", "visual_odometry_sparse"} <= command.evaluations().keys()
    assert "record" not in command.evaluations()


def test_results_are_written_with_their_provenance(tmp_path: Path) -> None:
    path = record.write(tmp_path, "nothing", {"error_m": 0.1})
    written = json.loads(path.read_text())
    assert path == tmp_path / "docs" / "evaluation" / "nothing.json"
    assert written["figures"] == {"error_m": 0.1}
    assert {"commit", "tree_differs", "lock_sha256", "python", "machine", "created"} == written[
        "provenance"
    ].keys()


def test_a_record_of_uncommitted_code_is_refused_and_a_draft_is_only_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Quick:
        @staticmethod
        def evaluate(data: Path, progress: object) -> dict[str, float]:
            return {"error_m": 0.1}

    monkeypatch.setattr(command, "ROOT", tmp_path)
    monkeypatch.setattr(command, "evaluations", lambda: {"quick": Quick})
    monkeypatch.setattr(command, "provenance", lambda root: {"commit": "c", "tree_differs": True})
    assert run_safely(lambda: command.main(["quick", "--data", str(tmp_path)])) == 1
    assert "uncommitted changes" in capsys.readouterr().err
    assert command.main(["quick", "--data", str(tmp_path), "--draft"]) == 0
    assert capsys.readouterr().out == 'quick: {"error_m": 0.1}\n'
    assert not (tmp_path / "docs").exists()


def test_missing_data_and_unknown_names_are_errors_of_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_safely(lambda: command.main(["--data", str(tmp_path / "none")])) == 1
    assert "name it with --data or CDFF_DATA" in capsys.readouterr().err
    assert run_safely(lambda: command.main(["nonsense", "--data", str(tmp_path)])) == 1
    assert "known are" in capsys.readouterr().err


def test_a_repeated_part_keeps_the_other_results_and_has_its_own_provenance(tmp_path: Path) -> None:
    record.write(tmp_path, "two", {"first": 1, "second": 2})
    written = json.loads(record.write(tmp_path, "two", {"second": 3}, "second").read_text())
    assert written["figures"] == {"first": 1, "second": 3}
    assert written["provenance"]["parts"].keys() == {"second"}
    assert "parts" not in written["provenance"]["parts"]["second"]


def test_an_unknown_part_of_an_evaluation_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_safely(lambda: command.main(["missions:nonsense", "--data", str(tmp_path)])) == 1
    assert "no part 'nonsense'; expected long_traverse_localisation" in capsys.readouterr().err
