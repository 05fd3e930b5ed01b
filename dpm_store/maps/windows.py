# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Windows of maps: their query, the plan of their cells, and their header as derived products."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.contract.limits import MAX_COORDINATE_M
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import CovarianceKind
from cdff_common.raster.cell_selection import Choice, Disagreement, NavigationChoice
from dpm_store.maps.patches import DerivedProduct, Patch, Patches, PatchSelection, bounds_of, derived_header
from dpm_store.products.records import ProductRecord, Query

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry
    from cdff_common.raster.weighting import Agreement

#: Cells of one window.
MAX_CELLS = 1 << 22


@dataclass(frozen=True, slots=True)
class WindowQuery:
    """Contents and assembly of a window.

    Attributes
    ----------
    region : Region or None
        Region in ``frame``; None for all patches.
    resolution_m : float or None
        Cell size; finer patches are aggregated to it, coarser patches determine the size.
    frame : str
        Frame of the window. Patches in other frames are transformed over fixed edges and resampled.
    robot : str or None
        Only patches of this robot; None for all robots.
    newest_after_ns : int or None
        Lower bound of the end of capture of the newest patch.
    t0_ns, t1_ns : int or None
        Lower and upper bound of the end of capture of all patches.
    as_of_ns : int or None
        Mission time of the state of products and frames to use.
    frames_revision : int or None
        State of the frame tree to use; repeats a window from before a re-anchoring.
    choice : Choice
        Value of a cell of elevation with measurements of several patches.
    disagreement : Disagreement
        Treatment of pooled cells whose patches disagree.
    navigation_choice : NavigationChoice
        Value of a cell of a navigation map with classes of several maps.
    """

    region: Region | None = None
    resolution_m: float | None = None
    frame: str = "site"
    robot: str | None = None
    newest_after_ns: int | None = None
    t0_ns: int | None = None
    t1_ns: int | None = None
    as_of_ns: int | None = None
    frames_revision: int | None = None
    choice: Choice = Choice.POOLED
    disagreement: Disagreement = Disagreement.KEEP
    navigation_choice: NavigationChoice = NavigationChoice.NEWEST

    def search(self, region: Region | None) -> Query:
        """Return the query of patches in a region."""
        return Query(
            robot=self.robot,
            region=region,
            frame=self.frame,
            t0_ns=self.t0_ns,
            t1_ns=self.t1_ns,
            as_of_ns=self.as_of_ns,
            frames_revision=self.frames_revision,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Window(DerivedProduct):
    """A window and its sources.

    Attributes
    ----------
    map : ElevationMap or NavigationMap
        Cells outside the region are unobserved.
    newest_ns, oldest_ns : int
        End of capture of the newest and oldest patch.
    coverage : float
        Fraction of the region's cells that are observed.
    disagreeing : int
        Pooled cells in which patches disagree by more than their variance explains; in a navigation map cells
        with different classes.
    resampled : dict
        Number of resampled patches by frame: they are in another frame, or their cells do not align with the
        window's.
    unplaced_frames : tuple of str
        Frames that no fixed edges connect with the window's; their patches were not searched.
    frames_revision : int
        State of the frame tree of the window.
    agreement : tuple of dict
        Comparison of the robots of a weighted window, see ``cdff_common.raster.weighting.Agreement``.
    """

    map: Any
    newest_ns: int
    oldest_ns: int
    coverage: float
    disagreeing: int
    resampled: dict[str, int]
    unplaced_frames: tuple[str, ...]
    frames_revision: int
    agreement: tuple[dict[str, Any], ...] = ()

    @property
    def patches(self) -> tuple[str, ...]:
        """Ids of the patches with cells in the window."""
        return self.header.inputs

    def manifest(self) -> dict[str, Any]:
        """Return plain data of the sources, for replies."""
        sources = {"patches": self.patches, "resolution_m": self.header.resolution_m}
        return DerivedProduct.manifest(self) | sources


@dataclass(frozen=True, slots=True)
class WindowPlan:
    """The patches and the cells of a window, before any patch is read.

    Attributes
    ----------
    region : Region or None
        Region of the query with ``near`` replaced by a circle.
    selection : PatchSelection
    geometry : GridGeometry
    """

    region: Region | None
    selection: PatchSelection
    geometry: GridGeometry


@dataclass(frozen=True, slots=True)
class PatchUsage:
    """Patches with cells in a grid (``records``), resampled and purged ones, and others as in ``Window``.

    ``agreements`` compare the robots of a weighted window.
    """

    records: list[ProductRecord]
    disagreeing: int = 0
    resampled_ids: frozenset[str] = frozenset()
    skipped_frames: tuple[str, ...] = ()
    purged_ids: frozenset[str] = frozenset()
    agreements: tuple[Agreement, ...] = ()

    @classmethod
    def merged(cls, parts: Sequence[PatchUsage]) -> PatchUsage:
        """Return the patches of several grids without common cells."""
        records = {record.id: record for part in parts for record in part.records}
        return cls(
            records=sorted(records.values(), key=lambda r: (r.header.t1_ns, r.id)),
            disagreeing=sum(part.disagreeing for part in parts),
            resampled_ids=frozenset().union(*(part.resampled_ids for part in parts)),
            skipped_frames=tuple(sorted({frame for part in parts for frame in part.skipped_frames})),
            purged_ids=frozenset().union(*(part.purged_ids for part in parts)),
            agreements=parts[0].agreements if parts else (),
        )

    @property
    def resampled(self) -> dict[str, int]:
        """Number of resampled patches by frame."""
        return dict(Counter(r.header.frame for r in self.records if r.id in self.resampled_ids))

    @property
    def span_ns(self) -> tuple[int, int]:
        """Start of the first capture and end of the last capture."""
        return min(r.header.t0_ns for r in self.records), max(r.header.t1_ns for r in self.records)


def plan_window(patches: Patches, query: WindowQuery) -> WindowPlan:
    """Find the patches of a window and determine its cells.

    Raises
    ------
    ProductNotFoundError
        If no patch is in the region, or none is new enough.
    InputError
        If the window would have more than ``MAX_CELLS`` cells.
    """
    from cdff_common.raster import GridGeometry, delivered_resolution

    search = query.search(query.region)
    region = None if query.region is None else patches.resolved_region(search)
    selection = patches.find(search)
    records = selection.records
    if query.t1_ns is not None:
        records = tuple(r for r in records if r.header.t1_ns <= query.t1_ns)
    if not records:
        unplaced = ", ".join(selection.unplaced_frames)
        raise _no_patch(query, patches.product, f"; frames {unplaced} are not connected" if unplaced else "")
    newest = max(r.header.t1_ns for r in records)
    if query.newest_after_ns is not None and newest < query.newest_after_ns:
        raise ProductNotFoundError(
            f"newest {patches.product} patch{_location_text(query)} ended at {newest}, expected "
            f"{query.newest_after_ns} or later"
        )
    selection = replace(selection, records=records)
    cells = delivered_resolution([max(patches.resolution_m(r) for r in records)], query.resolution_m)
    bounds = region.bounds if region is not None else bounds_of(selection, query.frame)
    _check_size(bounds, cells)
    return WindowPlan(region, selection, GridGeometry.aligned(query.frame, cells, bounds))


def add_patches(
    patches: Patches,
    selection: PatchSelection,
    geometry: GridGeometry,
    add: Callable[[Patch, UncertainTransform | None], bool],
) -> PatchUsage:
    """Add the patches of a selection to a mosaic by ``add``, except tilted and purged patches.

    ``add`` takes a patch and ``T_window_frame`` (None for the window's frame), and returns whether it has
    cells in the mosaic.
    """
    from cdff_common.raster.mosaic import fitting_factor, is_level

    skipped = {frame for frame, T in selection.transforms.items() if not is_level(T)}
    records: list[ProductRecord] = []
    resampled: set[str] = set()
    purged: set[str] = set()
    for record, patch in patches.read([r for r in selection.records if r.header.frame not in skipped]):
        frame = record.header.frame
        if patch is None:
            purged.add(record.id)
        elif add(patch, selection.transforms.get(frame)):
            records.append(record)
            if fitting_factor(patch.geometry, geometry) is None:
                resampled.add(record.id)
    return PatchUsage(records, 0, frozenset(resampled), tuple(sorted(skipped)), frozenset(purged))


def raise_if_no_patch_used(usage: PatchUsage, query: WindowQuery, product: str) -> None:
    """Raise ProductNotFoundError if no patch has cells in the window."""
    if not usage.records:
        tilted = ", ".join(usage.skipped_frames)
        raise _no_patch(query, product, f"; frames {tilted} are tilted too much" if tilted else "")


def build_window(
    plan: WindowPlan,
    usage: PatchUsage,
    value_type: type[Any],
    layers: dict[str, NDArray[Any]],
    observed: NDArray[np.bool_],
    rules: Sequence[str],
    port: str,
) -> Window:
    """Return the window of layers; cells with their centre outside the region become unobserved.

    Parameters
    ----------
    value_type : type
        ElevationMap or NavigationMap.
    layers : dict of str to array, shape (rows, cols)
        Float layers with NaN, or whole numbers with 0, for unobserved.
    observed : array of bool, shape (rows, cols)
    rules : sequence of str
        Rules that combine patches in a cell; the id of the product depends on them.
    port : str
        Port of the derived product.
    """
    from cdff_common import raster

    geometry, region, selection = plan.geometry, plan.region, plan.selection
    if region is None:
        coverage = float(np.count_nonzero(observed)) / observed.size
    else:
        coverage = raster.coverage(region, geometry, observed)
        outside = ~raster.mask(region, geometry)
        if outside.any():
            for layer in layers.values():
                layer[outside] = np.nan if np.issubdtype(layer.dtype, np.floating) else 0
    (t0_ns, newest), sources = usage.span_ns, usage.records
    value = value_type.from_layers(geometry, layers, t0_ns=t0_ns, t1_ns=newest)
    transforms = [
        [f, selection.transforms[f].matrix.tolist()]
        for f in sorted(usage.resampled)
        if f in selection.transforms
    ]
    inputs, region_text = sorted(r.id for r in sources), region.text if region else ""
    header = derived_header(
        sources,
        [region_text, geometry.frame, geometry.resolution_m, inputs, [*rules, transforms]],
        port=port,
        frame=geometry.frame,
        producer="dpm/window/2",
        extent_m=value.extent_m(),
        purged=len(usage.purged_ids),
        resolution_m=geometry.resolution_m,
        covariance_kind=CovarianceKind.FORMAL,
        metrics={"coverage": coverage, "patches": float(len(sources))},
    )
    return Window(
        map=value,
        header=header,
        robots=tuple(sorted({r.robot for r in sources})),
        newest_ns=newest,
        oldest_ns=min(r.header.t1_ns for r in sources),
        coverage=coverage,
        disagreeing=usage.disagreeing,
        resampled=usage.resampled,
        skipped_frames=usage.skipped_frames,
        unplaced_frames=selection.unplaced_frames,
        purged=len(usage.purged_ids),
        frames_revision=selection.frames_revision,
        agreement=tuple(a.to_dict() for a in usage.agreements),
    )


def _location_text(query: WindowQuery) -> str:
    return "" if query.region is None else f" in {query.region.text} of {query.frame}"


def _no_patch(query: WindowQuery, product: str, detail: str) -> ProductNotFoundError:
    return ProductNotFoundError(f"no {product} patch{_location_text(query)}{detail}")


def _check_size(bounds: tuple[float, float, float, float], resolution_m: float) -> None:
    """Raise InputError if a window has too many cells or is too far from the origin."""
    x0, y0, x1, y1 = bounds
    columns, rows = (x1 - x0) / resolution_m + 1.0, (y1 - y0) / resolution_m + 1.0
    # This form of the comparison also refuses NaN.
    if not (rows * columns <= MAX_CELLS and max(abs(v) for v in bounds) <= MAX_COORDINATE_M):
        raise InputError(
            f"window of {rows:.4g} x {columns:.4g} cells of {resolution_m:g} m: expected at most {MAX_CELLS} "
            f"cells within {MAX_COORDINATE_M:g} m of the origin; ask for a smaller region or a larger "
            "resolution_m"
        )
