# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation across products: a window pooled from every patch that reaches into it, with a manifest of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status, product_id
from dpm_store.products import ProductTable
from dpm_store.records import MAX_LIMIT, ProductRecord, Query
from dpm_store.search import Search

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry

#: dfpc and port under which derived windows are stored; they are never pooled again.
DERIVED_DFPC, DERIVED_PORT = "dpm", "window"
#: Of one window: its statistics take about 50 bytes a cell while it is assembled.
MAX_CELLS = 1 << 22
MAX_PATCHES = 20_000
#: Farthest from its frame's origin that a window may reach, metres.
FARTHEST_M = 1e8


@dataclass(frozen=True, slots=True, eq=False)
class ElevationWindow:
    """A window and what it was made from.

    Attributes
    ----------
    map : ElevationMap
        Cells outside the region are unobserved.
    header : Header
        Of the derived product; ``inputs`` are the patches, ``quality.metrics`` holds ``coverage``.
    patches : tuple of str
        Ids of the patches that reached into the window.
    robots : tuple of str
        Who measured them.
    newest_ns, oldest_ns : int
        End of capture of the newest and of the oldest patch.
    coverage : float
        Part of the region's cells that are observed, 0 to 1.
    skipped_frames : tuple of str
        Frames of patches in the region that were left out: pooling does not resample.
    """

    map: Any
    header: Header
    patches: tuple[str, ...]
    robots: tuple[str, ...]
    newest_ns: int
    oldest_ns: int
    coverage: float
    skipped_frames: tuple[str, ...] = ()

    @property
    def robot(self) -> str:
        """The robot that measured it, or ``ground`` where several did."""
        return self.robots[0] if len(self.robots) == 1 else "ground"

    def manifest(self) -> dict[str, Any]:
        """Plain data for replies: what is in the window."""
        return {
            "patches": list(self.patches), "robots": list(self.robots), "newest_ns": self.newest_ns,
            "oldest_ns": self.oldest_ns, "coverage": self.coverage, "resolution_m": self.header.resolution_m,
            "skipped_frames": list(self.skipped_frames),
        }  # fmt: skip


class Maps:
    """Derived maps of a store."""

    def __init__(self, search: Search, products: ProductTable) -> None:
        self._search = search
        self._products = products

    def elevation_window(
        self, region: Region | None, *, resolution_m: float | None = None, frame: str = "site",
        region_frame: str | None = None, robot: str | None = None, newest_after_ns: int | None = None,
        t1_ns: int | None = None,
    ) -> ElevationWindow:  # fmt: skip
        """Pool every patch of the region.

        Parameters
        ----------
        region : Region or None
            In ``frame``; None for all there is.
        resolution_m : float, optional
            Cell size wanted; finer patches are aggregated to it, coarser are delivered as they are.
        frame : str
            Of the window. Patches in other frames are left out and named.
        region_frame : str, optional
            Only ``frame`` itself, unless the region is ``near`` a frame.
        robot : str, optional
            Only this robot's patches.
        newest_after_ns : int, optional
            The newest patch must have ended its capture at or after this.
        t1_ns : int, optional
            Only patches that ended their capture by then.

        Raises
        ------
        ProductNotFoundError
            If no patch reaches into the region, or none is new enough.
        InputError
            If the window would have more than ``MAX_CELLS`` cells, or patches whose cells do not fit each other.
        """
        from cdff_common import raster
        from cdff_common.codecs import decode
        from cdff_common.raster import CellStatistics, GridGeometry, WindowAssembler, delivered_resolution
        from cdff_common.types import ElevationMap

        if region_frame not in (None, frame) and region is not None and region.near_frame is None:
            raise InputError(f"region in {region_frame}, window in {frame}: expected one frame for both")
        where = "" if region is None else f" in {region.text} of {frame}"
        query = Query(types=("dem",), robot=robot, region=region, frame=frame, t1_ns=t1_ns, limit=MAX_LIMIT)
        region = region if region is None else self._search.resolved_region(query)
        found = [r for r in self._all(replace(query, region=region)) if r.dfpc != DERIVED_DFPC and r.size]
        records = [r for r in found if r.header.frame == frame]
        skipped = tuple(sorted({r.header.frame for r in found} - {frame}))
        if t1_ns is not None:
            records = [r for r in records if r.header.t1_ns <= t1_ns]
        if not records:
            raise ProductNotFoundError(f"no dem patch{where}" + (f"; only in frames {skipped}" if skipped else ""))
        newest = max(r.header.t1_ns for r in records)
        if newest_after_ns is not None and newest < newest_after_ns:
            raise ProductNotFoundError(f"newest dem patch{where} ended at {newest}, wanted {newest_after_ns} or later")
        cells = delivered_resolution({self._resolution(r) for r in records}, resolution_m)
        bounds = _bounds(region, records)
        _check_size(bounds, cells)
        geometry = GridGeometry.aligned(frame, cells, bounds)
        assembler, used = WindowAssembler(geometry), []
        for record in sorted(records, key=lambda r: (r.header.t1_ns, r.id)):
            patch = decode("ElevationMap", self._products.payload(record.id), record.codec)
            layers = {name: patch.layer(name) for name in patch.layer_names}
            if assembler.add(CellStatistics.from_layers(patch.geometry, layers, record.header.t1_ns)):
                used.append(record)
        if not used:
            raise ProductNotFoundError(f"no dem patch{where}")
        newest, oldest = max(r.header.t1_ns for r in used), min(r.header.t1_ns for r in used)
        layers = assembler.statistics.to_layers(newest)
        observed, coverage = assembler.statistics.observed, 1.0
        if region is not None:
            coverage = raster.coverage(region, geometry, observed)
            inside = raster.mask(region, geometry)
            layers = {name: np.where(inside, layer, np.float32(np.nan)) for name, layer in layers.items()}
        else:
            coverage = float(np.count_nonzero(observed)) / observed.size
        t0_ns = min(r.header.t0_ns for r in used)
        value = ElevationMap.from_layers(geometry, layers, t0_ns=t0_ns, t1_ns=newest)
        robots = tuple(sorted({r.robot for r in used}))
        header = _header(value, geometry, region, used, robots, coverage, t0_ns, newest)
        return ElevationWindow(
            value, header, header.inputs, robots, newest, oldest, coverage, skipped
        )  # fmt: skip

    def _all(self, query: Query) -> Iterator[ProductRecord]:
        count, page = 0, self._search.run(query)
        while True:
            yield from page.items
            count += len(page.items)
            if page.cursor is None:
                return
            if count >= MAX_PATCHES:
                raise InputError(f"more than {MAX_PATCHES} patches in that region; ask for a smaller one")
            page = self._search.run(replace(query, cursor=page.cursor))

    def _resolution(self, record: ProductRecord) -> float:
        if record.header.resolution_m is not None:
            return record.header.resolution_m
        from cdff_common.codecs import decode

        patch = decode("ElevationMap", self._products.payload(record.id), record.codec)
        return float(patch.geometry.resolution_m)


