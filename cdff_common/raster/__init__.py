# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Georeferenced grids, pooled statistics, aggregation, windows, slope and regions: the only raster algebra."""

from cdff_common.raster.geometry import Bounds, GridGeometry

__all__ = ["Bounds", "GridGeometry"]
