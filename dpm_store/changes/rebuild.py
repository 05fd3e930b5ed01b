# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rebuilding of a damaged or missing database from the records of all changes and the payloads.

The records are replayed into a new database, which then takes the place of the old one. The old database and
the old records are kept in ``replaced-N``.
"""

from __future__ import annotations

import logging
import os
import shutil
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from cdff_common.errors import ConfigurationError, StorageError
from cdff_common.output import storage_errors
from cdff_common.process import lock_file
from dpm_store.changes.change_recorder import FOLDER
from dpm_store.changes.replay import Replay
from dpm_store.engine.database import EMBEDDED
from dpm_store.maps import tile_files
from dpm_store.payloads.blobs import fsync
from dpm_store.store import in_use, open_store

logger = logging.getLogger(__name__)

_PART = "rebuild.part"


@dataclass(slots=True)
class Rebuilt:
    """Result of a rebuild.

    Attributes
    ----------
    changes : int
        Replayed changes.
    products : int
        Live products of the new database.
    lost : list of str
        Ids of products that were not deleted and whose payload is missing or corrupt; they become tombstones.
    replaced : Path
        Folder of the old database and records.
    """

    replaced: Path
    changes: int = 0
    products: int = 0
    lost: list[str] = field(default_factory=list)


def rebuild(directory: Path, *, remove_unnamed: bool = False) -> Rebuilt:
    """Replace the database of a store that no process uses.

    Parameters
    ----------
    remove_unnamed : bool
        Also remove the payloads that no record names, even if they are most of them.

    Raises
    ------
    ConfigurationError
        If there are no records.
    UnavailableError
        If a process has the store open.
    StorageError
        If the disk is full or fails; the old database stays.
    """
    if not any((directory / FOLDER).glob("*.changes")):
        raise ConfigurationError(
            f"data directory {directory}: no records in {FOLDER}/, from which a database could be rebuilt; "
            "restore a backup"
        )
    _record_all(directory)
    with storage_errors(directory):
        lock = lock_file(directory / "store.lock", str(os.getpid()), partial(in_use, directory))
        try:
            result = Rebuilt(_new_folder(directory))
            shutil.rmtree(directory / _PART, ignore_errors=True)
            (directory / _PART).mkdir()
            replay = Replay(directory, directory / _PART)
            replay.run()
            result.changes, result.lost = replay.changes, sorted(replay.lost)
            _exchange(directory, result.replaced)
            if remove_unnamed:
                (directory / FOLDER).mkdir()
        finally:
            os.close(lock)
    with open_store(f"sqlite:///{directory}") as store:
        result.products = store.statistics().count
        if remove_unnamed:
            store.collect()
    return result


def _record_all(directory: Path) -> None:
    """Write the records that are missing, if the database can be read."""
    if (directory / EMBEDDED.FILE_NAME).exists():
        try:
            open_store(f"sqlite:///{directory}").close()
        except StorageError as error:
            logger.warning("the old database is not readable: %s", error)


def _new_folder(directory: Path) -> Path:
    number = 1 + max((int(p.name.rpartition("-")[2]) for p in directory.glob("replaced-*")), default=0)
    return directory / f"replaced-{number}"


def _exchange(directory: Path, replaced: Path) -> None:
    """Move the old files to ``replaced`` and the new database to its place.

    After an interruption the records are complete, so that the next rebuild gives the same result.
    """
    replaced.mkdir()
    for name in (f"{EMBEDDED.FILE_NAME}{suffix}" for suffix in ("-wal", "-shm", "")):
        if (directory / name).exists():
            (directory / name).rename(replaced / name)
    shutil.rmtree(
        directory / tile_files.FOLDER, ignore_errors=True
    )  # they refer to events of the old database
    new_database = directory / _PART / EMBEDDED.FILE_NAME
    fsync(new_database)
    new_database.rename(directory / EMBEDDED.FILE_NAME)
    fsync(directory)
    (directory / FOLDER).rename(replaced / FOLDER)
    fsync(directory)
    shutil.rmtree(directory / _PART, ignore_errors=True)
