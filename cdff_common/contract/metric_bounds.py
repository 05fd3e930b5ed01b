# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bounds of quality metrics: ``inliers>=30,rmse_px<0.5``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

from cdff_common.errors import InputError

_BOUND = re.compile(r"([A-Za-z_][A-Za-z0-9_.\-]{0,63})(>=|<=|>|<|=)(.{1,40})\Z")
#: Largest number of comparisons of one search.
_MAX_BOUNDS = 16


@dataclass(frozen=True, slots=True)
class MetricBound:
    """Bounds of one metric: ``low <= value <= high``, strict inequalities if ``strict``."""

    name: str
    low: float = -math.inf
    high: float = math.inf
    strict: bool = False

    def __str__(self) -> str:
        if self.low == self.high:
            return f"{self.name}={self.low!r}"
        sign, value = (">", self.low) if math.isfinite(self.low) else ("<", self.high)
        return f"{self.name}{sign}{'' if self.strict else '='}{value!r}"


def parse_metric_bounds(value: Any) -> tuple[MetricBound, ...]:
    """Return the bounds of comma-separated comparisons; raises InputError."""
    if isinstance(value, (list, tuple)):  # parsed bounds, or the single text of an HTTP query
        if all(isinstance(bound, MetricBound) for bound in value):
            return tuple(value)
        value = ",".join(value)
    comparisons = value.split(",")
    if len(comparisons) > _MAX_BOUNDS:
        raise InputError(f"quality: {len(comparisons)} comparisons, expected at most {_MAX_BOUNDS}")
    return tuple(_parse_bound(text) for text in comparisons)


def _parse_bound(text: str) -> MetricBound:
    """Return the bound of one comparison, such as ``inliers>=30``; raises InputError."""
    match = _BOUND.match(text)
    try:
        value = float(match[3]) if match is not None else math.nan
    except ValueError:
        value = math.nan
    if match is None or not math.isfinite(value):
        raise InputError(f"quality={text[:80]!r}: expected a comparison such as inliers>=30 or rmse_px<0.5")
    name, comparison = match[1], match[2]
    low = value if comparison in (">=", ">", "=") else -math.inf
    high = value if comparison in ("<=", "<", "=") else math.inf
    return MetricBound(name, low, high, strict=comparison in (">", "<"))
