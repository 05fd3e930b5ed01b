# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is said of a product after it was made (tags, notes, pins, judgements), and pose graphs; only new tables."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from dpm_store import sqlite

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the tables; nothing that was there is touched."""
    op.create_table(
        "annotations",
        sa.Column("product_id", sa.String(36), primary_key=True),
        sa.Column("revision", sa.Integer, primary_key=True),
        sa.Column("stamp_ns", sa.BigInteger, nullable=False),
        sa.Column("author", sa.String(256), nullable=False),
        sa.Column("tags", sa.String, nullable=False),
        sa.Column("notes", sa.String, nullable=False),
        sa.Column("pinned", sa.Boolean, nullable=False),
        sa.Column("quality", sa.LargeBinary),
        sa.Column("superseded_by", sa.String(36)),
    )
    op.create_table(
        "product_tags",
        sa.Column("tag", sa.String(64), primary_key=True),
        sa.Column("product_id", sa.String(36), primary_key=True),
    )
    op.create_table("pins", sa.Column("product_id", sa.String(36), primary_key=True))
    op.create_table(
        "supersessions",
        sa.Column("product_id", sa.String(36), primary_key=True),
        sa.Column("by_id", sa.String(36), nullable=False),
    )
    op.create_table(
        "pose_graph_nodes",
        sa.Column("product_id", sa.String(36), primary_key=True),
        sa.Column("node", sa.BigInteger, primary_key=True),
        sa.Column("frame", sa.String(128), nullable=False),
        sa.Column("stamp_ns", sa.BigInteger, nullable=False),
        sa.Column("matrix", sa.LargeBinary, nullable=False),
        sa.Column("covariance", sa.LargeBinary),
    )
    op.create_table(
        "pose_graph_edges",
        sa.Column("product_id", sa.String(36), primary_key=True),
        sa.Column("edge", sa.Integer, primary_key=True),
        sa.Column("from_node", sa.BigInteger, nullable=False),
        sa.Column("to_node", sa.BigInteger, nullable=False),
        sa.Column("kind", sa.String(32), nullable=False),
        sa.Column("matrix", sa.LargeBinary, nullable=False),
        sa.Column("covariance", sa.LargeBinary),
    )
    op.create_index("product_tags_by_product", "product_tags", ["product_id"])
    op.create_index("supersessions_by_newer", "supersessions", ["by_id"])
    for statement in sqlite.DDL_ANNOTATIONS:
        op.execute(statement)
