# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Backup and restoration of a store; another process may write to it during the backup.

The online backup of the database copies one committed state. Then the payloads of this state are copied.
Payloads never change, and no space of packs is reclaimed during the copy. If ``collect`` removes a payload
file during the copy, because its product was deleted, the backup starts again.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import func, select

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store.engine import schema
from dpm_store.engine.database import EMBEDDED
from dpm_store.payloads.blobs import BlobFiles, fsync
from dpm_store.payloads.packs import PackFiles, merge_spans
from dpm_store.payloads.payloads import BLOBS, PACKS

#: Attempts of a backup; one fails if payloads are removed while it runs.
_ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class Backup:
    """Contents of a copy: live products, files of large payloads, bytes."""

    products: int
    files: int
    bytes: int


def backup(source: Path, target: Path) -> Backup:
    """Copy the store in ``source``, which may be open and written by another process, to a new directory.

    A copy of a backup is a store again.

    Raises
    ------
    ConfigurationError
        If there is no store in ``source``, or ``target`` exists and is not empty.
    StorageError
        If the disk is full or fails; the partial copy is removed.
    """
    if not (source / EMBEDDED.FILE_NAME).is_file():
        raise ConfigurationError(f"{source}: there is no store; expected {EMBEDDED.FILE_NAME} in it")
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise ConfigurationError(f"{target}: exists; expected a new or empty directory")
    partial = target.with_name(target.name + ".part")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        for _ in range(_ATTEMPTS):
            partial.mkdir(parents=True)
            with PackFiles(source / PACKS).copying():
                result = _copy(source, partial)
            if result is not None:
                _sync_all(partial)
                if target.exists():
                    target.rmdir()
                partial.rename(target)
                return result
            shutil.rmtree(partial)
    except OSError as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise StorageError(f"backup to {target}: {error.strerror}; nothing was kept") from error
    raise StorageError(f"backup of {source}: payloads were removed {_ATTEMPTS} times while it ran; try again")


def _copy(source: Path, partial: Path) -> Backup | None:
    """Copy once; return None if a file was removed meanwhile."""
    p, b = schema.products.c, schema.blobs.c
    live = select(func.count()).select_from(schema.products).where(p.deleted_ns.is_(None))
    packed = select(b.location, b.size).where(b.location.is_not(None)).order_by(b.location)
    with EMBEDDED.copied(source / EMBEDDED.FILE_NAME, partial / EMBEDDED.FILE_NAME) as connection:
        products: int = connection.execute(live).scalar_one()
        in_files = select(b.sha256).where(b.location.is_(None)).order_by(b.sha256)
        digests = connection.execute(in_files).scalars().all()
        spans = merge_spans((row.location, row.size) for row in connection.execute(packed))
    copies, originals = BlobFiles(partial / BLOBS), source / BLOBS
    size = (partial / EMBEDDED.FILE_NAME).stat().st_size + sum(length for _, length in spans)
    try:
        PackFiles(source / PACKS).copy(spans, PackFiles(partial / PACKS))
    except FileNotFoundError:
        return None
    for sha256 in digests:
        target = copies.path(sha256)
        target.parent.mkdir(exist_ok=True)
        try:
            shutil.copyfile(originals / sha256[:2] / sha256[2:], target)
        except FileNotFoundError:
            return None
        size += target.stat().st_size
    return Backup(products, len(digests), size)


def _sync_all(directory: Path) -> None:
    """Make every file and directory below durable."""
    for root, _, names in os.walk(directory):
        for name in (*names, "."):
            fsync(Path(root) / name)
