-- SPDX-FileCopyrightText: 2026 the CDFF contributors
-- SPDX-License-Identifier: BSD-3-Clause
-- The first released schema, as statements separated by empty lines. A released migration never changes.
-- Times are integer nanoseconds of mission time. An ordinal numbers the rows of a table in the order of
-- insertion; INTEGER PRIMARY KEY is the row id of SQLite. Matrices are 16 or 36 little-endian float64.
CREATE TABLE meta (name VARCHAR(64) NOT NULL, value VARCHAR NOT NULL, PRIMARY KEY (name))

-- Frames that have held products, and the lowest and highest z of the boxes of these products.
CREATE TABLE frame_names (
    ordinal INTEGER NOT NULL PRIMARY KEY,
    frame VARCHAR(128) NOT NULL,
    zmin_m FLOAT,
    zmax_m FLOAT,
    UNIQUE (frame)
)

-- Revisions of the fixed edges parent -> frame. Append-only.
CREATE TABLE frames (
    frame VARCHAR(128) NOT NULL,
    revision INTEGER NOT NULL,
    parent VARCHAR(128) NOT NULL,
    matrix BLOB NOT NULL,
    covariance BLOB,
    valid_from_ns BIGINT,
    valid_until_ns BIGINT,
    inserted_ns BIGINT NOT NULL,
    producer VARCHAR(256) NOT NULL,
    PRIMARY KEY (frame, revision)
)

-- Frame revisions in the order of insertion; an ordinal identifies a state of the whole tree. Append-only.
CREATE TABLE frame_log (
    ordinal INTEGER NOT NULL PRIMARY KEY,
    frame VARCHAR(128) NOT NULL,
    revision INTEGER NOT NULL
)

CREATE UNIQUE INDEX frame_log_by_frame ON frame_log (frame, revision)

-- Revisions of the bodies at the root of frame trees. Append-only.
CREATE TABLE bodies (
    name VARCHAR(64) NOT NULL,
    revision INTEGER NOT NULL,
    definition BLOB NOT NULL,
    inserted_ns BIGINT NOT NULL,
    producer VARCHAR(256) NOT NULL,
    PRIMARY KEY (name, revision)
)

CREATE TABLE robots (
    robot VARCHAR(64) NOT NULL PRIMARY KEY,
    doc VARCHAR NOT NULL,
    description BLOB NOT NULL,
    inserted_ns BIGINT NOT NULL,
    updated_ns BIGINT NOT NULL
)

-- Payloads by content, with their location in the packs (null for a file) and the number of live products
-- with the payload (a trigger subtracts deleted ones).
CREATE TABLE blobs (
    sha256 VARCHAR(64) NOT NULL PRIMARY KEY,
    size BIGINT NOT NULL,
    chunk_sums BLOB NOT NULL,
    location BIGINT,
    live BIGINT DEFAULT '0' NOT NULL
)

-- Only payloads in packs.
CREATE INDEX blobs_by_location ON blobs (location, size) WHERE location IS NOT NULL

CREATE TABLE products (
    ordinal INTEGER NOT NULL PRIMARY KEY,
    id VARCHAR(36) NOT NULL,
    robot VARCHAR(64) NOT NULL,
    dfpc VARCHAR(64) NOT NULL,
    port VARCHAR(64) NOT NULL,
    product VARCHAR(64) NOT NULL,
    type_name VARCHAR(64) NOT NULL,
    codec VARCHAR(16) NOT NULL,
    frame VARCHAR(128) NOT NULL,
    child VARCHAR(128),
    config_hash VARCHAR(64) NOT NULL,
    t0_ns BIGINT NOT NULL,
    t1_ns BIGINT NOT NULL,
    xmin_m FLOAT,
    ymin_m FLOAT,
    zmin_m FLOAT,
    xmax_m FLOAT,
    ymax_m FLOAT,
    zmax_m FLOAT,
    resolution_m FLOAT,
    status VARCHAR(16) NOT NULL,
    covariance_kind VARCHAR(16) DEFAULT 'none' NOT NULL,
    header BLOB NOT NULL,
    sha256 VARCHAR(64) REFERENCES blobs (sha256),
    size BIGINT NOT NULL,
    inserted_ns BIGINT NOT NULL,
    deleted_ns BIGINT,
    UNIQUE (id)
)

