# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products as features in collections, one per type, shared by STAC and OGC API Features."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.clock import format_stamp, parse_rfc3339
from cdff_common.contract.limits import LATEST_NS, MAX_PAGE
from cdff_common.contract.products import product_types
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geodesy import Body
from cdff_common.geometry.region import Region
from dpm_store import Page, ProductRecord, Query
from dpm_store.products.records import Cursor, Order
from dpm_store.search.extents import Extent, Origin
from dpm_store.search.filters import Among, Call
from services.dpm.http.context import Context
from services.dpm.http.search_places import Place, Touching, both, box_outline, required_place

#: Largest number of pages of the store that are read and filtered for one page of features.
_MAX_STEPS = 50
#: Largest number of products that are counted in a region.
_MOST_COUNTED = 20_000
#: Box of the whole body, degrees: west, south, east, north.
_EVERYWHERE = (-180.0, -90.0, 180.0, 90.0)


@dataclass(frozen=True, slots=True)
class Collection:
    """Products of one type.

    Attributes
    ----------
    id : str
        Product type.
    bounds_deg : tuple or None
        ``west south east north`` on the body; None if no product has a location.
    t0_ns, t1_ns : int
        Start of the first and end of the last capture.
    origins : tuple of Origin
        Robots, DFPCs, types and statuses of the products.
    frames : tuple of str
        Frames of the products.
    body : str
        Name of the body of its coordinates; empty for that of the site.
    """

    id: str
    bounds_deg: tuple[float, float, float, float] | None
    t0_ns: int
    t1_ns: int
    origins: tuple[Origin, ...] = ()
    frames: tuple[str, ...] = ()
    body: str = ""

    @property
    def title(self) -> str:
        """Text for users."""
        product = self.id.partition("-")[0]
        known = product_types().get(product)
        title = product.replace("_", " ").capitalize() if known is None else known.title
        return f"{title} ({self.body})" if self.body else title

    @property
    def description(self) -> str:
        """Text for users."""
        return f"{self.title} of all robots; each feature is the footprint of one product."

    @property
    def spatial_deg(self) -> list[float]:
        """Bounds, of the entire body if no product has a location."""
        return list(self.bounds_deg or _EVERYWHERE)

    @property
    def interval(self) -> list[str]:
        """Start and end as RFC 3339."""
        return [format_stamp(self.t0_ns), format_stamp(self.t1_ns)]


@dataclass(frozen=True, slots=True)
class OutlinedProduct:
    """A product with its outline in metres of its frame and in degrees of its body, None if unknown."""

    record: ProductRecord
    in_frame: BaseGeometry | None
    in_degrees: BaseGeometry | None
    body: Body | None


@dataclass(frozen=True, slots=True)
class FeaturePage:
    """A page of products, the cursor of the next, and the number of products on all pages, None if it was
    not counted.
    """

    items: tuple[OutlinedProduct, ...]
    cursor: str | None
    count: int | None = None


