# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import resource
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


def test_a_file_that_cannot_be_completed_leaves_no_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))  # as on a full disk
    try:
        with pytest.raises(StorageError, match=r"x\.ply: cannot be written"):
            write_file(tmp_path / "x.ply", bytes(2000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old").write_bytes(b"old")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(StorageError, match="Permission denied"):
        write_file(tmp_path / "old", b"new")
    assert (tmp_path / "old").stat().st_size == 3
    monkeypatch.undo()
    with pytest.raises(StorageError):
        write_file(Path("/dev/full"), b"x")
    assert Path("/dev/full").exists()
