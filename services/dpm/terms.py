# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Terms of a search that are written in a small language of their own."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from cdff_common.errors import InputError
from cdff_common.interfaces.product import CovarianceKind
from dpm_store.records import MetricBound, Order

_TERM = re.compile(r"([A-Za-z_][A-Za-z0-9_.\-]{0,63})(>=|<=|>|<|=)(.{1,40})\Z")
_MAX_TERMS = 16


def metric_bounds(text: str) -> tuple[MetricBound, ...]:
    """``inliers>=30,rmse_px<0.5``: numbers of the quality that must be there and within bounds, all of them.

    Raises
    ------
    InputError
        On a term that is no ``name``, comparison, number.
    """
    terms = text.split(",")
    if len(terms) > _MAX_TERMS:
        raise InputError(f"quality: {len(terms)} terms, expected at most {_MAX_TERMS}")
    return tuple(_bound(term) for term in terms)


def _bound(term: str) -> MetricBound:
    match = _TERM.match(term)
    try:
        value = float(match[3]) if match is not None else math.nan
    except ValueError:
        value = math.nan
    if match is None or not math.isfinite(value):
        raise InputError(f"quality={term[:80]!r}: expected as in inliers>=30 or rmse_px<0.5")
    name, comparison = match[1], match[2]
    low = value if comparison in (">=", ">", "=") else -math.inf
    high = value if comparison in ("<=", "<", "=") else math.inf
    return MetricBound(name, low, high, strict=comparison in (">", "<"))


def order_terms(parameters: Mapping[str, str]) -> dict[str, Any]:
    """``order`` and ``point`` of a query."""
    order = parameters.get("order", Order.NEWEST)
    if order not in list(Order):
        raise InputError(f"order={order[:80]!r}: expected one of {', '.join(Order)}")
    return {"order": Order(order), "point": _point(parameters["point"]) if "point" in parameters else None}


def covariance_kind(parameters: Mapping[str, str]) -> str | None:
    """The kind of covariance asked for."""
    kind = parameters.get("covariance_kind")
    if kind is not None and kind not in list(CovarianceKind):
        raise InputError(f"covariance_kind={kind[:80]!r}: expected one of {', '.join(CovarianceKind)}")
    return kind


def _point(text: str) -> tuple[float, float]:
    parts = text.split(",")
    try:
        x, y = (float(part) for part in parts)
    except ValueError as error:
        raise InputError(f"point={text[:80]!r}: expected x,y in metres") from error
    return x, y
