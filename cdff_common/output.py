# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files and folders that a user names for output: what cannot be written is a known error, told before the work."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cdff_common.errors import StorageError


@contextmanager
def writing(place: str | Path) -> Iterator[None]:
    """Turn an OSError of the block, which writes ``place``, into a StorageError that names it."""
    try:
        yield
    except OSError as error:
        raise StorageError(f"{place}: cannot be written: {error.strerror or error}") from error


def make_folder(path: Path) -> Path:
    """Make a folder for output with its parents and return it; raises StorageError where that is not possible."""
    with writing(path):
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK):
            raise PermissionError(None, "no permission to write there")
    return path


def check_file(path: Path) -> None:
    """Raise StorageError where a file cannot be put at ``path``, before work is done for it."""
    if path.is_dir():
        raise StorageError(f"{path}: cannot be written: it is a folder, expected the name of a file")
    if not path.parent.is_dir():
        raise StorageError(f"{path}: cannot be written: there is no folder {path.parent}; make it first")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise StorageError(f"{path}: cannot be written: no permission to write there")


def write_file(path: Path, data: bytes) -> None:
    """Write a file; raises StorageError where that is not possible."""
    with writing(path):
        path.write_bytes(data)
