# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Data as JSON, the same on the command line and over HTTP."""

from __future__ import annotations

import math
from typing import Any


def jsonable(data: Any) -> Any:
    """Plain data for JSON: ``…_ns`` as decimal strings (contract §6), bytes as hexadecimal, null for NaN and ±inf."""
    if isinstance(data, dict):
        return {
            str(k): str(v) if isinstance(v, int) and str(k).endswith("_ns") and v is not True else jsonable(v)
            for k, v in data.items()
        }
    if isinstance(data, (list, tuple, set, frozenset)):
        return [jsonable(v) for v in data]
    if isinstance(data, bytes):
        return data.hex()
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data
