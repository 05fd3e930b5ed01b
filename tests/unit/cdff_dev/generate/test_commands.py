# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from cdff_common import cli
from cdff_common.errors import ConfigurationError
from cdff_dev.generate.artefacts import Artefact, due
from cdff_dev.generate.interfaces import interfaces
from cdff_dev.generate.plan import plan
from cdff_dev.generate.python_source import sentence
from cdff_dev.generate.skeletons import skeletons
from cdff_dev.tree import Tree

FIG3 = Path(__file__).resolve().parents[3] / "data" / "fig3_laser_filter.yaml"


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    """A tree that contains only the description of the paper's Fig. 3."""
    folder = tmp_path / "cdff_core" / "dfns" / "laser_filter"
    folder.mkdir(parents=True)
    shutil.copy(FIG3, folder / "dfn.yaml")
    return Tree(tmp_path)


def _describe(tree: Tree, text: str) -> None:
    (tree.root / "cdff_core" / "dfns" / "laser_filter" / "dfn.yaml").write_text(text)


@pytest.mark.req("CDFF-DEV-040")
def test_the_description_of_fig_3_gives_an_interface_and_a_module_per_implementation(tree: Tree) -> None:
    results = {a.path.relative_to(tree.root).as_posix(): a.text for a in interfaces(tree) + skeletons(tree)}
    assert sorted(results) == [
        "cdff_core/dfns/laser_filter/__init__.py",
        "cdff_core/dfns/laser_filter/box_filter.py",
        "cdff_core/dfns/laser_filter/interface.py",
        "cdff_core/dfns/laser_filter/noise_filter.py",
        "tests/unit/cdff_core/dfns/laser_filter/test_box_filter.py",
        "tests/unit/cdff_core/dfns/laser_filter/test_noise_filter.py",
    ]
    text = results["cdff_core/dfns/laser_filter/interface.py"]
    assert "# GENERATED from dfn.yaml by cdff generate; do not edit." in text
    assert "    scan_samples: LaserScan\n    laser_2_body_tf: RigidBodyState\n" in text
    assert "class LaserFilterInterface(Dfn[ConfigT, LaserFilterInputs, LaserFilterOutputs]):" in text


def test_generating_twice_gives_the_same_text(tree: Tree) -> None:
    assert plan(tree, ["interfaces", "skeletons"]) == plan(tree, ["interfaces", "skeletons"])


def test_optional_and_array_ports_follow_required_ones(tree: Tree) -> None:
    _describe(
        tree,
        "name: LaserFilter\n"
        "input_ports:\n"
        "  - {name: mask, type: 'bool[n]', optional: true}\n"
        "  - {name: points, type: 'float64[n,3]', doc: in the sensor frame}\n"
        "output_ports: []\n",
    )
    text = interfaces(tree)[0].text
    assert "    points: NDArray[np.float64]\n    mask: NDArray[np.bool_] | None = None\n" in text
    assert "points : ndarray of float64, shape (n,3)\n        In the sensor frame.\n" in text


def test_text_of_a_description_is_escaped_in_the_docstring(tree: Tree) -> None:
    text_with_quotes = 'evil """ \\' + "x" * 300
    _describe(
        tree,
        json.dumps({"name": "LaserFilter", "doc": text_with_quotes, "input_ports": [], "output_ports": []}),
    )
    compile(interfaces(tree)[0].text, "interface.py", "exec")


def test_description_in_a_folder_of_another_name_is_refused(tree: Tree) -> None:
    _describe(tree, "name: Other\n")
    with pytest.raises(ConfigurationError, match="belongs in folder other"):
        interfaces(tree)


def test_unknown_key_of_a_description_is_refused_with_file_and_key(tree: Tree) -> None:
    _describe(tree, "name: LaserFilter\nimplementation: [NoiseFilter]\n")
    with pytest.raises(ConfigurationError, match=r"laser_filter/dfn\.yaml: implementation="):
        interfaces(tree)


