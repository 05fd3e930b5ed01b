# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bounds and defaults of the interfaces (``docs/og2-interface.md``, ``docs/dpm.md``)."""

from __future__ import annotations

#: Larger answers are sent by reference with ``deliver=auto``.
INLINE_BYTES = 1_000_000
#: Products on one page of a search.
DEFAULT_PAGE, MAX_PAGE = 100, 1000
#: Default and largest number of jobs in a list; each has its request and its plan.
DEFAULT_JOBS, MAX_JOBS = 50, 200
#: Points of an assembled cloud.
DEFAULT_POINTS, MAX_POINTS = 500_000, 5_000_000
#: Corners of the path of an elevation profile.
MAX_PATH_CORNERS = 1024
#: Coordinates of windows and paths, metres.
MAX_COORDINATE_M = 1e8
#: Times, nanoseconds: before the year 2116.
LATEST_NS = 1 << 62
#: Ages, seconds.
MAX_AGE_S = LATEST_NS // 1_000_000_000
#: Generations of a provenance query.
MAX_GENERATIONS = 64
#: Deadline of a request: the default is below the 10 s after which a Zenoh query ends by itself.
DEFAULT_DEADLINE_MS = 8_000
DEADLINE_BOUNDS_MS = (100, 3_600_000)
