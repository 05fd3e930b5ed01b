# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds by region: all clouds that reach in, in one frame, thinned fairly to a budget of points.

Clouds are read one after the other, the newest first. Whenever more than a few times the budget has gathered, each
voxel of a grid around the frame's origin keeps its newest point, and the voxels double until that is enough. The grids
are nested, so that it does not matter when this happens, and memory is bounded by the budget and the largest cloud. At
the end one point for each voxel of the first size that fits is taken, and the rest of the budget from the finer ones.
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
DEFAULT_POINTS = 1_000_000
MAX_POINTS = 5_000_000
MAX_CLOUDS = 20_000
#: Points that may gather before they are thinned, times the budget.
_SLACK = 4
_FINEST_M = 0.001
#: Voxels along an axis that a key holds, each side of the origin.
_REACH = 1 << 20
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
        self._voxel_m = 0.0
        self._has_intensity = True
        self.seen = 0

    def add(self, points: NDArray[np.float64], intensity: NDArray[Any] | None) -> None:
        """Take in points ``(n, 3)`` that are older than all before."""
        self._has_intensity &= intensity is not None
        column = np.zeros(len(points)) if intensity is None else intensity.astype(np.float64)
        self.seen += len(points)
        self._parts.append(np.column_stack([points, column]))
        self._gathered += len(points)
        if self._gathered > _SLACK * self._most:
            self._thin()

    def result(self) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, float]:
        """Points, intensities where all clouds had them, and the voxels that are all represented."""
        rows = np.vstack(self._parts)
        if self._voxel_m > 0.0:
            rows = rows[_first_of_each(rows, self._voxel_m)[0]]
        voxel_m = self._voxel_m
        if len(rows) > self._most:
            rows, voxel_m = self._fair(rows)
        return rows[:, :3], rows[:, 3] if self._has_intensity else None, voxel_m

    def _thin(self) -> None:
        rows = np.vstack(self._parts)
        while len(rows) > _SLACK * self._most // 2:
            self._voxel_m = max(2.0 * self._voxel_m, _finest(rows))
            rows = rows[_first_of_each(rows, self._voxel_m)[0]]
        self._parts, self._gathered = [rows], len(rows)

    def _fair(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """One point for each voxel of a size that fits the budget, and then others until it is full."""
        voxel_m = max(2.0 * self._voxel_m, _finest(rows))
        chosen, keys = _first_of_each(rows, voxel_m)
        while len(chosen) > self._most:
            voxel_m *= 2.0
            chosen, keys = _first_of_each(rows, voxel_m)
        rest = np.setdiff1d(np.arange(len(rows)), chosen, assume_unique=True)
        # Rank of each point among those of its voxel: all voxels get their second before any gets a third.
        order = np.argsort(keys[rest], kind="stable")
        _, starts, counts = np.unique(keys[rest][order], return_index=True, return_counts=True)
        rank = np.empty(len(rest), dtype=np.int64)
        rank[order] = np.arange(len(rest)) - np.repeat(starts, counts)
        extra = rest[np.argsort(rank, kind="stable")[: self._most - len(chosen)]]
        return rows[np.sort(np.concatenate([chosen, extra]))], voxel_m


def _finest(rows: NDArray[np.float64]) -> float:
    """The smallest voxel, a power of two of ``_FINEST_M``, whose keys reach all points."""
    reach = float(np.abs(rows[:, :3]).max()) if len(rows) else 0.0
    doubled = max(0, int(np.ceil(np.log2(max(reach, 1e-9) / (_FINEST_M * (_REACH - 1))))))
    return float(_FINEST_M * 2**doubled)


def _first_of_each(rows: NDArray[np.float64], voxel_m: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Index of the first point of each voxel, ascending, and the voxel's key of every point."""
    cells = np.floor(rows[:, :3] / voxel_m).astype(np.int64) + _REACH
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    _, first = np.unique(keys, return_index=True)
    return np.sort(first), keys


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
