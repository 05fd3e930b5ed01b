# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Migration of a database to the schema of this version, by Alembic, which is imported only if needed."""

from __future__ import annotations

from importlib.resources import files

from sqlalchemy import inspect, text

from cdff_common.errors import ConfigurationError
from dpm_store.engine.database import Database

#: The newest revision in ``migrations``; a test compares the two.
HEAD = "r1"
#: Schemas of development versions, which were never released.
_UNRELEASED = ("0001", "0002", "0003", "0004", "0005")


def revision_of(database: Database) -> str | None:
    """Return the revision of the schema in the database; None for an empty one."""
    with database.read() as connection:
        if not inspect(connection).has_table("alembic_version"):
            return None
        revision: str | None = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
        return revision


def migrate(database: Database) -> None:
    """Run the missing migrations in one transaction.

    Raises
    ------
    ConfigurationError
        If the database was made by a newer version, or by a version before the first release.
    """
    revision = revision_of(database)
    if revision == HEAD:
        return
    if revision in _UNRELEASED:
        raise ConfigurationError(
            f"the store has schema {revision} of an unreleased version, this version reads {HEAD}: export "
            "its products with that version (`cdff dpm export`), and put them into a new data directory"
        )
    from alembic import command
    from alembic.config import Config
    from alembic.util import CommandError

    folder = files("dpm_store.engine") / "migrations"
    config = Config()
    config.set_main_option("script_location", str(folder))
    config.set_main_option("version_locations", str(folder / database.engine.dialect.name))
    config.set_main_option("path_separator", "newline")
    try:
        with database.deletion() as connection:
            config.attributes["connection"] = connection
            command.upgrade(config, HEAD)
    except CommandError as error:
        raise ConfigurationError(
            f"the store has schema {revision}, this version reads up to {HEAD}; open it with a newer version"
        ) from error
