# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Georeferenced grids, pooled statistics, aggregation, windows, slope and regions: the only raster algebra."""

from cdff_common.raster.geometry import Bounds, GridGeometry
from cdff_common.raster.region import coverage, mask
from cdff_common.raster.resample import aggregate, aggregate_to, delivered_resolution
from cdff_common.raster.slope import hillshade, horn_gradient, slope_rad
from cdff_common.raster.statistics import ELEVATION_LAYERS, NEVER_NS, CellStatistics, pool
from cdff_common.raster.window import WindowAssembler, assemble

__all__ = [
    "ELEVATION_LAYERS",
    "NEVER_NS",
    "Bounds",
    "CellStatistics",
    "GridGeometry",
    "WindowAssembler",
    "aggregate",
    "aggregate_to",
    "assemble",
    "coverage",
    "delivered_resolution",
    "hillshade",
    "horn_gradient",
    "mask",
    "pool",
    "slope_rad",
]
