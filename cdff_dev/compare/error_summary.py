# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Summary statistics of a list of errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def error_summary(values: ArrayLike, digits: int = 4) -> dict[str, float]:
    """Return count, minimum, median, 95th percentile and maximum of a list of errors."""
    errors = np.asarray(values, dtype=np.float64)
    if not errors.size:
        return {"count": 0}
    summary = {
        "min": errors.min(),
        "median": np.median(errors),
        "p95": np.quantile(errors, 0.95),
        "max": errors.max(),
    }
    return {"count": int(errors.size)} | {key: round(float(value), digits) for key, value in summary.items()}
