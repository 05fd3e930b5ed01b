# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation maps against truth."""

from cdff_dev.elevation.compare import Z_90, compare, table, true_heights
from cdff_dev.elevation.read import read_dem

__all__ = ["Z_90", "compare", "read_dem", "table", "true_heights"]
