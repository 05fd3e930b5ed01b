# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A map that moves with the robot."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import GridGeometry
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs, DemFusionInterface, DemFusionOutputs
from cdff_core.elevation import visibility
from cdff_core.elevation.fusing import bounds_of, middle_of, window_around
from cdff_core.elevation.map_cells import MapCells


class RollingWindowConfig(DfnConfig):
    """Size of the window."""

    size_m: float = Field(40.0, gt=0.0, le=10_000.0, description="Edge of the square window, metres")
    resolution_m: float | None = Field(None, gt=0.0, description="Edge of a cell, metres; the patches' where absent")
    clear_margin_m: float = Field(0.1, ge=0.0, description="How far below a cell rays must pass to clear it, metres")


class RollingWindow(DemFusionInterface):
    """Pool each patch into a window of bounded size; what the window leaves behind is forgotten.

    The pooled variance has the term of the disagreement between patches: two that lie 0.3 m apart make a cell of
    sigma 0.15 m, however certain each is.
    """

    Config: ClassVar[type[DfnConfig]] = RollingWindowConfig

    def setup(self) -> None:
        """Start with nothing observed."""
        visibility.compile_now(1.0)
        self._cells: MapCells | None = None
        self._span_ns = (0, 0)

    def process(self, inputs: DemFusionInputs) -> DemFusionOutputs:
        """Return the window after the patch.

        Raises
        ------
        InputError
            If the patch's cells do not fit into the window's, or there is neither a patch nor a window.
        """
        patch, cleared = inputs.patch, 0
        if patch is not None:
            new = MapCells.of_map(patch, self.config.resolution_m)
            xy = middle_of(patch.geometry) if inputs.centre is None else np.asarray(inputs.centre, dtype=np.float64)
            resolution_m = new.geometry.resolution_m
            cells = self._move(
                window_around(patch.frame, resolution_m, xy, self.config.size_m), patch.t0_ns, patch.t1_ns
            )
            if inputs.rays is not None:
                cleared = visibility.clear_seen_through(cells, inputs.rays, patch.t0_ns, self.config.clear_margin_m)
            cells.add(new)
        if self._cells is None:
            raise InputError("no patch yet: nothing to return a map of")
        cells = self._cells
        if inputs.bounds is not None and np.all(np.isfinite(inputs.bounds)):
            g = cells.geometry
            cells = cells.window(GridGeometry.aligned(g.frame, g.resolution_m, bounds_of(inputs.bounds)))
        return DemFusionOutputs(map=cells.to_map(*self._span_ns), cleared=np.array(cleared), forgotten=np.array(0))

    def _move(self, geometry: GridGeometry, t0_ns: int, t1_ns: int) -> MapCells:
        """Shift the window to ``geometry`` and return it; cells of another frame or size start anew."""
        old = self._cells
        if old is not None and old.geometry.shares_cells_with(geometry):
            self._span_ns = (min(self._span_ns[0], t0_ns), max(self._span_ns[1], t1_ns))
            if old.geometry != geometry:
                self._cells = old.window(geometry)
            return self._cells or old
        self._cells, self._span_ns = MapCells.empty(geometry), (t0_ns, t1_ns)
        return self._cells
