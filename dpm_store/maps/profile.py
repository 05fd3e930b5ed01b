# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation along a line, sampled from the cells that it crosses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry.region import Region
from dpm_store.maps.elevation import Maps
from dpm_store.maps.patches import bounds_each, overlapping
from dpm_store.maps.windows import WindowQuery

MAX_SAMPLES = 20_000
#: Side of the windows of a long line, cells.
_CHUNK_CELLS = 256


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """Elevation along a line.

    Attributes
    ----------
    distance_m : NDArray[np.float64], shape (n,)
        Distance from the start along the line.
    points_m : NDArray[np.float64], shape (n, 2)
    mean_m, sigma_m : NDArray[np.float64], shape (n,)
        Mean and standard deviation of the cell of the point; NaN where unobserved.
    count : NDArray[np.float64], shape (n,)
        Number of heights in that cell, 0 where unobserved.
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
        """Return plain data; None where unobserved."""

        def to_list(values: NDArray[np.float64]) -> list[float | None]:
            return [float(v) if np.isfinite(v) else None for v in values]

        return {
            "distance_m": to_list(self.distance_m),
            "x_m": to_list(self.points_m[:, 0]),
            "y_m": to_list(self.points_m[:, 1]),
            "mean_m": to_list(self.mean_m),
            "sigma_m": to_list(self.sigma_m),
            "count": to_list(self.count),
            "resolution_m": self.resolution_m,
            "patches": list(self.patches),
            "coverage": float(np.mean(self.count > 0)),
        }


def elevation_profile(
    maps: Maps, query: WindowQuery, path_m: NDArray[np.float64], step_m: float | None
) -> Profile:
    """Sample the elevation along a line.

    Parameters
    ----------
    query : WindowQuery
        Patches and pooling; its region is ignored.
    path_m : NDArray[np.float64], shape (k, 2)
        Corners in ``query.frame``, 2 to ``MAX_PATH_CORNERS``.
    step_m : float or None
        Distance between samples; None for the cell size. The corners and the end are also sampled.

    Raises
    ------
    ProductNotFoundError
        If no patch is near the line.
    InputError
        If the line has no length, or there are more than ``MAX_SAMPLES`` samples.
    """
    from cdff_common.raster import GridGeometry, delivered_resolution

    low, high = path_m.min(axis=0), path_m.max(axis=0)
    margin = 1e-6 + 1e-9 * float(np.abs(path_m).max())  # a line along an axis has no area to search in
    search_region = Region("bbox", (low[0] - margin, low[1] - margin, high[0] + margin, high[1] + margin))
    selection = maps.patches.find(query.search(search_region))
    if not selection.records:
        raise ProductNotFoundError(f"no dem patch around the line in {query.frame}")
    coarsest = max(maps.patches.resolution_m(r) for r in selection.records)
    cell_m = delivered_resolution([coarsest], query.resolution_m)
    distance, points = _samples(path_m, cell_m if step_m is None else step_m)
    mean, sigma, count = (np.full(len(points), fill) for fill in (np.nan, np.nan, 0.0))
    boxes = bounds_each(selection, query.frame)
    used_ids: set[str] = set()
    first = 0
    while first < len(points):
        is_beyond = (
            np.abs(points[first : first + MAX_SAMPLES] - points[first]).max(axis=1) > _CHUNK_CELLS * cell_m
        )
        last = first + int(np.argmax(is_beyond)) if is_beyond.any() else len(points)
        chunk = points[first:last]
        (x0, y0), (x1, y1) = chunk.min(axis=0), chunk.max(axis=0)
        # one more cell on each side, for points on the edges
        bounds = (x0 - cell_m, y0 - cell_m, x1 + cell_m, y1 + cell_m)
        chunk_selection = overlapping(selection, boxes, bounds)
        geometry = GridGeometry.aligned(query.frame, cell_m, bounds)
        assembled, usage = maps.pool(query, chunk_selection, geometry)
        statistics = assembled.statistics
        rows, cols, inside = geometry.cells_of(chunk[:, 0], chunk[:, 1])
        observed = inside & (statistics.count[rows, cols] > 0)
        indices = np.arange(first, last)[observed]
        mean[indices] = statistics.mean[rows[observed], cols[observed]]
        sigma[indices] = np.sqrt(statistics.variance[rows[observed], cols[observed]])
        count[indices] = statistics.count[rows[observed], cols[observed]]
        used_ids |= {record.id for record in usage.records}
        first = last
    return Profile(distance, points, mean, sigma, count, cell_m, tuple(sorted(used_ids)))


def _samples(path_m: NDArray[np.float64], step_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return distances (n,) and positions (n, 2) along a line at regular steps and at its corners."""
    lengths = np.linalg.norm(np.diff(path_m, axis=0), axis=1)
    corner_distance = np.concatenate([[0.0], np.cumsum(lengths)])
    length_m = float(corner_distance[-1])
    if not length_m > 0.0:
        raise InputError("the line has no length")
    if length_m / step_m + len(path_m) > MAX_SAMPLES:
        raise InputError(
            f"a line of {length_m:.6g} m in steps of {step_m:g} m: expected at most {MAX_SAMPLES} samples; "
            "ask for a larger step_m"
        )
    distance = np.unique(np.concatenate([np.arange(0.0, corner_distance[-1], step_m), corner_distance]))
    distinct = np.concatenate([[True], lengths > 0.0])
    x = np.interp(distance, corner_distance[distinct], path_m[distinct, 0])
    return distance, np.column_stack([x, np.interp(distance, corner_distance[distinct], path_m[distinct, 1])])