def _bounds(region: Region | None, records: list[ProductRecord]) -> tuple[float, float, float, float]:
    if region is not None:
        return region.bounds
    boxes = np.array([r.header.box_m for r in records if r.header.box_m is not None])
    if not len(boxes):
        raise InputError("no patch says where it is; name a region")
    (x0, y0), (x1, y1) = boxes[:, :2].min(axis=0), boxes[:, 3:5].max(axis=0)
    return float(x0), float(y0), float(x1), float(y1)


def _check_size(bounds: tuple[float, float, float, float], resolution_m: float) -> None:
    x0, y0, x1, y1 = bounds
    columns, rows = (x1 - x0) / resolution_m + 1.0, (y1 - y0) / resolution_m + 1.0
    # The comparison is written so that what is not a number is refused too.
    if not (rows * columns <= MAX_CELLS and max(abs(v) for v in bounds) <= FARTHEST_M):
        raise InputError(
            f"window of {rows:.4g} x {columns:.4g} cells of {resolution_m:g} m: expected at most {MAX_CELLS} "
            f"cells within {FARTHEST_M:g} m of the origin; ask for a smaller region or a larger resolution_m"
        )


def _header(
    value: Any, geometry: GridGeometry, region: Region | None, used: list[ProductRecord], robots: tuple[str, ...],
    coverage: float, t0_ns: int, t1_ns: int,
) -> Header:  # fmt: skip
    """Header of the window; its id follows from what is in it, so that asking twice gives the same product."""
    inputs = tuple(sorted(r.id for r in used))
    asked = [region.text if region else "", geometry.frame, geometry.resolution_m, inputs]
    config_hash = hashlib.sha256(json.dumps(asked).encode()).hexdigest()[:16]
    degraded = any(r.header.quality.status is Status.DEGRADED for r in used)
    quality = Quality(
        Status.DEGRADED if degraded else Status.OK,
        ("degraded_inputs",) if degraded else (),
        CovarianceKind.FORMAL,
        {"coverage": coverage, "patches": float(len(used))},
    )
    robot = robots[0] if len(robots) == 1 else "ground"
    extent = value.extent_m()
    box: Any = None if extent is None else tuple(float(v) for v in extent)
    return Header(
        id=product_id(robot, DERIVED_DFPC, DERIVED_PORT, t1_ns, 0, config_hash), seq=0, t0_ns=t0_ns, t1_ns=t1_ns,
        frame=geometry.frame, producer="dpm/window/1", config_hash=config_hash, inputs=inputs, quality=quality,
        box_m=box, resolution_m=geometry.resolution_m,
    )  # fmt: skip
