# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products as features in collections, one per type: what STAC and OGC API Features have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.clock import format_stamp, parse_stamp
from cdff_common.errors import InputError, ProductNotFoundError
from dpm_store import ProductRecord, Query
from dpm_store.extents import Extent
from dpm_store.records import LATEST_NS, MAX_LIMIT
from services.dpm.http.context import Context
from services.dpm.http.places import Places, checked_box

TITLES = {
    "pose": "Poses", "trajectory": "Trajectories", "pose_graph": "Pose graphs", "pointcloud": "Point clouds",
    "dem": "Elevation patches", "navigation_map": "Navigation maps", "image": "Images", "disparity": "Disparities",
}  # fmt: skip
#: Pages of the store that one page of features may be filtered from.
_MAX_STEPS = 50
#: Wider than any site: what asks for it asks for everything that has a place.
_EVERYWHERE = (-180.0, -90.0, 180.0, 90.0)


@dataclass(frozen=True, slots=True)
class Collection:
    """Products of one type.

    Attributes
    ----------
    id : str
        As products are named in contract §5.
    bounds_deg : tuple or None
        ``west south east north`` on the body; None where nothing is placed.
    t0_ns, t1_ns : int
        Captures.
    """

    id: str
    bounds_deg: tuple[float, float, float, float] | None
    t0_ns: int
    t1_ns: int

    @property
    def title(self) -> str:
        """For people."""
        return TITLES.get(self.id, self.id.replace("_", " ").capitalize())

    @property
    def description(self) -> str:
        """For people."""
        return f"{self.title} of all robots; each feature is the footprint of one product."

    @property
    def spatial_deg(self) -> list[float]:
        """The bounds, all of the body where nothing is placed."""
        return list(self.bounds_deg or _EVERYWHERE)

    @property
    def interval(self) -> list[str]:
        """Begin and end as RFC 3339."""
        return [format_stamp(self.t0_ns), format_stamp(self.t1_ns)]


@dataclass(frozen=True, slots=True)
class Placed:
    """A product with its outline, in metres of its frame and in degrees of the body; None where there is none."""

    record: ProductRecord
    in_frame: BaseGeometry | None
    on_body: BaseGeometry | None

    def touches(self, place: BaseGeometry) -> bool:
        """Whether it and a geometry in degrees have a point in common."""
        return self.on_body is not None and bool(self.on_body.intersects(place))


@dataclass(frozen=True, slots=True)
class Found:
    """A page of products, and where to go on."""

    items: tuple[Placed, ...]
    cursor: str | None


