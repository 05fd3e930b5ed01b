# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses between clouds against truth: reading them, rates with their bounds, errors, consistency."""

from cdff_dev.registration.compare import compare, table
from cdff_dev.registration.read import Pair, read_pairs

__all__ = ["Pair", "compare", "read_pairs", "table"]
