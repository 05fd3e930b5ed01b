# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Georeferenced grids, pooled statistics, aggregation, windows, slope and regions."""

from cdff_common.raster.geometry import Bounds, GridGeometry
from cdff_common.raster.region import coverage, mask
from cdff_common.raster.resample import aggregate, aggregate_to, delivered_resolution
from cdff_common.raster.slope import hillshade, horn_gradient, slope_rad
from cdff_common.raster.statistics import ELEVATION_LAYERS, NEVER_NS, CellStatistics

__all__ = [
    "ELEVATION_LAYERS",
    "NEVER_NS",
    "Bounds",
    "CellStatistics",
    "GridGeometry",
    "aggregate",
    "aggregate_to",
    "coverage",
    "delivered_resolution",
    "hillshade",
    "horn_gradient",
    "mask",
    "slope_rad",
]
