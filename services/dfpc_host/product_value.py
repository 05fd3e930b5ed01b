# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Value of products for a mission that cannot keep all of them."""

from __future__ import annotations

#: Estimates and maps, in which many samples are combined: they are dropped last.
_HIGH = frozenset({"pose", "trajectory", "pose_graph", "dem", "navigation_map", "landmarks", "track"})
#: Sensor data and intermediate results of one sample: they are dropped first.
_LOW = frozenset({"disparity", "feature_matches", "image", "image_pair", "imu_span", "sample", "scan"})
#: Value of other products, and of those of unknown type.
DEFAULT_VALUE = 1


def value_of(product: str) -> int:
    """Return the value of a type of product, 0 to 2; smaller ones are dropped first."""
    if product in _HIGH:
        return 2
    return 0 if product in _LOW else DEFAULT_VALUE
