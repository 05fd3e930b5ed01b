# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff new`` in a copy of this checkout: what it makes is found, up to date, lint-free, and says what is missing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_LEFT = shutil.ignore_patterns(".*", "build", "dist", "*.egg-info", "__pycache__", "*.svg", "*.jpg", "images")
#: Tests that the checks and the pages need are all of them: requirement ids are read from their text.
_NEEDED = ("cdff_common", "cdff_core", "cdff_dev", "dpm_store", "services", "deploy", "docs", "tests", "benchmarks")


def _run(root: Path, *command: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, "-m", *command], cwd=root, env=environment, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of this checkout with all that is generated made anew, then three new nodes."""
    root = tmp_path_factory.mktemp("checkout")
    for folder in _NEEDED:
        shutil.copytree(ROOT / folder, root / folder, ignore=_LEFT)
    shutil.copy(ROOT / "pyproject.toml", root)
    done = _run(root, "cdff_common.cli", "generate")
    assert done.returncode == 0, done.stderr
    for kind, name in (("dfn", "X1"), ("dfn", "V2Filter"), ("dfpc", "EdgeMapping")):
        done = _run(root, "cdff_common.cli", "new", kind, name)
        assert done.returncode == 0, done.stderr
        assert f"wrote docs/reference/{kind}s.md" in done.stdout
    return root


@pytest.mark.slow
def test_what_new_made_is_up_to_date_and_on_the_pages(checkout: Path) -> None:
    done = _run(checkout, "cdff_common.cli", "generate", "--check")
    assert done.returncode == 0, done.stdout + done.stderr
    for kind, folder in (("dfn", "x1"), ("dfn", "v2_filter"), ("dfpc", "edge_mapping")):
        assert f"(#{folder})" in (checkout / "docs" / "reference" / f"{kind}s.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_check_names_the_template_fields_that_the_author_owes_and_nothing_else(checkout: Path) -> None:
    before = _run(ROOT, "cdff_common.cli", "check").stdout.splitlines()[:-1]
    faults = [f for f in _run(checkout, "cdff_common.cli", "check").stdout.splitlines()[:-1] if f not in before]
    assert sorted(faults) == [
        "DFN v2_filter: template field 'cost' is empty",
        "DFN x1: template field 'cost' is empty",
        "DFPC edge_mapping: template field 'cost' is empty",
    ]


@pytest.mark.slow
def test_what_new_made_passes_lint_and_its_own_tests(checkout: Path) -> None:
    made = ["cdff_core/dfns/x1", "cdff_core/dfns/v2_filter", "cdff_core/dfpcs/edge_mapping"]
    for check in (["ruff", "check"], ["ruff", "format", "--check"]):
        done = _run(checkout, *check, *made, *(f"tests/unit/{folder}" for folder in made))
        assert done.returncode == 0, done.stdout
    done = _run(checkout, "pytest", "-q", "-p", "no:cacheprovider", *(f"tests/unit/{folder}" for folder in made))
    assert done.returncode == 0, done.stdout
    assert "9 passed" in done.stdout
