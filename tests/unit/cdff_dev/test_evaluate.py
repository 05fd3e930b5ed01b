# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from pathlib import Path

import pytest

from cdff_common.cli import run_safely
from cdff_dev.evaluate import __main__ as command
from cdff_dev.evaluate import record


def test_every_module_that_evaluates_is_found() -> None:
    assert {"icp_localisation", "visual_odometry_sparse"} <= command.evaluations().keys()
    assert "record" not in command.evaluations()


def test_figures_are_written_with_where_they_come_from(tmp_path: Path) -> None:
    path = record.write(tmp_path, "nothing", {"error_m": 0.1})
    written = json.loads(path.read_text())
    assert path == tmp_path / "docs" / "evaluation" / "nothing.json"
    assert written["figures"] == {"error_m": 0.1}
    assert {"commit", "tree_differs", "lock_sha256", "python", "machine", "made"} == written["provenance"].keys()


def test_spread_of_errors_counts_them() -> None:
    assert record.spread([3.0, 1.0, 2.0]) == {"count": 3, "min": 1.0, "median": 2.0, "p95": 2.9, "max": 3.0}
    assert record.spread([]) == {"count": 0}


def test_missing_data_and_unknown_names_are_errors_of_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_safely(lambda: command.main(["--data", str(tmp_path / "none")])) == 1
    assert "name it with --data or CDFF_DATA" in capsys.readouterr().err
    assert run_safely(lambda: command.main(["nonsense", "--data", str(tmp_path)])) == 1
    assert "known are" in capsys.readouterr().err


def test_a_part_run_again_leaves_the_other_figures_and_says_where_it_comes_from(tmp_path: Path) -> None:
    record.write(tmp_path, "two", {"first": 1, "second": 2})
    written = json.loads(record.write(tmp_path, "two", {"second": 3}, "second").read_text())
    assert written["figures"] == {"first": 1, "second": 3}
    assert written["provenance"]["parts"].keys() == {"second"}
    assert "parts" not in written["provenance"]["parts"]["second"]


def test_a_part_that_an_evaluation_has_not_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_safely(lambda: command.main(["missions:nonsense", "--data", str(tmp_path)])) == 1
    assert "no part 'nonsense'; expected long_traverse_localisation" in capsys.readouterr().err