def test_interface_is_overwritten_and_implementation_is_kept(tree: Tree) -> None:
    for artefact in plan(tree, ["interfaces", "skeletons"]):
        artefact.write()
    folder = tree.folder("dfn", "laser_filter")
    (folder / "interface.py").write_text("edited")
    (folder / "noise_filter.py").write_text("written by hand")
    assert [a.path.name for a in due(plan(tree, ["interfaces", "skeletons"]))] == ["interface.py"]


def test_check_lists_the_stale_file_and_changes_nothing(
    tree: Tree, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["generate", "interfaces", "--check", "--root", str(tree.root)]) == 1
    captured = capsys.readouterr()
    assert captured.out == "cdff_core/dfns/laser_filter/interface.py\n"
    assert "run cdff generate" in captured.err
    assert not (tree.folder("dfn", "laser_filter") / "interface.py").exists()


def test_dry_run_shows_the_difference_and_changes_nothing(
    tree: Tree, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["generate", "interfaces", "--dry-run", "--root", str(tree.root)]) == 0
    assert "+class LaserFilterInputs:" in capsys.readouterr().out
    assert not (tree.folder("dfn", "laser_filter") / "interface.py").exists()


def test_generate_is_idempotent(tree: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["generate", "interfaces", "--root", str(tree.root)]) == 0
    assert "wrote cdff_core/dfns/laser_filter/interface.py" in capsys.readouterr().out
    assert cli.main(["generate", "interfaces", "--check", "--root", str(tree.root)]) == 0


def test_a_module_of_an_undescribed_implementation_is_stale(
    tree: Tree, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["generate", "interfaces", "skeletons", "--root", str(tree.root)]
    assert cli.main(command) == 0
    description = tree.folder("dfn", "laser_filter") / "dfn.yaml"
    description.write_text(description.read_text().replace("BoxFilter", "SphereFilter"))
    capsys.readouterr()
    assert cli.main(command) == 0
    captured = capsys.readouterr()
    assert "wrote cdff_core/dfns/laser_filter/sphere_filter.py" in captured.out
    assert "stale: cdff_core/dfns/laser_filter/box_filter.py" in captured.err
    assert "stale: tests/unit/cdff_core/dfns/laser_filter/test_box_filter.py" in captured.err
    assert cli.main([*command, "--check"]) == 1


def test_a_folder_without_description_is_stale(tree: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["generate", "interfaces", "--root", str(tree.root)]) == 0
    (tree.folder("dfn", "laser_filter") / "dfn.yaml").unlink()
    assert cli.main(["generate", "skeletons", "--check", "--root", str(tree.root)]) == 1
    assert "stale: cdff_core/dfns/laser_filter:" in capsys.readouterr().err


def test_reference_pages_are_compared_only_after_the_skeletons_exist(
    tree: Tree, capsys: pytest.CaptureFixture[str]
) -> None:
    groups = ["interfaces", "skeletons", "reference"]
    assert cli.main(["generate", *groups, "--check", "--root", str(tree.root)]) == 1
    captured = capsys.readouterr()
    assert "cdff_core/dfns/laser_filter/box_filter.py" in captured.out
    assert "reference: not compared" in captured.err


def test_unknown_group_is_refused_with_the_known_ones(tree: Tree) -> None:
    with pytest.raises(ConfigurationError, match="known are types, interfaces"):
        plan(tree, ["nonsense"])


def test_diff_names_files_relative_to_the_tree(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("old\n")
    assert Artefact(tmp_path / "page.md", "new\n").diff(tmp_path).startswith("--- a/page.md\n+++ b/page.md\n")


@pytest.mark.parametrize(
    ("text", "expected"), [("scans of  a\nlaser", "Scans of a laser."), ("Ready?", "Ready?"), ("", "")]
)
def test_a_sentence_starts_with_a_capital_and_ends_with_a_full_stop(text: str, expected: str) -> None:
    assert sentence(text) == expected
