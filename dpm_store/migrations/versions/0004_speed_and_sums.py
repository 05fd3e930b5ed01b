# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A spatial index by frame and type together, sums that triggers keep, and what retention and collection go by."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from dpm_store import sqlite

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

_Ordinal = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    """Make the tables, then build the index anew and count what is there."""
    op.create_table(
        "index_buckets",
        sa.Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
        sa.Column("frame", sa.BigInteger, nullable=False),
        sa.Column("product", sa.String(64), nullable=False),
    )
    op.create_index("index_buckets_by_name", "index_buckets", ["frame", "product"], unique=True)
    op.create_table(
        "tallies",
        sa.Column("robot", sa.String(64), primary_key=True),
        sa.Column("product", sa.String(64), primary_key=True),
        sa.Column("live", sa.BigInteger, nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
    )
    op.create_table(
        "blob_tallies",
        sa.Column("inline", sa.Boolean, primary_key=True),
        sa.Column("payloads", sa.BigInteger, nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
    )
    op.create_index(
        "products_gone", "products", ["sha256"],
        sqlite_where=sa.text("deleted_ns IS NOT NULL AND sha256 IS NOT NULL"),
        postgresql_where=sa.text("deleted_ns IS NOT NULL AND sha256 IS NOT NULL"),
    )  # fmt: skip
    for statement in sqlite.DDL_0004:
        op.execute(statement)