CREATE INDEX products_by_time ON products (t1_ns, ordinal)

CREATE INDEX products_by_type ON products (product, t1_ns, ordinal)

CREATE INDEX products_by_robot ON products (robot, product, t1_ns, ordinal)

-- Only tombstones whose payload is not collected yet.
CREATE INDEX products_deleted ON products (sha256) WHERE deleted_ns IS NOT NULL AND sha256 IS NOT NULL

-- Outlines, in the x-y plane of their frame, of products that are clearly smaller than their box, as float64.
CREATE TABLE footprints (ordinal INTEGER NOT NULL PRIMARY KEY, ring BLOB NOT NULL)

-- Metrics of the headers' quality, for searches.
CREATE TABLE product_metrics (
    ordinal BIGINT NOT NULL,
    name VARCHAR(64) NOT NULL,
    value FLOAT NOT NULL,
    PRIMARY KEY (ordinal, name)
)

CREATE INDEX product_metrics_by_value ON product_metrics (name, value)

-- Inputs of products; an input may be a sensor sample that is not stored.
CREATE TABLE provenance (
    product_id VARCHAR(36) NOT NULL,
    input_id VARCHAR(64) NOT NULL,
    PRIMARY KEY (product_id, input_id)
)

CREATE INDEX provenance_by_input ON provenance (input_id)

-- Moving edges that have poses.
CREATE TABLE tracks (
    child VARCHAR(128) NOT NULL,
    parent VARCHAR(128) NOT NULL,
    source VARCHAR(160) NOT NULL,
    robot VARCHAR(64) NOT NULL,
    PRIMARY KEY (child, parent, source)
)

-- Poses of tracks. Of several with one stamp the first that is not deleted is used.
CREATE TABLE poses (
    ordinal INTEGER NOT NULL PRIMARY KEY,
    parent VARCHAR(128) NOT NULL,
    child VARCHAR(128) NOT NULL,
    source VARCHAR(160) NOT NULL,
    stamp_ns BIGINT NOT NULL,
    robot VARCHAR(64) NOT NULL,
    matrix BLOB NOT NULL,
    covariance BLOB,
    product_id VARCHAR(36) NOT NULL,
    inserted_ns BIGINT DEFAULT '0' NOT NULL,
    deleted_ns BIGINT
)

CREATE INDEX poses_by_track ON poses (child, parent, source, stamp_ns)

CREATE INDEX poses_by_product ON poses (product_id)

CREATE TABLE events (
    ordinal INTEGER NOT NULL PRIMARY KEY,
    stamp_ns BIGINT NOT NULL,
    scope VARCHAR(64) NOT NULL,
    kind VARCHAR(64) NOT NULL,
    body BLOB NOT NULL
)

CREATE INDEX events_by_kind ON events (kind, ordinal)

-- Revisions of the annotations of products; the last one is current. The tags are a JSON list. Append-only.
CREATE TABLE annotations (
    product_id VARCHAR(36) NOT NULL,
    revision INTEGER NOT NULL,
    stamp_ns BIGINT NOT NULL,
    author VARCHAR(256) NOT NULL,
    tags VARCHAR NOT NULL,
    notes VARCHAR NOT NULL,
    pinned BOOLEAN NOT NULL,
    quality BLOB,
    superseded_by VARCHAR(36),
    PRIMARY KEY (product_id, revision)
)

-- Tags, pins and successors of the current annotations, for searches.
CREATE TABLE product_tags (
    tag VARCHAR(64) NOT NULL,
    product_id VARCHAR(36) NOT NULL,
    PRIMARY KEY (tag, product_id)
)

CREATE INDEX product_tags_by_product ON product_tags (product_id)

CREATE TABLE pins (product_id VARCHAR(36) NOT NULL PRIMARY KEY)

CREATE TABLE supersessions (product_id VARCHAR(36) NOT NULL PRIMARY KEY, by_id VARCHAR(36) NOT NULL)

CREATE INDEX supersessions_by_newer ON supersessions (by_id)

