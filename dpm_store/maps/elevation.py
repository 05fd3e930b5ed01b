# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation across products: windows assembled from all their patches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dpm_store.maps.navigation import NavigationMaps
from dpm_store.maps.patches import Patches, PatchSelection, bounds_each, overlapping
from dpm_store.maps.windows import (
    PatchUsage,
    Window,
    WindowPlan,
    WindowQuery,
    add_patches,
    build_window,
    check_used,
    plan_window,
)

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry
    from cdff_common.raster.mosaic import AssembledWindow

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
        self.navigation = NavigationMaps(patches.of("navigation_map", "NavigationMap"))

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
        layers: dict[str, NDArray[np.float32]] = {}
        usages = []
        for strip, extended in _strips(geometry):
            part = overlapping(selection, boxes, extended.bounds)
            assembled, usage = self.pool(query, part, extended, auxiliary=True)
            target, inner = geometry.slices_of(strip), extended.slices_of(strip)
            for name, values in assembled.to_layers(latest_ns).items():
                if name not in layers:
                    layers[name] = np.full(geometry.shape, np.nan, dtype=np.float32)
                layers[name][target] = values[inner]
            observed[target] = assembled.statistics.observed[inner]
            usages.append(replace(usage, disagreeing=int(np.count_nonzero(assembled.flagged[inner]))))
        usage = PatchUsage.merged(usages)
        check_used(usage, query, "dem")
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
    ) -> tuple[AssembledWindow, PatchUsage]:
        """Assemble a selection of patches in a grid, with auxiliary layers if ``auxiliary``."""
        from cdff_common.raster.mosaic import Mosaic

        mosaic = Mosaic(geometry, query.choice, query.disagreement, auxiliary=auxiliary)
        usage = add_patches(
            self.patches,
            selection,
            geometry,
            lambda patch, T: mosaic.add(patch.geometry, patch.layers, patch.t1_ns, T),
        )
        assembled = mosaic.assembled()
        return assembled, replace(usage, disagreeing=assembled.disagreeing)


def _strips(geometry: GridGeometry) -> Iterator[tuple[GridGeometry, GridGeometry]]:
    """Yield strips of rows, from the top, and the same with one more row on each side inside the grid."""
    rows = max(STRIP_CELLS // geometry.cols, 1)
    for first in range(0, geometry.rows, rows):
        last = min(first + rows, geometry.rows)
        yield (
            geometry.row_range(first, last),
            geometry.row_range(max(first - 1, 0), min(last + 1, geometry.rows)),
        )
