# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Output files and folders named by a user; unwritable ones are reported before the work starts."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from cdff_common.errors import InputError, StorageError

#: Alternative suffixes of formats.
_SUFFIXES = {"tiff": "tif", "xml": "xer"}


@contextmanager
def storage_errors(path: str | Path) -> Iterator[None]:
    """Convert an OSError of the block, which writes ``path``, to a StorageError with the path."""
    try:
        yield
    except OSError as error:
        raise StorageError(f"{path}: cannot be written: {error.strerror or error}") from error


def make_folder(path: Path) -> Path:
    """Create an output folder with its parents and return it; raises StorageError."""
    with storage_errors(path):
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK):
            raise PermissionError(None, "no permission to write there")
    return path


def check_file(path: Path) -> None:
    """Raise StorageError if a file cannot be written at ``path``; ``-`` is standard output."""
    if is_standard_output(path):
        return
    if path.is_dir():
        raise StorageError(f"{path}: cannot be written: it is a folder, expected a file name")
    if not path.parent.is_dir():
        raise StorageError(f"{path}: cannot be written: there is no folder {path.parent}; create it first")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise StorageError(f"{path}: cannot be written: no permission to write there")


def replace_file(path: Path, data: bytes, *, sync: bool = False) -> None:
    """Write ``….part`` and rename it, so that a kill leaves the old or the new file; raises OSError.

    With ``sync`` the file also survives a loss of power. Missing folders are created.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    try:
        with part.open("wb") as file:
            file.write(data)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        part.replace(path)
    except OSError:
        with suppress(OSError):
            part.unlink()
        raise


def format_of_suffix(path: Path, known: Sequence[str], type_name: str, option: str = "--out ") -> str:
    """Return the format selected by the suffix of a file; raises InputError if it is not among ``known``."""
    suffix = path.suffix.lower().removeprefix(".")
    form = _SUFFIXES.get(suffix, suffix)
    if form not in known:
        raise InputError(
            f"{option}{path}: the suffix {path.suffix!r} is no format of a {type_name}, expected one of "
            f"{', '.join(f'.{k}' for k in known)}"
        )
    return form


def is_standard_output(path: Path | None) -> bool:
    """Return whether an output file is ``-``, the standard output."""
    return str(path) == "-"


def write_output(path: Path, data: bytes) -> None:
    """Write a file, or for ``-`` to standard output; raises StorageError."""
    if is_standard_output(path):
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    else:
        write_file(path, data)


def write_file(path: Path, data: bytes) -> None:
    """Write a file; raises StorageError and leaves no part of it."""
    with storage_errors(path), path.open("wb") as file, removed_after_error(path):
        file.write(data)
        file.flush()


@contextmanager
def removed_after_error(path: Path) -> Iterator[None]:
    """Remove a regular file that the block, which writes it, could not complete.

    The file is open before the block: one that cannot be opened stays.
    """
    try:
        yield
    except BaseException:
        with suppress(OSError):
            if path.is_file():
                path.unlink()
        raise
