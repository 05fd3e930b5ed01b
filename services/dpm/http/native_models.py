# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Models of the answers below ``/api/v1``."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, Field

from services.dpm.http.models import OpenModel, StampNs

Item = TypeVar("Item")
Matrix = Annotated[list[list[float]], Field(description="Rows")]
Box = Annotated[
    list[float], Field(min_length=6, max_length=6, description="xmin ymin zmin xmax ymax zmax, metres")
]


class Items(OpenModel, Generic[Item]):
    """All objects of one kind, in their order."""

    items: list[Item]


class Quality(OpenModel):
    """Quality of a result."""

    status: Literal["OK", "DEGRADED", "FAILED"]
    reasons: list[str]
    covariance_kind: str
    metrics: dict[str, float | None]


class ProductLinks(OpenModel):
    """Links of a product."""

    self: str
    payload: str
    thumbnail: str


class Product(OpenModel):
    """Metadata of a product: its header, names and storage."""

    id: str
    robot: str
    dfpc: str
    port: str
    product: str
    type_name: str
    codec: str
    v: int
    seq: int
    t0_ns: StampNs
    t1_ns: StampNs
    inserted_ns: StampNs
    frame: str
    producer: str
    config_hash: str
    inputs: list[str]
    quality: Quality
    size: int
    links: ProductLinks
    child: str | None = None
    box_m: Box | None = None
    resolution_m: float | None = None
    sha256: str | None = None
    deleted_ns: StampNs | None = None


class Annotation(OpenModel):
    """One revision of the annotation of a product."""

    revision: int
    tags: list[str]
    notes: str
    pinned: bool
    quality: Quality | None
    superseded_by: str | None
    author: str
    stamp_ns: StampNs


class AnnotatedProduct(Product):
    """A product with its formats and its annotation."""

    formats: list[str]
    annotation: Annotation


class PageLinks(OpenModel):
    """Links of a page."""

    self: str
    next: str | None = None


class ProductPage(OpenModel):
    """A page of a search."""

    items: list[Product]
    links: PageLinks
    cursor: str | None
    unplaced_frames: list[str]
    frames_revision: int
    distances_m: list[float] | None = None


class Inserted(BaseModel):
    """Outcome of an insertion."""

    id: str
    result: Literal["inserted", "already"]


class StoredMesh(Inserted):
    """Outcome of the upload of a mesh, and content of the file."""

    frame: str
    unit: str
    vertices: int
    triangles: int
    extent_m: Annotated[list[float], Field(min_length=3, max_length=3, description="Along x, y, z, metres")]
    symmetries: int | None
    sha256: Annotated[str, Field(description="SHA-256 of the file")]


class Deleted(BaseModel):
    """Outcome of a deletion; ``deleted`` is false if it was already deleted."""

    id: str
    deleted: bool


class NewAnnotation(Annotation):
    """The new revision."""

    id: str


class Generation(OpenModel):
    """A product in the provenance of another, with its distance."""

    id: str
    generation: int
    known: bool


class Provenance(OpenModel):
    """Generations of products and the links between them."""

    id: str
    direction: str
    items: list[Generation]
    links: list[dict[str, str]]
    truncated: bool


class FrameRevision(OpenModel):
    """A fixed edge ``parent -> frame``."""

    frame: str
    parent: str
    revision: int
    T: Matrix
    covariance: Matrix | None


class Track(OpenModel):
    """A moving edge and the time span of its poses."""

    parent: str
    child: str
    source: str
    robot: str
    t0_ns: StampNs
    t1_ns: StampNs
    count: int


class Frames(OpenModel):
    """Fixed and moving frames."""

    items: list[FrameRevision]
    tracks: list[Track]
    frames_revision: int


class Pose(OpenModel):
    """``T_parent_child`` at a time."""

    parent: str
    child: str
    stamp_ns: StampNs
    T: Matrix
    covariance: Matrix | None


class Robot(OpenModel):
    """A robot, its pose and its DFPCs."""

    id: str
    pose: Pose | None
    pose_missing: str
    dfpcs: list[dict[str, Any]]
    services: list[str]
    described: dict[str, Any] | None
    profile_revision: str
    has_left: bool


class AlarmBody(OpenModel):
    """A condition that needs an operator."""

    kind: str
    source: str
    severity: Literal["warning", "critical"]
    since_ns: StampNs
    what: str
    remedy: str
    acknowledged_by: str | None
    acknowledged_ns: StampNs | None


class AlarmList(OpenModel):
    """Active alarms."""

    items: list[AlarmBody]


class GatewayTopic(OpenModel):
    """Counters of a topic or port of a gateway to a robot."""

    robot: str
    gateway: str
    direction: Literal["in", "out"]
    topic: str
    type: str
    received: int
    forwarded: int
    dropped: dict[str, int]
    latency_ms: float
    least_age_ms: float | None
    last_fault: str


class GatewayTopicList(OpenModel):
    """Topics of all gateways that answer."""

    items: list[GatewayTopic]


class Overview(OpenModel):
    """Streams of the sensors with measured rates and faults, DFPCs, and their newest products."""

    streams: list[dict[str, Any]]
    dfpcs: list[dict[str, Any]]
    newest: list[dict[str, Any]]


class ServiceHealthBody(OpenModel):
    """Health of a service in words, with the end of the newest capture in its products."""

    scope: str
    service: str
    health: Literal["good", "idle", "degraded", "failed"]
    text: str
    newest_t1_ns: StampNs | None


class Status(OpenModel):
    """Counts and sizes, and the running services; without the bus there is no overview."""

    products: int
    by_robot: dict[str, dict[str, int]]
    payload_bytes: int
    newest_t1_ns: StampNs | None
    events: int
    now_ns: StampNs
    alarms: list[AlarmBody]
    counters: dict[str, int]
    services: dict[str, list[str]]
    health: list[ServiceHealthBody]
    mission: str | None
    process: str = "dpm"
    overview: Overview | None = None


class EventAnswer(OpenModel):
    """An event."""

    ordinal: int
    stamp_ns: StampNs
    scope: str
    kind: str


class RetentionDecision(OpenModel):
    """Decision of retention on a product, with its reason."""

    id: str
    product: str
    robot: str
    t1_ns: StampNs
    size: int
    retire: bool
    why: str


class RetentionPlan(OpenModel):
    """Plan of the retention rules, with the first thousand decisions."""

    applied: bool
    rules: int
    retired: int
    bytes: int
    kept: int
    verdicts: list[RetentionDecision]


class Changes(OpenModel):
    """Events; continue from ``next``."""

    items: list[EventAnswer]
    next: int
    more: bool
