# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.process import data_dir_of


@pytest.mark.parametrize(
    ("argument", "environment", "expected"),
    [
        ("/given", {"CDFF_DATA_DIR": "/other"}, Path("/given")),
        (None, {"CDFF_DATA_DIR": "/other"}, Path("/other")),
        (None, {"CDFF_DATA_DIR": ""}, Path.home() / ".local/share/cdff"),
        (None, {}, Path.home() / ".local/share/cdff"),
        ("~/data", {}, Path.home() / "data"),
    ],
)
def test_the_data_folder_is_the_argument_else_the_environment_else_the_default(
    argument: str | None, environment: dict[str, str], expected: Path
) -> None:
    assert data_dir_of(argument, environment) == expected


def test_the_default_is_spelt_in_one_module_beside_the_help_texts() -> None:
    root = Path(__file__).resolve().parents[3]
    packages = ("cdff_common", "cdff_core", "cdff_dev", "dpm_store", "services")
    spelt = {
        path.relative_to(root).as_posix()
        for package in packages
        for path in (root / package).rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if "share/cdff" in line and "CDFF_DATA_DIR" not in line
    }
    assert spelt == {"cdff_common/process.py"}