class Catalogue:
    """Collections and features of a DPM.

    Parameters
    ----------
    context : Context
    body : Body, optional
        Body to which regions are restricted; all bodies without it.
    """

    def __init__(self, context: Context, body: Body | None = None) -> None:
        self._context = context
        self._body = body
        self.places = context.places

    def collections(self) -> tuple[Collection, ...]:
        """Return the collections with products, by name."""
        extents_by_type: dict[str, list[Extent]] = {}
        for extent in self._context.extents.get(self._context.dpm.store):
            extents_by_type.setdefault(extent.product, []).append(extent)
        return tuple(self._collection(name, extents_by_type[name]) for name in sorted(extents_by_type))

    def collection(self, name: str) -> Collection:
        """Return a collection by name; raises ProductNotFoundError."""
        return self._collection(name, self.extents(name))

    def extents(self, name: str) -> list[Extent]:
        """Return the extents of a collection by frame; raises ProductNotFoundError if it does not exist."""
        extents = [e for e in self._context.extents.get(self._context.dpm.store) if e.product == name]
        if not extents:
            raise ProductNotFoundError(f"no collection {name[:64]!r}")
        return extents

    def get(self, collection: str, product_id: str) -> OutlinedProduct:
        """Return a product of a collection with its outlines; raises ProductNotFoundError."""
        record = self._context.dpm.store.get(product_id)
        if record.product != collection:
            raise ProductNotFoundError(
                f"product {product_id} is a {record.product}, not of {collection[:64]!r}"
            )
        return self.placed([record])[0]

    def placed(self, records: Sequence[ProductRecord]) -> list[OutlinedProduct]:
        """Return products with their outlines."""
        frames = [record.fields["frame"] for record in records]
        outlines = self.places.outlines_in_frame(records)
        in_degrees = self.places.outlines_in_degrees(frames, outlines)
        return [
            OutlinedProduct(record, outline, degrees, self.places.body_of(frame))
            for record, frame, outline, degrees in zip(records, frames, outlines, in_degrees, strict=True)
        ]

    def find(
        self, query: Query, *, bbox: Sequence[float] | None = None, intersects: BaseGeometry | None = None
    ) -> FeaturePage:
        """Return one page of products.

        Parameters
        ----------
        query : Query
            Query without a region; its expression may contain ``Touching``.
        bbox : sequence of 4 or 6, optional
            Degrees, west before east except across the antimeridian. Products without an outline on the body
            are not included.
        intersects : geometry, optional
            Degrees, instead of ``bbox``.
        """
        where = query.where
        if bbox is None and intersects is None:
            intersects, where = required_place(where)
        place = Place(self.places, bbox, intersects)
        query = replace(query, where=self._searched(where))
        if place.outline is not None and query.sort:
            query = replace(query, where=both(query.where, self._touching(place)))
        if place.outline is None or query.sort:
            page = self._context.dpm.retrieval.find(query)
            return FeaturePage(tuple(self.placed(page.items)), page.cursor, self._count(query))
        regions = self.places.regions(place.bounds, self._body)
        matches: list[OutlinedProduct] = []
        limit, cursor = query.limit, query.cursor
        for _ in range(_MAX_STEPS):  # the regions enclose the place
            page = self._page(replace(query, limit=limit - len(matches), cursor=cursor), regions)
            placed = self.placed(page.items)
            matches += placed if place.is_plain_box else place.touching(placed)
            cursor = page.cursor
            if cursor is None or len(matches) >= limit:
                break
        count = len(matches) if cursor is None else self._count_in(place, query, regions)
        return FeaturePage(tuple(matches), cursor, count if query.cursor is None else None)

    def _page(self, query: Query, regions: Sequence[tuple[str, Region]]) -> Page:
        """Return the products of a page which touch one of the regions, in the query's order."""
        pages = [
            self._context.dpm.retrieval.find(replace(query, frame=frame, region=region))
            for frame, region in regions
        ]
        if len(pages) == 1:
            return pages[0]
        record_by_ordinal = {record.ordinal: record for page in pages for record in page.items}
        newest_first = query.order is not Order.OLDEST
        items = sorted(record_by_ordinal.values(), key=lambda r: (r.t1_ns, r.ordinal), reverse=newest_first)
        is_last = len(items) <= query.limit and all(page.cursor is None for page in pages)
        items = items[: query.limit]
        if is_last or not items:
            return Page(tuple(items))
        last = items[-1]
        position = Cursor(query.order, last.t1_ns, last.ordinal, pages[0].frames_revision)
        return Page(tuple(items), position.text)

    def _count(self, query: Query) -> int | None:
        """Return the number of products on all pages, on the first page only."""
        return self._context.dpm.store.count(query) if query.cursor is None else None

    def _count_in(self, place: Place, query: Query, regions: Sequence[tuple[str, Region]]) -> int | None:
        """Return the number of products in a place on all pages; None after the first page, and if they are
        too many to count.
        """
        if query.cursor is not None:
            return None
        if not place.is_plain_box:
            page = self._page(replace(query, limit=MAX_PAGE), regions)
            return len(place.touching(self.placed(page.items))) if page.cursor is None else None
        ordinals = self._ordinals_in(query, regions)
        return None if ordinals is None else len(ordinals)

    def _ordinals_in(self, query: Query, regions: Sequence[tuple[str, Region]]) -> set[int] | None:
        """Return the products in one of the regions; None if they are too many."""
        ordinals: set[int] = set()
        for frame, region in regions:
            part = self._context.dpm.store.ordinals_in(
                replace(query, frame=frame, region=region), _MOST_COUNTED
            )
            if part is None:
                return None
            ordinals |= part
        return ordinals

    def _searched(self, where: Any) -> Any:
        """Return an expression with the products that touch each place in it."""
        if isinstance(where, Touching):
            bbox, geometry = where.place
            return self._touching(Place(self.places, bbox, geometry))
        if isinstance(where, Call):
            return Call(where.op, tuple(self._searched(argument) for argument in where.args))
        return where

    def _touching(self, place: Place) -> Among:
        """Return the products that touch a place; raises InputError if they are too many."""
        regions = self.places.regions(place.bounds, self._body)
        if place.is_plain_box:
            ordinals = self._ordinals_in(Query(), regions)
        else:
            ordinals, cursor = set(), None
            for _ in range(_MAX_STEPS):
                page = self._page(Query(limit=MAX_PAGE, cursor=cursor), regions)
                ordinals.update(p.record.ordinal for p in place.touching(self.placed(page.items)))
                cursor = page.cursor
                if cursor is None:
                    break
            else:
                raise _too_many_near(_MAX_STEPS * MAX_PAGE)
        if ordinals is None:
            raise _too_many_near(_MOST_COUNTED)
        return Among(frozenset(ordinals))

    def _collection(self, name: str, extents: Sequence[Extent]) -> Collection:
        boxes = [
            (e.frame, shapely.box(*e.box_m[:2], *e.box_m[3:5]))
            for e in extents
            if e.box_m is not None and self.places.body_of(e.frame) == self.places.body
        ]
        bounds = bounds_deg(self.places.outline_in_degrees(frame, box) for frame, box in boxes)
        times = min(e.t0_ns for e in extents), max(e.t1_ns for e in extents)
        all_origins = self._context.extents.origins(self._context.dpm.store)
        origins = tuple(origin for origin in all_origins if origin.product == name)
        return Collection(name, bounds, *times, origins, tuple(sorted({e.frame for e in extents})))