-- Nodes and edges of pose graphs, by product.
CREATE TABLE pose_graph_nodes (
    product_id VARCHAR(36) NOT NULL,
    node BIGINT NOT NULL,
    frame VARCHAR(128) NOT NULL,
    stamp_ns BIGINT NOT NULL,
    matrix BLOB NOT NULL,
    covariance BLOB,
    fixed BOOLEAN DEFAULT '0' NOT NULL,
    PRIMARY KEY (product_id, node)
)

CREATE TABLE pose_graph_edges (
    product_id VARCHAR(36) NOT NULL,
    edge INTEGER NOT NULL,
    from_node BIGINT NOT NULL,
    to_node BIGINT NOT NULL,
    kind VARCHAR(32) NOT NULL,
    matrix BLOB NOT NULL,
    covariance BLOB,
    information BLOB,
    PRIMARY KEY (product_id, edge)
)

-- Live products and the bytes of their payloads by robot and type; a trigger subtracts deleted products.
CREATE TABLE tallies (
    robot VARCHAR(64) NOT NULL,
    product VARCHAR(64) NOT NULL,
    live BIGINT NOT NULL,
    bytes BIGINT NOT NULL,
    PRIMARY KEY (robot, product)
)

-- Stored payloads, each content once, in packs and in files; a trigger subtracts removed payloads.
CREATE TABLE blob_tallies (packed BOOLEAN NOT NULL PRIMARY KEY, live BIGINT NOT NULL, bytes BIGINT NOT NULL)

-- Buckets of the spatial index, by frame (its ordinal) and type.
CREATE TABLE index_buckets (
    ordinal INTEGER NOT NULL PRIMARY KEY,
    frame BIGINT NOT NULL,
    product VARCHAR(64) NOT NULL
)

CREATE UNIQUE INDEX index_buckets_by_name ON index_buckets (frame, product)

CREATE VIRTUAL TABLE product_index USING rtree(id, bucket0, bucket1, x0, x1, y0, y1, z0, z1, t0, t1)

CREATE VIRTUAL TABLE deleted_index USING rtree(id, bucket0, bucket1, x0, x1, y0, y1, z0, z1, t0, t1)

CREATE TRIGGER products_delete AFTER UPDATE OF deleted_ns ON products
WHEN OLD.deleted_ns IS NULL AND NEW.deleted_ns IS NOT NULL
BEGIN
    UPDATE tallies SET live = live - 1, bytes = bytes - OLD.size
    WHERE robot = OLD.robot AND product = OLD.product;
    UPDATE blobs SET live = live - 1 WHERE sha256 = OLD.sha256;
END

CREATE TRIGGER blobs_delete AFTER DELETE ON blobs
BEGIN
    UPDATE blob_tallies SET live = live - 1, bytes = bytes - OLD.size
    WHERE packed = (OLD.location IS NOT NULL);
END

CREATE TRIGGER events_no_update BEFORE UPDATE ON events
BEGIN SELECT RAISE(ABORT, 'events are append-only'); END

CREATE TRIGGER events_no_delete BEFORE DELETE ON events
BEGIN SELECT RAISE(ABORT, 'events are append-only'); END

CREATE TRIGGER frames_no_update BEFORE UPDATE ON frames
BEGIN SELECT RAISE(ABORT, 'frames are append-only'); END

CREATE TRIGGER frames_no_delete BEFORE DELETE ON frames
BEGIN SELECT RAISE(ABORT, 'frames are append-only'); END

CREATE TRIGGER frame_log_no_update BEFORE UPDATE ON frame_log
BEGIN SELECT RAISE(ABORT, 'frame_log is append-only'); END

CREATE TRIGGER frame_log_no_delete BEFORE DELETE ON frame_log
BEGIN SELECT RAISE(ABORT, 'frame_log is append-only'); END

CREATE TRIGGER bodies_no_update BEFORE UPDATE ON bodies
BEGIN SELECT RAISE(ABORT, 'bodies are append-only'); END

CREATE TRIGGER bodies_no_delete BEFORE DELETE ON bodies
BEGIN SELECT RAISE(ABORT, 'bodies are append-only'); END

CREATE TRIGGER annotations_no_update BEFORE UPDATE ON annotations
BEGIN SELECT RAISE(ABORT, 'annotations are append-only'); END

CREATE TRIGGER annotations_no_delete BEFORE DELETE ON annotations
BEGIN SELECT RAISE(ABORT, 'annotations are append-only'); END
