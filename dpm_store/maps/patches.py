# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Patches of maps: found by region, read in order, and cached decoded."""

from __future__ import annotations

import hashlib
import itertools
import json
import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.contract.limits import MAX_PAGE
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status, product_id
from dpm_store.engine.time_limit import check_time
from dpm_store.frames.frames import FrameTable, HistoryView
from dpm_store.products.products import ProductTable
from dpm_store.products.records import Page, ProductRecord, Query
from dpm_store.search.outlines import corners_of
from dpm_store.search.search import Search

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry

#: DFPC name of derived maps, which are never pooled again.
DERIVED_DFPC = "dpm"
#: Largest number of patches of one window.
MAX_PATCHES = 20_000
#: Size of the cache of decoded elevation patches, bytes.
CACHE_BYTES = 24 << 20
#: Patches read together: at most so many, and at most so many bytes, unless one alone is larger.
_BATCH, BATCH_BYTES = 32, 8 << 20
#: Batches in memory: one is pooled while the next one is read.
BATCHES = 2
#: Threads that read patches, for all windows of a store; their heaps would otherwise outlive each window.
_READERS = 2
#: ``xmin ymin xmax ymax``, metres.
Bounds = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A decoded map: layers ``(rows, cols)`` by name."""

    geometry: GridGeometry
    layers: dict[str, NDArray[Any]]
    t1_ns: int


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DerivedProduct:
    """A product that is derived from others, and its sources.

    Attributes
    ----------
    header : Header
        The sources are the ``inputs``.
    robots : tuple of str
        Robots of the sources.
    skipped_frames : tuple of str
        Frames of omitted products: frames tilted too much for resampling, or, for a cloud, not connected with
        its frame by fixed edges.
    purged : int
        Products of the searched state whose payload is purged; the result is DEGRADED by them.
    """

    header: Header
    robots: tuple[str, ...]
    skipped_frames: tuple[str, ...]
    purged: int

    @property
    def robot(self) -> str:
        """The robot of the sources, or ``ground`` for several."""
        return self.robots[0] if len(self.robots) == 1 else "ground"

    def manifest(self) -> dict[str, Any]:
        """Return plain data of the sources, for replies."""
        names = (field.name for field in fields(self) if field.name not in ("header", "map", "cloud"))
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, slots=True)
class PatchSelection:
    """Patches that may overlap a region.

    Attributes
    ----------
    records : tuple of ProductRecord
        By end of capture, then id: the order of pooling.
    transforms : dict
        ``T_window_frame`` of the frames of records other than the window's frame.
    unplaced_frames : tuple of str
        Frames that no fixed edges connect with the window's; products in them were not searched.
    frames_revision : int
        State of the frame tree.
    """

    records: tuple[ProductRecord, ...]
    transforms: dict[str, UncertainTransform]
    unplaced_frames: tuple[str, ...] = ()
    frames_revision: int = 0

    @property
    def latest_ns(self) -> int:
        """End of the last capture."""
        return max(r.header.t1_ns for r in self.records)

    @property
    def largest_bytes(self) -> int:
        """Size of the largest decoded patch."""
        return max(r.decoded_bytes for r in self.records)

    @property
    def total_bytes(self) -> int:
        """Size of all decoded patches."""
        return sum(r.decoded_bytes for r in self.records)


class Patches:
    """Search and reading of maps of one kind, elevation by default.

    Parameters
    ----------
    product, type_name : str
        Kind of product and ASN.1 type.
    cache_bytes : int
        Size of the cache of decoded maps.
    readers : ThreadPoolExecutor, optional
        Threads that read patches; by default own ones.
    """

    def __init__(
        self,
        search: Search,
        products: ProductTable,
        frames: FrameTable,
        product: str = "dem",
        type_name: str = "ElevationMap",
        cache_bytes: int = CACHE_BYTES,
        readers: ThreadPoolExecutor | None = None,
    ) -> None:
        self.product = product
        self._type_name = type_name
        self._cache_bytes = cache_bytes
        self._search = search
        self._products = products
        self._frames = frames
        self._readers = readers or ThreadPoolExecutor(_READERS, thread_name_prefix="patches")
        self._lock = threading.Lock()
        self._cache: OrderedDict[str, Patch] = OrderedDict()
        self._cached_bytes = 0

    def of(self, product: str, type_name: str) -> Patches:
        """Return the patches of another kind in the same store, with a smaller cache."""
        return Patches(
            self._search,
            self._products,
            self._frames,
            product,
            type_name,
            self._cache_bytes // 4,
            self._readers,
        )

    def close(self) -> None:
        """End the reading threads."""
        self._readers.shutdown(cancel_futures=True)

    def any(self, query: Query) -> bool:
        """Return whether a search finds a patch; derived maps count."""
        return bool(self._search.run(replace(query, types=(self.product,), limit=1)).items)

    def find_few(self, query: Query, max_count: int) -> PatchSelection | None:
        """Return ``find``, or None if there are more than ``max_count`` patches or derived maps."""
        page = self._search.run(replace(query, types=(self.product,), limit=2 * max_count))
        records = _patches_of(page)
        return (
            None
            if page.cursor is not None or len(records) > max_count
            else self._selection(query, records, page)
        )

    def find(self, query: Query) -> PatchSelection:
        """Return the patches of a search with their transforms; raises InputError on too many."""
        step = replace(query, types=(self.product,), limit=MAX_PAGE)
        page = self._search.run(step)
        records = _patches_of(page)
        while page.cursor is not None:
            if len(records) >= MAX_PATCHES:
                raise InputError(
                    f"more than {MAX_PATCHES} products of type {self.product} in that region; ask for a "
                    "smaller one"
                )
            page = self._search.run(replace(step, cursor=page.cursor))
            records += _patches_of(page)
        return self._selection(query, records, page)

    def _selection(self, query: Query, records: Sequence[ProductRecord], page: Page) -> PatchSelection:
        tree = self._frames.tree(HistoryView(query.as_of_ns, query.frames_revision))
        others = {r.header.frame for r in records} - {query.frame}
        transforms = {frame: T for frame in others if (T := tree.find(query.frame, frame)) is not None}
        unplaced = {*page.unplaced_frames, *(others - transforms.keys())}
        usable = [r for r in records if r.header.frame == query.frame or r.header.frame in transforms]
        usable.sort(key=lambda r: (r.header.t1_ns, r.id))
        return PatchSelection(tuple(usable), transforms, tuple(sorted(unplaced)), page.frames_revision)

    def resolved_region(self, query: Query) -> Region:
        """Return the region of a query with ``near`` replaced by a circle."""
        return self._search.resolved_region(query)

    def resolution_m(self, record: ProductRecord) -> float:
        """Return the cell size of a patch, metres; from the payload if its header has none."""
        if record.header.resolution_m is not None:
            return record.header.resolution_m
        patch = next(self.read((record,)))[1]
        return 0.0 if patch is None else patch.geometry.resolution_m

    def read(self, records: Sequence[ProductRecord]) -> Iterator[tuple[ProductRecord, Patch | None]]:
        """Return the patches of records, in their order; None if the payload was purged.

        The checksums of each payload are verified when it is read. Raises OverloadedError when the time of
        the request is over.
        """
        read_count, total = 0, len(records)
        batches = list(_batches(records))
        # While one batch is pooled, the next is read, checked and decoded.
        pending = [self._readers.submit(self._load, batch) for batch in batches[:1]]
        try:
            for number, batch in enumerate(batches):
                check_time(read_count, total, "patches")
                read_count += len(batch)
                loaded = pending.pop().result()
                pending = [
                    self._readers.submit(self._load, next_batch)
                    for next_batch in batches[number + 1 : number + BATCHES]
                ]
                for record in batch:
                    yield record, loaded.pop(record.id, None)
        finally:
            for batch_read in pending:
                batch_read.cancel()

    def _load(self, records: Sequence[ProductRecord]) -> dict[str, Patch]:
        """Return the decoded patches of records by id, from the cache or from their payloads."""
        from cdff_common.codecs import decode

        patches = self._cached(records)
        missing = {record.id: record for record in records if record.id not in patches}
        for record_id, payload in self._products.payloads(list(missing)):
            record = missing[record_id]
            value = decode(self._type_name, payload, record.codec)
            layers = {name: value.layer(name) for name in value.layer_names}
            patches[record_id] = Patch(value.geometry, layers, record.header.t1_ns)
            self._add_to_cache(record_id, patches[record_id])
        return patches

    def _cached(self, records: Sequence[ProductRecord]) -> dict[str, Patch]:
        with self._lock:
            for record in records:
                if record.id in self._cache:
                    self._cache.move_to_end(record.id)
            return {record.id: self._cache[record.id] for record in records if record.id in self._cache}

    def _add_to_cache(self, product_id: str, patch: Patch) -> None:
        """Cache a patch, unless it takes more than a quarter of the cache; the oldest patches are evicted."""
        size = sum(layer.nbytes for layer in patch.layers.values())
        if size > self._cache_bytes // 4:
            return
        with self._lock:
            if product_id in self._cache:
                return
            self._cache[product_id] = patch
            self._cached_bytes += size
            while self._cached_bytes > self._cache_bytes:
                _, evicted = self._cache.popitem(last=False)
                self._cached_bytes -= sum(layer.nbytes for layer in evicted.layers.values())


def _batches(records: Sequence[ProductRecord]) -> Iterator[list[ProductRecord]]:
    """Yield records that are read together."""
    batch: list[ProductRecord] = []
    size = 0
    for record in records:
        if batch and (len(batch) == _BATCH or size + record.decoded_bytes > BATCH_BYTES):
            yield batch
            batch, size = [], 0
        batch.append(record)
        size += record.decoded_bytes
    if batch:
        yield batch


def _patches_of(page: Page) -> list[ProductRecord]:
    """Return the products of a page that have a payload and are not derived."""
    return [record for record in page.items if record.dfpc != DERIVED_DFPC and record.size]


def bounds_in(T: UncertainTransform, box_m: NDArray[np.float64]) -> Bounds:
    """Return the bounds of a box ``(6,)`` in another frame, metres."""
    corners = T.apply(corners_of(box_m[None])[0])[:, :2]
    (xmin, ymin), (xmax, ymax) = corners.min(axis=0), corners.max(axis=0)
    return float(xmin), float(ymin), float(xmax), float(ymax)


def bounds_each(selection: PatchSelection, frame: str) -> NDArray[np.float64]:
    """Return the bounds ``(n, 4)`` of each patch in the window's frame, metres; infinite without a box."""
    bounds = np.full((len(selection.records), 4), [-np.inf, -np.inf, np.inf, np.inf])
    for row, record in zip(bounds, selection.records, strict=True):
        box_m = record.header.box_m
        if box_m is not None and record.header.frame == frame:
            row[:] = box_m[0], box_m[1], box_m[3], box_m[4]
        elif box_m is not None:
            row[:] = bounds_in(selection.transforms[record.header.frame], np.array(box_m))
    return bounds


