# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation map of bounded size that moves with the robot."""

from __future__ import annotations

import numpy as np

from cdff_common.errors import InputError
from cdff_common.raster import GridGeometry
from cdff_core.dfns.dem_fusion._configuration import WindowConfig
from cdff_core.dfns.dem_fusion.interface import Inputs, Interface, Outputs
from cdff_core.elevation import visibility
from cdff_core.elevation.map_cells import MapCells, bounds_of, middle_of, window_around


class RollingWindow(Interface[WindowConfig]):
    """Pool each patch into a window of bounded size; cells outside the window are removed.

    The pooled variance includes the disagreement between patches: two patches whose heights differ by 0.3 m
    give a cell with a standard deviation of 0.15 m, even if their own variances are 0.
    """

    def setup(self) -> None:
        """Start with an empty map."""
        visibility.compile_now(1.0)
        self._cells: MapCells | None = None
        self._span_ns = (0, 0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the window after adding the patch.

        Raises
        ------
        InputError
            If the cells of the patch are not aligned with those of the window, or no call had a patch yet.
        """
        patch, cleared_cells = inputs.patch, 0
        if patch is not None:
            patch_cells = MapCells.of_map(patch, self.config.resolution_m)
            centre_m = middle_of(patch.geometry) if inputs.centre is None else np.asarray(inputs.centre)
            resolution_m = patch_cells.geometry.resolution_m
            geometry = window_around(patch.frame, resolution_m, centre_m, self.config.size_m)
            cells = self._move(geometry, patch.t0_ns, patch.t1_ns)
            if inputs.rays is not None:
                cleared_cells = visibility.clear_seen_through(
                    cells, inputs.rays, patch.t0_ns, self.config.clear_margin_m
                )
            cells.add(patch_cells)
        if self._cells is None:
            raise InputError("no patch yet: there is no map to return")
        cells = self._cells
        if inputs.bounds is not None and np.all(np.isfinite(inputs.bounds)):
            g = cells.geometry
            cells = cells.window(GridGeometry.aligned(g.frame, g.resolution_m, bounds_of(inputs.bounds)))
        return Outputs(map=cells.to_map(*self._span_ns), cleared=cleared_cells, forgotten=0)

    def _move(self, geometry: GridGeometry, t0_ns: int, t1_ns: int) -> MapCells:
        """Return the moved window, or an empty one if the frame or the cell size has changed."""
        previous = self._cells
        if previous is not None and previous.geometry.shares_cells_with(geometry):
            self._span_ns = (min(self._span_ns[0], t0_ns), max(self._span_ns[1], t1_ns))
            if previous.geometry != geometry:
                self._cells = previous.window(geometry)
            return self._cells or previous
        self._cells, self._span_ns = MapCells.empty(geometry), (t0_ns, t1_ns)
        return self._cells
