# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The first schema."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from dpm_store import sqlite

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

_Ordinal = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    """Make every table, then what the engine needs beside them."""
    op.create_table(
        "meta",
        sa.Column("name", sa.String(64), primary_key=True),
        sa.Column("value", sa.String, nullable=False),
    )
    op.create_table(
        "frame_names",
        sa.Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
        sa.Column("frame", sa.String(128), nullable=False, unique=True),
    )
    op.create_table(
        "frames",
        sa.Column("frame", sa.String(128), primary_key=True),
        sa.Column("revision", sa.Integer, primary_key=True),
        sa.Column("parent", sa.String(128), nullable=False),
        sa.Column("matrix", sa.LargeBinary, nullable=False),
        sa.Column("covariance", sa.LargeBinary),
        sa.Column("valid_from_ns", sa.BigInteger),
        sa.Column("valid_until_ns", sa.BigInteger),
        sa.Column("inserted_ns", sa.BigInteger, nullable=False),
        sa.Column("producer", sa.String(256), nullable=False),
    )
    op.create_table(
        "blobs",
        sa.Column("sha256", sa.String(64), primary_key=True),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.Column("chunk_sums", sa.LargeBinary, nullable=False),
        sa.Column("content", sa.LargeBinary),
    )
    op.create_table(
        "products",
        sa.Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
        sa.Column("id", sa.String(36), nullable=False, unique=True),
        sa.Column("robot", sa.String(64), nullable=False),
        sa.Column("dfpc", sa.String(64), nullable=False),
        sa.Column("port", sa.String(64), nullable=False),
        sa.Column("product", sa.String(64), nullable=False),
        sa.Column("type_name", sa.String(64), nullable=False),
        sa.Column("codec", sa.String(16), nullable=False),
        sa.Column("frame", sa.String(128), nullable=False),
        sa.Column("child", sa.String(128)),
        sa.Column("config_hash", sa.String(64), nullable=False),
        sa.Column("t0_ns", sa.BigInteger, nullable=False),
        sa.Column("t1_ns", sa.BigInteger, nullable=False),
        sa.Column("xmin_m", sa.Float),
        sa.Column("ymin_m", sa.Float),
        sa.Column("zmin_m", sa.Float),
        sa.Column("xmax_m", sa.Float),
        sa.Column("ymax_m", sa.Float),
        sa.Column("zmax_m", sa.Float),
        sa.Column("resolution_m", sa.Float),
        sa.Column("status", sa.String(16), nullable=False),
        sa.Column("header", sa.LargeBinary, nullable=False),
        sa.Column("sha256", sa.String(64), sa.ForeignKey("blobs.sha256")),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.Column("inserted_ns", sa.BigInteger, nullable=False),
        sa.Column("deleted_ns", sa.BigInteger),
    )
    op.create_table(
        "provenance",
        sa.Column("product_id", sa.String(36), primary_key=True),
        sa.Column("input_id", sa.String(64), primary_key=True),
    )
    op.create_table(
        "poses",
        sa.Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
        sa.Column("parent", sa.String(128), nullable=False),
        sa.Column("child", sa.String(128), nullable=False),
        sa.Column("source", sa.String(160), nullable=False),
        sa.Column("stamp_ns", sa.BigInteger, nullable=False),
        sa.Column("robot", sa.String(64), nullable=False),
        sa.Column("matrix", sa.LargeBinary, nullable=False),
        sa.Column("covariance", sa.LargeBinary),
        sa.Column("product_id", sa.String(36), nullable=False),
        sa.UniqueConstraint("child", "parent", "source", "stamp_ns", name="poses_by_track"),
    )
    op.create_table(
        "events",
        sa.Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
        sa.Column("stamp_ns", sa.BigInteger, nullable=False),
        sa.Column("scope", sa.String(64), nullable=False),
        sa.Column("kind", sa.String(64), nullable=False),
        sa.Column("body", sa.LargeBinary, nullable=False),
    )
    op.create_index("products_by_time", "products", ["t1_ns", "ordinal"])
    op.create_index("products_by_type", "products", ["product", "t1_ns", "ordinal"])
    op.create_index("products_by_robot", "products", ["robot", "product", "t1_ns", "ordinal"])
    op.create_index("products_by_blob", "products", ["sha256"])
    op.create_index("provenance_by_input", "provenance", ["input_id"])
    op.create_index("poses_by_product", "poses", ["product_id"])
    op.create_index("events_by_kind", "events", ["kind", "ordinal"])
    for statement in sqlite.DDL:
        op.execute(statement)