def overlapping(selection: PatchSelection, boxes: NDArray[np.float64], bounds: Bounds) -> PatchSelection:
    """Return the patches with a box ``(n, 4)`` that overlaps the bounds."""
    x0, y0, x1, y1 = bounds
    overlaps = (boxes[:, 0] <= x1) & (boxes[:, 2] >= x0) & (boxes[:, 1] <= y1) & (boxes[:, 3] >= y0)
    return replace(selection, records=tuple(itertools.compress(selection.records, overlaps.tolist())))


def bounds_of(selection: PatchSelection, frame: str) -> Bounds:
    """Return the bounds of all patches in the window's frame, metres; raises InputError if none has a box."""
    bounds = bounds_each(selection, frame)
    finite = bounds[np.isfinite(bounds).all(axis=1)]
    if not len(finite):
        raise InputError("no patch has a box; name a region")
    (xmin, ymin), (xmax, ymax) = finite[:, :2].min(axis=0), finite[:, 2:].max(axis=0)
    return float(xmin), float(ymin), float(xmax), float(ymax)


def derived_header(
    sources: Sequence[ProductRecord],
    contents: Sequence[Any],
    *,
    port: str,
    frame: str,
    producer: str,
    extent_m: Sequence[float] | None,
    purged: int,
    resolution_m: float | None = None,
    covariance_kind: CovarianceKind = CovarianceKind.NONE,
    metrics: Mapping[str, float] | None = None,
) -> Header:
    """Return the header of a product that is derived from others.

    Parameters
    ----------
    sources : sequence of ProductRecord
    contents : sequence
        JSON values that determine the product; its id depends on them.
    purged : int
        Number of inputs without a payload; the product is DEGRADED by them.
    """
    config_hash = hashlib.sha256(json.dumps(contents).encode()).hexdigest()[:16]
    is_degraded = any(r.header.quality.status is Status.DEGRADED for r in sources)
    causes = {"degraded_inputs": is_degraded, "purged_inputs": purged}
    reasons = tuple(reason for reason, applies in causes.items() if applies)
    status = Status.DEGRADED if reasons else Status.OK
    robots, t1_ns = {r.robot for r in sources}, max(r.header.t1_ns for r in sources)
    robot = robots.pop() if len(robots) == 1 else "ground"
    box_m: Any = None if extent_m is None else tuple(map(float, extent_m))
    return Header(
        id=product_id(robot, DERIVED_DFPC, port, t1_ns, 0, config_hash),
        seq=0,
        t0_ns=min(r.header.t0_ns for r in sources),
        t1_ns=t1_ns,
        frame=frame,
        producer=producer,
        config_hash=config_hash,
        inputs=tuple(sorted(r.id for r in sources)),
        quality=Quality(status, reasons, covariance_kind, dict(metrics or {})),
        box_m=box_m,
        resolution_m=resolution_m,
    )
