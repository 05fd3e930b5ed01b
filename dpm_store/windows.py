# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a window is: how one is asked for, what it is made from, and the header by which it is a product of its own."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status, product_id
from cdff_common.raster.choice import Choice, Disagreement, NavigationChoice
from dpm_store.patches import DERIVED_DFPC, Found, Patches, bounds_of
from dpm_store.records import ProductRecord, Query

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry

#: Of one window: its statistics take about 60 bytes a cell while it is assembled, with further layers about 100.
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
        What a cell of elevation holds where several patches have measured it.
    disagreement : Disagreement
        What becomes of pooled cells whose patches disagree.
    judgement : NavigationChoice
        Of a navigation map: whose judgement a cell holds where several maps know it.
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
    judgement: NavigationChoice = NavigationChoice.NEWEST

    def query(self, region: Region | None) -> Query:
        """The search for patches in a region."""
        return Query(
            robot=self.robot, region=region, frame=self.frame, t1_ns=self.t1_ns, as_of_ns=self.as_of_ns,
            frames_revision=self.frames_revision,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A window and what it was made from.

    Attributes
    ----------
    map : ElevationMap or NavigationMap
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
        Pooled cells in which patches disagree by more than their spread explains; of a navigation map cells of which
        patches name different classes.
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


@dataclass(frozen=True, slots=True)
class Frame:
    """What a window is assembled into, and what from, before any patch is read.

    Attributes
    ----------
    asked : WindowQuery
    region : Region or None
        With ``near`` turned into a circle.
    found : Found
    geometry : GridGeometry
        Of the cells.
    """

    asked: WindowQuery
    region: Region | None
    found: Found
    geometry: GridGeometry

    def nothing(self, product: str, beside: str = "") -> ProductNotFoundError:
        """What to raise where there is no patch."""
        return _nothing(self.asked, product, beside)


@dataclass(frozen=True, slots=True)
class Made:
    """What came of the patches; fields as of ``Window``."""

    used: list[ProductRecord]
    disagreeing: int = 0
    resampled: dict[str, int] = field(default_factory=dict)
    skipped_frames: tuple[str, ...] = ()
    purged: int = 0

    @property
    def span_ns(self) -> tuple[int, int]:
        """Begin of the first capture, end of the last."""
        return min(r.header.t0_ns for r in self.used), max(r.header.t1_ns for r in self.used)


def framed(patches: Patches, asked: WindowQuery) -> Frame:
    """Find the patches of a window and lay its cells.

    Raises
    ------
    ProductNotFoundError
        If no patch reaches into the region, or none is new enough.
    InputError
        If the window would have more than ``MAX_CELLS`` cells.
    """
    from cdff_common.raster import GridGeometry, delivered_resolution

    query = asked.query(asked.region)
    region = None if asked.region is None else patches.resolved_region(query)
    found = patches.find(query)
    records = found.records
    if asked.t1_ns is not None:
        records = tuple(r for r in records if r.header.t1_ns <= asked.t1_ns)
    if not records:
        unplaced = ", ".join(found.unplaced_frames)
        raise _nothing(asked, patches.product, f"; frames {unplaced} cannot be placed" if unplaced else "")
    newest = max(r.header.t1_ns for r in records)
    if asked.newest_after_ns is not None and newest < asked.newest_after_ns:
        raise ProductNotFoundError(
            f"newest {patches.product} patch{_where(asked)} ended at {newest}, wanted {asked.newest_after_ns} or later"
        )
    found = replace(found, records=records)
    cells = delivered_resolution([max(patches.resolution_m(r) for r in records)], asked.resolution_m)
    bounds = region.bounds if region is not None else bounds_of(found, asked.frame)
    _check_size(bounds, cells)
    return Frame(asked, region, found, GridGeometry.aligned(asked.frame, cells, bounds))


def finished(
    frame: Frame, made: Made, value_type: type[Any], layers: dict[str, NDArray[Any]], observed: NDArray[np.bool_],
    rules: Sequence[str], port: str,
) -> Window:  # fmt: skip
    """The window of layers; cells whose centre lies outside the region are made unobserved.

    Parameters
    ----------
    value_type : type
        ElevationMap or NavigationMap.
    layers : dict of str to array, shape (rows, cols)
        Float layers with NaN, or whole numbers with 0, for unobserved.
    observed : array of bool, shape (rows, cols)
    rules : sequence of str
        By which cells were combined: they are part of what its id follows from.
    port : str
        Under which it is stored.
    """
    from cdff_common import raster

    geometry, region, found = frame.geometry, frame.region, frame.found
    if region is None:
        coverage = float(np.count_nonzero(observed)) / observed.size
    else:
        coverage = raster.coverage(region, geometry, observed)
        outside = ~raster.mask(region, geometry)
        if outside.any():
            for layer in layers.values():
                layer[outside] = np.nan if np.issubdtype(layer.dtype, np.floating) else 0
    (t0_ns, newest), used = made.span_ns, made.used
    value = value_type.from_layers(geometry, layers, t0_ns=t0_ns, t1_ns=newest)
    robots = tuple(sorted({r.robot for r in used}))
    placed = [[f, found.transforms[f].matrix.tolist()] for f in sorted(made.resampled) if f in found.transforms]
    header = _header(value, region, [*rules, placed], made, robots, coverage, port)
    return Window(
        value, header, header.inputs, robots, newest, min(r.header.t1_ns for r in used), coverage, made.disagreeing,
        made.resampled, made.skipped_frames, found.unplaced_frames, made.purged, found.frames_revision,
    )  # fmt: skip


def _where(asked: WindowQuery) -> str:
    return "" if asked.region is None else f" in {asked.region.text} of {asked.frame}"


def _nothing(asked: WindowQuery, product: str, beside: str) -> ProductNotFoundError:
    return ProductNotFoundError(f"no {product} patch{_where(asked)}{beside}")


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
    value: Any, region: Region | None, rules: list[Any], made: Made, robots: tuple[str, ...], coverage: float, port: str
) -> Header:
    """Header of the window; its id follows from what is in it, so that asking twice gives the same product."""
    inputs, used = tuple(sorted(r.id for r in made.used)), made.used
    geometry, (t0_ns, t1_ns) = value.geometry, made.span_ns
    made_by = [region.text if region else "", geometry.frame, geometry.resolution_m, inputs, rules]
    config_hash = hashlib.sha256(json.dumps(made_by).encode()).hexdigest()[:16]
    degraded = ("degraded_inputs",) if any(r.header.quality.status is Status.DEGRADED for r in used) else ()
    reasons = (*degraded, *(("purged_inputs",) if made.purged else ()))
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
        id=product_id(robot, DERIVED_DFPC, port, t1_ns, 0, config_hash), seq=0, t0_ns=t0_ns, t1_ns=t1_ns,
        frame=geometry.frame, producer="dpm/window/2", config_hash=config_hash, inputs=inputs, quality=quality,
        box_m=box, resolution_m=geometry.resolution_m,
    )  # fmt: skip
