# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tables as SQLAlchemy Core describes them, read from the SQL of the migrations, which documents them."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import BigInteger, Integer, MetaData, create_engine

_MIGRATIONS = Path(__file__).parent / "migrations" / "sqlite"
#: Columns of the box of a product, in the order of ``Header.box_m``.
SIDES = ("xmin_m", "ymin_m", "zmin_m", "xmax_m", "ymax_m", "zmax_m")


def _read_metadata() -> MetaData:
    """Return the tables that the migrations create, reflected from an empty database."""
    metadata, engine = MetaData(), create_engine("sqlite://")
    with engine.begin() as connection:
        for path in sorted(_MIGRATIONS.glob("*.sql")):
            for statement in path.read_text("utf-8").split("\n\n"):
                connection.exec_driver_sql(statement)
        # the spatial indexes are virtual tables, which the dialect of the engine accesses
        metadata.reflect(connection, only=lambda name, _: "_index" not in name)
    engine.dispose()
    for column in (column for table in metadata.tables.values() for column in table.columns):
        if isinstance(column.type, Integer):  # all integers of SQLite have 64 bits
            column.type = BigInteger()
    return metadata


_tables = _read_metadata().tables
meta = _tables["meta"]
frame_names = _tables["frame_names"]
frames = _tables["frames"]
frame_log = _tables["frame_log"]
bodies = _tables["bodies"]
robots = _tables["robots"]
blobs = _tables["blobs"]
products = _tables["products"]
footprints = _tables["footprints"]
product_metrics = _tables["product_metrics"]
provenance = _tables["provenance"]
tracks = _tables["tracks"]
poses = _tables["poses"]
events = _tables["events"]
annotation_revisions = _tables["annotations"]
product_tags = _tables["product_tags"]
pins = _tables["pins"]
supersessions = _tables["supersessions"]
pose_graph_nodes = _tables["pose_graph_nodes"]
pose_graph_edges = _tables["pose_graph_edges"]
tallies = _tables["tallies"]
blob_tallies = _tables["blob_tallies"]
index_buckets = _tables["index_buckets"]
