# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation across products: windows assembled from all their patches."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from dpm_store.maps.navigation import NavigationMaps
from dpm_store.maps.patches import Patches, PatchSelection
from dpm_store.maps.windows import (
    PatchUsage,
    Window,
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

    def elevation_window(self, query: WindowQuery) -> Window:
        """Assemble every patch of the region; raises like ``windows.plan_window``."""
        from cdff_common.raster import ELEVATION_LAYERS
        from cdff_common.types import ElevationMap

        plan = plan_window(self.patches, query)
        assembled, usage = self.pool(query, plan.selection, plan.geometry, auxiliary=True)
        check_used(usage, query, "dem")
        layers = assembled.to_layers(usage.span_ns[1])
        rules = [query.choice, query.disagreement, *(name for name in layers if name not in ELEVATION_LAYERS)]
        return build_window(
            plan, usage, ElevationMap, layers, assembled.statistics.observed, rules, DERIVED_PORT
        )

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
