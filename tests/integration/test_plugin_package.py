# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The example plug-in: installed by pip without network; a broken plug-in does not affect the others."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.integration.conftest import ROOT

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the installed plug-in."""
    if missing := [name for name in ("pip", "setuptools") if importlib.util.find_spec(name) is None]:
        pytest.skip(f"{missing[0]} is not installed")
    folder = tmp_path_factory.mktemp("plugin")
    source = shutil.copytree(ROOT / "examples" / "plugin_package", folder / "source")
    offline = ("--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--disable-pip-version-check")
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        *offline,
        "--target",
        str(folder / "site"),
        str(source),
    ]
    subprocess.run(command, check=True, timeout=120)
    return folder / "site"


def run(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}
    command = [sys.executable, "-m", *arguments]
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=120
    )


def test_installed_plugin_passes_its_own_test(site: Path) -> None:
    result = run(site, "pytest", "-q", "-p", "no:cacheprovider", "examples/plugin_package/tests")
    assert result.returncode == 0, result.stdout


def test_installed_plugin_is_listed_among_the_dfns_and_dfpcs(site: Path) -> None:
    for kind, name in (("dfn", "position_smoothing"), ("dfpc", "pose_smoother")):
        result = run(site, "cdff_common.cli", kind, "list", "--json")
        assert result.returncode == 0, result.stderr
        assert name in [row["name"] for row in json.loads(result.stdout)[f"{kind}s"]]


@pytest.mark.parametrize(
    ("file", "text", "reason"),
    [
        ("dfn.yaml", "name: PositionSmoothing\nimplementation: [A]\n", "dfn.yaml: implementation="),
        ("exponential_average.py", "", "exponential_average.py: AttributeError"),
        (
            "exponential_average.py",
            "import nothing_of_that_name\n",
            "exponential_average.py: ModuleNotFoundError",
        ),
        ("../__init__.py", "1 / 0\n", "ZeroDivisionError"),
    ],
)
def test_a_broken_plugin_is_listed_with_file_and_reason_and_does_not_affect_others(
    site: Path, tmp_path: Path, file: str, text: str, reason: str
) -> None:
    broken = shutil.copytree(site, tmp_path / "site")
    (broken / "cdff_example_plugin" / "dfns" / "position_smoothing" / file).write_text(text)
    result = run(broken, "cdff_common.cli", "dfn", "list", "--json")
    document = json.loads(result.stdout)
    assert result.returncode == 1
    assert any(reason in failure for failure in document["failures"].values()), document["failures"]
    assert "laser_filter" in [row["name"] for row in document["dfns"]]
