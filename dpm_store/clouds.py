# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds by region: all clouds that reach in, in one frame, thinned fairly to a budget of points.

Clouds are read one after the other, the newest first. Whenever more than four times the budget has gathered, each voxel
of a grid around the frame's origin keeps its newest point, and the voxels double along one axis after the other until
no more than twice the budget is left. The grids are nested, so that it does not matter when this happens, and memory is
bounded by the budget and the largest cloud. At the end one point is kept of each voxel of the first size that fits the
budget, and of the voxels of the size before as many more as there is room for.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import FrameNotFoundError, InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import Header, Quality, Status, product_id
from dpm_store.frames import FrameTable, Known
from dpm_store.patches import DERIVED_DFPC
from dpm_store.products import ProductTable
from dpm_store.records import MAX_LIMIT, ProductRecord, Query
from dpm_store.search import Search

DERIVED_PORT = "cloud"
DEFAULT_POINTS = 500_000
MAX_POINTS = 5_000_000
MAX_CLOUDS = 20_000
#: Points that may gather before they are thinned, and that may be left then, times the budget: a step of the grid
#: halves them at most, so that the budget can still be filled.
_GATHERED, _LEFT = 4, 2
#: Edge of the smallest voxels, metres; coarser where a cloud reaches farther than their numbers.
_FINEST_M = 0.001
_REACH = 1 << 20
#: After so many steps a voxel holds everything on its side of the origin.
_STEPS = 66
#: Spreads keys evenly (Knuth, TAOCP 3, 6.4).
_SPREAD = np.uint64(0x9E3779B97F4A7C15)
_AHEAD = 8


@dataclass(frozen=True, slots=True, eq=False)
class AssembledCloud:
    """A cloud and what it was made from.

    Attributes
    ----------
    cloud : Pointcloud
    header : Header
        Of the derived product; ``inputs`` are the clouds.
    robots : tuple of str
    points_seen : int
        Points of the clouds that lie in the region.
    voxel_m : float
        Of this size each voxel that holds a point of the region is represented; 0 where every point is there.
    skipped_frames : tuple of str
        Frames that fixed edges do not join with the one asked.
    purged : int
        Clouds whose payload is gone since.
    """

    cloud: Any
    header: Header
    robots: tuple[str, ...]
    points_seen: int
    voxel_m: float
    skipped_frames: tuple[str, ...]
    purged: int = 0

    @property
    def robot(self) -> str:
        """The robot that measured it, or ``ground`` where several did."""
        return self.robots[0] if len(self.robots) == 1 else "ground"

    def manifest(self) -> dict[str, Any]:
        """Plain data for replies."""
        return {
            "clouds": list(self.header.inputs), "robots": list(self.robots), "points": len(self.cloud.points_m),
            "points_seen": self.points_seen, "voxel_m": self.voxel_m, "skipped_frames": list(self.skipped_frames),
            "purged": self.purged,
        }  # fmt: skip


