# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""JSON form of data, for the command line and HTTP."""

from __future__ import annotations

import math
from typing import Any


def jsonable(data: Any) -> Any:
    """Return data in JSON form: ``…_ns`` as decimal strings, bytes as hexadecimal, null for NaN and ±inf.

    Arrays and numbers of numpy become lists and numbers.
    """
    if isinstance(data, dict):
        return {
            str(k): str(v) if isinstance(v, int) and str(k).endswith("_ns") and v is not True else jsonable(v)
            for k, v in data.items()
        }
    if isinstance(data, (list, tuple, set, frozenset)):
        return [jsonable(v) for v in data]
    if isinstance(data, bytes):
        return data.hex()
    if hasattr(data, "tolist"):
        return jsonable(data.tolist())
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data
