# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bring a database to the schema of this version, by Alembic; a current one is left alone without importing it."""

from __future__ import annotations

import logging
from importlib.resources import files

from sqlalchemy import inspect, text

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store import sqlite
from dpm_store.database import Database

logger = logging.getLogger(__name__)

#: The newest revision under ``migrations/versions``; a test holds it to that.
HEAD = "0005"


def revision_of(database: Database) -> str | None:
    """Revision of the schema in the file; None for an empty one."""
    with database.read() as connection:
        if not inspect(connection).has_table("alembic_version"):
            return None
        found: str | None = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
        return found


def migrate(database: Database, target: str = HEAD) -> None:
    """Run the migrations that are missing up to ``target``, in one transaction.

    Raises
    ------
    ConfigurationError
        If the database was made by a newer version.
    """
    revision = revision_of(database)
    if revision == target:
        return
    from alembic import command
    from alembic.config import Config
    from alembic.util import CommandError

    config = Config()
    config.set_main_option("script_location", str(files("dpm_store") / "migrations"))
    try:
        with database.freeing() as connection:
            config.attributes["connection"] = connection
            command.upgrade(config, target)
        if revision is not None:
            _shrink(database)
    except CommandError as error:
        raise ConfigurationError(
            f"the store has schema {revision}, this version knows up to {HEAD}; open it with a newer version"
        ) from error


def _shrink(database: Database) -> None:
    """Give the disk back what a migration left free; where it cannot be, later insertions use it."""
    try:
        sqlite.shrink(database.engine)
    except StorageError as error:
        logger.warning("file not made smaller", extra={"why": str(error)})