class Clouds:
    """Derived clouds of a store."""

    def __init__(self, search: Search, products: ProductTable, frames: FrameTable) -> None:
        self._search = search
        self._products = products
        self._frames = frames

    def assemble(self, query: Query, most_points: int = DEFAULT_POINTS) -> AssembledCloud:
        """All clouds of a region in the query's frame.

        Parameters
        ----------
        query : Query
            Its types and limit are not looked at.
        most_points : int
            Of the result, 1 to ``MAX_POINTS``.

        Raises
        ------
        ProductNotFoundError
            If no cloud has a point in the region.
        InputError
            On a budget out of range, or more than ``MAX_CLOUDS`` clouds.
        """
        from cdff_common.types import Pointcloud

        if not 1 <= most_points <= MAX_POINTS:
            raise InputError(f"points={most_points}: expected 1 to {MAX_POINTS}")
        region = None if query.region is None else self._search.resolved_region(query)
        records, unplaced = self._find(replace(query, region=region))
        budget = _Budget(most_points)
        used: list[ProductRecord] = []
        purged, transforms = 0, self._transforms(query, records, unplaced)
        for record, points, intensity in self._read([r for r in records if r.header.frame in transforms]):
            if points is None:
                purged += 1
                continue
            moved = transforms[record.header.frame].apply(points)
            inside = np.isfinite(moved).all(axis=1)
            if region is not None:
                inside &= region.contains(moved[:, 0], moved[:, 1], moved[:, 2])
            if inside.any():
                budget.add(moved[inside], None if intensity is None else intensity[inside])
                used.append(record)
        if not used:
            where = "" if region is None else f" in {region.text} of {query.frame}"
            raise ProductNotFoundError(f"no point cloud{where}")
        points_m, intensities, voxel_m = budget.result()
        newest = max(r.header.t1_ns for r in used)
        cloud = Pointcloud.from_points(
            points_m, frame=query.frame, stamp_ns=newest,
            intensity=None if intensities is None else intensities.astype(np.int32),
        )  # fmt: skip
        robots = tuple(sorted({r.robot for r in used}))
        header = _header(cloud, query, region, used, robots, most_points, purged)
        return AssembledCloud(cloud, header, robots, budget.seen, voxel_m, tuple(sorted(unplaced)), purged)

    def _find(self, query: Query) -> tuple[list[ProductRecord], set[str]]:
        found: list[ProductRecord] = []
        step = replace(query, types=("pointcloud",), limit=MAX_LIMIT)
        while True:
            page = self._search.run(step)
            found += [r for r in page.items if r.dfpc != DERIVED_DFPC and r.size]
            if page.cursor is None:
                return found, set(page.unplaced_frames)
            if len(found) >= MAX_CLOUDS:
                raise InputError(f"more than {MAX_CLOUDS} clouds in that region; ask for a smaller one")
            step = replace(step, cursor=page.cursor)

    def _transforms(
        self, query: Query, records: list[ProductRecord], unplaced: set[str]
    ) -> dict[str, UncertainTransform]:
        known, found = Known(query.as_of_ns, query.frames_revision), {}
        for frame in {r.header.frame for r in records}:
            try:
                found[frame] = self._frames.lookup(query.frame, frame, known=known)
            except FrameNotFoundError:
                unplaced.add(frame)
        return found

    def _read(self, records: list[ProductRecord]) -> Any:
        """Records with points ``(n, 3)`` and intensities, newest first; None for points that were purged."""
        from cdff_common.codecs import decode

        records.sort(key=lambda r: (-r.header.t1_ns, r.id))
        for first in range(0, len(records), _AHEAD):
            batch = records[first : first + _AHEAD]
            payloads = dict(self._products.payloads([r.id for r in batch]))
            for record in batch:
                payload = payloads.pop(record.id, None)
                if payload is None:
                    yield record, None, None
                    continue
                value = decode(record.type_name, payload, record.codec)
                intensity = value.intensity
                some = intensity is not None and len(intensity) == len(value.points_m)
                yield record, value.points_m, np.asarray(intensity) if some else None


