# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Navigation across products: windows and tiles of class and cost, each cell one map's judgement (see the mosaic)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.choice import NavigationChoice
from dpm_store.patches import Found, Patches
from dpm_store.pyramid import FEW, tile_query
from dpm_store.records import ProductRecord
from dpm_store.windows import Made, Window, WindowQuery, finished, framed

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry
    from cdff_common.raster.navigation import NavigationMosaic
    from cdff_common.raster.tiles import Tile

#: Port under which windows are stored.
DERIVED_PORT = "navigation_window"


class NavigationMaps:
    """Windows and tiles of navigation maps.

    Parameters
    ----------
    patches : Patches
        Of navigation maps.
    """

    def __init__(self, patches: Patches) -> None:
        self._patches = patches

    def window(self, asked: WindowQuery) -> Window:
        """Assemble every navigation map of the region by ``asked.judgement``; raises as ``windows.framed``."""
        from cdff_common.types import NavigationMap

        frame = framed(self._patches, asked)
        mosaic, made = self._assembled(frame.found, frame.geometry, asked.judgement)
        if not made.used:
            tilted = ", ".join(made.skipped_frames)
            raise frame.nothing("navigation_map", f"; frames {tilted} are tilted too much" if tilted else "")
        layers = mosaic.layers()
        return finished(frame, made, NavigationMap, layers, layers["class"] > 0, [asked.judgement], DERIVED_PORT)

    def tile(self, frame: str, tile: Tile) -> dict[str, NDArray[Any]]:
        """Layers of a tile, newest judgement first: from the maps where they are few, else from the four tiles below.

        Of four cells that become one the worst counts; what is judged in smaller cells goes over what is judged in
        larger ones, where both are known, once a tile is made from those below.
        """
        from cdff_common.raster.resample import largest_of_blocks
        from cdff_common.raster.tiles import LAST_LEVEL, cell_m

        geometry = tile.geometry(frame)
        found = self._patches.find_few(tile_query(frame, geometry), FEW)
        if found is not None or tile.z == LAST_LEVEL:
            found = found or self._patches.find(tile_query(frame, geometry))
            return self._assembled(found, geometry, NavigationChoice.NEWEST)[0].layers()
        finer_m = cell_m(tile.z + 1) * (1.0 + 1e-6)
        coarse = self._patches.find(tile_query(frame, geometry, above_m=finer_m))
        mosaic, _ = self._assembled(coarse, geometry, NavigationChoice.NEWEST)
        if self._patches.any(tile_query(frame, geometry, most_m=finer_m)):
            for child in tile.children():
                layers, cells = largest_of_blocks(self.tile(frame, child), child.geometry(frame), 2)
                mosaic.add(cells, layers)
        return mosaic.layers()

    def _assembled(
        self, found: Found, geometry: GridGeometry, choice: NavigationChoice
    ) -> tuple[NavigationMosaic, Made]:
        from cdff_common.raster.mosaic import fitting_factor, is_level
        from cdff_common.raster.navigation import NavigationMosaic

        mosaic = NavigationMosaic(geometry, choice)
        skipped = {frame for frame, T in found.transforms.items() if not is_level(T)}
        used: list[ProductRecord] = []
        resampled: dict[str, int] = {}
        purged = 0
        for record, patch in self._patches.read([r for r in found.records if r.header.frame not in skipped]):
            frame = record.header.frame
            if patch is None:
                purged += 1
            elif mosaic.add(patch.geometry, patch.layers, found.transforms.get(frame)):
                used.append(record)
                if fitting_factor(patch.geometry, geometry) is None:
                    resampled[frame] = resampled.get(frame, 0) + 1
        differing = int(np.count_nonzero(mosaic.differing))
        return mosaic, Made(used, differing, resampled, tuple(sorted(skipped)), purged)
