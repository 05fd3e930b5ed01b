# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rules for every file of the tree."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("cdff_common", "cdff_core", "cdff_dev", "dpm_store", "services")
SPDX = ("SPDX-FileCopyrightText: 2026 the CDFF contributors", "SPDX-License-Identifier: BSD-3-Clause")
WITH_LICENCE = {".py", ".asn", ".sh"}
BINARY = {".png", ".jpg", ".pcd", ".ply", ".msg", ".npz", ".tif", ".bin", ".las"}
#: Folders of a developer's machine; written in two halves, so that this file does not contain them.
MACHINE_PATHS = re.compile("|".join(f"/{name}/" for name in ("work", "root", "tmp/bash" + "_jobs", "farm")))
#: GPL packages: used for comparison in their own environment, never imported.
GPL = {"evo", "visp", "orbslam", "pyqt5", "PyQt5"}
MAX_LINES = 600


def _tracked() -> list[Path]:
    try:
        result = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"not a git checkout, the list of files is unknown: {error}")
    return [p for name in result.stdout.split("\0") if name and (p := ROOT / name).is_file()]


def _modules() -> list[Path]:
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def test_every_source_file_has_both_licence_lines() -> None:
    for path in _tracked():
        if path.suffix in WITH_LICENCE:
            head = path.read_text(encoding="utf-8")[:400]
            assert not head.strip() or all(line in head for line in SPDX), path.relative_to(ROOT)


def test_no_file_contains_a_path_of_a_developers_machine() -> None:
    for path in _tracked():
        if path.suffix not in BINARY:
            text = path.read_text(encoding="utf-8", errors="replace")
            assert MACHINE_PATHS.search(text) is None, path.relative_to(ROOT)


def test_no_tracked_file_is_over_one_megabyte() -> None:
    assert [p.relative_to(ROOT) for p in _tracked() if p.stat().st_size > 1_000_000] == []


def test_no_module_exceeds_the_maximum_length() -> None:
    generated = "# GENERATED from"
    for path in _modules():
        lines = path.read_text(encoding="utf-8").splitlines()
        if not any(line.startswith(generated) for line in lines[:4]):
            assert len(lines) <= MAX_LINES, path.relative_to(ROOT)


@pytest.mark.req("CDFF-DEV-010")
def test_shipped_packages_import_neither_the_toolkit_nor_gpl_packages() -> None:
    for path in _modules():
        package = path.relative_to(ROOT).parts[0]
        for name in _imports(path):
            assert name not in GPL, f"{path.relative_to(ROOT)} imports {name}"
            if package != "cdff_dev":
                assert name != "cdff_dev", f"{path.relative_to(ROOT)} imports the toolkit"


@pytest.mark.req("CDFF-CORE-012", "CDFF-CORE-031")
def test_imports_follow_the_layers() -> None:
    command = Path(sys.executable).parent / "lint-imports"
    result = subprocess.run([command, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


def test_algorithms_use_no_clock_environment_or_file() -> None:
    forbidden = {"time", "datetime", "socket", "subprocess", "threading", "multiprocessing", "os", "random"}
    for path in (p for part in ("dfns", "dfpcs") for p in (ROOT / "cdff_core" / part).rglob("*.py")):
        assert forbidden.isdisjoint(_imports(path)), path.relative_to(ROOT)
        calls = [
            n.func.id
            for n in ast.walk(_parsed(path))
            if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
        ]
        assert not {"open", "print", "input"} & set(calls), path.relative_to(ROOT)


def _parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _imports(path: Path) -> set[str]:
    """Return the top-level packages that a module imports."""
    names: set[str] = set()
    for node in ast.walk(_parsed(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names