class _Budget:
    """Points so far, thinned as they come."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._parts: list[NDArray[np.float64]] = []
        self._gathered = 0
        self._step = -1
        self._has_intensity = True
        self.seen = 0

    def add(self, points: NDArray[np.float64], intensity: NDArray[Any] | None) -> None:
        """Take in points ``(n, 3)`` that are older than all before."""
        self._has_intensity &= intensity is not None
        column = np.zeros(len(points)) if intensity is None else intensity.astype(np.float64)
        self.seen += len(points)
        self._parts.append(np.column_stack([points, column]))
        self._gathered += len(points)
        if self._gathered > _GATHERED * self._most:
            rows = self._thinned(np.vstack(self._parts), _LEFT * self._most)
            self._parts, self._gathered = [rows], len(rows)

    def result(self) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, float]:
        """Points, intensities where all clouds had them, and the size of voxels that are all represented."""
        rows = self._thinned(np.vstack(self._parts), _LEFT * self._most)
        voxel_m = 0.0
        if len(rows) > self._most:
            step = _step_for(rows, self._step, self._most)
            rows = self._thinned(rows, self._most, step - 1)
            rows, voxel_m = self._filled(rows, _newest_of_each(rows, step), step), float(_edges(step).max())
        return rows[:, :3], rows[:, 3] if self._has_intensity else None, voxel_m

    def _thinned(self, rows: NDArray[np.float64], most: int, step: int | None = None) -> NDArray[np.float64]:
        """One point for each voxel of a step, by default the first that leaves few enough."""
        if step is None and self._step < 0 and len(rows) <= most:
            return rows
        self._step = _step_for(rows, self._step, most) if step is None else step
        return rows[_newest_of_each(rows, self._step)] if self._step >= 0 else rows

    def _filled(self, rows: NDArray[np.float64], chosen: NDArray[np.int64], step: int) -> NDArray[np.float64]:
        """The chosen ones, and of the others as many as there is room for, from all over the place."""
        rest = np.setdiff1d(np.arange(len(rows)), chosen, assume_unique=True)
        mixed = _keys(rows[rest], step).astype(np.uint64) * _SPREAD
        extra = rest[np.argsort(mixed, kind="stable")[: max(0, self._most - len(chosen))]]
        kept: NDArray[np.float64] = rows[np.sort(np.concatenate([chosen, extra]))[: self._most]]
        return kept


def _edges(step: int) -> NDArray[np.float64]:
    """Edges ``(3,)`` of the voxels of a step, metres: x doubles, then y, then z."""
    return np.asarray(_FINEST_M * 2.0 ** ((step + np.array([2, 1, 0])) // 3), dtype=np.float64)


def _step_for(rows: NDArray[np.float64], least: int, most: int) -> int:
    """The first step from ``least`` on of which no more than ``most`` voxels hold points: fewer do at every step."""
    reach_m = float(np.abs(rows[:, :3]).max()) if len(rows) else 0.0
    low = max(least, 3 * max(0, int(np.ceil(np.log2(max(reach_m, _FINEST_M) / (_FINEST_M * (_REACH - 1)))))))
    last, stride = low + _STEPS, 1

    def few(step: int) -> bool:
        return step >= last or len(np.unique(_keys(rows, step))) <= most

    high = low  # the step that is looked for is near the last one: strides grow from there
    while not few(high):
        low, high, stride = high + 1, min(high + stride, last), 2 * stride
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if few(middle) else (middle + 1, high)
    return high


def _keys(rows: NDArray[np.float64], step: int) -> NDArray[np.int64]:
    cells = np.floor(rows[:, :3] / _edges(step)).astype(np.int64) + _REACH
    return np.asarray((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2], dtype=np.int64)


def _newest_of_each(rows: NDArray[np.float64], step: int) -> NDArray[np.int64]:
    """Indices of the first point of each voxel, ascending."""
    return np.sort(np.unique(_keys(rows, step), return_index=True)[1])


def _header(
    cloud: Any, query: Query, region: Region | None, used: list[ProductRecord], robots: tuple[str, ...], most: int,
    purged: int,
) -> Header:  # fmt: skip
    inputs = tuple(sorted(r.id for r in used))
    made_by = [region.text if region else "", query.frame, most, inputs, query.as_of_ns, query.frames_revision]
    config_hash = hashlib.sha256(json.dumps(made_by).encode()).hexdigest()[:16]
    degraded = ("degraded_inputs",) if any(r.header.quality.status is Status.DEGRADED for r in used) else ()
    reasons = (*degraded, *(("purged_inputs",) if purged else ()))
    t0_ns, t1_ns = min(r.header.t0_ns for r in used), max(r.header.t1_ns for r in used)
    extent = cloud.extent_m()
    box: Any = None if extent is None else tuple(float(v) for v in extent)
    return Header(
        id=product_id(robots[0] if len(robots) == 1 else "ground", DERIVED_DFPC, DERIVED_PORT, t1_ns, 0, config_hash),
        seq=0, t0_ns=t0_ns, t1_ns=t1_ns, frame=query.frame, producer="dpm/cloud/1", config_hash=config_hash,
        inputs=inputs, quality=Quality(Status.DEGRADED if reasons else Status.OK, reasons),
        box_m=box,
    )  # fmt: skip