def selected_collections(
    collections: Sequence[Collection],
    bbox: Sequence[float] | None,
    datetime: str | None,
    words: str | None,
) -> list[Collection]:
    """Return the collections whose extent touches a box and an interval and whose text contains one of the
    words.
    """
    t0_ns, t1_ns = span_of(datetime)
    box = None if bbox is None else box_outline(bbox)
    search_words = [word.strip().lower() for word in (words or "").split(",") if word.strip()]

    def is_selected(collection: Collection) -> bool:
        text = f"{collection.id} {collection.title} {collection.description}".lower()
        return (
            (t0_ns is None or collection.t1_ns >= t0_ns)
            and (t1_ns is None or collection.t0_ns <= t1_ns)
            and (not search_words or any(word in text for word in search_words))
            and (
                box is None
                or (collection.bounds_deg is not None and box.intersects(shapely.box(*collection.bounds_deg)))
            )
        )

    return [c for c in collections if is_selected(c)]


def bounds_deg(
    outlines: Iterable[BaseGeometry | None],
) -> tuple[float, float, float, float] | None:
    """Return the bounds of the outlines that are not None, ``west south east north``; None without any."""
    known = [outline for outline in outlines if outline is not None]
    if not known:
        return None
    west, south, east, north = map(float, shapely.total_bounds(known))
    return west, south, east, north


def span_of(datetime: str | None) -> tuple[int | None, int | None]:
    """Return ``(t0_ns, t1_ns)`` of a ``datetime`` of STAC and OGC: a time or an interval, open at ``..``.

    Raises
    ------
    InputError
        If a time is not one of RFC 3339, or the interval ends before its start.
    """
    if datetime is None:
        return None, None
    parts = datetime.split("/")
    if len(parts) > 2 or (len(parts) == 2 and all(part in ("", "..") for part in parts)):
        raise InputError(
            f"datetime={datetime[:80]!r}: expected a time, or two of them as t0/t1, one of them may be .."
        )
    times = [
        None if part in ("", "..") and len(parts) == 2 else parse_rfc3339(part, "datetime") for part in parts
    ]
    if any(t is not None and abs(t) > LATEST_NS for t in times):
        raise InputError(f"datetime={datetime[:80]!r}: expected times before the year 2116")
    t0_ns, t1_ns = times[0], times[-1]
    if t0_ns is not None and t1_ns is not None and t0_ns > t1_ns:
        raise InputError(f"datetime={datetime[:80]!r}: the interval ends before its start")
    return t0_ns, t1_ns


def numbers_of(text: str | None, name: str = "bbox") -> list[float] | None:
    """Return comma-separated numbers; raises InputError."""
    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise InputError(f"{name}={text[:80]!r}: expected numbers with commas") from error


def page_size(limit: int | None) -> int:
    """Return the features per page; a limit above the largest is reduced (OGC 17-069r4 §7.15.3)."""
    return 100 if limit is None else min(limit, MAX_PAGE)


def _too_many_near(limit: int) -> InputError:
    return InputError(
        f"more than {limit} products are near the geometry: use bbox or intersects, or a smaller one"
    )
