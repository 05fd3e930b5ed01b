# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Coverage of a requested region: stored cells, cells that robots can observe, plans for the missing cells.

The region is divided into a few hundred coarse cells, each represented by a bit of an integer. A cell counts
as stored or reachable if any part of it is, so that no feasible product is refused.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.region import Region
from cdff_common.interfaces.profile import Robot
from cdff_common.types import ElevationMap, NavigationMap, Pointcloud
from cdff_core.orchestration.conversion import observed_cells
from cdff_core.orchestration.planner import NoPlan, Plan, Root, combine_plans, plan
from cdff_core.orchestration.world import ProviderId, World

#: Number of coarse cells along the longer side of a region.
CELLS = 24
#: Number of robots up to which all teams are planned; for more robots only single robots and all together.
MOST_COMBINED = 10
#: Kinds of sensors that observe the terrain.
_TERRAIN_SENSORS = ("stereo_camera", "camera", "lidar")
#: Assumed largest distance between a sensor and the base of its robot, metres.
_REACH_MARGIN_M = 2.0


@dataclass(frozen=True, slots=True)
class RegionCoverage:
    """Requested, stored and reachable cells of a region, one bit for each coarse cell."""

    requested: int  # cells of the region
    stored: int  # cells with data in the DPM
    required_count: int  # number of cells that the product must cover
    #: Robot to the cells that it can observe in time; robots not listed can observe all.
    reach: Mapping[str, int] = field(default_factory=dict)
    pooled: bool = False  # true if products of several robots are combined

    @property
    def missing(self) -> int:
        """Cells of the region without data."""
        return self.requested & ~self.stored

    def reachable(self, robots: Iterable[str]) -> int:
        """Return the missing cells that any of ``robots`` can observe."""
        bits = 0
        for robot in robots:
            bits |= self.reach.get(robot, self.missing)
        return bits & self.missing

    def is_sufficient(self, robots: Iterable[str]) -> bool:
        """Return whether ``robots`` can observe missing cells, and enough of them for the product."""
        added = self.reachable(robots).bit_count()
        return added > 0 and (self.requested & self.stored).bit_count() + added >= self.required_count

    def fraction(self, bits: int) -> float:
        """Return the fraction of the region that some cells cover, 0 to 1."""
        return (bits & self.requested).bit_count() / max(self.requested.bit_count(), 1)


@dataclass(frozen=True, slots=True)
class RegionCells:
    """Coarse cells of a region."""

    #: (n, 2), centres of the cells in the frame of the region; the centre of its box if none is inside.
    centres_m: NDArray[np.float64]
    half_diagonal_m: float  # half the diagonal of a cell

    @classmethod
    def of(cls, region: Region, min_size_m: float = 0.0) -> RegionCells:
        """Return the cells of a resolved region, at least ``min_size_m`` wide."""
        x0, y0, x1, y1 = region.bounds
        cell_m = max(max(x1 - x0, y1 - y0, 1e-6) / CELLS, min_size_m)
        x = x0 + cell_m * (np.arange(max(math.ceil((x1 - x0) / cell_m), 1)) + 0.5)
        y = y0 + cell_m * (np.arange(max(math.ceil((y1 - y0) / cell_m), 1)) + 0.5)
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        inside = grid[region.contains(grid[:, 0], grid[:, 1])]
        middle = np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])
        return cls(inside if len(inside) else middle, cell_m * math.sqrt(0.5))

    @property
    def all(self) -> int:
        """Bits of all cells."""
        return (1 << len(self.centres_m)) - 1

    def bits(self, mask: NDArray[np.bool_]) -> int:
        """Return the bits of a mask of shape ``(n,)``."""
        return int.from_bytes(np.packbits(mask, bitorder="little").tobytes(), "little")

    def near(self, xy_m: tuple[float, float], radius_m: float) -> int:
        """Return the cells that are partly within ``radius_m`` of a point."""
        distance_m = np.hypot(self.centres_m[:, 0] - xy_m[0], self.centres_m[:, 1] - xy_m[1])
        return self.bits(distance_m <= radius_m + self.half_diagonal_m)

    def containing(self, points_m: NDArray[np.float64]) -> int:
        """Return the cells that contain any of the points, shape ``(k, 2)``."""
        if not len(points_m):
            return 0
        cell_m = self.half_diagonal_m / math.sqrt(0.5)
        origin = self.centres_m.min(axis=0)
        occupied = {
            (int(i), int(j))
            for i, j in np.unique(np.rint((points_m - origin) / cell_m).astype(np.int64), axis=0)
        }
        cells = np.rint((self.centres_m - origin) / cell_m).astype(np.int64)
        return self.bits(np.fromiter(((int(i), int(j)) in occupied for i, j in cells), np.bool_, len(cells)))


