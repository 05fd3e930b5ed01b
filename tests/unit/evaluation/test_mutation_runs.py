# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs of tests on changed code: limits of CPU time; outcomes hold as long as their sources and tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from evaluation.runs.import_graph import ImportGraph
from evaluation.runs.mutation_progress import MutationProgress
from evaluation.runs.nearest_tests import NearestTests

ROOT = Path(__file__).resolve().parents[3]
SERVED = "import sys; from evaluation.runs import mutation_server as s; s._LIBRARIES = (); s.main()"


def served(folder: Path, *sources: str) -> list[dict[str, Any]]:
    """Return the answers of the server for one test file after the other."""
    requests = []
    for number, source in enumerate(sources):
        file = folder / f"test_{number}.py"
        file.write_text(source, encoding="utf-8")
        requests.append(
            json.dumps(
                {"arguments": [str(file), "-c", str(folder / "pytest.ini")], "cpu_s": 3, "idle_s": 3.0}
            )
        )
    (folder / "pytest.ini").write_text(
        "[pytest]\naddopts = -p no:dash -p no:schemathesis\n", encoding="utf-8"
    )
    completed = subprocess.run(
        [sys.executable, "-c", SERVED],
        cwd=ROOT,
        input="\n".join(requests),
        capture_output=True,
        text=True,
        check=True,
    )
    return [json.loads(line) for line in completed.stdout.splitlines()]


@pytest.mark.slow
def test_an_endless_loop_and_an_endless_wait_are_timeouts_and_a_crash_is_a_failure(tmp_path: Path) -> None:
    loop, wait, crash, late = served(
        tmp_path,
        "def test_a():\n    while True: pass\n",
        "import time\ndef test_a():\n    time.sleep(60)\n",
        "import os\ndef test_a():\n    os.abort()\n",
        "import time\ndef test_a():\n    time.sleep(0.3)\n    assert False\n",
    )
    assert loop["outcome"] == wait["outcome"] == "timeout"
    assert crash["outcome"] == late["outcome"] == "failed"
    assert late["test"].endswith("::test_a")
    assert late["waited_s"] > 0.25


def commit(root: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
    for command in (["init", "-q"], ["add", "."], [*identity, "commit", "-qm", "a"]):
        subprocess.run(["git", *command], cwd=root, check=True)


def test_an_outcome_holds_until_its_sources_or_its_tests_change(tmp_path: Path) -> None:
    folders = ("cdff_common", "cdff_core", "cdff_dev", "dpm_store", "services", "evaluation")
    files = [f"{folder}/{name}.py" for folder in folders for name in "ab"]
    commit(tmp_path, dict.fromkeys([*files, "tests/one.py", "tests/other.py"], "1"))
    killed, survived = "cdff_core/a.py::f constant #1", "cdff_core/a.py::f constant #2"
    progress = MutationProgress(tmp_path)
    progress.add(killed, {"outcome": "killed", "test": "tests/one.py::test_a"})
    progress.add(survived, {"outcome": "survived", "test": ""})

    def outcomes() -> list[str | None]:
        progress = MutationProgress(tmp_path)
        answers = (progress.answer(killed), progress.answer(survived))
        return [None if answer is None else answer["outcome"] for answer in answers]

    assert outcomes() == ["killed", "survived"]
    commit(tmp_path, {"tests/other.py": "2"})
    assert outcomes() == ["killed", None]
    commit(tmp_path, {"cdff_core/b.py": "2"})
    assert outcomes() == ["killed", None]
    commit(tmp_path, {"cdff_core/a.py": "2"})
    assert outcomes() == [None, None]


def test_killed_mutants_of_the_record_are_known(tmp_path: Path) -> None:
    commit(tmp_path, {"cdff_core/a.py": "1", "tests/one.py": "1"})
    key = "cdff_core/a.py::f constant #1"
    answer = MutationProgress(tmp_path).add(key, {"outcome": "killed", "test": "tests/one.py::test_a"})
    (tmp_path / "build" / "mutation.json").unlink()
    row = {"part": "algorithms", "line": 1, "mutant": key, **answer}
    record = {"figures": {"mutants": [row, {"mutant": "of an old record", "outcome": "killed", "test": ""}]}}
    commit(tmp_path, {"docs/evaluation/mutation.json": json.dumps(record)})
    assert MutationProgress(tmp_path).answer(key) == answer
    assert MutationProgress(tmp_path).answer("of an old record") is None


def test_uncommitted_changes_neither_use_nor_store_outcomes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "evaluation.runs.mutation_progress.provenance", lambda root: {"commit": "", "tree_differs": True}
    )
    monkeypatch.setattr(MutationProgress, "_object_of", lambda self, path: path)
    MutationProgress(tmp_path).add("key", {"outcome": "survived", "test": ""})
    assert MutationProgress(tmp_path).answer("key") is None


