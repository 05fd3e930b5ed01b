# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Copies of a store that another process may be writing, and stores from copies.

The database is copied by SQLite's own online backup, which gives one committed state; then the payloads that this
state names. Payloads never change, so a copy is right whenever it is made. Packs keep what they hold while they are
copied; a file that a ``collect`` took in between was of a product deleted since, and the copy is begun anew.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store import sqlite
from dpm_store.blobs import BlobFiles, sync
from dpm_store.packs import PackFiles
from dpm_store.payloads import BLOBS, PACKS

DATABASE = "store.sqlite"
_ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class Backup:
    """What was copied: live products, files of large payloads, bytes."""

    products: int
    files: int
    bytes: int


def backup(source: Path, target: Path) -> Backup:
    """Copy the store in ``source``, which may be open and written by another process, to a new directory.

    Raises
    ------
    ConfigurationError
        If there is no store in ``source``, or ``target`` exists and is not empty.
    StorageError
        If the disk is full or fails; what was copied is removed.
    """
    if not (source / DATABASE).is_file():
        raise ConfigurationError(f"{source}: there is no store; expected {DATABASE} in it")
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise ConfigurationError(f"{target}: is there already; expected a new or empty directory")
    part = target.with_name(target.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        for _ in range(_ATTEMPTS):
            part.mkdir(parents=True)
            with PackFiles(source / PACKS).copying():
                done = _copy(source, part)
            if done is not None:
                _sync_all(part)
                if target.exists():
                    target.rmdir()
                part.rename(target)
                return done
            shutil.rmtree(part)
    except OSError as error:
        shutil.rmtree(part, ignore_errors=True)
        raise StorageError(f"backup to {target}: {error.strerror}; nothing was kept") from error
    raise StorageError(f"backup of {source}: payloads were removed {_ATTEMPTS} times while it ran; try again")


def restore(source: Path, target: Path) -> Backup:
    """Make a store of a copy; raises as ``backup``. The copy stays."""
    return backup(source, target)


def _copy(source: Path, part: Path) -> Backup | None:
    """One attempt; None where a file was taken meanwhile."""
    products, named, spans = sqlite.copy_database(source / DATABASE, part / DATABASE)
    here, there = BlobFiles(part / BLOBS), source / BLOBS
    size = (part / DATABASE).stat().st_size + sum(length for _, length in spans)
    try:
        PackFiles(source / PACKS).copy(spans, PackFiles(part / PACKS))
    except FileNotFoundError:
        return None
    for sha256 in named:
        target = here.path(sha256)
        target.parent.mkdir(exist_ok=True)
        try:
            shutil.copyfile(there / sha256[:2] / sha256[2:], target)
        except FileNotFoundError:
            return None
        size += target.stat().st_size
    return Backup(products, len(named), size)


def _sync_all(directory: Path) -> None:
    """Make every file and directory below durable."""
    for root, _, names in os.walk(directory):
        for name in (*names, "."):
            sync(Path(root) / name)