class Catalogue:
    """Collections and features of a DPM."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.places = Places(context.dpm.store)

    def collections(self) -> tuple[Collection, ...]:
        """Those that hold something, by name."""
        found: dict[str, list[Extent]] = {}
        for extent in self._context.extents.get(self._context.dpm.store):
            found.setdefault(extent.product, []).append(extent)
        return tuple(self._collection(name, found[name]) for name in sorted(found))

    def collection(self, name: str) -> Collection:
        """One by its name; raises ProductNotFoundError."""
        extents = self._extents(name)
        if not extents:
            raise ProductNotFoundError(f"no collection {name[:64]!r}")
        return self._collection(name, extents)

    def check(self, name: str) -> None:
        """Raise ProductNotFoundError where there is no such collection."""
        if not self._extents(name):
            raise ProductNotFoundError(f"no collection {name[:64]!r}")

    def get(self, collection: str, product_id: str) -> Placed:
        """A product of a collection with its outlines; raises ProductNotFoundError."""
        record = self._context.dpm.store.get(product_id)
        if record.product != collection:
            raise ProductNotFoundError(f"product {product_id} is a {record.product}, not of {collection[:64]!r}")
        return self.placed([record])[0]

    def placed(self, records: Sequence[ProductRecord]) -> list[Placed]:
        """Products with their outlines."""
        outlines = self.places.outlines(records)
        return [
            Placed(record, outline, self.places.on_body(record.header.frame, outline))
            for record, outline in zip(records, outlines, strict=True)
        ]

    def find(
        self, query: Query, *, bbox: Sequence[float] | None = None, intersects: BaseGeometry | None = None
    ) -> Found:
        """One page of products.

        Parameters
        ----------
        query : Query
            Everything but the place.
        bbox : sequence of 4 or 6, optional
            Degrees, west before east save across the antimeridian. What has no place on the body is not found by it.
        intersects : geometry, optional
            Degrees, instead of ``bbox``.
        """
        place = intersects if bbox is None else box_outline(bbox)
        if place is None:
            page = self._context.dpm.search(query)
            return Found(tuple(self.placed(page.items)), page.cursor)
        near = self.places.region(place.bounds if bbox is None else bbox)
        if near is not None:
            query = replace(query, frame=near[0], region=near[1])
        elif not self.places.several_sites():
            return Found((), None)
        kept: list[Placed] = []
        wanted = query.limit
        for _ in range(_MAX_STEPS):  # the region is around the place: what only touches the region falls out here
            page = self._context.dpm.search(replace(query, limit=wanted - len(kept)))
            kept += [p for p in self.placed(page.items) if p.touches(place)]
            query = replace(query, cursor=page.cursor)
            if page.cursor is None or len(kept) >= wanted:
                break
        return Found(tuple(kept), query.cursor)

    def find_ids(
        self, ids: Sequence[str], query: Query, *, bbox: Sequence[float] | None = None,
        intersects: BaseGeometry | None = None,
    ) -> Found:  # fmt: skip
        """Products by their ids that fit everything else that is asked; unknown ones are left out."""
        place = intersects if bbox is None else box_outline(bbox)
        records = []
        for product_id in dict.fromkeys(ids):
            try:
                records.append(self._context.dpm.store.get(product_id))
            except ProductNotFoundError:
                continue
        fitting = self.placed([record for record in records if _fits(record, query)])
        return Found(tuple(p for p in fitting if place is None or p.touches(place)), None)

    def _extents(self, name: str) -> list[Extent]:
        return [e for e in self._context.extents.get(self._context.dpm.store) if e.product == name]

    def _collection(self, name: str, extents: Sequence[Extent]) -> Collection:
        boxes = [(e.frame, shapely.box(*e.box_m[:2], *e.box_m[3:5])) for e in extents if e.box_m is not None]
        on_body = [o for frame, box in boxes if (o := self.places.on_body(frame, box)) is not None]
        bounds = None if not on_body else tuple(float(v) for v in shapely.total_bounds(on_body))
        return Collection(name, bounds, min(e.t0_ns for e in extents), max(e.t1_ns for e in extents))  # type: ignore[arg-type]  # total_bounds gives four


def box_outline(bbox: Sequence[float]) -> BaseGeometry:
    """A box in degrees, in two parts where its west is east of its east: across the antimeridian."""
    west, south, east, north = checked_box(bbox)
    if west <= east:
        return shapely.box(west, south, east, north)
    return shapely.union(shapely.box(west, south, 180.0, north), shapely.box(-180.0, south, east, north))


def span_of(datetime: str | None) -> tuple[int | None, int | None]:
    """``datetime`` of STAC and OGC, an RFC 3339 time or an interval open at ``..``, as ``(t0_ns, t1_ns)``."""
    if datetime is None:
        return None, None
    parts = datetime.split("/")
    if len(parts) > 2 or (len(parts) == 2 and all(part in ("", "..") for part in parts)):
        raise InputError(f"datetime={datetime[:80]!r}: expected a time, or two of them as t0/t1, one of them may be ..")
    times = [None if part in ("", "..") and len(parts) == 2 else parse_stamp(part, "datetime") for part in parts]
    if any(t is not None and abs(t) > LATEST_NS for t in times):
        raise InputError(f"datetime={datetime[:80]!r}: expected times before the year 2116")
    return times[0], times[-1]


def numbers_of(text: str | None, name: str = "bbox") -> list[float] | None:
    """Numbers between commas; raises InputError."""
    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise InputError(f"{name}={text[:80]!r}: expected numbers with commas") from error


def page_size(limit: int | None) -> int:
    """Features in a page: more than the server gives is no error (OGC 17-069r4 §7.15.3)."""
    return 100 if limit is None else min(limit, MAX_LIMIT)


def _fits(record: ProductRecord, query: Query) -> bool:
    header = record.header
    return (
        (not query.types or record.product in query.types)
        and (query.t0_ns is None or header.t1_ns >= query.t0_ns)
        and (query.t1_ns is None or header.t0_ns <= query.t1_ns)
    )
