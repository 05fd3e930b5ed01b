# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of map tiles: limit of the disk space."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.statistics import CellStatistics
from dpm_store.maps.tile_files import TileFiles

CELLS = 16


def statistics(x_m: float) -> CellStatistics:
    geometry = GridGeometry("site", 0.5, x_m, x_m + 8.0, CELLS, CELLS)
    layers = [np.full((CELLS, CELLS), value) for value in (1.0, x_m, 0.0, x_m, x_m)]
    return CellStatistics(geometry, *layers, np.zeros((CELLS, CELLS), np.int64))


def test_beyond_the_limit_the_files_that_were_used_least_recently_are_removed_from_the_disk(
    tmp_path: Path,
) -> None:
    size = 6 * 8 * CELLS**2
    files = TileFiles(tmp_path, 3 * size)
    for x in range(3):
        files.write(("site", 10, x, 0), statistics(8.0 * x))
    assert len(list(tmp_path.rglob("*.tile"))) == 3
    files.write(("site", 10, 3, 0), statistics(24.0))
    assert len(list(tmp_path.rglob("*.tile"))) == 3
    files.remove(("site", 10, 3, 0))
    files.remove(("site", 10, 99, 0))  # of no file
    assert len(list(tmp_path.rglob("*.tile"))) == 2
