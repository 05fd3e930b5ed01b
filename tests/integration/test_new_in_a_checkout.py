# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff new`` in a copy of this checkout: the new files pass all checks but for fields of the author."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Compiled kernels in ``__pycache__`` are copied, because their compilation takes minutes.
_NOT_COPIED = shutil.ignore_patterns(".*", "build", "dist", "*.egg-info", "*.svg", "*.jpg", "images")
#: All tests are copied, because the checks read requirement ids from the text of the tests.
_COPIED = (
    "cdff_common",
    "cdff_core",
    "cdff_dev",
    "dpm_store",
    "services",
    "deploy",
    "docs",
    "tests",
    "benchmarks",
    "evaluation",
)


def _run(root: Path, *command: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(root)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # each command would compile every module
    return subprocess.run(
        [sys.executable, "-m", *command],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of this checkout with regenerated files and three new skeletons."""
    root = tmp_path_factory.mktemp("checkout")
    for folder in _COPIED:
        shutil.copytree(ROOT / folder, root / folder, ignore=_NOT_COPIED)
    shutil.copy(ROOT / "pyproject.toml", root)
    result = _run(root, "cdff_common.cli", "generate")
    assert result.returncode == 0, result.stderr
    for kind, name in (("dfn", "X1"), ("dfn", "V2Filter"), ("dfpc", "EdgeMapping")):
        result = _run(root, "cdff_common.cli", "new", kind, name)
        assert result.returncode == 0, result.stderr
        assert f"wrote docs/reference/{kind}s.md" in result.stdout
    return root


@pytest.mark.slow
def test_a_generated_skeleton_is_up_to_date_and_documented(checkout: Path) -> None:
    result = _run(checkout, "cdff_common.cli", "generate", "--check")
    assert result.returncode == 0, result.stdout + result.stderr
    for kind, folder in (("dfn", "x1"), ("dfn", "v2_filter"), ("dfpc", "edge_mapping")):
        assert f"({kind}s/{folder}.md)" in (checkout / "docs" / "reference" / f"{kind}s.md").read_text(
            encoding="utf-8"
        )


@pytest.mark.slow
def test_check_names_only_the_template_fields_that_the_author_must_complete(checkout: Path) -> None:
    before = _run(ROOT, "cdff_common.cli", "check").stdout.splitlines()[:-1]
    faults = [
        f for f in _run(checkout, "cdff_common.cli", "check").stdout.splitlines()[:-1] if f not in before
    ]
    assert sorted(faults) == [
        "DFN v2_filter: template field 'cost' is empty",
        "DFN x1: template field 'cost' is empty",
        "DFPC edge_mapping: template field 'cost' is empty",
    ]


@pytest.mark.slow
def test_a_generated_skeleton_passes_lint_and_its_own_tests(checkout: Path) -> None:
    folders = ["cdff_core/dfns/x1", "cdff_core/dfns/v2_filter", "cdff_core/dfpcs/edge_mapping"]
    for check in (["ruff", "check"], ["ruff", "format", "--check"]):
        result = _run(checkout, *check, *folders, *(f"tests/unit/{folder}" for folder in folders))
        assert result.returncode == 0, result.stdout
    result = _run(
        checkout, "pytest", "-q", "-p", "no:cacheprovider", *(f"tests/unit/{folder}" for folder in folders)
    )
    assert result.returncode == 0, result.stdout
    assert "9 passed" in result.stdout
