# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cdff_common import cli
from cdff_common.errors import ConflictError, InputError
from cdff_dev.generate.artefacts import due
from cdff_dev.generate.plan import plan
from cdff_dev.new.scaffold import scaffold
from cdff_dev.tree import Tree

ROOT = Path(__file__).resolve().parents[4]


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    """A checkout that contains only the packages and the tool configuration."""
    for package in ("cdff_core", "cdff_core/dfns", "cdff_core/dfpcs"):
        (tmp_path / package).mkdir()
        shutil.copy(ROOT / package / "__init__.py", tmp_path / package)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return Tree(tmp_path)


def _run(tree: Tree, *command: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(tree.root)}
    return subprocess.run(
        [sys.executable, "-m", *command],
        cwd=tree.root,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.req("CDFF-DEV-041", "CDFF-DEV-050")
def test_new_skeletons_pass_their_own_tests_and_lint(tree: Tree) -> None:
    scaffold(tree, "dfn", "EdgeKeeper")
    scaffold(tree, "dfpc", "edge_mapping")
    for check in (["ruff", "check", "."], ["ruff", "format", "--check", "."]):
        completed = _run(tree, *check)
        assert completed.returncode == 0, completed.stdout
    completed = _run(tree, "pytest", "-q", "tests")
    assert completed.returncode == 0, completed.stdout
    assert "6 passed" in completed.stdout


def test_nothing_is_to_be_generated_after_new_files_are_written(tree: Tree) -> None:
    scaffold(tree, "dfn", "EdgeKeeper")
    scaffold(tree, "dfpc", "EdgeMapping")
    assert due(plan(tree, ["interfaces", "skeletons"])) == []


def test_a_name_may_be_that_of_the_class_or_of_the_folder(tree: Tree) -> None:
    scaffold(tree, "dfn", "edge_keeper")
    scaffold(tree, "dfn", "RockFinder3D")
    skeleton = (tree.folder("dfn", "edge_keeper") / "edge_keeper.py").read_text()
    assert "class EdgeKeeper(Interface[" in skeleton
    assert tree.folder("dfn", "rock_finder_3d").is_dir()


@pytest.mark.parametrize("name", ["X1", "V2Filter", "x1", "v2_filter"])
def test_folder_and_class_names_agree_if_a_number_follows_a_capital(tree: Tree, name: str) -> None:
    paths = scaffold(tree, "dfn", name)
    assert [d.folder for d in tree.dfns()] == [paths[0].parent.name]
    assert due(plan(tree, ["interfaces", "skeletons"])) == []


def test_a_name_in_use_by_a_dfn_or_dfpc_is_refused(tree: Tree) -> None:
    scaffold(tree, "dfn", "EdgeKeeper")
    with pytest.raises(ConflictError, match="edge_keeper exists"):
        scaffold(tree, "dfpc", "EdgeKeeper")


@pytest.mark.parametrize("name", ["../evil", "3d_thing", "a b", "", "x" * 80])
def test_an_invalid_identifier_is_refused(tree: Tree, name: str) -> None:
    with pytest.raises(InputError, match="expected an identifier"):
        scaffold(tree, "dfn", name)


def test_the_command_lists_the_written_files(tree: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["new", "dfn", "EdgeKeeper", "--root", str(tree.root)]) == 0
    assert "wrote cdff_core/dfns/edge_keeper/dfn.yaml" in capsys.readouterr().out
