# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small payloads move out of the database into packs; payloads count the products that have them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from dpm_store import sqlite
from dpm_store.packs import PackFiles
from dpm_store.payloads import PACKS

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

#: Contents in memory at a time.
_TOGETHER = 1000


def upgrade() -> None:
    """Copy contents to packs, forget them here, then count. What is interrupted is begun anew."""
    op.add_column("blobs", sa.Column("place", sa.BigInteger))
    op.add_column("blobs", sa.Column("live", sa.BigInteger, nullable=False, server_default="0"))
    for statement in sqlite.DDL_0005_FIRST:
        op.execute(statement)
    connection = op.get_bind()
    packs = PackFiles(sqlite.directory(connection) / PACKS)
    for found in sqlite.contents(connection, _TOGETHER):
        places = packs.append([content for _, content in found])
        sqlite.place_contents(connection, [(place, row) for place, (row, _) in zip(places, found, strict=True)])
    packs.settle()
    packs.close()
    op.drop_column("blobs", "content")
    packed = sa.text("place IS NOT NULL")
    op.create_index("blobs_by_place", "blobs", ["place", "size"], sqlite_where=packed, postgresql_where=packed)
    for statement in sqlite.DDL_0005:
        op.execute(statement)
