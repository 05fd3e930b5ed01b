# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of ``deploy`` are found by name or by path."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.resources import deploy_folder, resolve, shipped_names


def test_a_shipped_file_is_found_by_name() -> None:
    assert "rover_traverse" in shipped_names("profiles")
    assert resolve("profiles", "rover_traverse") == deploy_folder() / "profiles" / "rover_traverse.yaml"


def test_an_existing_path_precedes_a_shipped_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own_file = tmp_path / "own.yaml"
    own_file.write_text("name: own\n")
    assert resolve("profiles", own_file) == own_file
    (tmp_path / "rover_traverse").write_text("name: own\n")
    monkeypatch.chdir(tmp_path)
    assert resolve("profiles", "rover_traverse") == Path("rover_traverse")


@pytest.mark.parametrize(
    "name", ["nowhere", "nowhere.yaml", "../profiles/rover_traverse", "rover_traverse.yaml"]
)
def test_an_unknown_name_is_refused_with_the_shipped_names(name: str) -> None:
    with pytest.raises(ConfigurationError, match=r"profile .*: no such file; shipped are .*rover_traverse"):
        resolve("profiles", name)
