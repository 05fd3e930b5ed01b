# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of poses between clouds with ground truth: rates with intervals, errors, consistency."""

from cdff_dev.compare.registration.compare import compare, table
from cdff_dev.compare.registration.read import Pair, read_pairs

__all__ = ["Pair", "compare", "read_pairs", "table"]
