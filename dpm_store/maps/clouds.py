# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds by region: all clouds in one frame, downsampled evenly to a budget of points.

Clouds are read from the newest. Whenever more than four times the budget is collected, each voxel of a grid
around the frame's origin keeps its newest point, and the voxels double along one axis after the other until
at most twice the budget remains. The grids are nested, so that the result does not depend on the time of
downsampling, and memory is limited by the budget and the largest cloud. The result has one point of each
voxel of the first size that fits the budget, and as many points of the next smaller voxels as the budget
allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.contract.limits import DEFAULT_POINTS, MAX_POINTS
from cdff_common.errors import InputError, ProductNotFoundError
from dpm_store.engine.time_limit import check_time
from dpm_store.frames.frames import IDENTITY
from dpm_store.maps.patches import DerivedProduct, Patches, derived_header
from dpm_store.products.products import ProductTable
from dpm_store.products.records import ProductRecord, Query

DERIVED_PORT = "cloud"
#: Points before and after downsampling, in multiples of the budget: one step of the grid at most halves the
#: points, so that enough remain to fill the budget.
_COLLECTED, _REMAINING = 4, 2
#: Edge of the smallest voxels, metres; coarser if a cloud exceeds the range of their numbers.
_FINEST_M = 0.001
_REACH = 1 << 20
#: After this many steps a voxel contains everything on its side of the origin.
_STEPS = 66
#: Spreads keys evenly (Knuth, TAOCP 3, 6.4).
_SPREAD = np.uint64(0x9E3779B97F4A7C15)
#: Clouds that are read at once.
_AHEAD = 8


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AssembledCloud(DerivedProduct):
    """A cloud and its sources.

    Attributes
    ----------
    cloud : Pointcloud
    points_seen : int
        Number of points of the clouds in the region.
    voxel_m : float
        Every voxel of this size with a point of the region is represented; 0 if all points are.
    """

    cloud: Any
    points_seen: int
    voxel_m: float

    def manifest(self) -> dict[str, Any]:
        """Return plain data of the sources, for replies."""
        counts = {"clouds": self.header.inputs, "points": len(self.cloud.points_m)}
        return DerivedProduct.manifest(self) | counts


class Clouds:
    """Derived point clouds."""

    def __init__(self, patches: Patches, products: ProductTable) -> None:
        self._patches = patches
        self._products = products

    def assemble(self, query: Query, max_points: int = DEFAULT_POINTS) -> AssembledCloud:
        """Return all clouds of a region in the query's frame.

        Parameters
        ----------
        query : Query
            Its types and limit are ignored.
        max_points : int
            Limit of the result, 1 to ``MAX_POINTS``.

        Raises
        ------
        ProductNotFoundError
            If no cloud has a point in the region.
        InputError
            If the budget is out of range, or there are more than ``patches.MAX_PATCHES`` clouds.
        """
        from cdff_common.types import Pointcloud

        if not 1 <= max_points <= MAX_POINTS:
            raise InputError(f"points={max_points}: expected 1 to {MAX_POINTS}")
        region = None if query.region is None else self._patches.resolved_region(query)
        selection = self._patches.find(replace(query, region=region))
        budget = _Budget(max_points)
        sources: list[ProductRecord] = []
        purged = 0
        for record, points, intensity in self._read(selection.records):
            if points is None:
                purged += 1
                continue
            transformed = selection.transforms.get(record.header.frame, IDENTITY).apply(points)
            inside = np.isfinite(transformed).all(axis=1)
            if region is not None:
                inside &= region.contains(transformed[:, 0], transformed[:, 1], transformed[:, 2])
            if inside.any():
                budget.add(transformed[inside], None if intensity is None else intensity[inside])
                sources.append(record)
        if not sources:
            location = "" if region is None else f" in {region.text} of {query.frame}"
            raise ProductNotFoundError(f"no point cloud{location}")
        points_m, intensities, voxel_m = budget.result()
        newest = max(r.header.t1_ns for r in sources)
        cloud = Pointcloud.from_points(
            points_m,
            frame=query.frame,
            stamp_ns=newest,
            intensity=None if intensities is None else intensities.astype(np.int32),
        )
        region_key = [region.text if region else "", query.frame]
        inputs = sorted(r.id for r in sources)
        header = derived_header(
            sources,
            [*region_key, max_points, inputs, query.as_of_ns, query.frames_revision],
            port=DERIVED_PORT,
            frame=query.frame,
            producer="dpm/cloud/1",
            extent_m=cloud.extent_m(),
            purged=purged,
        )
        return AssembledCloud(
            cloud=cloud,
            header=header,
            robots=tuple(sorted({r.robot for r in sources})),
            points_seen=budget.seen,
            voxel_m=voxel_m,
            skipped_frames=selection.unplaced_frames,
            purged=purged,
        )

    def _read(self, records: Sequence[ProductRecord]) -> Any:
        """Return records with points ``(n, 3)`` and intensities, newest first; None for purged points."""
        from cdff_common.codecs import decode

        records = sorted(records, key=lambda r: (-r.header.t1_ns, r.id))
        for first in range(0, len(records), _AHEAD):
            check_time(first, len(records), "clouds")
            batch = records[first : first + _AHEAD]
            payloads = dict(self._products.payloads([r.id for r in batch]))
            for record in batch:
                payload = payloads.pop(record.id, None)
                if payload is None:
                    yield record, None, None
                    continue
                value = decode(record.type_name, payload, record.codec)
                intensity = value.intensity
                is_complete = intensity is not None and len(intensity) == len(value.points_m)
                yield record, value.points_m, np.asarray(intensity) if is_complete else None


