# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps on their way into a window: found by region, read in order, kept decoded while there is room."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from dpm_store.frames import FrameTable, Known
from dpm_store.products import ProductTable
from dpm_store.records import MAX_LIMIT, Page, ProductRecord, Query
from dpm_store.search import Search

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry

#: dfpc under which derived maps are stored; they are never pooled again.
DERIVED_DFPC = "dpm"
#: Of one window.
MAX_PATCHES = 20_000
#: Of decoded elevation patches that are kept in memory.
CACHE_BYTES = 48 << 20
#: Patches read together; as many are in memory at a time.
_AHEAD = 32


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A decoded map: layers ``(rows, cols)`` by name."""

    geometry: GridGeometry
    layers: dict[str, NDArray[Any]]
    t1_ns: int


@dataclass(frozen=True, slots=True)
class Found:
    """Patches that may reach into a region.

    Attributes
    ----------
    records : tuple of ProductRecord
        By end of capture, then id: the order in which they are pooled.
    transforms : dict
        ``T_window_frame`` of the frames of records that are not in the window's own.
    unplaced_frames : tuple of str
        Frames that no chain of fixed edges joins with the window's; products in them were not looked at.
    frames_revision : int
        State of the frame tree.
    """

    records: tuple[ProductRecord, ...]
    transforms: dict[str, UncertainTransform]
    unplaced_frames: tuple[str, ...] = ()
    frames_revision: int = 0


class Patches:
    """Finds and reads maps of one kind, elevation unless another is named.

    Parameters
    ----------
    product, type_name : str
        What they are stored as.
    cache_bytes : int
        Of decoded maps that are kept in memory.
    """

    def __init__(
        self, search: Search, products: ProductTable, frames: FrameTable, product: str = "dem",
        type_name: str = "ElevationMap", cache_bytes: int = CACHE_BYTES,
    ) -> None:  # fmt: skip
        self.product = product
        self._type_name = type_name
        self._cache_bytes = cache_bytes
        self._search = search
        self._products = products
        self._frames = frames
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, Patch] = OrderedDict()
        self._kept_bytes = 0

    def of(self, product: str, type_name: str) -> Patches:
        """Maps of another kind in the same store, with a smaller cache."""
        return Patches(self._search, self._products, self._frames, product, type_name, self._cache_bytes // 4)

    def any(self, query: Query) -> bool:
        """Whether a search finds a patch; derived maps count."""
        return bool(self._search.run(replace(query, types=(self.product,), limit=1)).items)

    def find_few(self, query: Query, most: int) -> Found | None:
        """As ``find``; None where there are more than ``most``, or as many derived maps."""
        page = self._search.run(replace(query, types=(self.product,), limit=2 * most))
        found = [r for r in page.items if r.dfpc != DERIVED_DFPC and r.size]
        if page.cursor is not None or len(found) > most:
            return None
        return self._placed(query, found, page)

    def find(self, query: Query) -> Found:
        """Patches that a search finds, and how they lie in the query's frame; raises InputError on too many."""
        found: list[ProductRecord] = []
        page = self._search.run(replace(query, types=(self.product,), limit=MAX_LIMIT))
        while True:
            found += [r for r in page.items if r.dfpc != DERIVED_DFPC and r.size]
            if page.cursor is None:
                break
            if len(found) >= MAX_PATCHES:
                raise InputError(f"more than {MAX_PATCHES} patches in that region; ask for a smaller one")
            page = self._search.run(replace(query, types=(self.product,), limit=MAX_LIMIT, cursor=page.cursor))
        return self._placed(query, found, page)

    def _placed(self, query: Query, found: Sequence[ProductRecord], page: Page) -> Found:
        transforms: dict[str, UncertainTransform] = {}
        unplaced = set(page.unplaced_frames)
        for frame in {r.header.frame for r in found} - {query.frame}:
            try:
                transforms[frame] = self._frames.lookup(
                    query.frame, frame, known=Known(query.as_of_ns, query.frames_revision)
                )
            except FrameNotFoundError:
                unplaced.add(frame)
        placed = [r for r in found if r.header.frame == query.frame or r.header.frame in transforms]
        placed.sort(key=lambda r: (r.header.t1_ns, r.id))
        return Found(tuple(placed), transforms, tuple(sorted(unplaced)), page.frames_revision)

    def resolved_region(self, query: Query) -> Region:
        """The region of a query with ``near`` turned into a circle."""
        return self._search.resolved_region(query)

    def resolution_m(self, record: ProductRecord) -> float:
        """Cell size of a patch, metres; from the payload where its header does not say it."""
        if record.header.resolution_m is not None:
            return record.header.resolution_m
        patch = next(self.read((record,)))[1]
        return 0.0 if patch is None else patch.geometry.resolution_m

    def read(self, records: Sequence[ProductRecord]) -> Iterator[tuple[ProductRecord, Patch | None]]:
        """The patches of records, in their order; None where one was deleted and its payload purged since.

        Each payload is compared with its checksum when it is read.
        """
        batches = [records[first : first + _AHEAD] for first in range(0, len(records), _AHEAD)]
        # While one batch is pooled the next is read, checked and decoded.
        with ThreadPoolExecutor(1, thread_name_prefix="patches") as pool:
            coming = [pool.submit(self._loaded, batch) for batch in batches[:1]]
            for number, batch in enumerate(batches):
                known = coming.pop().result()
                coming = [pool.submit(self._loaded, following) for following in batches[number + 1 : number + 2]]
                for record in batch:
                    yield record, known.get(record.id)

    def _loaded(self, records: Sequence[ProductRecord]) -> dict[str, Patch]:
        """Decoded patches of records by id, those that are kept as they are."""
        from cdff_common.codecs import decode

        known = self._known(records)
        codecs = {record.id: record for record in records if record.id not in known}
        for product_id, payload in self._products.payloads(list(codecs)):
            record = codecs[product_id]
            value = decode(self._type_name, payload, record.codec)
            layers = {name: value.layer(name) for name in value.layer_names}
            known[product_id] = Patch(value.geometry, layers, record.header.t1_ns)
            self._keep(product_id, known[product_id])
        return known

    def _known(self, records: Sequence[ProductRecord]) -> dict[str, Patch]:
        with self._lock:
            for record in records:
                if record.id in self._kept:
                    self._kept.move_to_end(record.id)
            return {record.id: self._kept[record.id] for record in records if record.id in self._kept}

    def _keep(self, product_id: str, patch: Patch) -> None:
        size = sum(layer.nbytes for layer in patch.layers.values())
        if size > self._cache_bytes // 4:
            return
        with self._lock:
            if product_id in self._kept:
                return
            self._kept[product_id] = patch
            self._kept_bytes += size
            while self._kept_bytes > self._cache_bytes:
                _, gone = self._kept.popitem(last=False)
                self._kept_bytes -= sum(layer.nbytes for layer in gone.layers.values())


def bounds_each(found: Found, frame: str) -> NDArray[np.float64]:
    """Bounds ``(n, 4)`` of each patch in the window's frame, metres; infinite where a patch does not say them."""
    bounds = np.full((len(found.records), 4), [-np.inf, -np.inf, np.inf, np.inf])
    for row, record in zip(bounds, found.records, strict=True):
        box = record.header.box_m
        if box is None:
            continue
        corners = np.array([[box[i], box[j], box[k]] for i in (0, 3) for j in (1, 4) for k in (2, 5)])
        if record.header.frame != frame:
            corners = found.transforms[record.header.frame].apply(corners)
        row[:2], row[2:] = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    return bounds


def bounds_of(found: Found, frame: str) -> tuple[float, float, float, float]:
    """Bounds of all patches in the window's frame, metres; raises InputError where no patch says where it is."""
    bounds = bounds_each(found, frame)
    known = bounds[np.isfinite(bounds).all(axis=1)]
    if not len(known):
        raise InputError("no patch says where it is; name a region")
    (xmin, ymin), (xmax, ymax) = known[:, :2].min(axis=0), known[:, 2:].max(axis=0)
    return float(xmin), float(ymin), float(xmax), float(ymax)
