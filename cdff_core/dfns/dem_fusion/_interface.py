# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN DemFusion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import ElevationMap


@dataclass(frozen=True, slots=True, eq=False)
class DemFusionInputs:
    """Inputs of one call.

    Attributes
    ----------
    patch : ElevationMap, optional
        Statistics of measurements that no earlier patch held; nothing is added where absent.
    centre : ndarray of float64, shape (2), optional
        X and y the window is centred on, metres; where it was, or the patch's middle, where absent.
    rays : ndarray of float64, shape (n,6), optional
        From the sensor to the points of the patch, x y z each, metres; clears cells that two of them passed below.
    bounds : ndarray of float64, shape (4), optional
        Xmin ymin xmax ymax of the map to return in place of the window, metres; not finite for all there is.
    """

    patch: ElevationMap | None = None
    centre: NDArray[np.float64] | None = None
    rays: NDArray[np.float64] | None = None
    bounds: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DemFusionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    map : ElevationMap
        The window around the centre, in cells of the configured size or the patches'; for bounds of more than
        max_cells cells in ones 2^n times as large.
    cleared : ndarray of int64, shape ()
        Cells that were forgotten.
    forgotten : ndarray of int64, shape ()
        Tiles that were lost to make room for the patch's; 0 for a window, which forgets what it leaves behind.
    """

    map: ElevationMap
    cleared: NDArray[np.int64]
    forgotten: NDArray[np.int64]


class DemFusionInterface(Dfn[Any, DemFusionInputs, DemFusionOutputs]):
    """Pools elevation patches into a map, exactly as if all measurements had been rasterised at once, and forgets
    what later rays passed through.
    """
