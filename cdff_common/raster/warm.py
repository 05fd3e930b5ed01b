# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compile the loops over cells before somebody waits for a map."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform


def warm_rasters() -> None:
    """Pool small maps as windows and tiles do: of six layers and of more, in place, from another frame, and coarser."""
    from cdff_common.raster import ELEVATION_LAYERS, GridGeometry, aggregate
    from cdff_common.raster.further_layers import SUMMED
    from cdff_common.raster.mosaic import Mosaic
    from cdff_common.types import ElevationMap

    geometry = GridGeometry("site", 1.0, 0.0, 2.0, 2, 2)
    # Layers of a message cannot be written to, and are another type to the compiler than those that can.
    one = np.ones(geometry.shape, dtype=np.float32)
    names = (*ELEVATION_LAYERS, *SUMMED)
    value = ElevationMap.from_layers(geometry, dict.fromkeys(names, one), t0_ns=0, t1_ns=0)
    all_layers = {name: value.layer(name) for name in names}
    six = {name: all_layers[name] for name in ELEVATION_LAYERS}
    mosaic = Mosaic(geometry, further=True)
    for layers in (all_layers, six):
        mosaic.add(geometry, layers, 0)
        mosaic.add(GridGeometry("other", 1.0, 0.0, 2.0, 2, 2), layers, 0, UncertainTransform.identity())
    made = mosaic.assembled()
    made.to_layers(0)
    aggregate(made.statistics, 2).to_layers(0)