TREE = {
    "cdff_common/grid.py": "import numpy\n",
    "cdff_core/dfns/grid_search/_walk.py": "from cdff_common.grid import cell\n",
    "cdff_core/dfns/grid_search/breadth.py": "from cdff_core.dfns.grid_search import _walk\nclass Breadth:\n",
    "cdff_core/dfpcs/planner/dfpc.yaml": "- {dfn_id: a, name: GridSearch, implementation: Breadth}\n",
    "cdff_core/dfpcs/planner/compound.py": "class Planner: ...\n",
    "tests/support/plans.py": "from cdff_core.dfpcs.planner.compound import Planner\n",
    "tests/unit/test_grid.py": "import cdff_common.grid\n",
    "tests/unit/test_by_name.py": 'registry.make_dfn("grid_search")\n',
    "tests/unit/test_planner.py": "from tests.support.plans import plan\n",
    "tests/unit/test_other.py": "# grid\n",
}


def test_tests_reach_a_file_by_imports_and_by_the_names_of_plugins() -> None:
    steps = ImportGraph(TREE).steps_to("cdff_common/grid.py")
    reached = {name: count for name, count in steps.items() if name.startswith("tests/unit/")}
    assert reached == {
        "tests/unit/test_grid.py": 1,
        "tests/unit/test_by_name.py": 4,  # the implementation by its name (2), its module _walk, the grid
        "tests/unit/test_planner.py": 6,  # plans, compound, its implementation (2), _walk, the grid
    }


def write_tree(root: Path, files: dict[str, str]) -> None:
    """Write files, and tests of nothing so that words of the others are rare."""
    for name, text in (files | {f"tests/unit/test_{n}.py": "" for n in range(30)}).items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")


def test_defaults_of_parameters_are_compared_with_the_reference_pages_also_if_that_is_slow(
    tmp_path: Path,
) -> None:
    write_tree(tmp_path, TREE)
    nearest = NearestTests(tmp_path)
    path = "cdff_core/dfns/grid_search/breadth.py"
    first, second, third = nearest.groups(path, "")
    assert first[0].endswith("test_generated_files_are_up_to_date[reference]")
    assert (len(second), len(third)) == (2, 6)
    assert nearest.groups(path, "Breadth.process")[0] == second


def test_tests_that_execute_a_file_run_before_those_that_only_have_its_name(tmp_path: Path) -> None:
    often = {"tests/unit/test_other.py": "# grid cell\n" * 50}
    write_tree(tmp_path, TREE | often)
    first, second = NearestTests(tmp_path).groups("cdff_common/grid.py", "cell")
    assert first[0] == "tests/unit/test_grid.py"
    assert set(first[1:] + second[:2]) == {f"tests/unit/test_{n}.py" for n in ("by_name", "planner", "other")}
    slow = tmp_path / "tests/unit/test_grid.py"
    slow.write_text(slow.read_text(encoding="utf-8") + "# pytest.mark.slow\n", encoding="utf-8")
    *_, last = NearestTests(tmp_path).groups("cdff_common/grid.py", "cell")
    assert last[:2] == ("tests/unit/test_grid.py", "-m")
