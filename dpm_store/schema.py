# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tables, as SQLAlchemy Core describes them. What one engine needs beyond them is in its dialect module.

Times are integer nanoseconds of mission time. ``ordinal`` is the store's own number of a product: cursors and the
spatial index use it. Matrices are 16 or 36 little-endian float64. The migrations under ``migrations/`` make these
tables; a test compares the two.
"""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    text,
)

metadata = MetaData()

#: SQLite gives a rowid only to a column that is literally INTEGER.
_Ordinal = BigInteger().with_variant(Integer, "sqlite")

meta = Table(
    "meta",
    metadata,
    Column("name", String(64), primary_key=True),
    Column("value", String, nullable=False),
)

#: Frames that hold products, and the heights between which all of their boxes ever lay.
frame_names = Table(
    "frame_names",
    metadata,
    Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
    Column("frame", String(128), nullable=False, unique=True),
    Column("zmin_m", Float),
    Column("zmax_m", Float),
)

#: One row per revision of a fixed edge parent -> frame; nothing is ever overwritten.
frames = Table(
    "frames",
    metadata,
    Column("frame", String(128), primary_key=True),
    Column("revision", Integer, primary_key=True),
    Column("parent", String(128), nullable=False),
    Column("matrix", LargeBinary, nullable=False),
    Column("covariance", LargeBinary),
    Column("valid_from_ns", BigInteger),
    Column("valid_until_ns", BigInteger),
    Column("inserted_ns", BigInteger, nullable=False),
    Column("producer", String(256), nullable=False),
)

#: Every frame revision in the order it came: naming a number names a state of the whole tree.
frame_log = Table(
    "frame_log",
    metadata,
    Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
    Column("frame", String(128), nullable=False),
    Column("revision", Integer, nullable=False),
    Index("frame_log_by_frame", "frame", "revision", unique=True),
)

#: Bodies that frames hang under: of the registry where one is used, or defined by an operator. Append-only.
bodies = Table(
    "bodies",
    metadata,
    Column("name", String(64), primary_key=True),
    Column("revision", Integer, primary_key=True),
    Column("definition", LargeBinary, nullable=False),
    Column("inserted_ns", BigInteger, nullable=False),
    Column("producer", String(256), nullable=False),
)

robots = Table(
    "robots",
    metadata,
    Column("robot", String(64), primary_key=True),
    Column("doc", String, nullable=False),
    Column("description", LargeBinary, nullable=False),
    Column("inserted_ns", BigInteger, nullable=False),
    Column("updated_ns", BigInteger, nullable=False),
)

_PACKED = text("place IS NOT NULL")
#: Payloads by content: where in the packs each begins (none: it has a file), and how many live products have it
#: (a trigger takes deleted ones off).
blobs = Table(
    "blobs",
    metadata,
    Column("sha256", String(64), primary_key=True),
    Column("size", BigInteger, nullable=False),
    Column("chunk_sums", LargeBinary, nullable=False),
    Column("place", BigInteger),
    Column("live", BigInteger, nullable=False, server_default="0"),
)
Index("blobs_by_place", blobs.c.place, blobs.c.size, sqlite_where=_PACKED)

products = Table(
    "products",
    metadata,
    Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
    Column("id", String(36), nullable=False, unique=True),
    Column("robot", String(64), nullable=False),
    Column("dfpc", String(64), nullable=False),
    Column("port", String(64), nullable=False),
    Column("product", String(64), nullable=False),
    Column("type_name", String(64), nullable=False),
    Column("codec", String(16), nullable=False),
    Column("frame", String(128), nullable=False),
    Column("child", String(128)),
    Column("config_hash", String(64), nullable=False),
    Column("t0_ns", BigInteger, nullable=False),
    Column("t1_ns", BigInteger, nullable=False),
    Column("xmin_m", Float),
    Column("ymin_m", Float),
    Column("zmin_m", Float),
    Column("xmax_m", Float),
    Column("ymax_m", Float),
    Column("zmax_m", Float),
    Column("resolution_m", Float),
    Column("status", String(16), nullable=False),
    Column("covariance_kind", String(16), nullable=False, server_default="none"),
    Column("header", LargeBinary, nullable=False),
    Column("sha256", String(64), ForeignKey("blobs.sha256")),
    Column("size", BigInteger, nullable=False),
    Column("inserted_ns", BigInteger, nullable=False),
    Column("deleted_ns", BigInteger),
)
Index("products_by_time", products.c.t1_ns, products.c.ordinal)
Index("products_by_type", products.c.product, products.c.t1_ns, products.c.ordinal)
Index("products_by_robot", products.c.robot, products.c.product, products.c.t1_ns, products.c.ordinal)
_GONE = text("deleted_ns IS NOT NULL AND sha256 IS NOT NULL")
#: Tombstones whose payload was not collected yet.
Index("products_gone", products.c.sha256, sqlite_where=_GONE)

#: Outlines of products in the x-y plane of their frame, where they say more than the box: x, y as float64.
footprints = Table(
    "footprints",
    metadata,
    Column("ordinal", _Ordinal, primary_key=True, autoincrement=False),
    Column("ring", LargeBinary, nullable=False),
)

#: What the headers' quality says in numbers, to be found by.
product_metrics = Table(
    "product_metrics",
    metadata,
    Column("ordinal", _Ordinal, primary_key=True, autoincrement=False),
    Column("name", String(64), primary_key=True),
    Column("value", Float, nullable=False),
    Index("product_metrics_by_value", "name", "value"),
)

#: Who was made from what: an input may be a sensor sample that is not stored.
provenance = Table(
    "provenance",
    metadata,
    Column("product_id", String(36), primary_key=True),
    Column("input_id", String(64), primary_key=True),
)
Index("provenance_by_input", provenance.c.input_id)

#: Moving edges that there are poses of.
tracks = Table(
    "tracks",
    metadata,
    Column("child", String(128), primary_key=True),
    Column("parent", String(128), primary_key=True),
    Column("source", String(160), primary_key=True),
    Column("robot", String(64), nullable=False),
)

#: Of several poses of a track for one stamp the first that is not deleted holds.
poses = Table(
    "poses",
    metadata,
    Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
    Column("parent", String(128), nullable=False),
    Column("child", String(128), nullable=False),
    Column("source", String(160), nullable=False),
    Column("stamp_ns", BigInteger, nullable=False),
    Column("robot", String(64), nullable=False),
    Column("matrix", LargeBinary, nullable=False),
    Column("covariance", LargeBinary),
    Column("product_id", String(36), nullable=False),
    Column("inserted_ns", BigInteger, nullable=False, server_default="0"),
    Column("deleted_ns", BigInteger),
)
Index("poses_by_track", poses.c.child, poses.c.parent, poses.c.source, poses.c.stamp_ns)
Index("poses_by_product", poses.c.product_id)

events = Table(
    "events",
    metadata,
    Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
    Column("stamp_ns", BigInteger, nullable=False),
    Column("scope", String(64), nullable=False),
    Column("kind", String(64), nullable=False),
    Column("body", LargeBinary, nullable=False),
)
Index("events_by_kind", events.c.kind, events.c.ordinal)

#: What is said of a product after it was made: one row per revision, the last one holds. ``tags`` is a JSON list.
annotation_revisions = Table(
    "annotations",
    metadata,
    Column("product_id", String(36), primary_key=True),
    Column("revision", Integer, primary_key=True),
    Column("stamp_ns", BigInteger, nullable=False),
    Column("author", String(256), nullable=False),
    Column("tags", String, nullable=False),
    Column("notes", String, nullable=False),
    Column("pinned", Boolean, nullable=False),
    Column("quality", LargeBinary),
    Column("superseded_by", String(36)),
)

#: The last revisions' tags, pins and successors, for searches.
product_tags = Table(
    "product_tags",
    metadata,
    Column("tag", String(64), primary_key=True),
    Column("product_id", String(36), primary_key=True),
)
Index("product_tags_by_product", product_tags.c.product_id)
pins = Table("pins", metadata, Column("product_id", String(36), primary_key=True))
supersessions = Table(
    "supersessions",
    metadata,
    Column("product_id", String(36), primary_key=True),
    Column("by_id", String(36), nullable=False),
)
Index("supersessions_by_newer", supersessions.c.by_id)

#: Nodes and edges of a pose graph, under the product that they came with.
pose_graph_nodes = Table(
    "pose_graph_nodes",
    metadata,
    Column("product_id", String(36), primary_key=True),
    Column("node", BigInteger, primary_key=True),
    Column("frame", String(128), nullable=False),
    Column("stamp_ns", BigInteger, nullable=False),
    Column("matrix", LargeBinary, nullable=False),
    Column("covariance", LargeBinary),
    Column("fixed", Boolean, nullable=False, server_default="0"),
)
pose_graph_edges = Table(
    "pose_graph_edges",
    metadata,
    Column("product_id", String(36), primary_key=True),
    Column("edge", Integer, primary_key=True),
    Column("from_node", BigInteger, nullable=False),
    Column("to_node", BigInteger, nullable=False),
    Column("kind", String(32), nullable=False),
    Column("matrix", LargeBinary, nullable=False),
    Column("covariance", LargeBinary),
    Column("information", LargeBinary),
)

#: Live products and the bytes of their payloads by robot and type; triggers take off what goes.
tallies = Table(
    "tallies",
    metadata,
    Column("robot", String(64), primary_key=True),
    Column("product", String(64), primary_key=True),
    Column("live", BigInteger, nullable=False),
    Column("bytes", BigInteger, nullable=False),
)

#: Payloads that are kept, each content once, in packs (inline) and in files of their own; triggers take off what goes.
blob_tallies = Table(
    "blob_tallies",
    metadata,
    Column("inline", Boolean, primary_key=True),
    Column("payloads", BigInteger, nullable=False),
    Column("bytes", BigInteger, nullable=False),
)

#: What the spatial index calls a frame (its ordinal) and a type together.
index_buckets = Table(
    "index_buckets",
    metadata,
    Column("ordinal", _Ordinal, primary_key=True, autoincrement=True),
    Column("frame", BigInteger, nullable=False),
    Column("product", String(64), nullable=False),
    Index("index_buckets_by_name", "frame", "product", unique=True),
)
