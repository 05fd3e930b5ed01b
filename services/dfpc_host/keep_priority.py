# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Priority of product types for a spool that cannot keep all products."""

from __future__ import annotations

#: Estimates and maps, in which many samples are combined: they are dropped last.
_HIGH = frozenset({"pose", "trajectory", "pose_graph", "dem", "navigation_map", "landmarks", "track"})
#: Sensor data and intermediate results of one sample: they are dropped first.
_LOW = frozenset({"disparity", "feature_matches", "image", "image_pair", "imu_span", "sample", "scan"})
#: Priority of other products, and of products of unknown type.
DEFAULT_PRIORITY = 1


def keep_priority(product: str) -> int:
    """Return the priority of a type of product, 0 to 2; products of a smaller one are dropped first."""
    if product in _HIGH:
        return 2
    return 0 if product in _LOW else DEFAULT_PRIORITY
