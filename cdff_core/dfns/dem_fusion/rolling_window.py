# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A square map that moves with the robot."""

from __future__ import annotations

from math import floor
from typing import ClassVar

from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import CellStatistics, GridGeometry, WindowAssembler
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs, DemFusionInterface, DemFusionOutputs


class RollingWindowConfig(DfnConfig):
    """Size of the window."""

    size_m: float = Field(40.0, gt=0.0, le=10_000.0, description="Edge of the square window, metres")
    resolution_m: float | None = Field(None, gt=0.0, description="Edge of a cell, metres; the patches' where absent")


class RollingWindow(DemFusionInterface):
    """Pool each patch into a window of bounded size; what the window leaves behind is forgotten.

    The pooled variance has the term of the disagreement between patches: two that lie 0.3 m apart make a cell of
    sigma 0.15 m, however certain each is.
    """

    Config: ClassVar[type[DfnConfig]] = RollingWindowConfig

    def setup(self) -> None:
        """Start with nothing observed."""
        self._window: WindowAssembler | None = None
        self._span_ns: tuple[int, int] | None = None

    def process(self, inputs: DemFusionInputs) -> DemFusionOutputs:
        """Return the window after the patch; raises InputError if the patch's cells do not fit into the window's."""
        geometry = inputs.patch.geometry
        statistics = CellStatistics.from_layers(
            geometry, {name: inputs.patch.layer(name) for name in inputs.patch.layer_names}, inputs.patch.t1_ns
        )
        if inputs.centre is None:
            b = geometry.bounds
            x, y = 0.5 * (b.xmin + b.xmax), 0.5 * (b.ymin + b.ymax)
        else:
            x, y = (float(v) for v in inputs.centre)
        window = self._moved(self._around(x, y, geometry))
        window.add(statistics)
        t0_ns, t1_ns = inputs.patch.t0_ns, inputs.patch.t1_ns
        if self._span_ns is not None:
            t0_ns, t1_ns = min(t0_ns, self._span_ns[0]), max(t1_ns, self._span_ns[1])
        self._span_ns = (t0_ns, t1_ns)
        fused = window.statistics
        layers = fused.to_layers(t1_ns)
        return DemFusionOutputs(map=ElevationMap.from_layers(fused.geometry, layers, t0_ns=t0_ns, t1_ns=t1_ns))

    def _around(self, x_m: float, y_m: float, patch: GridGeometry) -> GridGeometry:
        resolution_m = self.config.resolution_m or patch.resolution_m
        cells = max(1, round(self.config.size_m / resolution_m))
        left = floor(x_m / resolution_m) - cells // 2
        top = floor(y_m / resolution_m) + 1 + (cells - 1) // 2
        return GridGeometry.from_cells(patch.frame, resolution_m, left=left, top=top, rows=cells, cols=cells)

    def _moved(self, geometry: GridGeometry) -> WindowAssembler:
        """The window shifted to ``geometry``; cells of another frame or size start anew."""
        old = self._window
        if old is not None and old.statistics.geometry == geometry:
            return old
        self._window = WindowAssembler(geometry)
        if old is not None and old.statistics.geometry.shares_cells_with(geometry):
            self._window.statistics = old.statistics.window(geometry)
        else:
            self._span_ns = None
        return self._window
