# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Looks into the DPM for what answers a request now: one function for each kind of product."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from cdff_common.clock import NS_PER_S, Clock
from cdff_common.errors import ExtrapolationError, FrameNotFoundError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import Header
from cdff_common.interfaces.profile import Profile
from cdff_common.types import NavigationMap, Pointcloud
from cdff_core.orchestration import translate
from cdff_core.orchestration.cover import Cells, Cover, observed_points, reach_m
from cdff_core.orchestration.judge import Candidate, Judgement, best, judge
from cdff_core.orchestration.request import ProductRequest
from services.orchestrator.dpm import DERIVED_DFPC, Dpm, Stored

#: Most clouds that are put together to cover a region.
_CLOUDS = 8
_MAPS = 8
#: Cell in which a point counts as covering, metres, where no resolution was asked.
_CLOUD_CELL_M = 0.5
#: "Until then" of captures where none counts.
_NEVER_NS = -1
#: ``dfpc`` of products that the DPM or the orchestrator derived from others: their sources are found instead.
_DERIVED = ("dpm", DERIVED_DFPC)


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A possible answer, in the product's own type and frame, cut to the region.

    Attributes
    ----------
    candidate : Candidate
    sources : tuple of Header
        Headers of what it was made from, newest first.
    value : Any
        A ``cdff_common.types`` object, or the ``UncertainTransform`` of a pose that the frame tree composed.
    frame, child : str
        Of the value.
    whole : bool
        Whether it is one stored product as it is.
    region : Region or None
        The region in ``frame``.
    robots : tuple of str
        Whose measurements were asked for; empty for all.
    moved_by : UncertainTransform or None
        What the newest part was moved by into ``frame``, where it was.
    payload, encoding
        The bytes that the value came as, where it is a stored product as it is.
    """

    candidate: Candidate
    sources: tuple[Header, ...]
    value: Any
    frame: str
    child: str | None = None
    whole: bool = False
    region: Region | None = None
    robots: tuple[str, ...] = ()
    moved_by: UncertainTransform | None = None
    payload: bytes = b""
    encoding: str = ""


class Finder:
    """Finds candidates for requests.

    ``find`` raises UnavailableError where the DPM is away, and InputError where a request cannot be met whatever comes.
    """

    def __init__(self, dpm: Dpm, clock: Clock, profile: Profile) -> None:
        self._dpm = dpm
        self._clock = clock
        self._profile = profile

    def find(
        self, request: ProductRequest, robots: Sequence[str], until_s: float
    ) -> tuple[tuple[Found, Judgement] | None, str]:
        """Return the best candidate with its judgement (None without any), and why there is no better one."""
        kinds: dict[str, Callable[[ProductRequest, str, float], Found | None]] = {
            "pose": self._pose,
            "pointcloud": self._pointcloud,
            "dem": self._dem,
            "navigation_map": self._navigation_map,
        }
        look = kinds.get(request.product, self._newest)
        found, reasons = [], []
        # Elevation of several robots is pooled into one window; other products are one robot's.
        for robot in ("any",) if request.product == "dem" and request.robot == "any" else robots:
            try:
                one = look(request, robot, until_s)
            except (FrameNotFoundError, ExtrapolationError, ProductNotFoundError) as error:
                reasons.append(str(error))
                continue
            if one is None:
                where = "for it" if request.region is None else "in the region (coverage 0)"
                reasons.append(f"the DPM holds no {request.product} of {robot} {where}")
            else:
                found.append(one)
        now_ns = self._clock.now_ns()
        choice = best([f.candidate for f in found], request, now_ns)
        if choice is None:
            return None, "; ".join(reasons)
        chosen = next(f for f in found if f.candidate is choice[0])
        return (chosen, choice[1]), "; ".join([*choice[1].missing, *choice[1].short])

    def knows_frame(self, frame: str, robots: Sequence[str], until_s: float) -> bool:
        """Whether the DPM's frame tree joins a frame to the site or to one of the robots, at whatever time."""
        for robot in robots:
            for other in ("site", f"{robot}/base"):
                try:
                    self._dpm.pose(robot, other, frame, None, until_s)
                except (FrameNotFoundError, ProductNotFoundError) as error:
                    if not error.retriable:
                        continue  # no chain joins them; otherwise it is only not known at that time
                return True
        return False

    def cover(
        self, request: ProductRequest, robots: Sequence[str], found: Found | None, until_s: float, horizon_s: float
    ) -> Cover:
        """What of the region is held, and what each robot can see of it within ``horizon_s`` seconds.

        Raises
        ------
        CdffError
            If where the region is cannot be said.
        """
        region, frame = (None, "") if found is None else (found.region, found.frame)
        if region is None:
            region, frame, _ = self._placed(request, robots[0], until_s)
        # Larger than what is held has: each that it covers holds the middle of one of its cells.
        resolution_m = 0.0 if found is None else found.candidate.resolution_m or 0.0
        cells = Cells.of(region, 1.5 * resolution_m)
        held = 0
        if found is not None and found.value is not None and found.candidate.status != "FAILED":
            held = cells.holding(observed_points(found.value))
        reach: dict[str, int] = {}
        for robot in robots:
            radius_m = reach_m(self._profile.robot(robot), horizon_s)
            if radius_m is None:
                continue
            try:
                T = self._dpm.pose(robot, frame, f"{robot}/base", None, until_s)
            except (FrameNotFoundError, ExtrapolationError, ProductNotFoundError):
                continue  # nobody knows where it is: it may be near
            reach[robot] = cells.near((float(T.matrix[0, 3]), float(T.matrix[1, 3])), radius_m)
        least = max(math.floor(request.min_coverage * len(cells.centres_m)), 1)
        pooled = request.product == "dem" and request.robot == "any"
        return Cover(cells.all, held, least, reach, pooled)

    # -- one for each product ---------------------------------------------------------------------------

    def _newest(self, request: ProductRequest, robot: str, until_s: float) -> Found | None:
        """Products without a place: the newest one."""
        items = self._search(request, until_s, type=request.product, robot=robot, limit=10)
        if not items:
            return None
        stored = self._dpm.value(str(items[0]["id"]), robot, until_s)
        return self._whole(stored)

    def _pose(self, request: ProductRequest, robot: str, until_s: float) -> Found | None:
        """The newest pose, or the one at the time asked for, in the frame asked for."""
        child = request.child or f"{robot}/base"
        items: list[dict[str, Any]] = []
        for of in dict.fromkeys((child, f"{robot}/base")):
            items = items or self._usable(self._dpm.search(until_s, type="pose", robot=robot, child=of, limit=10))
        if not items and request.t_ns is None:
            return None
        newest = self._dpm.value(str(items[0]["id"]), robot, until_s) if items else None
        if (
            request.t_ns is None
            and newest is not None
            and (newest.header.frame, newest.header.child) == (request.frame, child)
        ):
            return self._whole(newest)
        t_ns = request.t_ns if request.t_ns is not None else int(items[0]["t1_ns"])
        T = self._dpm.pose(robot, request.frame, child, t_ns, until_s)
        source = () if newest is None else (newest.header,)
        status = "OK" if newest is None else str(newest.header.quality.status)
        candidate = Candidate(source[0].id if source else "", robot, t_ns, t_ns, status=status)
        return Found(candidate, source, T, request.frame, child)

    def _pointcloud(self, request: ProductRequest, robot: str, until_s: float) -> Found | None:
        """The newest cloud of the region; several, newest first, where one does not cover it."""
        if request.region is None:
            return self._newest(request, robot, until_s)
        region, frame, last_ns = self._placed(request, robot, until_s)
        now_ns = self._now_ns(request)
        cell_m = request.resolution_m or _CLOUD_CELL_M
        parts: list[Pointcloud] = []
        sources: list[Header] = []
        moved_by: UncertainTransform | None = None
        merged, coverage = None, 0.0
        for item in self._clouds(request, robot, region, frame, last_ns, until_s):
            if sources and now_ns - int(item["t1_ns"]) > request.max_age_s * NS_PER_S:
                break
            stored = self._dpm.value(str(item["id"]), robot, until_s)
            h, cloud = stored.header, stored.value
            if h.frame != frame:
                # Each at its own time: a cloud in the robot's frame was taken where the robot was then.
                T = self._dpm.pose(robot, frame, h.frame, h.t1_ns, until_s)
                cloud, moved_by = translate.cloud_in(cloud, T, frame), moved_by or T
            part = translate.cropped_cloud(cloud, region)
            if not len(part.points_m):
                continue
            parts.append(part)
            sources.append(h)
            merged = translate.merged_clouds(parts)
            coverage = translate.cloud_coverage(merged, region, cell_m)
            if coverage >= max(request.min_coverage, 1e-12):
                break
        if merged is None:
            return None
        if request.resolution_m is not None:
            merged = translate.thinned_cloud(merged, request.resolution_m)
        candidate = self._candidate(sources, robot, coverage, request.resolution_m)
        return Found(candidate, tuple(sources), merged, frame, region=region, moved_by=moved_by)

    def _clouds(
        self, request: ProductRequest, robot: str, region: Region, frame: str, last_ns: int | None, until_s: float
    ) -> list[dict[str, Any]]:
        """Clouds that may reach into the region, newest first; those of moving frames are not found by place."""
        asked = {"type": "pointcloud", "robot": robot, "limit": _CLOUDS}
        items = self._search(request, until_s, last_ns, region=region.text, frame=frame, **asked)
        return items or [i for i in self._search(request, until_s, last_ns, **asked) if i["frame"] != frame]

    def _dem(self, request: ProductRequest, robot: str, until_s: float) -> Found | None:
        """The window that the DPM pools from all patches of the region; asked for only if something is new enough."""
        if request.region is None:
            stored = self._dpm.window(until_s, robot=robot, resolution_m=request.resolution_m, t1=request.t_ns)
            return self._window(stored, None, robot)
        region, frame, last_ns = self._placed(request, robot, until_s)
        items = self._search(
            request, until_s, last_ns, type="dem", robot=robot, region=region.text, frame=frame, limit=5
        )
        if not items:
            return None
        # Of several robots, whose maps have frames of their own, the DPM resamples into the frame asked for.
        home = request.frame if robot == "any" else str(items[0]["frame"])
        newest = Candidate(str(items[0]["id"]), robot, int(items[0]["t1_ns"]), int(items[0]["t1_ns"]))
        placed = self._seen_from(region, frame, home, robot, newest.t1_ns, until_s)
        if any(m.startswith(("age", "time")) for m in judge(newest, request, self._clock.now_ns()).missing):
            header = Header.from_dict(items[0])
            return Found(newest, (header,), None, home, region=placed)
        stored = self._dpm.window(
            until_s, robot=robot, region=placed.text, frame=home, resolution_m=request.resolution_m, t1=last_ns
        )
        return self._window(stored, placed, robot)

    def _navigation_map(self, request: ProductRequest, robot: str, until_s: float) -> Found | None:
        """The newest navigation map of the region; several of the same cells, newer on top, where one is too little."""
        if request.region is None:
            return self._newest(request, robot, until_s)
        region, frame, last_ns = self._placed(request, robot, until_s)
        items = self._search(
            request, until_s, last_ns, type="navigation_map", robot=robot, region=region.text, frame=frame, limit=_MAPS
        )
        parts: list[NavigationMap] = []
        sources: list[Header] = []
        found: Found | None = None
        for item in items:
            if sources and self._now_ns(request) - int(item["t1_ns"]) > request.max_age_s * NS_PER_S:
                break
            stored = self._dpm.value(str(item["id"]), robot, until_s)
            h, value = stored.header, stored.value
            placed = self._seen_from(region, frame, h.frame, robot, h.t1_ns, until_s)
            grid, seen = value.geometry, translate.observed_cells(value)
            if translate.grid_coverage(grid, seen, placed) <= 0.0:
                continue
            if parts and not grid.shares_cells_with(parts[0].geometry):
                continue
            parts.append(translate.masked_map(value, placed))
            sources.append(h)
            merged = translate.coarser_map(translate.merged_maps(parts), request.resolution_m)
            coverage = translate.grid_coverage(merged.geometry, translate.observed_cells(merged), placed)
            candidate = self._candidate(sources, robot, coverage, merged.geometry.resolution_m)
            found = Found(candidate, tuple(sources), merged, h.frame, region=placed)
            if coverage >= max(request.min_coverage, 1e-12):
                break
        return found

    # -- shared ------------------------------------------------------------------------------------------

    def _placed(self, request: ProductRequest, robot: str, until_s: float) -> tuple[Region, str, int | None]:
        """The request's region, its frame, and until when captures count: what comes meanwhile lies elsewhere.

        ``near`` is resolved at the end of capture of the newest product; other regions stay where they are. Where there
        is no product yet none counts, not one either that comes a moment later: the robot is elsewhere by then.
        """
        assert request.region is not None
        region, frame = request.region, request.region_frame
        if region.near_frame is None:
            return region, frame, request.t_ns
        newest = self._search(request, until_s, type=request.product, robot=robot, limit=10)
        t_ns = int(newest[0]["t1_ns"]) if newest else None
        try:
            T = self._dpm.pose(robot, frame, region.near_frame, t_ns, until_s)
        except ProductNotFoundError:  # nobody knows it at that time
            T = self._dpm.pose(robot, frame, region.near_frame, None, until_s)
        placed = region.resolved(float(T.matrix[0, 3]), float(T.matrix[1, 3]))
        return placed, frame, _NEVER_NS if t_ns is None else t_ns

    def _seen_from(self, region: Region, frame: str, home: str, robot: str, t_ns: int, until_s: float) -> Region:
        if home == frame:
            return region
        return translate.region_in(region, self._dpm.pose(robot, home, frame, t_ns, until_s).matrix)

    def pose(self, robot: str, parent: str, child: str, t_ns: int, until_s: float) -> UncertainTransform:
        """``T_parent_child`` at a time, from the DPM."""
        return self._dpm.pose(robot, parent, child, t_ns, until_s)

    def _now_ns(self, request: ProductRequest) -> int:
        """The mission time that ages are of: the one asked for, else now."""
        return self._clock.now_ns() if request.t_ns is None else request.t_ns

    def _search(
        self, request: ProductRequest, until_s: float, last_ns: int | None = None, **parameters: object
    ) -> list[dict[str, Any]]:
        """Metadata of usable products, newest first; of those captured until ``last_ns``, else the time asked for."""
        until_ns = request.t_ns if last_ns is None else last_ns
        if until_ns == _NEVER_NS:
            return []
        items = self._usable(self._dpm.search(until_s, **parameters, t1=until_ns))
        return [i for i in items if until_ns is None or int(i["t1_ns"]) <= until_ns]

    @staticmethod
    def _usable(items: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        return [i for i in items if i.get("quality", {}).get("status") != "FAILED" and i.get("dfpc") not in _DERIVED]

    @staticmethod
    def _candidate(
        sources: Sequence[Header], robot: str, coverage: float | None, resolution_m: float | None
    ) -> Candidate:
        degraded = any(h.quality.status != "OK" for h in sources)
        return Candidate(
            sources[0].id,
            robot,
            max(h.t1_ns for h in sources),
            min(h.t1_ns for h in sources),
            resolution_m,
            coverage,
            "DEGRADED" if degraded else "OK",
        )

    def _whole(self, stored: Stored) -> Found:
        h = stored.header
        candidate = self._candidate([h], stored.robot, None, h.resolution_m)
        return Found(
            candidate,
            (h,),
            stored.value,
            h.frame,
            h.child,
            whole=True,
            payload=stored.payload,
            encoding=stored.encoding,
        )

    def _window(self, stored: Stored, region: Region | None, robot: str) -> Found:
        robots = () if robot == "any" else (robot,)
        h, manifest = stored.header, stored.manifest
        coverage = float(h.quality.metrics.get("coverage", math.nan))
        if region is None:
            known: float | None = None
        else:
            known = (
                translate.grid_coverage(stored.value.geometry, translate.observed_cells(stored.value), region)
                if math.isnan(coverage)
                else coverage
            )
        oldest_ns = int(manifest.get("oldest_ns", h.t0_ns))
        candidate = Candidate(
            h.id, stored.robot, h.t1_ns, min(oldest_ns, h.t1_ns), h.resolution_m, known, str(h.quality.status)
        )
        return Found(candidate, (h,), stored.value, h.frame, region=region, robots=robots)
