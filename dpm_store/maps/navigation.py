# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Navigation windows and tiles from many products. Each cell has the class and cost of one map."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.cell_selection import NavigationChoice
from dpm_store.maps.patches import Patches, PatchSelection
from dpm_store.maps.tile_queries import FEW, patches_in_state, tile_parts, tile_query
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
    from cdff_common.raster.navigation import NavigationMosaic
    from cdff_common.raster.tiles import Tile

#: Port of derived windows.
DERIVED_PORT = "navigation_window"


class NavigationMaps:
    """Windows and tiles of navigation maps.

    Parameters
    ----------
    patches : Patches
        Patches of navigation maps.
    """

    def __init__(self, patches: Patches) -> None:
        self._patches = patches

    def plan(self, query: WindowQuery) -> WindowPlan:
        """Return the maps and cells of a window; raises like ``windows.plan_window``."""
        return plan_window(self._patches, query)

    def window(self, query: WindowQuery, plan: WindowPlan | None = None) -> Window:
        """Assemble every navigation map of the region, by ``plan`` if given; raises like ``plan``."""
        from cdff_common.types import NavigationMap

        plan = plan or self.plan(query)
        mosaic, usage = self._assemble(plan.selection, plan.geometry, query.navigation_choice)
        raise_if_no_patch_used(usage, query, "navigation_map")
        layers = mosaic.layers()
        return build_window(
            plan, usage, NavigationMap, layers, layers["class"] > 0, [query.navigation_choice], DERIVED_PORT
        )

    def tile(self, frame: str, tile: Tile) -> dict[str, NDArray[Any]]:
        """Return the layers of a tile with the newest class per cell.
        They are assembled from the maps if these are few, else from the four tiles of the next level, where
        smaller cells have precedence over larger ones and four cells become one with their worst class.
        """
        from cdff_common.raster.resample import largest_of_blocks

        geometry = tile.geometry(frame)
        few = self._patches.find_few(tile_query(frame, geometry), FEW)
        selection, children = (few, ()) if few is not None else tile_parts(self._patches, frame, tile)
        mosaic, _ = self._assemble(selection, geometry, NavigationChoice.NEWEST)
        for child in children:
            layers, cells = largest_of_blocks(self.tile(frame, child), child.geometry(frame), 2)
            mosaic.add(cells, layers)
        return mosaic.layers()

    def rectangle(self, frame: str, z: int, geometry: GridGeometry) -> dict[str, NDArray[Any]]:
        """Return the layers of cells of a level, from the tiles that cover them."""
        from cdff_common.raster.tiles import Tile, tiles_over

        inset, b = geometry.resolution_m / 2.0, geometry.bounds
        columns, rows = tiles_over(z, (b.xmin + inset, b.ymin + inset, b.xmax - inset, b.ymax - inset))
        layers: dict[str, NDArray[Any]] = {"class": np.zeros(geometry.shape, dtype=np.uint8)}
        for tile in (Tile(z, x, y) for y in rows for x in columns):
            cells = tile.geometry(frame)
            common = geometry.intersection(cells)
            if common is None:
                continue
            for name, values in self.tile(frame, tile).items():
                if name not in layers:
                    layers[name] = np.full(geometry.shape, np.nan, dtype=values.dtype)
                layers[name][geometry.slices_of(common)] = values[cells.slices_of(common)]
        return layers

    def cells_in_state(self, query: Query, geometry: GridGeometry) -> dict[str, NDArray[Any]]:
        """Return the layers of the maps of a search in the cells of a grid; raises InputError on too many."""
        selection = patches_in_state(self._patches, query)
        return self._assemble(selection, geometry, NavigationChoice.NEWEST)[0].layers()

    def _assemble(
        self, selection: PatchSelection, geometry: GridGeometry, choice: NavigationChoice
    ) -> tuple[NavigationMosaic, PatchUsage]:
        """Return the mosaic of the selected patches in a grid, and which of them were used."""
        from cdff_common.raster.navigation import NavigationMosaic

        mosaic = NavigationMosaic(geometry, choice)
        usage = add_patches(
            self._patches, selection, geometry, lambda patch, T: mosaic.add(patch.geometry, patch.layers, T)
        )
        return mosaic, replace(usage, disagreeing=int(np.count_nonzero(mosaic.differing)))
