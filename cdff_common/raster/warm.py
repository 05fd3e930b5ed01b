# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compilation of the loops over cells before the first request."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform


def warm_rasters() -> None:
    """Compile the loops by pooling small maps with six and with all layers, resampled and aggregated."""
    from cdff_common.raster import ELEVATION_LAYERS, GridGeometry, aggregate
    from cdff_common.raster.auxiliary_layers import POOLED_LAYERS
    from cdff_common.raster.mosaic import Mosaic
    from cdff_common.raster.surface import local_surface
    from cdff_common.raster.viewshed import viewshed
    from cdff_common.types import ElevationMap

    geometry = GridGeometry("site", 1.0, 0.0, 2.0, 2, 2)
    # The layers of a message are read-only, for which numba compiles another version.
    ones = np.ones(geometry.shape, dtype=np.float32)
    names = (*ELEVATION_LAYERS, *POOLED_LAYERS)
    value = ElevationMap.from_layers(geometry, dict.fromkeys(names, ones), t0_ns=0, t1_ns=0)
    all_layers = {name: value.layer(name) for name in names}
    six = {name: all_layers[name] for name in ELEVATION_LAYERS}
    mosaic = Mosaic(geometry, auxiliary=True)
    for layers in (all_layers, six):
        mosaic.add(geometry, layers, 0)
        mosaic.add(GridGeometry("other", 1.0, 0.0, 2.0, 2, 2), layers, 0, UncertainTransform.identity())
    window = mosaic.assembled()
    window.to_layers(0)
    aggregate(window.statistics, 2).to_layers(0)
    zeros = np.zeros(geometry.shape)
    local_surface(zeros, zeros, geometry.resolution_m)
    viewshed(geometry, zeros, zeros, (0.5, 0.5), observer_height_m=1.0)
