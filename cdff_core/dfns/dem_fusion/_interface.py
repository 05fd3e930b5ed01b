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
    patch : ElevationMap
        Statistics of measurements that no earlier patch held.
    centre : ndarray of float64, shape (2), optional
        X and y the map is centred on, metres; the patch's middle where absent.
    """

    patch: ElevationMap
    centre: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DemFusionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    map : ElevationMap
        The window around the centre, in cells of the configured size or the patches'.
    """

    map: ElevationMap


class DemFusionInterface(Dfn[Any, DemFusionInputs, DemFusionOutputs]):
    """Pools elevation patches into a map that moves with the robot, exactly as if all measurements had been
    rasterised at once.
    """
