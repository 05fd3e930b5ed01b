# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation across products: a window assembled from every patch that reaches into it, with a manifest of them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status, product_id
from cdff_common.raster.choice import Choice, Disagreement
from dpm_store.patches import DERIVED_DFPC, Found, Patches, bounds_of
from dpm_store.records import ProductRecord, Query

if TYPE_CHECKING:
    from cdff_common.raster import CellStatistics, GridGeometry

#: Port under which windows are stored.
DERIVED_PORT = "window"
#: Of one window: its statistics take about 60 bytes a cell while it is assembled.
MAX_CELLS = 1 << 22
#: Farthest from its frame's origin that a window may reach, metres.
FARTHEST_M = 1e8


@dataclass(frozen=True, slots=True)
class WindowQuery:
    """What a window is made from, and how.

    Attributes
    ----------
    region : Region or None
        In ``frame``; None for all there is.
    resolution_m : float or None
        Cell size wanted; finer patches are aggregated to it, coarser are delivered as they are.
    frame : str
        Of the window. Patches in other frames are carried into it by fixed edges and resampled.
    robot : str or None
        Only this robot's patches; all robots' without.
    newest_after_ns : int or None
        The newest patch must have ended its capture at or after this.
    t1_ns : int or None
        Only patches that ended their capture by then.
    as_of_ns : int or None
        Only what the store knew at this mission time, in frames as they were known then.
    frames_revision : int or None
        Frames as they were in this state of the tree: the answer of before a re-anchoring again.
    choice : Choice
        What a cell holds where several patches have measured it.
    disagreement : Disagreement
        What becomes of pooled cells whose patches disagree.
    """

    region: Region | None = None
    resolution_m: float | None = None
    frame: str = "site"
    robot: str | None = None
    newest_after_ns: int | None = None
    t1_ns: int | None = None
    as_of_ns: int | None = None
    frames_revision: int | None = None
    choice: Choice = Choice.POOLED
    disagreement: Disagreement = Disagreement.KEEP

    def query(self, region: Region | None) -> Query:
        """The search for patches in a region."""
        return Query(
            robot=self.robot, region=region, frame=self.frame, t1_ns=self.t1_ns, as_of_ns=self.as_of_ns,
            frames_revision=self.frames_revision,
        )  # fmt: skip


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
    disagreeing : int
        Pooled cells in which patches disagree by more than their spread explains.
    resampled : dict
        Patches that were resampled, by frame: they lie in another frame, or their cells do not fit the window's.
    skipped_frames : tuple of str
        Frames of patches in the region that were left out: tilted too much to be resampled.
    unplaced_frames : tuple of str
        Frames that fixed edges do not join with the window's; whether they hold patches was not looked at.
    purged : int
        Patches that the store knew then and whose payload is gone since; the window is DEGRADED by them.
    frames_revision : int
        State of the frame tree that it was made in.
    """

    map: Any
    header: Header
    patches: tuple[str, ...]
    robots: tuple[str, ...]
    newest_ns: int
    oldest_ns: int
    coverage: float
    disagreeing: int = 0
    resampled: dict[str, int] = field(default_factory=dict)
    skipped_frames: tuple[str, ...] = ()
    unplaced_frames: tuple[str, ...] = ()
    purged: int = 0
    frames_revision: int = 0

    @property
    def robot(self) -> str:
        """The robot that measured it, or ``ground`` where several did."""
        return self.robots[0] if len(self.robots) == 1 else "ground"

    def manifest(self) -> dict[str, Any]:
        """Plain data for replies: what is in the window."""
        return {
            "patches": list(self.patches), "robots": list(self.robots), "newest_ns": self.newest_ns,
            "oldest_ns": self.oldest_ns, "coverage": self.coverage, "resolution_m": self.header.resolution_m,
            "disagreeing": self.disagreeing, "resampled": dict(self.resampled),
            "skipped_frames": list(self.skipped_frames), "unplaced_frames": list(self.unplaced_frames),
            "purged": self.purged, "frames_revision": self.frames_revision,
        }  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class PooledCells:
    """Cells of a grid, and what they were assembled from; fields as of ``ElevationWindow``."""

    statistics: CellStatistics
    used: list[ProductRecord]
    disagreeing: int
    resampled: dict[str, int]
    skipped_frames: tuple[str, ...]
    purged: int


class Maps:
    """Derived maps of a store."""

    def __init__(self, patches: Patches) -> None:
        self.patches = patches

    def elevation_window(self, asked: WindowQuery) -> ElevationWindow:
        """Assemble every patch of the region.

        Raises
        ------
        ProductNotFoundError
            If no patch reaches into the region, or none is new enough.
        InputError
            If the window would have more than ``MAX_CELLS`` cells.
        """
        from cdff_common.raster import GridGeometry, delivered_resolution

        where = "" if asked.region is None else f" in {asked.region.text} of {asked.frame}"
        query = asked.query(asked.region)
        region = None if asked.region is None else self.patches.resolved_region(query)
        found = self.patches.find(query)
        records = found.records
        if asked.t1_ns is not None:
            records = tuple(r for r in records if r.header.t1_ns <= asked.t1_ns)
        if not records:
            beside = f"; frames {', '.join(found.unplaced_frames)} cannot be placed" if found.unplaced_frames else ""
            raise ProductNotFoundError(f"no dem patch{where}{beside}")
        newest = max(r.header.t1_ns for r in records)
        if asked.newest_after_ns is not None and newest < asked.newest_after_ns:
            raise ProductNotFoundError(
                f"newest dem patch{where} ended at {newest}, wanted {asked.newest_after_ns} or later"
            )
        found = replace(found, records=records)
        cells = delivered_resolution([max(self.patches.resolution_m(r) for r in records)], asked.resolution_m)
        bounds = region.bounds if region is not None else bounds_of(found, asked.frame)
        _check_size(bounds, cells)
        return self._assembled(asked, region, found, GridGeometry.aligned(asked.frame, cells, bounds), where)

    def _assembled(
        self, asked: WindowQuery, region: Region | None, found: Found, geometry: GridGeometry, where: str
    ) -> ElevationWindow:
        from cdff_common import raster
        from cdff_common.types import ElevationMap

        made = self.pooled(asked, found, geometry)
        used, skipped, statistics = made.used, made.skipped_frames, made.statistics
        if not used:
            beside = f"; frames {', '.join(skipped)} are tilted too much" if skipped else ""
            raise ProductNotFoundError(f"no dem patch{where}{beside}")
        newest, oldest = max(r.header.t1_ns for r in used), min(r.header.t1_ns for r in used)
        layers, observed = statistics.to_layers(newest), statistics.observed
        if region is None:
            coverage = float(np.count_nonzero(observed)) / observed.size
        else:
            coverage = raster.coverage(region, geometry, observed)
            outside = ~raster.mask(region, geometry)
            if outside.any():
                for layer in layers.values():
                    layer[outside] = np.nan
        t0_ns = min(r.header.t0_ns for r in used)
        value = ElevationMap.from_layers(geometry, layers, t0_ns=t0_ns, t1_ns=newest)
        robots = tuple(sorted({r.robot for r in used}))
        placed = [
            [frame, found.transforms[frame].matrix.tolist()]
            for frame in sorted(made.resampled)
            if frame in found.transforms
        ]
        header = _header(value, asked, region, placed, used, robots, coverage, t0_ns, newest, made.purged)
        return ElevationWindow(
            value, header, header.inputs, robots, newest, oldest, coverage, made.disagreeing, made.resampled,
            skipped, found.unplaced_frames, made.purged, found.frames_revision,
        )  # fmt: skip

    def pooled(self, asked: WindowQuery, found: Found, geometry: GridGeometry) -> PooledCells:
        """Assemble patches that were found into a grid."""
        from cdff_common.raster.mosaic import Mosaic, fitting_factor, is_level

        mosaic = Mosaic(geometry, asked.choice, asked.disagreement)
        skipped = {frame for frame, T in found.transforms.items() if not is_level(T)}
        records = [r for r in found.records if r.header.frame not in skipped]
        used: list[ProductRecord] = []
        resampled: dict[str, int] = {}
        purged = 0
        for record, patch in self.patches.read(records):
            frame = record.header.frame
            if patch is None:
                purged += 1
            elif mosaic.add(patch.geometry, patch.layers, patch.t1_ns, found.transforms.get(frame)):
                used.append(record)
                if fitting_factor(patch.geometry, geometry) is None:
                    resampled[frame] = resampled.get(frame, 0) + 1
        statistics, disagreeing = mosaic.statistics()
        return PooledCells(statistics, used, disagreeing, resampled, tuple(sorted(skipped)), purged)


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
    value: Any, asked: WindowQuery, region: Region | None, placed: list[Any], used: list[ProductRecord],
    robots: tuple[str, ...], coverage: float, t0_ns: int, t1_ns: int, purged: int,
) -> Header:  # fmt: skip
    """Header of the window; its id follows from what is in it, so that asking twice gives the same product."""
    inputs = tuple(sorted(r.id for r in used))
    geometry = value.geometry
    rules = [asked.choice, asked.disagreement, placed]
    made_by = [region.text if region else "", geometry.frame, geometry.resolution_m, inputs, rules]
    config_hash = hashlib.sha256(json.dumps(made_by).encode()).hexdigest()[:16]
    degraded = ("degraded_inputs",) if any(r.header.quality.status is Status.DEGRADED for r in used) else ()
    reasons = (*degraded, *(("purged_inputs",) if purged else ()))
    quality = Quality(
        Status.DEGRADED if reasons else Status.OK,
        reasons,
        CovarianceKind.FORMAL,
        {"coverage": coverage, "patches": float(len(used))},
    )
    robot = robots[0] if len(robots) == 1 else "ground"
    extent = value.extent_m()
    box: Any = None if extent is None else tuple(float(v) for v in extent)
    return Header(
        id=product_id(robot, DERIVED_DFPC, DERIVED_PORT, t1_ns, 0, config_hash), seq=0, t0_ns=t0_ns, t1_ns=t1_ns,
        frame=geometry.frame, producer="dpm/window/2", config_hash=config_hash, inputs=inputs, quality=quality,
        box_m=box, resolution_m=geometry.resolution_m,
    )  # fmt: skip
