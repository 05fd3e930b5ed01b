# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_core.dfpcs.lidar_localisation.tiled_map import TiledMap


def test_the_minimum_number_of_points_is_that_of_each_query_also_for_a_cached_local_map() -> None:
    scan_map = TiledMap(0.1, 10.0, normals=np.zeros_like, coarse=np.copy)
    x, y = np.meshgrid(np.arange(10.0), np.arange(10.0))
    scan_map.add(np.column_stack([x.ravel(), y.ravel(), np.zeros(100)]), "site")
    centre = np.zeros(3)
    assert scan_map.local(centre, min_points=500) is None
    local = scan_map.local(centre, min_points=50)
    assert local is not None
    assert scan_map.local(centre, min_points=500) is None
    assert scan_map.local(centre, min_points=50) is local