def reach_m(robot: Robot, horizon_s: float) -> float | None:
    """Return the distance up to which a robot can observe the terrain within ``horizon_s`` seconds.

    None unless every terrain sensor has a ``range_m`` and the robot a limit ``max_speed_m_s``.
    """
    ranges = [sensor.range_m for sensor in robot.sensors.values() if sensor.kind in _TERRAIN_SENSORS]
    speed_m_s = robot.limits.get("max_speed_m_s")
    if speed_m_s is None or not ranges or any(r is None for r in ranges):
        return None
    return max(r for r in ranges if r is not None) + speed_m_s * max(horizon_s, 0.0) + _REACH_MARGIN_M


def observed_points(value: ElevationMap | NavigationMap | Pointcloud) -> NDArray[np.float64]:
    """Return the horizontal positions ``(n, 2)`` of the data of a product, metres, in its frame."""
    if isinstance(value, Pointcloud):
        return np.asarray(value.points_m[:, :2])
    x, y = value.geometry.centres_m()
    observed = observed_cells(value)
    shape = observed.shape
    return np.column_stack([np.broadcast_to(x, shape)[observed], np.broadcast_to(y, shape)[observed]])


def plan_coverage(
    world: World,
    product: str,
    robots: Iterable[str],
    coverage: RegionCoverage,
    exclude: frozenset[ProviderId] = frozenset(),
    roots: frozenset[Root] | None = None,
) -> Plan | NoPlan:
    """Return the cheapest plan for the missing cells, with one robot or, if ``pooled``, with several.

    ``exclude`` and ``roots`` are as for ``plan``. Robots share no DFPC, sensor or budget, so that the
    cheapest plan of several robots combines the cheapest plan of each.
    """
    robots = sorted(set(robots))
    results = {robot: plan(world, product, [robot], exclude, roots) for robot in robots}
    plans = {robot: p for robot, p in results.items() if isinstance(p, Plan)}
    if not plans:
        return plan(world, product, robots, exclude, roots)
    count = len(plans)
    sizes = range(1, count + 1) if coverage.pooled and count <= MOST_COMBINED else (1, count)
    teams = [
        team
        for size in sizes
        if size == 1 or coverage.pooled
        for team in itertools.combinations(sorted(plans), size)
    ]
    sufficient = [team for team in teams if coverage.is_sufficient(team)]
    if sufficient:
        best = min(sufficient, key=lambda team: (sum(plans[r].cost for r in team), len(team), team))
        return combine_plans([plans[r] for r in best])
    reasons = [f"the DPM holds {coverage.fraction(coverage.stored):.0%} of the region"]
    for robot in sorted(plans):
        reachable = coverage.fraction(coverage.reachable([robot]))
        reasons.append(f"{robot} can observe {reachable:.0%} more of it in time")
    reasons += [reason for p in results.values() if isinstance(p, NoPlan) for reason in p.reasons]
    largest_fraction = max(coverage.fraction(coverage.stored | coverage.reachable(team)) for team in teams)
    nearest = (f"{product} of {largest_fraction:.0%} of the region",) if largest_fraction > 0.0 else ()
    return NoPlan(tuple(dict.fromkeys(reasons)), nearest)
