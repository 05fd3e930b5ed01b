# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small values of a store by name, as JSON in the table ``meta``; they are not part of the changes."""

from __future__ import annotations

import json
from typing import Any

from sqlalchemy import select

from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of


def read_note(database: Database, name: str) -> Any:
    """Return a value; None if it was never written."""
    m = schema.meta.c
    with database.read() as connection:
        text = connection.execute(select(m.value).where(m.name == name)).scalar()
    return None if text is None else json.loads(text)


def write_note(database: Database, name: str, value: Any) -> None:
    """Replace a value; raises StorageError."""
    row = {"name": name, "value": json.dumps(value)}
    with database.write() as connection:
        dialect_of(connection).upsert_rows(connection, schema.meta, [row], replace=("value",))
