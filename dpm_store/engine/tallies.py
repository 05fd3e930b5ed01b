# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sums of rows and bytes that the store updates with every insertion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import Connection, Table

from dpm_store.engine.database import dialect_of


def add_to_tallies(
    connection: Connection, table: Table, sizes: Iterable[tuple[tuple[Any, ...], int]]
) -> None:
    """Add rows to the sums in ``table``, given as key and bytes; faster than a trigger per row."""
    sums: dict[tuple[Any, ...], tuple[int, int]] = {}
    for key, size in sizes:
        count, total = sums.get(key, (0, 0))
        sums[key] = count + 1, total + size
    names = [column.name for column in table.primary_key]
    rows = [
        {**dict(zip(names, key, strict=True)), "live": count, "bytes": total}
        for key, (count, total) in sums.items()
    ]
    dialect_of(connection).upsert_rows(connection, table, rows, add=("live", "bytes"))
