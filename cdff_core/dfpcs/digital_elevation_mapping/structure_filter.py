# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Classification of points as ground or structure before they are rasterised in large cells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.ground_segmentation.interface import GroundSegmentationInputs
from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig

#: Largest cell, as a multiple of ``overhang_gap_m``, in which overhangs are visible without a ground filter: in
#: larger cells, ground with a slope of 30° is about as high as the gap.
_LARGE_CELL = 2.0
#: Smallest cell of the ground filter, as a multiple of the gap, and largest number of filter cells along the edge of
#: one cell of the map.
_FILTER_CELL, _MAX_DIVISION = 1.25, 8
_MAX_FILTER_CELLS = 1 << 25


class StructureFilter:
    """Finds the structure above the ground for cells that are large relative to the overhang gap.

    The ground is filtered in its own cells, whose size does not depend on that of the map unless the map has
    very large cells.
    """

    def __init__(self, config: DigitalElevationMappingConfig, dfn: Callable[..., Dfn[Any, Any, Any]]) -> None:
        self._gap_m = config.overhang_gap_m
        self._filters: dict[float, Dfn[Any, Any, Any]] = {}
        for factor in {1, config.far_factor} - {0}:
            edge_m = config.resolution_m * factor
            if self._gap_m is not None and edge_m > _LARGE_CELL * self._gap_m:
                cell_m = max(_FILTER_CELL * self._gap_m, edge_m / _MAX_DIVISION)
                self._filters[edge_m] = dfn(
                    "ground",
                    cell_m=cell_m,
                    # The lowest point of a cell can be a diagonal of the cell away from a point above it.
                    tolerance_per_slope_m=float(np.sqrt(2.0) * cell_m),
                    phases=1,
                    max_cells=_MAX_FILTER_CELLS,
                )

    def find(self, points_m: FloatArray, edge_m: float) -> BoolArray | None:
        """Return which points are structure, shape (n,), or None if the rasterisation finds overhangs itself.

        Parameters
        ----------
        points_m : ndarray, shape (n, 3)
            Points, z up, metres; rows that are not finite are no structure.
        edge_m : float
            Edge of a cell of the map, metres.
        """
        if edge_m not in self._filters or self._gap_m is None:
            return None
        outputs = self._filters[edge_m].process(GroundSegmentationInputs(points=points_m))
        is_structure = outputs.height_above_ground > self._gap_m
        is_structure[outputs.ground] = False
        return np.asarray(is_structure)
