# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One window out of many patches, each measurement counted once."""

from __future__ import annotations

from collections.abc import Sequence

from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.resample import aggregate, delivered_resolution, integer_factor
from cdff_common.raster.statistics import CellStatistics


class WindowAssembler:
    """Pools patches one by one into a window, so that only one patch need be in memory at a time.

    Parameters
    ----------
    geometry : GridGeometry
        The window; its cell size is a multiple of each patch's (``resample.delivered_resolution`` gives it).
    """

    def __init__(self, geometry: GridGeometry) -> None:
        self.statistics = CellStatistics.empty(geometry)
        self.patches = 0

    def add(self, patch: CellStatistics) -> bool:
        """Pool one patch; tell whether it reached into the window.

        Raises
        ------
        InputError
            If the patch is in another frame, or its cells do not fit into the window's.
        """
        window, fine = self.statistics.geometry, patch.geometry
        factor = integer_factor(fine.resolution_m, window.resolution_m)
        common = fine.coarsened(factor).intersection(window)
        if common is None:
            return False
        # Whole cells of the window only, so that none is pooled from a part of its measurements.
        reach = GridGeometry.from_cells(
            fine.frame,
            fine.resolution_m,
            left=common.left * factor,
            top=common.top * factor,
            rows=common.rows * factor,
            cols=common.cols * factor,
        )
        self.statistics.add(aggregate(patch if fine == reach else patch.window(reach), factor))
        self.patches += 1
        return True


def assemble(
    patches: Sequence[CellStatistics],
    frame: str,
    bounds: tuple[float, float, float, float],
    resolution_m: float | None = None,
) -> CellStatistics:
    """Pool patches into the window that covers ``bounds``.

    Parameters
    ----------
    patches : sequence of CellStatistics
        All in ``frame``; their measurements distinct, or they count twice.
    bounds : tuple of 4 floats
        xmin, ymin, xmax, ymax in metres.
    resolution_m : float, optional
        Wanted cell size; see ``resample.delivered_resolution`` for what is delivered.

    Raises
    ------
    InputError
        If there is no patch, a frame differs, or cell sizes do not fit.
    """
    delivered = delivered_resolution([p.geometry.resolution_m for p in patches], resolution_m)
    assembler = WindowAssembler(GridGeometry.aligned(frame, delivered, bounds))
    for patch in patches:
        assembler.add(patch)
    return assembler.statistics
