-- SPDX-FileCopyrightText: 2026 the CDFF contributors
-- SPDX-License-Identifier: BSD-3-Clause
-- The first released schema for PostgreSQL with PostGIS, as statements separated by empty lines. A released
-- migration never changes. The tables are those of SQLite. Texts are compared byte by byte, as SQLite does.
-- Times are integer nanoseconds of mission time. An ordinal numbers the rows of a table in the order of
-- insertion, without gaps. Matrices are 16 or 36 little-endian float64.
CREATE EXTENSION IF NOT EXISTS postgis

CREATE EXTENSION IF NOT EXISTS btree_gist

CREATE TABLE meta (name TEXT COLLATE "C" NOT NULL, value TEXT COLLATE "C" NOT NULL, PRIMARY KEY (name))

-- Frames that have held products, and the lowest and highest z of the boxes of these products.
CREATE TABLE frame_names (
    ordinal BIGINT NOT NULL PRIMARY KEY,
    frame TEXT COLLATE "C" NOT NULL,
    zmin_m DOUBLE PRECISION,
    zmax_m DOUBLE PRECISION,
    UNIQUE (frame)
)

-- Revisions of the fixed edges parent -> frame. Append-only.
CREATE TABLE frames (
    frame TEXT COLLATE "C" NOT NULL,
    revision BIGINT NOT NULL,
    parent TEXT COLLATE "C" NOT NULL,
    matrix BYTEA NOT NULL,
    covariance BYTEA,
    valid_from_ns BIGINT,
    valid_until_ns BIGINT,
    inserted_ns BIGINT NOT NULL,
    producer TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (frame, revision)
)

-- Frame revisions in the order of insertion; an ordinal identifies a state of the whole tree. Append-only.
CREATE TABLE frame_log (
    ordinal BIGINT NOT NULL PRIMARY KEY,
    frame TEXT COLLATE "C" NOT NULL,
    revision BIGINT NOT NULL
)

CREATE UNIQUE INDEX frame_log_by_frame ON frame_log (frame, revision)

-- Revisions of the bodies at the root of frame trees. Append-only.
CREATE TABLE bodies (
    name TEXT COLLATE "C" NOT NULL,
    revision BIGINT NOT NULL,
    definition BYTEA NOT NULL,
    inserted_ns BIGINT NOT NULL,
    producer TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (name, revision)
)

CREATE TABLE robots (
    robot TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    doc TEXT COLLATE "C" NOT NULL,
    description BYTEA NOT NULL,
    inserted_ns BIGINT NOT NULL,
    updated_ns BIGINT NOT NULL
)

-- Payloads by content, with their location in the packs (null for a file) and the number of live products
-- with the payload (a trigger subtracts deleted ones).
CREATE TABLE blobs (
    sha256 TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    size BIGINT NOT NULL,
    chunk_sums BYTEA NOT NULL,
    location BIGINT,
    live BIGINT DEFAULT '0' NOT NULL
)

-- Only payloads in packs.
CREATE INDEX blobs_by_location ON blobs (location, size) WHERE location IS NOT NULL

