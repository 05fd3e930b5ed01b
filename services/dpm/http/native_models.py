# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the native interface answers with (contract §8), as the OpenAPI document shows it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from services.dpm.http.models import Open, StampNs

Matrix = Annotated[list[list[float]], Field(description="Rows")]
Box = Annotated[list[float], Field(min_length=6, max_length=6, description="xmin ymin zmin xmax ymax zmax, metres")]


class Quality(Open):
    """How far a result can be trusted."""

    status: Literal["OK", "DEGRADED", "FAILED"]
    reasons: list[str]
    covariance_kind: str
    metrics: dict[str, float | None]


class ProductLinks(Open):
    """Where more of a product is."""

    self: str
    payload: str
    thumbnail: str


class Product(Open):
    """Metadata of a product: its header, and what the key and the store add."""

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


class Annotation(Open):
    """One revision of what is said of a product."""

    revision: int
    tags: list[str]
    notes: str
    pinned: bool
    quality: Quality | None
    superseded_by: str | None
    author: str
    stamp_ns: StampNs


class Described(Product):
    """A product with its formats and what is said of it."""

    formats: list[str]
    annotation: Annotation


class PageLinks(Open):
    """Where the next page is."""

    self: str
    next: str | None = None


class ProductPage(Open):
    """A page of a search."""

    items: list[Product]
    links: PageLinks
    cursor: str | None
    unplaced_frames: list[str]
    frames_revision: int
    distances_m: list[float] | None = None


class Inserted(BaseModel):
    """What an insertion came to."""

    id: str
    result: Literal["inserted", "already"]


class InsertedAll(BaseModel):
    """What a batch came to, in its order."""

    items: list[Inserted]


class Deleted(BaseModel):
    """Whether a product was deleted now; false where it was before."""

    id: str
    deleted: bool


class NewAnnotation(Annotation):
    """The revision that was made."""

    id: str


class Annotations(BaseModel):
    """All revisions, oldest first."""

    items: list[Annotation]


class Generation(Open):
    """A product that another was made from, or that was made from it."""

    id: str
    generation: int
    known: bool


class Provenance(Open):
    """Generations of products and who was made from whom."""

    id: str
    direction: str
    items: list[Generation]
    links: list[dict[str, str]]
    truncated: bool


class FrameRevision(Open):
    """A fixed edge ``parent -> frame``."""

    frame: str
    parent: str
    revision: int
    T: Matrix
    covariance: Matrix | None


class Track(Open):
    """A moving edge and the span that is known."""

    parent: str
    child: str
    source: str
    robot: str
    t0_ns: StampNs
    t1_ns: StampNs
    count: int


class Frames(Open):
    """Fixed frames and moving ones."""

    items: list[FrameRevision]
    tracks: list[Track]
    frames_revision: int


class FrameRevisions(Open):
    """All revisions of a frame, oldest first."""

    items: list[FrameRevision]


class Pose(Open):
    """``T_parent_child`` at a time."""

    parent: str
    child: str
    stamp_ns: StampNs
    T: Matrix
    covariance: Matrix | None


class Poses(Open):
    """Poses in the order of time."""

    items: list[Pose]


class Robot(Open):
    """A robot, where it is and what its DFPCs do."""

    id: str
    pose: Pose | None
    pose_missing: str
    dfpcs: list[dict[str, Any]]
    services: list[str]
    described: dict[str, Any] | None


class Robots(Open):
    """All robots."""

    items: list[Robot]


class Status(Open):
    """Counts and sizes, and who is alive."""

    products: int
    by_robot: dict[str, dict[str, int]]
    payload_bytes: int
    newest_t1_ns: StampNs | None
    events: int
    now_ns: StampNs
    counters: dict[str, int]
    services: dict[str, list[str]]
    mission: str | None


class Happened(Open):
    """An event."""

    ordinal: int
    stamp_ns: StampNs
    scope: str
    kind: str


class Verdict(Open):
    """What retention does with a product, and why."""

    id: str
    product: str
    robot: str
    t1_ns: StampNs
    size: int
    retire: bool
    why: str


class RetentionPlan(Open):
    """What the rules let go; the first thousand verdicts."""

    applied: bool
    rules: int
    retired: int
    bytes: int
    kept: int
    verdicts: list[Verdict]


class Changes(Open):
    """What happened; go on from ``next``."""

    items: list[Happened]
    next: int
    more: bool
