# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation along a line: one sample after the other, each the cell that it lies in."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry.region import Region
from dpm_store.maps import Maps
from dpm_store.patches import Found, bounds_each
from dpm_store.windows import WindowQuery

MAX_CORNERS = 1024
MAX_SAMPLES = 20_000
#: Cells along a side of the windows that a long line is read from.
_CHUNK_CELLS = 256


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """Elevation along a line.

    Attributes
    ----------
    distance_m : NDArray[np.float64], shape (n,)
        From the start, along the line.
    points_m : NDArray[np.float64], shape (n, 2)
    mean_m, sigma_m : NDArray[np.float64], shape (n,)
        Of the cell that the point lies in; NaN where unobserved.
    count : NDArray[np.float64], shape (n,)
        Heights in that cell, 0 where unobserved.
    resolution_m : float
        Size of the cells.
    patches : tuple of str
        Ids of the patches around the line.
    """

    distance_m: NDArray[np.float64]
    points_m: NDArray[np.float64]
    mean_m: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    count: NDArray[np.float64]
    resolution_m: float
    patches: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data; None where unobserved."""

        def plain(values: NDArray[np.float64]) -> list[float | None]:
            return [float(v) if np.isfinite(v) else None for v in values]

        return {
            "distance_m": plain(self.distance_m), "x_m": plain(self.points_m[:, 0]), "y_m": plain(self.points_m[:, 1]),
            "mean_m": plain(self.mean_m), "sigma_m": plain(self.sigma_m), "count": plain(self.count),
            "resolution_m": self.resolution_m, "patches": list(self.patches),
            "coverage": float(np.mean(self.count > 0)),
        }  # fmt: skip


def elevation_profile(maps: Maps, asked: WindowQuery, path_m: NDArray[np.float64], step_m: float | None) -> Profile:
    """Sample the elevation along a line.

    Parameters
    ----------
    asked : WindowQuery
        What is sampled and how it is pooled; its region is not looked at.
    path_m : NDArray[np.float64], shape (k, 2)
        Corners in ``asked.frame``, 2 to ``MAX_CORNERS``.
    step_m : float or None
        Between samples; the size of a cell without. The corners and the end are sampled besides.

    Raises
    ------
    ProductNotFoundError
        If no patch lies around the line.
    InputError
        On a line without length, or more than ``MAX_SAMPLES`` samples.
    """
    from cdff_common.raster import GridGeometry, delivered_resolution

    low, high = path_m.min(axis=0), path_m.max(axis=0)
    inset = 1e-6 + 1e-9 * float(np.abs(path_m).max())  # a line along an axis has no area to search in
    around = Region("bbox", (low[0] - inset, low[1] - inset, high[0] + inset, high[1] + inset))
    found = maps.patches.find(asked.query(around))
    if not found.records:
        raise ProductNotFoundError(f"no dem patch around the line in {asked.frame}")
    coarsest = max(maps.patches.resolution_m(r) for r in found.records)
    cell_m = delivered_resolution([coarsest], asked.resolution_m)
    distance, points = _samples(path_m, cell_m if step_m is None else step_m)
    mean, sigma, count = (np.full(len(points), fill) for fill in (np.nan, np.nan, 0.0))
    boxes = bounds_each(found, asked.frame)
    used: set[str] = set()
    first = 0
    while first < len(points):
        near = np.abs(points[first : first + MAX_SAMPLES] - points[first]).max(axis=1) > _CHUNK_CELLS * cell_m
        last = first + int(np.argmax(near)) if near.any() else len(points)
        part = points[first:last]
        (x0, y0), (x1, y1) = part.min(axis=0), part.max(axis=0)
        geometry = GridGeometry.aligned(asked.frame, cell_m, (x0, y0, x1 + 1e-9, y1 + 1e-9))
        here = _reaching(found, boxes, (x0, y0, x1, y1), cell_m)
        made = maps.pooled(asked, here, _wider(geometry))
        rows, cols, inside = made.statistics.geometry.cells_of(part[:, 0], part[:, 1])
        seen = inside & (made.statistics.count[rows, cols] > 0)
        at = np.arange(first, last)[seen]
        mean[at] = made.statistics.mean[rows[seen], cols[seen]]
        sigma[at] = np.sqrt(made.statistics.variance[rows[seen], cols[seen]])
        count[at] = made.statistics.count[rows[seen], cols[seen]]
        used |= {record.id for record in made.made.used}
        first = last
    return Profile(distance, points, mean, sigma, count, cell_m, tuple(sorted(used)))


def _samples(path_m: NDArray[np.float64], step_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    lengths = np.linalg.norm(np.diff(path_m, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    if not at[-1] > 0.0:
        raise InputError("the line has no length")
    if at[-1] / step_m + len(path_m) > MAX_SAMPLES:
        raise InputError(
            f"a line of {at[-1]:.6g} m in steps of {step_m:g} m: expected at most {MAX_SAMPLES} samples; ask for a "
            "larger step_m"
        )
    distance = np.unique(np.concatenate([np.arange(0.0, at[-1], step_m), at]))
    kept = np.concatenate([[True], lengths > 0.0])
    x = np.interp(distance, at[kept], path_m[kept, 0])
    return distance, np.column_stack([x, np.interp(distance, at[kept], path_m[kept, 1])])


def _reaching(
    found: Found, boxes: NDArray[np.float64], bounds: tuple[float, float, float, float], slack_m: float
) -> Found:
    x0, y0, x1, y1 = bounds
    near = (boxes[:, 0] <= x1 + slack_m) & (boxes[:, 2] >= x0 - slack_m)
    near &= (boxes[:, 1] <= y1 + slack_m) & (boxes[:, 3] >= y0 - slack_m)
    return replace(found, records=tuple(r for r, is_near in zip(found.records, near, strict=True) if is_near))


def _wider(geometry: Any) -> Any:
    """A cell more on each side: a point on an edge belongs to the cell right of or above it."""
    from cdff_common.raster import GridGeometry

    return GridGeometry.from_cells(
        geometry.frame, geometry.resolution_m, left=geometry.left - 1, top=geometry.top + 1,
        rows=geometry.rows + 2, cols=geometry.cols + 2,
    )  # fmt: skip
