# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A region that is partly covered: what is left to make, who can reach it, and the cheapest way to make just that.

The region is looked at in a few hundred coarse cells, each a bit of an integer. A cell counts as held or in reach as
soon as some of it is, so that nothing that can be made is ever refused.
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
from cdff_core.orchestration.planner import NoPlan, Plan, plan, together
from cdff_core.orchestration.translate import observed_cells
from cdff_core.orchestration.world import MakerId, World

#: Coarse cells along the longer side of a region.
CELLS = 24
#: Robots up to which every combination is looked at; of more, each is taken alone or all together.
MOST_COMBINED = 10


@dataclass(frozen=True, slots=True)
class Cover:
    """What of a region is wanted, held and in reach, a bit for each coarse cell.

    Attributes
    ----------
    wanted : int
        Cells of the region.
    held : int
        Those that the DPM holds something of.
    least : int
        How many have to be held in the end.
    reach : mapping of str to int
        Robot to the cells it can see in time; absent robots may see all of them.
    pooled : bool
        Whether products of several robots are put together.
    """

    wanted: int
    held: int
    least: int
    reach: Mapping[str, int] = field(default_factory=dict)
    pooled: bool = False

    @property
    def rest(self) -> int:
        """Cells that are wanted and not held."""
        return self.wanted & ~self.held

    def gained(self, robots: Iterable[str]) -> int:
        """Cells of the rest that some of ``robots`` can see."""
        bits = 0
        for robot in robots:
            bits |= self.reach.get(robot, self.rest)
        return bits & self.rest

    def is_enough(self, robots: Iterable[str]) -> bool:
        """Whether enough is held once ``robots`` have made what they see; they have to see something of the rest."""
        gained = self.gained(robots).bit_count()
        return gained > 0 and (self.wanted & self.held).bit_count() + gained >= self.least

    def share(self, bits: int) -> float:
        """Part of the region that some cells are, 0 to 1."""
        return (bits & self.wanted).bit_count() / max(self.wanted.bit_count(), 1)


@dataclass(frozen=True, slots=True)
class Cells:
    """The coarse cells of a region: their centres, and half the diagonal of one.

    Attributes
    ----------
    centres_m : NDArray[np.float64], shape (n, 2)
        In the region's frame; those inside the region alone (or the middle of its box where none is).
    half_m : float
    """

    centres_m: NDArray[np.float64]
    half_m: float

    @classmethod
    def of(cls, region: Region, least_m: float = 0.0) -> Cells:
        """Cells of a resolved region, none smaller than ``least_m``."""
        x0, y0, x1, y1 = region.bounds
        cell_m = max(max(x1 - x0, y1 - y0, 1e-6) / CELLS, least_m)
        x = x0 + cell_m * (np.arange(max(math.ceil((x1 - x0) / cell_m), 1)) + 0.5)
        y = y0 + cell_m * (np.arange(max(math.ceil((y1 - y0) / cell_m), 1)) + 0.5)
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        inside = grid[region.contains(grid[:, 0], grid[:, 1])]
        middle = np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])
        return cls(inside if len(inside) else middle, cell_m * math.sqrt(0.5))

    @property
    def all(self) -> int:
        """Every cell."""
        return (1 << len(self.centres_m)) - 1

    def bits(self, which: NDArray[np.bool_]) -> int:
        """The cells of a mask ``(n,)``."""
        return int.from_bytes(np.packbits(which, bitorder="little").tobytes(), "little")

    def near(self, xy_m: tuple[float, float], radius_m: float) -> int:
        """Cells some of which lies within ``radius_m`` of a point."""
        distance_m = np.hypot(self.centres_m[:, 0] - xy_m[0], self.centres_m[:, 1] - xy_m[1])
        return self.bits(distance_m <= radius_m + self.half_m)

    def holding(self, points_m: NDArray[np.float64]) -> int:
        """Cells that hold one of some points ``(k, 2)``."""
        if not len(points_m):
            return 0
        cell_m = self.half_m / math.sqrt(0.5)
        origin = self.centres_m.min(axis=0)
        seen = {(int(i), int(j)) for i, j in np.unique(np.rint((points_m - origin) / cell_m).astype(np.int64), axis=0)}
        own = np.rint((self.centres_m - origin) / cell_m).astype(np.int64)
        return self.bits(np.fromiter(((int(i), int(j)) in seen for i, j in own), np.bool_, len(own)))


#: Kinds of sensors that see the ground.
_SEEING = ("stereo_camera", "camera", "lidar")
#: Beyond its range: what the base of a robot may be off its sensors, metres.
_REACH_MARGIN_M = 2.0


def reach_m(robot: Robot, horizon_s: float) -> float | None:
    """How far from where it is a robot may see within ``horizon_s`` seconds; None where the profile does not say.

    It takes every sensor that sees the ground to state its ``range_m``, and a limit ``max_speed_m_s``.
    """
    ranges = [sensor.range_m for sensor in robot.sensors.values() if sensor.kind in _SEEING]
    speed_m_s = robot.limits.get("max_speed_m_s")
    if speed_m_s is None or not ranges or any(r is None for r in ranges):
        return None
    return max(r for r in ranges if r is not None) + speed_m_s * max(horizon_s, 0.0) + _REACH_MARGIN_M


def observed_points(value: ElevationMap | NavigationMap | Pointcloud) -> NDArray[np.float64]:
    """Where a product holds something: ``(n, 2)``, metres, in its frame."""
    if isinstance(value, Pointcloud):
        return np.asarray(value.points_m[:, :2])
    x, y = value.geometry.centres_m()
    seen = observed_cells(value)
    return np.column_stack([np.broadcast_to(x, seen.shape)[seen], np.broadcast_to(y, seen.shape)[seen]])


def plan_cover(
    world: World,
    product: str,
    robots: Iterable[str],
    cover: Cover,
    exclude: frozenset[MakerId] = frozenset(),
    roots: frozenset[MakerId] | None = None,
) -> Plan | NoPlan:
    """Return the cheapest plan that makes what is left of a region, on one robot or (``pooled``) on several.

    ``exclude`` and ``roots`` are as for ``plan``.
    Robots share no DFPC, sensor or budget, so the cheapest plan of a set of them is the sum of the cheapest of each.
    """
    robots = sorted(set(robots))
    made = {robot: plan(world, product, [robot], exclude, roots) for robot in robots}
    plans = {robot: p for robot, p in made.items() if isinstance(p, Plan)}
    if not plans:
        return plan(world, product, robots, exclude, roots)
    sizes = range(1, len(plans) + 1) if cover.pooled and len(plans) <= MOST_COMBINED else (1, len(plans))
    sets = [s for size in sizes if size == 1 or cover.pooled for s in itertools.combinations(sorted(plans), size)]
    enough = [s for s in sets if cover.is_enough(s)]
    if enough:
        best = min(enough, key=lambda s: (sum(plans[r].cost for r in s), len(s), s))
        return together([plans[r] for r in best])
    reasons = [f"the DPM holds {cover.share(cover.held):.0%} of the region"]
    reasons += [f"{r} can see {cover.share(cover.gained([r])):.0%} more of it in time" for r in sorted(plans)]
    reasons += [reason for p in made.values() if isinstance(p, NoPlan) for reason in p.reasons]
    most = max(cover.share(cover.held | cover.gained(s)) for s in sets)
    return NoPlan(tuple(dict.fromkeys(reasons)), (f"{product} of {most:.0%} of the region",) if most > 0.0 else ())
