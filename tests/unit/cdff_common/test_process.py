# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import os
from pathlib import Path

import pytest

from cdff_common.errors import StorageError, UnavailableError
from cdff_common.process import data_dir_of, lock_file


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


def test_the_default_data_folder_is_defined_in_one_module() -> None:
    root = Path(__file__).resolve().parents[3]
    packages = ("cdff_common", "cdff_core", "cdff_dev", "dpm_store", "services")
    files_with_default = {
        path.relative_to(root).as_posix()
        for package in packages
        for path in (root / package).rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if "share/cdff" in line and "CDFF_DATA_DIR" not in line
    }
    assert files_with_default == {"cdff_common/process.py"}


def test_a_lock_names_its_holder_and_ends_with_its_descriptor(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    descriptor = lock_file(path, "process 7 on a long name", str)
    os.close(descriptor)
    descriptor = lock_file(path, "process 8", str)
    with pytest.raises(UnavailableError, match=r"^held by process 8$"):
        lock_file(path, "process 9", lambda holder: f"held by {holder}")
    os.close(descriptor)
    os.close(lock_file(path, "process 9", str))
    with pytest.raises(StorageError, match="missing"):
        lock_file(tmp_path / "missing" / "lock", "process 9", str)
