# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation across products: windows assembled from all their patches."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.cell_selection import Choice
from dpm_store.maps.navigation import NavigationMaps
from dpm_store.maps.patches import Patches, PatchSelection, bounds_each, overlapping
from dpm_store.maps.pooled_blocks import PooledBlocks
from dpm_store.maps.tile_queries import patches_in_state
from dpm_store.maps.windows import (
    PatchUsage,
    Window,
    WindowPlan,
    WindowQuery,
    add_patches,
    build_window,
    plan_window,
    raise_if_no_patch_used,
)
from dpm_store.products.records import Query

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry
    from cdff_common.raster.mosaic import AssembledWindow
    from cdff_common.raster.weighting import Agreement, RobotCells

#: Port of derived windows.
DERIVED_PORT = "window"
#: Cells of a strip. Its assembly needs about 200 bytes per cell, in addition to the layers of the window.
STRIP_CELLS = 1 << 20
#: Auxiliary layers in their order, and layers that are ages relative to the newest patch.
AUXILIARY_LAYERS = ("pose_variance", "error_variance", "first_age_s", "intensity", "overhang_m")
AGES = {"age_s", "first_age_s"}


class Maps:
    """Derived maps.

    Attributes
    ----------
    navigation : NavigationMaps
        Windows and tiles of navigation maps.
    """

    def __init__(self, patches: Patches) -> None:
        self.patches = patches
        self._blocks = PooledBlocks(patches)
        self.navigation = NavigationMaps(patches.of("navigation_map", "NavigationMap"))

    def drop_idle_blocks(self) -> bool:
        """Drop pooled cells that no window has used for some seconds; return whether there were any."""
        return self._blocks.drop_idle()

    def plan(self, query: WindowQuery) -> WindowPlan:
        """Return the patches and cells of an elevation window; raises like ``windows.plan_window``."""
        return plan_window(self.patches, query)

    def elevation_window(self, query: WindowQuery, plan: WindowPlan | None = None) -> Window:
        """Assemble every patch of the region, by ``plan`` if given; raises like ``windows.plan_window``.

        A large window is assembled in strips of rows. A strip includes a row of each neighbour, because
        auxiliary layers depend on neighbouring cells.
        """
        from cdff_common.raster import ELEVATION_LAYERS
        from cdff_common.types import ElevationMap

        plan = plan or self.plan(query)
        geometry, selection = plan.geometry, plan.selection
        boxes, latest_ns = bounds_each(selection, geometry.frame), selection.latest_ns
        observed = np.zeros(geometry.shape, dtype=np.bool_)
        robots = _robots_of(selection) if query.choice is Choice.WEIGHTED else ()
        strips = list(_strips(geometry, STRIP_CELLS // max(len(robots), 1)))
        agreements = None
        if len(robots) > 1 and len(strips) > 1:  # all strips have the same weights
            agreements = self.compare_robots(query, selection, geometry)
        layers: dict[str, NDArray[np.float32]] = {}
        usages = []
        for strip, extended in strips:
            part = overlapping(selection, boxes, extended.bounds)
            assembled, usage = self.pool(query, part, extended, auxiliary=True, agreements=agreements)
            target, inner = geometry.slices_of(strip), extended.slices_of(strip)
            for name, values in assembled.to_layers(latest_ns).items():
                if name not in layers:
                    layers[name] = np.full(geometry.shape, np.nan, dtype=np.float32)
                layers[name][target] = values[inner]
            observed[target] = assembled.statistics.observed[inner]
            usages.append(replace(usage, disagreeing=int(np.count_nonzero(assembled.flagged[inner]))))
        usage = PatchUsage.merged(usages)
        raise_if_no_patch_used(usage, query, "dem")
        for name in AGES & layers.keys():  # relative to the newest patch with cells in the window
            layers[name] -= np.float32((latest_ns - usage.span_ns[1]) * 1e-9)
        layers = {name: layers[name] for name in (*ELEVATION_LAYERS, *AUXILIARY_LAYERS) if name in layers}
        rules = [query.choice, query.disagreement, *(name for name in layers if name not in ELEVATION_LAYERS)]
        return build_window(plan, usage, ElevationMap, layers, observed, rules, DERIVED_PORT)

    def pool(
        self,
        query: WindowQuery,
        selection: PatchSelection,
        geometry: GridGeometry,
        *,
        auxiliary: bool = False,
        agreements: Sequence[Agreement] | None = None,
    ) -> tuple[AssembledWindow, PatchUsage]:
        """Assemble a selection of patches in a grid, with auxiliary layers if ``auxiliary``.

        ``agreements`` of robots determine the weights of a weighted window; by default those of this grid.
        """
        from cdff_common.raster.mosaic import Mosaic
        from cdff_common.raster.weighting import compare_robots, fuse_robots

        choice = query.choice
        if choice is Choice.WEIGHTED:
            if len(_robots_of(selection)) > 1:
                parts, usages = self._pool_robots(query, selection, geometry)
                compared = tuple(compare_robots(parts) if agreements is None else agreements)
                assembled = fuse_robots(parts, compared)
                usage = PatchUsage.merged(usages)
                return assembled, replace(usage, disagreeing=assembled.disagreeing, agreements=compared)
            choice = Choice.POOLED  # the maps of one robot share its errors
        if auxiliary and selection.records:
            pooled = self._blocks.pool(replace(query, choice=choice), selection, geometry)
            if pooled is not None:
                return pooled[0], replace(pooled[1], agreements=tuple(agreements or ()))
        mosaic = Mosaic(geometry, choice, query.disagreement, auxiliary=auxiliary)
        usage = add_patches(
            self.patches,
            selection,
            geometry,
            lambda patch, T: mosaic.add(patch.geometry, patch.layers, patch.t1_ns, T) is not None,
        )
        assembled = mosaic.assembled()
        return assembled, replace(
            usage, disagreeing=assembled.disagreeing, agreements=tuple(agreements or ())
        )

    def cells_in_state(self, query: Query, geometry: GridGeometry) -> dict[str, NDArray[np.float32]]:
        """Return the layers of the patches of a search in the cells of a grid; raises InputError if many."""
        selection = patches_in_state(self.patches, query)
        assembled, _ = self.pool(WindowQuery(frame=geometry.frame), selection, geometry)
        return assembled.to_layers(0)

    def compare_robots(
        self, query: WindowQuery, selection: PatchSelection, geometry: GridGeometry
    ) -> tuple[Agreement, ...]:
        """Return the agreement of the robots in a grid, compared in larger cells if it has many."""
        from cdff_common.raster.weighting import compare_robots

        most = STRIP_CELLS // len(_robots_of(selection))
        factor = max(1, math.ceil(math.sqrt(geometry.rows * geometry.cols / most)))
        return compare_robots(self._pool_robots(query, selection, geometry.coarsened(factor))[0])

    def _pool_robots(
        self, query: WindowQuery, selection: PatchSelection, geometry: GridGeometry
    ) -> tuple[list[RobotCells], list[PatchUsage]]:
        """Return the pooled cells of each robot with cells in a grid, and the use of all patches."""
        from cdff_common.raster.weighting import RobotCells

        parts, usages = [], []
        for robot in _robots_of(selection):
            pooled = replace(query, choice=Choice.POOLED, robot=robot)
            of_robot = replace(selection, records=tuple(r for r in selection.records if r.robot == robot))
            assembled, usage = self.pool(pooled, of_robot, geometry, auxiliary=True)
            parts.append(RobotCells(robot, assembled))
            usages.append(usage)
        return parts, usages


def _robots_of(selection: PatchSelection) -> tuple[str, ...]:
    """Return the robots of the patches, in order."""
    return tuple(sorted({record.robot for record in selection.records}))


def _strips(geometry: GridGeometry, cells: int) -> Iterator[tuple[GridGeometry, GridGeometry]]:
    """Yield strips of rows, from the top, and the same with one more row on each side inside the grid."""
    rows = max(cells // geometry.cols, 1)
    for first in range(0, geometry.rows, rows):
        last = min(first + rows, geometry.rows)
        yield (
            geometry.row_range(first, last),
            geometry.row_range(max(first - 1, 0), min(last + 1, geometry.rows)),
        )
