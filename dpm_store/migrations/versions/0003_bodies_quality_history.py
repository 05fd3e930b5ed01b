# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies, robots, states of the frame tree, footprints, quality to be found by, poses as of a time.

What was there stays: numbers and kinds of quality are taken out of the stored headers, the frame revisions are numbered
in the order in which they came, poses learn when they were inserted, and deleted products enter an index of their own.
"""

from __future__ import annotations

import math

import msgpack
import sqlalchemy as sa
from alembic import op

from dpm_store import sqlite

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

_Ordinal = sa.BigInteger().with_variant(sa.Integer, "sqlite")
_BATCH = 10_000


def upgrade() -> None:
    """Make what is new, then fill it from what is there."""
    _make_tables()
    _extend_tables()
    for statement in sqlite.DDL_0003:
        op.execute(statement)
    _fill_quality()
    op.execute(
        "INSERT INTO frame_log (frame, revision) SELECT frame, revision FROM frames "
        "ORDER BY inserted_ns, frame, revision"
    )
    op.execute(
        "UPDATE frame_names SET (zmin_m, zmax_m) = (SELECT min(p.zmin_m), max(p.zmax_m) FROM products p "
        "WHERE p.frame = frame_names.frame)"
    )
    op.execute("INSERT INTO tracks SELECT DISTINCT child, parent, source, robot FROM poses")
    op.execute(
        "UPDATE poses SET inserted_ns = coalesce("
        "(SELECT p.inserted_ns FROM products p WHERE p.id = poses.product_id), 0)"
    )


def _make_tables() -> None:
    op.create_table(
        "frame_log",
        sa.Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
        sa.Column("frame", sa.String(128), nullable=False),
        sa.Column("revision", sa.Integer, nullable=False),
    )
    op.create_table(
        "bodies",
        sa.Column("name", sa.String(64), primary_key=True),
        sa.Column("revision", sa.Integer, primary_key=True),
        sa.Column("definition", sa.LargeBinary, nullable=False),
        sa.Column("inserted_ns", sa.BigInteger, nullable=False),
        sa.Column("producer", sa.String(256), nullable=False),
    )
    op.create_table(
        "robots",
        sa.Column("robot", sa.String(64), primary_key=True),
        sa.Column("doc", sa.String, nullable=False),
        sa.Column("description", sa.LargeBinary, nullable=False),
        sa.Column("inserted_ns", sa.BigInteger, nullable=False),
        sa.Column("updated_ns", sa.BigInteger, nullable=False),
    )
    op.create_table(
        "footprints",
        sa.Column("ordinal", _Ordinal, primary_key=True, autoincrement=False),
        sa.Column("ring", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "product_metrics",
        sa.Column("ordinal", _Ordinal, primary_key=True, autoincrement=False),
        sa.Column("name", sa.String(64), primary_key=True),
        sa.Column("value", sa.Float, nullable=False),
    )
    op.create_table(
        "tracks",
        sa.Column("child", sa.String(128), primary_key=True),
        sa.Column("parent", sa.String(128), primary_key=True),
        sa.Column("source", sa.String(160), primary_key=True),
        sa.Column("robot", sa.String(64), nullable=False),
    )
    op.create_index("frame_log_by_frame", "frame_log", ["frame", "revision"], unique=True)
    op.create_index("product_metrics_by_value", "product_metrics", ["name", "value"])


def _extend_tables() -> None:
    op.add_column(
        "products", sa.Column("covariance_kind", sa.String(16), nullable=False, server_default="none")
    )  # fmt: skip
    op.add_column("frame_names", sa.Column("zmin_m", sa.Float))
    op.add_column("frame_names", sa.Column("zmax_m", sa.Float))
    op.add_column("pose_graph_nodes", sa.Column("fixed", sa.Boolean, nullable=False, server_default="0"))
    op.add_column("pose_graph_edges", sa.Column("information", sa.LargeBinary))
    with op.batch_alter_table("poses") as poses:
        poses.drop_constraint("poses_by_track", type_="unique")
        poses.add_column(sa.Column("inserted_ns", sa.BigInteger, nullable=False, server_default="0"))
        poses.add_column(sa.Column("deleted_ns", sa.BigInteger))
    op.create_index("poses_by_track", "poses", ["child", "parent", "source", "stamp_ns"])


def _fill_quality() -> None:
    """Take covariance kind and metrics out of the headers, some thousand at a time."""
    connection, last = op.get_bind(), -1
    products = sa.table("products", *(sa.column(name) for name in ("ordinal", "header", "covariance_kind")))
    metrics = sa.table("product_metrics", *(sa.column(name) for name in ("ordinal", "name", "value")))
    page = sa.select(products.c.ordinal, products.c.header).order_by(products.c.ordinal).limit(_BATCH)
    set_kind = products.update().where(products.c.ordinal == sa.bindparam("row")).values(
        covariance_kind=sa.bindparam("kind")
    )  # fmt: skip
    while rows := connection.execute(page.where(products.c.ordinal > last)).all():
        kinds, values = [], []
        for ordinal, header in rows:
            quality = msgpack.unpackb(header)["quality"]
            if quality.get("covariance_kind", "none") != "none":
                kinds.append({"row": ordinal, "kind": quality["covariance_kind"]})
            values += [
                {"ordinal": ordinal, "name": name, "value": value}
                for name, value in quality.get("metrics", {}).items()
                if len(name) <= 64 and math.isfinite(value)
            ]
        if kinds:
            connection.execute(set_kind, kinds)
        if values:
            connection.execute(metrics.insert(), values)
        last = rows[-1].ordinal
