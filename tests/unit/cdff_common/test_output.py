# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import StorageError
from cdff_common.output import check_file, make_folder, write_file


def test_an_output_path_below_a_file_is_a_known_error(
    tmp_path: Path,
) -> None:
    path_without_folder = tmp_path / "none" / "x.ply"
    with pytest.raises(StorageError, match=r"there is no folder .*none; create it first"):
        check_file(path_without_folder)
    with pytest.raises(StorageError, match="cannot be written: No such file"):
        write_file(path_without_folder, b"x")


def test_files_and_folders_are_not_interchanged(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="it is a folder"):
        check_file(tmp_path)
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(StorageError, match="cannot be written"):
        make_folder(tmp_path / "file" / "below")


def test_a_writable_output_is_written(tmp_path: Path) -> None:
    path = make_folder(tmp_path / "a" / "b") / "x"
    check_file(path)
    write_file(path, b"data")
    check_file(path)
    assert path.read_bytes() == b"data"