class _Budget:
    """Collected points within a limit."""

    def __init__(self, max_points: int) -> None:
        self._max_points = max_points
        self._parts: list[NDArray[np.float64]] = []
        self._collected = 0
        self._step = -1
        self._has_intensity = True
        self.seen = 0

    def add(self, points: NDArray[np.float64], intensity: NDArray[Any] | None) -> None:
        """Add points ``(n, 3)`` that are older than all previous ones."""
        self._has_intensity &= intensity is not None
        column = np.zeros(len(points)) if intensity is None else intensity.astype(np.float64)
        self.seen += len(points)
        self._parts.append(np.column_stack([points, column]))
        self._collected += len(points)
        if self._collected > _COLLECTED * self._max_points:
            rows = self._downsample(np.vstack(self._parts), _REMAINING * self._max_points)
            self._parts, self._collected = [rows], len(rows)

    def result(self) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, float]:
        """Return points, intensities if all clouds have them, and the size of the represented voxels."""
        rows = self._downsample(np.vstack(self._parts), _REMAINING * self._max_points)
        voxel_m = 0.0
        if len(rows) > self._max_points:
            step = _step_for(rows, self._step, self._max_points)
            rows = self._downsample(rows, self._max_points, step - 1)
            rows, voxel_m = (
                self._fill_budget(rows, _newest_of_each(rows, step), step),
                float(_edges(step).max()),
            )
        return rows[:, :3], rows[:, 3] if self._has_intensity else None, voxel_m

    def _downsample(
        self, rows: NDArray[np.float64], max_points: int, step: int | None = None
    ) -> NDArray[np.float64]:
        """Return one point per voxel of a step, by default of the first step that leaves at most
        ``max_points``.
        """
        if step is None and self._step < 0 and len(rows) <= max_points:
            return rows
        self._step = _step_for(rows, self._step, max_points) if step is None else step
        return rows[_newest_of_each(rows, self._step)] if self._step >= 0 else rows

    def _fill_budget(
        self, rows: NDArray[np.float64], selected: NDArray[np.int64], step: int
    ) -> NDArray[np.float64]:
        """Return the selected points and evenly distributed others up to the limit."""
        unselected = np.setdiff1d(np.arange(len(rows)), selected, assume_unique=True)
        hashes = _keys(rows[unselected], step).astype(np.uint64) * _SPREAD
        extra_rows = unselected[np.argsort(hashes, kind="stable")[: max(0, self._max_points - len(selected))]]
        filled: NDArray[np.float64] = rows[
            np.sort(np.concatenate([selected, extra_rows]))[: self._max_points]
        ]
        return filled


def _edges(step: int) -> NDArray[np.float64]:
    """Return the edges ``(3,)`` of the voxels of a step, metres: x doubles, then y, then z."""
    return np.asarray(_FINEST_M * 2.0 ** ((step + np.array([2, 1, 0])) // 3), dtype=np.float64)


def _step_for(rows: NDArray[np.float64], first_step: int, max_voxels: int) -> int:
    """Return the first step from ``first_step`` with points in at most ``max_voxels`` voxels; the number
    decreases.
    """
    reach_m = float(np.abs(rows[:, :3]).max()) if len(rows) else 0.0
    low = max(
        first_step, 3 * max(0, int(np.ceil(np.log2(max(reach_m, _FINEST_M) / (_FINEST_M * (_REACH - 1))))))
    )
    last, stride = low + _STEPS, 1

    def is_within_limit(step: int) -> bool:
        return step >= last or len(np.unique(_keys(rows, step))) <= max_voxels

    high = low  # the result is usually near the previous step: strides grow from there
    while not is_within_limit(high):
        low, high, stride = high + 1, min(high + stride, last), 2 * stride
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if is_within_limit(middle) else (middle + 1, high)
    return high


def _keys(rows: NDArray[np.float64], step: int) -> NDArray[np.int64]:
    cells = np.floor(rows[:, :3] / _edges(step)).astype(np.int64) + _REACH
    return np.asarray((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2], dtype=np.int64)


def _newest_of_each(rows: NDArray[np.float64], step: int) -> NDArray[np.int64]:
    """Return the indices of the first point of each voxel, ascending."""
    return np.sort(np.unique(_keys(rows, step), return_index=True)[1])
