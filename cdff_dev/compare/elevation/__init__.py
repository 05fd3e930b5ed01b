# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of elevation maps with ground truth."""

from cdff_dev.compare.elevation.compare import compare, table
from cdff_dev.compare.elevation.read import read_dem

__all__ = ["compare", "read_dem", "table"]
