# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Geometry of a grid: row 0 at the top (ymax), edges at multiples of the cell size from the frame's origin.

A cell has an integer address in its frame, ``floor(x / resolution)`` and ``floor(y / resolution)``. Two grids
of one frame and resolution therefore share their cells exactly, for any windows, and pool without resampling.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import checked_frame

#: Largest deviation of an edge from a multiple of the cell size, in cells.
ALIGNMENT_TOLERANCE_CELLS = 1e-4
#: Largest number of cells; larger grids indicate a mistyped region or cell size.
MAX_CELLS = 1 << 30


class Bounds(NamedTuple):
    """Rectangle in a frame, metres."""

    xmin: float
    ymin: float
    xmax: float
    ymax: float


@dataclass(frozen=True, slots=True)
class GridGeometry:
    """Frame, cell size and window of a grid.

    Attributes
    ----------
    frame : str
        Frame of x and y.
    resolution_m : float
        Edge of a cell, metres, above 0.
    xmin_m, ymax_m : float
        Outer corner of cell (0, 0): the left edge of column 0 and the top edge of row 0, metres; both
        multiples of ``resolution_m`` (stored snapped to them).
    rows, cols : int
        Size, at least 1 each. y decreases with the row, x increases with the column.

    Raises
    ------
    InputError
        If a value is out of range or an edge is not a multiple of the cell size.
    """

    frame: str
    resolution_m: float
    xmin_m: float
    ymax_m: float
    rows: int
    cols: int

    def __post_init__(self) -> None:
        checked_frame(self.frame)
        resolution = float(self.resolution_m)
        if not (isfinite(resolution) and resolution > 0.0):
            raise InputError(f"resolution_m={self.resolution_m}: expected metres above 0")
        rows, cols = int(self.rows), int(self.cols)
        if rows < 1 or cols < 1 or rows * cols > MAX_CELLS:
            raise InputError(
                f"grid of {rows} x {cols} cells: expected at least 1 x 1 and at most {MAX_CELLS} cells"
            )
        object.__setattr__(self, "resolution_m", resolution)
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "cols", cols)
        object.__setattr__(self, "xmin_m", _snap_to_grid(float(self.xmin_m), resolution, "xmin_m"))
        object.__setattr__(self, "ymax_m", _snap_to_grid(float(self.ymax_m), resolution, "ymax_m"))

    @classmethod
    def aligned(
        cls, frame: str, resolution_m: float, bounds: tuple[float, float, float, float]
    ) -> GridGeometry:
        """Return the smallest grid that covers ``bounds`` = (xmin, ymin, xmax, ymax), metres.

        Raises
        ------
        InputError
            If the bounds are not finite, reversed, or give too many cells.
        """
        xmin, ymin, xmax, ymax = (float(b) for b in bounds)
        if not all(isfinite(b) for b in (xmin, ymin, xmax, ymax)) or xmin > xmax or ymin > ymax:
            raise InputError(f"bounds {bounds}: expected finite xmin <= xmax and ymin <= ymax")
        if not (isfinite(resolution_m) and resolution_m > 0.0):
            raise InputError(f"resolution_m={resolution_m}: expected metres above 0")
        tolerance = ALIGNMENT_TOLERANCE_CELLS
        left, bottom = floor(xmin / resolution_m + tolerance), floor(ymin / resolution_m + tolerance)
        right = max(ceil(xmax / resolution_m - tolerance), left + 1)
        top = max(ceil(ymax / resolution_m - tolerance), bottom + 1)
        return cls.from_cells(frame, resolution_m, left=left, top=top, rows=top - bottom, cols=right - left)

    @classmethod
    def from_cells(
        cls, frame: str, resolution_m: float, *, left: int, top: int, rows: int, cols: int
    ) -> GridGeometry:
        """Return a grid from integer edge addresses, in cells from the frame's origin."""
        return cls(frame, resolution_m, left * resolution_m, top * resolution_m, rows, cols)

    @classmethod
    def around(
        cls, frame: str, resolution_m: float, points_m: ArrayLike, max_cells: int = MAX_CELLS
    ) -> GridGeometry:
        """Return the smallest grid whose cells hold all finite points ``(n, 3)``, metres.

        Raises
        ------
        InputError
            If no point is finite, or the grid would have more than ``max_cells`` cells.
        """
        from cdff_common.raster._kernels import finite_bounds

        points = np.ascontiguousarray(points_m, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points_m: shape {points.shape}, expected (n, 3)")
        count, xmin, ymin, xmax, ymax = finite_bounds(points)
        if not count:
            raise InputError(f"{len(points)} points: expected at least one finite point")
        if ((xmax - xmin) / resolution_m + 1.0) * ((ymax - ymin) / resolution_m + 1.0) > max_cells:
            raise InputError(
                f"points from ({xmin:.3f}, {ymin:.3f}) to ({xmax:.3f}, {ymax:.3f}) m in cells of "
                f"{resolution_m} m: "
                f"expected at most {max_cells} cells; remove outliers or use larger cells"
            )
        # A point on the upper bound belongs to the cell above it, so the bounds themselves are insufficient.
        left, bottom = floor(xmin / resolution_m), floor(ymin / resolution_m)
        right, top = floor(xmax / resolution_m) + 1, floor(ymax / resolution_m) + 1
        return cls.from_cells(frame, resolution_m, left=left, top=top, rows=top - bottom, cols=right - left)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape ``(rows, cols)`` of the layers."""
        return self.rows, self.cols

    @property
    def left(self) -> int:
        """Address of the left edge, cells from the frame's origin."""
        return round(self.xmin_m / self.resolution_m)

    @property
    def top(self) -> int:
        """Address of the top edge, cells from the frame's origin."""
        return round(self.ymax_m / self.resolution_m)

    @property
    def xmax_m(self) -> float:
        """Right edge, metres."""
        return (self.left + self.cols) * self.resolution_m

    @property
    def ymin_m(self) -> float:
        """Bottom edge, metres."""
        return (self.top - self.rows) * self.resolution_m

    @property
    def bounds(self) -> Bounds:
        """Outer edges, metres."""
        return Bounds(self.xmin_m, self.ymin_m, self.xmax_m, self.ymax_m)

    def x_centres_m(self) -> NDArray[np.float64]:
        """Return x of the column centres ``(cols,)``, metres, ascending."""
        return np.asarray((self.left + np.arange(self.cols) + 0.5) * self.resolution_m, dtype=np.float64)

    def y_centres_m(self) -> NDArray[np.float64]:
        """Return y of the row centres ``(rows,)``, metres, descending."""
        return np.asarray((self.top - np.arange(self.rows) - 0.5) * self.resolution_m, dtype=np.float64)

    def centres_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y ``(rows, cols)`` of all cell centres, metres."""
        x, y = np.meshgrid(self.x_centres_m(), self.y_centres_m())
        return x, y

    def cells_of(
        self, x_m: ArrayLike, y_m: ArrayLike
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Return the rows and columns of points, and whether they are inside the window.

        Parameters
        ----------
        x_m, y_m : array_like, shape (n,)
            In ``frame``, metres. A point on an edge belongs to the cell right of or above it.

        Returns
        -------
        rows, cols : NDArray[np.int64], shape (n,)
            Valid where ``inside``; 0 elsewhere.
        inside : NDArray[np.bool_], shape (n,)
            False also for coordinates that are not finite.
        """
        x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
        col = np.floor(x / self.resolution_m) - self.left
        row = self.top - 1 - np.floor(y / self.resolution_m)
        inside = (col >= 0) & (col < self.cols) & (row >= 0) & (row < self.rows)
        return np.where(inside, row, 0).astype(np.int64), np.where(inside, col, 0).astype(np.int64), inside

    def shares_cells_with(self, other: GridGeometry) -> bool:
        """Return whether both grids have the same frame and cell size."""
        return self.frame == other.frame and bool(
            abs(self.resolution_m - other.resolution_m) <= 1e-9 * self.resolution_m
        )

    def union(self, other: GridGeometry) -> GridGeometry:
        """Return the smallest grid that covers both; raises InputError if they do not share cells."""
        self._check_shares(other)
        left, top = min(self.left, other.left), max(self.top, other.top)
        right = max(self.left + self.cols, other.left + other.cols)
        bottom = min(self.top - self.rows, other.top - other.rows)
        return self._window(left, top, right, bottom)

    def intersection(self, other: GridGeometry) -> GridGeometry | None:
        """Return the common grid, or None if they do not overlap; raises InputError if they do not share
        cells.
        """
        self._check_shares(other)
        left, top = max(self.left, other.left), min(self.top, other.top)
        right = min(self.left + self.cols, other.left + other.cols)
        bottom = max(self.top - self.rows, other.top - other.rows)
        return self._window(left, top, right, bottom) if right > left and top > bottom else None

    def slices_of(self, window: GridGeometry) -> tuple[slice, slice]:
        """Return the row and column slices of ``window`` in this grid; raises InputError if it is not
        inside.
        """
        self._check_shares(window)
        row, col = self.top - window.top, window.left - self.left
        if row < 0 or col < 0 or row + window.rows > self.rows or col + window.cols > self.cols:
            raise InputError(f"window {window.bounds} extends beyond the grid {self.bounds}")
        return slice(row, row + window.rows), slice(col, col + window.cols)

    def row_range(self, first: int, last: int) -> GridGeometry:
        """Return the grid of rows ``first`` to ``last - 1``."""
        return self._window(self.left, self.top - first, self.left + self.cols, self.top - last)

    def coarsened(self, factor: int) -> GridGeometry:
        """Return the smallest aligned grid of cells ``factor`` times as large that covers this one."""
        if factor < 1:
            raise InputError(f"factor={factor}: expected 1 or more; cells are not refined")
        left, right = floor(self.left / factor), ceil((self.left + self.cols) / factor)
        bottom, top = floor((self.top - self.rows) / factor), ceil(self.top / factor)
        return GridGeometry.from_cells(
            self.frame, self.resolution_m * factor, left=left, top=top, rows=top - bottom, cols=right - left
        )

    def _window(self, left: int, top: int, right: int, bottom: int) -> GridGeometry:
        return GridGeometry.from_cells(
            self.frame, self.resolution_m, left=left, top=top, rows=top - bottom, cols=right - left
        )

    def _check_shares(self, other: GridGeometry) -> None:
        if not self.shares_cells_with(other):
            raise InputError(
                f"grids in {self.frame} at {self.resolution_m} m and in {other.frame} at "
                f"{other.resolution_m} m: "
                "expected the same frame and cell size; aggregate to the coarser first"
            )


def _snap_to_grid(value: float, resolution: float, name: str) -> float:
    """Return a coordinate rounded to a multiple of the cell size; raises InputError if it is not close to
    one.
    """
    cells = value / resolution
    if not isfinite(cells) or abs(cells - round(cells)) > ALIGNMENT_TOLERANCE_CELLS:
        raise InputError(
            f"{name}={value}: expected a multiple of the cell size {resolution} m from the frame's origin"
        )
    return round(cells) * resolution
