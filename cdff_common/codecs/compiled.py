# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Availability of numba, which the extra ``client`` does not install."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec


@cache
def has_numba() -> bool:
    """Return whether the compiled loops can be loaded; without them numbers are coded one by one."""
    return find_spec("numba") is not None
