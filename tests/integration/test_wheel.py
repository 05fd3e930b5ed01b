# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The wheel, installed with one extra each into new environments outside the checkout."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.integration.conftest import ROOT

pytestmark = [pytest.mark.integration, pytest.mark.slow]


def run(command: list[str | Path], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "CDFF", "VIRTUAL"))}
    return subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.fixture(scope="module")
def uv() -> list[str]:
    """The command line of uv, which also sets up the development environment."""
    if shutil.which("uv"):
        return ["uv"]
    if run([sys.executable, "-m", "uv", "--version"], ROOT).returncode == 0:
        return [sys.executable, "-m", "uv"]
    pytest.skip("uv is not installed")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    build = run([sys.executable, "-m", "hatchling", "build", "-d", out], ROOT)
    assert build.returncode == 0, build.stderr
    assert len(list(out.glob("*.tar.gz"))) == 1
    return next(out.glob("*.whl"))


def install(uv: list[str], wheel: Path, extra: str, folder: Path) -> Path:
    """Install the wheel with one extra and return the folder of its programs."""
    venv = folder / "venv"
    assert run([*uv, "venv", "--quiet", "--python", sys.executable, venv], folder).returncode == 0
    python = venv / "bin" / "python"
    requirements = ["-c", ROOT / "requirements" / f"{extra}.txt", f"cdff[{extra}] @ {wheel.as_uri()}"]
    # The set-up has filled the cache of uv; without this cache, the package index is used.
    for source in (["--offline"], []):
        result = run([*uv, "pip", "install", "--quiet", *source, "--python", python, *requirements], folder)
        if result.returncode == 0:
            return python.parent
    raise AssertionError(result.stderr)


def test_wheel_and_sdist_are_reproducible(wheel: Path, tmp_path: Path) -> None:
    """Two builds from other folders, with other modes and times of the files, have the same bytes."""
    tracked = run(["git", "ls-files", "-z"], ROOT)
    if tracked.returncode != 0:
        pytest.skip("not a git checkout, the list of files is unknown")
    copy, out = tmp_path / "copy", tmp_path / "dist"
    for name in filter(None, tracked.stdout.split("\0")):
        if (ROOT / name).is_file():
            target = copy / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, target)
            target.chmod(0o700 if (ROOT / name).stat().st_mode & 0o100 else 0o600)
            os.utime(target, (1_000_000_000, 1_000_000_000))
    build = run([sys.executable, "-m", "hatchling", "build", "-d", out], copy)
    assert build.returncode == 0, build.stderr
    digests = [
        {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}
        for folder in (wheel.parent, out)
    ]
    assert digests[0] == digests[1]


def test_the_client_installation_contains_no_algorithm_library(
    uv: list[str], wheel: Path, tmp_path: Path
) -> None:
    programs = install(uv, wheel, "client", tmp_path)
    packages = run([*uv, "pip", "list", "--python", programs / "python"], tmp_path).stdout.lower()
    assert not {"numba", "scipy", "sqlalchemy", "open3d-cpu"} & set(packages.split())
    imported = run(
        [programs / "python", "-c", "from cdff_common.client import Client, AsyncClient"], tmp_path
    )
    assert imported.returncode == 0, imported.stderr
    refused = run([programs / "cdff", "run", "disparity_image", "left=a.png", "--out", "x"], tmp_path)
    assert refused.returncode == 1
    assert "cdff[core]" in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1


def test_the_dpm_installation_names_the_extra_of_a_missing_library(
    uv: list[str], wheel: Path, tmp_path: Path
) -> None:
    programs = install(uv, wheel, "dpm", tmp_path)
    doctor = run([programs / "cdff", "doctor", "--json"], tmp_path)
    assert "Traceback" not in doctor.stderr
    assert '"cdff"' in doctor.stdout
    refused = run([programs / "cdff", "run", "disparity_image", "left=a.png", "--out", "x"], tmp_path)
    assert (refused.returncode, len(refused.stderr.strip().splitlines())) == (1, 1), refused.stderr
    assert "cdff[core]" in refused.stderr


def test_profiles_missions_and_scenarios_are_in_the_wheel(uv: list[str], wheel: Path, tmp_path: Path) -> None:
    programs = install(uv, wheel, "core", tmp_path)
    program = (
        "from cdff_common.interfaces.profile import load_profile\n"
        "from cdff_common.resources import shipped_names\n"
        "names = shipped_names('profiles')\n"
        "print(len([load_profile(name) for name in names]), *map(shipped_names, ('missions', 'simulation')))"
    )
    result = run([programs / "python", "-c", program], tmp_path)
    assert result.returncode == 0, result.stderr
    count = len(list((ROOT / "deploy" / "profiles").glob("*.yaml")))
    assert result.stdout.startswith(f"{count} ")
    assert "return_to_base" in result.stdout
    assert "rover_traverse" in result.stdout