CREATE TABLE products (
    ordinal BIGINT NOT NULL PRIMARY KEY,
    id TEXT COLLATE "C" NOT NULL,
    robot TEXT COLLATE "C" NOT NULL,
    dfpc TEXT COLLATE "C" NOT NULL,
    port TEXT COLLATE "C" NOT NULL,
    product TEXT COLLATE "C" NOT NULL,
    type_name TEXT COLLATE "C" NOT NULL,
    codec TEXT COLLATE "C" NOT NULL,
    frame TEXT COLLATE "C" NOT NULL,
    child TEXT COLLATE "C",
    config_hash TEXT COLLATE "C" NOT NULL,
    t0_ns BIGINT NOT NULL,
    t1_ns BIGINT NOT NULL,
    xmin_m DOUBLE PRECISION,
    ymin_m DOUBLE PRECISION,
    zmin_m DOUBLE PRECISION,
    xmax_m DOUBLE PRECISION,
    ymax_m DOUBLE PRECISION,
    zmax_m DOUBLE PRECISION,
    resolution_m DOUBLE PRECISION,
    status TEXT COLLATE "C" NOT NULL,
    covariance_kind TEXT COLLATE "C" DEFAULT 'none' NOT NULL,
    header BYTEA NOT NULL,
    sha256 TEXT COLLATE "C" REFERENCES blobs (sha256),
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
CREATE TABLE footprints (ordinal BIGINT NOT NULL PRIMARY KEY, ring BYTEA NOT NULL)

-- Metrics of the headers' quality, for searches.
CREATE TABLE product_metrics (
    ordinal BIGINT NOT NULL,
    name TEXT COLLATE "C" NOT NULL,
    value DOUBLE PRECISION NOT NULL,
    PRIMARY KEY (ordinal, name)
)

CREATE INDEX product_metrics_by_value ON product_metrics (name, value)

-- Inputs of products; an input may be a sensor sample that is not stored.
CREATE TABLE provenance (
    product_id TEXT COLLATE "C" NOT NULL,
    input_id TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (product_id, input_id)
)

CREATE INDEX provenance_by_input ON provenance (input_id)

-- Moving edges that have poses.
CREATE TABLE tracks (
    child TEXT COLLATE "C" NOT NULL,
    parent TEXT COLLATE "C" NOT NULL,
    source TEXT COLLATE "C" NOT NULL,
    robot TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (child, parent, source)
)

-- Poses of tracks. Of several with one stamp the first that is not deleted is used.
CREATE TABLE poses (
    ordinal BIGINT NOT NULL PRIMARY KEY,
    parent TEXT COLLATE "C" NOT NULL,
    child TEXT COLLATE "C" NOT NULL,
    source TEXT COLLATE "C" NOT NULL,
    stamp_ns BIGINT NOT NULL,
    robot TEXT COLLATE "C" NOT NULL,
    matrix BYTEA NOT NULL,
    covariance BYTEA,
    product_id TEXT COLLATE "C" NOT NULL,
    inserted_ns BIGINT DEFAULT '0' NOT NULL,
    deleted_ns BIGINT
)

CREATE INDEX poses_by_track ON poses (child, parent, source, stamp_ns)

CREATE INDEX poses_by_product ON poses (product_id)

CREATE TABLE events (
    ordinal BIGINT NOT NULL PRIMARY KEY,
    stamp_ns BIGINT NOT NULL,
    scope TEXT COLLATE "C" NOT NULL,
    kind TEXT COLLATE "C" NOT NULL,
    body BYTEA NOT NULL
)

CREATE INDEX events_by_kind ON events (kind, ordinal)

-- Revisions of the annotations of products; the last one is current. The tags are a JSON list. Append-only.
CREATE TABLE annotations (
    product_id TEXT COLLATE "C" NOT NULL,
    revision BIGINT NOT NULL,
    stamp_ns BIGINT NOT NULL,
    author TEXT COLLATE "C" NOT NULL,
    tags TEXT COLLATE "C" NOT NULL,
    notes TEXT COLLATE "C" NOT NULL,
    pinned BOOLEAN NOT NULL,
    quality BYTEA,
    superseded_by TEXT COLLATE "C",
    PRIMARY KEY (product_id, revision)
)

-- Tags, pins and successors of the current annotations, for searches.
CREATE TABLE product_tags (
    tag TEXT COLLATE "C" NOT NULL,
    product_id TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (tag, product_id)
)

CREATE INDEX product_tags_by_product ON product_tags (product_id)

CREATE TABLE pins (product_id TEXT COLLATE "C" NOT NULL PRIMARY KEY)

CREATE TABLE supersessions (product_id TEXT COLLATE "C" NOT NULL PRIMARY KEY, by_id TEXT COLLATE "C" NOT NULL)

CREATE INDEX supersessions_by_newer ON supersessions (by_id)

-- Nodes and edges of pose graphs, by product.
CREATE TABLE pose_graph_nodes (
    product_id TEXT COLLATE "C" NOT NULL,
    node BIGINT NOT NULL,
    frame TEXT COLLATE "C" NOT NULL,
    stamp_ns BIGINT NOT NULL,
    matrix BYTEA NOT NULL,
    covariance BYTEA,
    fixed BOOLEAN DEFAULT '0' NOT NULL,
    PRIMARY KEY (product_id, node)
)

CREATE TABLE pose_graph_edges (
    product_id TEXT COLLATE "C" NOT NULL,
    edge BIGINT NOT NULL,
    from_node BIGINT NOT NULL,
    to_node BIGINT NOT NULL,
    kind TEXT COLLATE "C" NOT NULL,
    matrix BYTEA NOT NULL,
    covariance BYTEA,
    information BYTEA,
    PRIMARY KEY (product_id, edge)
)

-- Live products and the bytes of their payloads by robot and type; a trigger subtracts deleted products.
CREATE TABLE tallies (
    robot TEXT COLLATE "C" NOT NULL,
    product TEXT COLLATE "C" NOT NULL,
    live BIGINT NOT NULL,
    bytes BIGINT NOT NULL,
    PRIMARY KEY (robot, product)
)

-- Stored payloads, each content once, in packs and in files; a trigger subtracts removed payloads.
CREATE TABLE blob_tallies (packed BOOLEAN NOT NULL PRIMARY KEY, live BIGINT NOT NULL, bytes BIGINT NOT NULL)

-- Buckets of the spatial index, by frame (its ordinal) and type.
CREATE TABLE index_buckets (
    ordinal BIGINT NOT NULL PRIMARY KEY,
    frame BIGINT NOT NULL,
    product TEXT COLLATE "C" NOT NULL
)

CREATE UNIQUE INDEX index_buckets_by_name ON index_buckets (frame, product)

-- Spatial indexes of live and of deleted products: the box in its frame, and the time of capture as the fourth
-- dimension. The bucket is the frame and the type. Times are seconds since the epoch of the store.
CREATE TABLE product_index (
    ordinal BIGINT NOT NULL PRIMARY KEY,
    bucket BIGINT NOT NULL,
    t0_s DOUBLE PRECISION NOT NULL,
    t1_s DOUBLE PRECISION NOT NULL,
    shape GEOMETRY NOT NULL
)

CREATE INDEX product_index_by_shape ON product_index USING gist (bucket, shape gist_geometry_ops_nd)

CREATE TABLE deleted_index (LIKE product_index INCLUDING ALL)

CREATE FUNCTION assign_ordinal() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    EXECUTE format('SELECT coalesce(max(ordinal), 0) + 1 FROM %I.%I', TG_TABLE_SCHEMA, TG_TABLE_NAME)
    INTO NEW.ordinal;
    RETURN NEW;
END $$

CREATE TRIGGER frame_names_ordinal BEFORE INSERT ON frame_names FOR EACH ROW WHEN (NEW.ordinal IS NULL)
EXECUTE FUNCTION assign_ordinal()

CREATE TRIGGER frame_log_ordinal BEFORE INSERT ON frame_log FOR EACH ROW WHEN (NEW.ordinal IS NULL)
EXECUTE FUNCTION assign_ordinal()

CREATE TRIGGER poses_ordinal BEFORE INSERT ON poses FOR EACH ROW WHEN (NEW.ordinal IS NULL)
EXECUTE FUNCTION assign_ordinal()

CREATE TRIGGER events_ordinal BEFORE INSERT ON events FOR EACH ROW WHEN (NEW.ordinal IS NULL)
EXECUTE FUNCTION assign_ordinal()

CREATE TRIGGER index_buckets_ordinal BEFORE INSERT ON index_buckets FOR EACH ROW WHEN (NEW.ordinal IS NULL)
EXECUTE FUNCTION assign_ordinal()

CREATE FUNCTION subtract_product() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    UPDATE tallies SET live = live - 1, bytes = bytes - OLD.size
    WHERE robot = OLD.robot AND product = OLD.product;
    UPDATE blobs SET live = live - 1 WHERE sha256 = OLD.sha256;
    RETURN NULL;
END $$

CREATE TRIGGER products_delete AFTER UPDATE OF deleted_ns ON products FOR EACH ROW
WHEN (OLD.deleted_ns IS NULL AND NEW.deleted_ns IS NOT NULL) EXECUTE FUNCTION subtract_product()

CREATE FUNCTION subtract_blob() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    UPDATE blob_tallies SET live = live - 1, bytes = bytes - OLD.size
    WHERE packed = (OLD.location IS NOT NULL);
    RETURN NULL;
END $$

CREATE TRIGGER blobs_delete AFTER DELETE ON blobs FOR EACH ROW EXECUTE FUNCTION subtract_blob()

CREATE FUNCTION refuse_change() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION '% are append-only', TG_TABLE_NAME;
END $$

CREATE TRIGGER events_append_only BEFORE UPDATE OR DELETE ON events FOR EACH ROW EXECUTE FUNCTION refuse_change()

CREATE TRIGGER frames_append_only BEFORE UPDATE OR DELETE ON frames FOR EACH ROW EXECUTE FUNCTION refuse_change()

CREATE TRIGGER frame_log_append_only BEFORE UPDATE OR DELETE ON frame_log FOR EACH ROW EXECUTE FUNCTION refuse_change()

CREATE TRIGGER bodies_append_only BEFORE UPDATE OR DELETE ON bodies FOR EACH ROW EXECUTE FUNCTION refuse_change()

CREATE TRIGGER annotations_append_only BEFORE UPDATE OR DELETE ON annotations FOR EACH ROW EXECUTE FUNCTION refuse_change()
