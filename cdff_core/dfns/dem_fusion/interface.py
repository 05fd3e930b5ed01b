# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN DemFusion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import ElevationMap


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DemFusionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    patch : ElevationMap, optional
        Statistics of measurements that no earlier patch contains; without a patch nothing is added.
    centre : ndarray of float64, shape (2), optional
        X and y of the window's centre, metres; default: the middle of the patch; without a patch, the
        previous centre is used and a RollingWindow does not move.
    rays : ndarray of float64, shape (n,6), optional
        Rays from the sensor to the points of the patch: x y z of both ends, metres; a cell is cleared if
        two rays pass below its height.
    bounds : ndarray of float64, shape (4), optional
        Xmin ymin xmax ymax of the returned map instead of the window, metres; values that are not finite
        select the whole map.
    """

    ARRAYS = ArrayPorts(
        {"centre": "float64[2]", "rays": "float64[n,6]", "bounds": "float64[4]"},
        optional=["centre", "rays", "bounds"],
    )

    patch: ElevationMap | None = None
    centre: NDArray[np.float64] | None = None
    rays: NDArray[np.float64] | None = None
    bounds: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DemFusionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    map : ElevationMap
        Map of the bounds, or of the window around the centre, with the configured cell size or the cell
        size of the patches; if the bounds contain more than max_cells cells, TiledMap returns cells that
        are 2^n times as large.
    cleared : int
        Number of cleared cells.
    forgotten : int
        Number of evicted tiles; 0 for a window.
    """

    map: ElevationMap
    cleared: int
    forgotten: int


class DemFusionInterface(Dfn[ConfigT, DemFusionInputs, DemFusionOutputs]):
    """Fuse elevation patches into a map. The statistics of each cell are those of all its
    measurements, as if these had been rasterised together. Cells through which later rays pass are
    cleared.
    """


#: Short names for the implementations.
Inputs = DemFusionInputs
Outputs = DemFusionOutputs
Interface = DemFusionInterface
