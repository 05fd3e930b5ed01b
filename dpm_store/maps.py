# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation across products: a window assembled from every patch that reaches into it, with a manifest of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from dpm_store.navigation import NavigationMaps
from dpm_store.patches import Found, Patches
from dpm_store.records import ProductRecord
from dpm_store.windows import Made, Window, WindowQuery, finished, framed

if TYPE_CHECKING:
    from cdff_common.raster import CellStatistics, GridGeometry
    from cdff_common.raster.mosaic import Assembled

#: Port under which windows are stored.
DERIVED_PORT = "window"


@dataclass(frozen=True, slots=True, eq=False)
class PooledCells:
    """Cells of a grid, and what they were assembled from."""

    assembled: Assembled
    made: Made

    @property
    def statistics(self) -> CellStatistics:
        """Of the heights."""
        return self.assembled.statistics


class Maps:
    """Derived maps of a store.

    Attributes
    ----------
    navigation : NavigationMaps
        Windows and tiles of navigation maps.
    """

    def __init__(self, patches: Patches) -> None:
        self.patches = patches
        self.navigation = NavigationMaps(patches.of("navigation_map", "NavigationMap"))

    def elevation_window(self, asked: WindowQuery) -> Window:
        """Assemble every patch of the region; raises as ``windows.framed``."""
        from cdff_common.raster import ELEVATION_LAYERS
        from cdff_common.types import ElevationMap

        frame = framed(self.patches, asked)
        cells = self.pooled(asked, frame.found, frame.geometry, further=True)
        made = cells.made
        if not made.used:
            tilted = ", ".join(made.skipped_frames)
            raise frame.nothing("dem", f"; frames {tilted} are tilted too much" if tilted else "")
        layers = cells.assembled.to_layers(made.span_ns[1])
        rules = [asked.choice, asked.disagreement, *(name for name in layers if name not in ELEVATION_LAYERS)]
        return finished(frame, made, ElevationMap, layers, cells.statistics.observed, rules, DERIVED_PORT)

    def pooled(self, asked: WindowQuery, found: Found, geometry: GridGeometry, *, further: bool = False) -> PooledCells:
        """Assemble patches that were found into a grid, ``further`` layers only where wanted."""
        from cdff_common.raster.mosaic import Mosaic, fitting_factor, is_level

        mosaic = Mosaic(geometry, asked.choice, asked.disagreement, further=further)
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
        assembled = mosaic.assembled()
        made = Made(used, assembled.disagreeing, resampled, tuple(sorted(skipped)), purged)
        return PooledCells(assembled, made)
