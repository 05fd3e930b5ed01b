# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of two runs: folders of ``cdff slam``, ``vo``, ``dem``, ``run`` or ``replay``."""

from cdff_dev.compare.runs.compare import compare_runs
from cdff_dev.compare.runs.report import table

__all__ = ["compare_runs", "table"]
