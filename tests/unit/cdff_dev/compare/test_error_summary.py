# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from cdff_dev.compare.error_summary import error_summary


def test_summary_counts_the_errors() -> None:
    assert error_summary([3.0, 1.0, 2.0]) == {"count": 3, "min": 1.0, "median": 2.0, "p95": 2.9, "max": 3.0}
    assert error_summary([]) == {"count": 0}
