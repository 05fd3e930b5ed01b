# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search of the DPM for products that may answer a request, with one method for each kind of product."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cdff_common.clock import NS_PER_S, Clock
from cdff_common.errors import CdffError, ExtrapolationError, FrameNotFoundError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import CovarianceKind, Header
from cdff_common.interfaces.profile import Profile
from cdff_common.types import NavigationMap, Pointcloud
from cdff_core.orchestration import conversion
from cdff_core.orchestration.acceptance import Assessment, ProductCandidate, assess, best_candidate
from cdff_core.orchestration.accuracy import Accuracy, sigmas_of
from cdff_core.orchestration.coverage import RegionCells, RegionCoverage, observed_points, reach_m
from cdff_core.orchestration.request import ProductRequest
from cdff_core.orchestration.world import ProviderId
from services.orchestrator.dpm import CACHED, DERIVED_DFPC, DpmClient, StoredProduct

#: Largest number of clouds and of maps merged to cover a region.
_CLOUDS, _MAPS = 8, 8
#: Number of the newest products among which one in the requested frame is preferred.
_NEWEST = 40
#: Size of the cells covered by a point without a requested resolution, metres.
_CLOUD_CELL_M = 0.5
#: Limit of the capture time if no product qualifies.
_NEVER_NS = -1
#: ``dfpc`` of derived products; their sources are used instead.
_DERIVED = ("dpm", DERIVED_DFPC)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class ProductMatch:
    """A possible reply, in the type and frame of the product, cropped to the region.

    Attributes
    ----------
    candidate : ProductCandidate
    sources : tuple of Header
        Headers of its source products, newest first.
    value : Any
        A ``cdff_common.types`` object, or the ``UncertainTransform`` of a pose from the frame tree.
    frame, child : str
        Frames of the value.
    is_unmodified : bool
        True if it is one unmodified stored product.
    region : Region or None
        The region in ``frame``.
    robots : tuple of str
        Robots whose measurements were requested; empty for all.
    moved_by : UncertainTransform or None
        Transform applied to the newest part, if any.
    stored : StoredProduct or None
        The product of the DPM that holds the value; None for a modified value.
    """

    candidate: ProductCandidate
    sources: tuple[Header, ...]
    value: Any
    frame: str
    child: str | None = None
    is_unmodified: bool = False
    region: Region | None = None
    robots: tuple[str, ...] = ()
    moved_by: UncertainTransform | None = None
    stored: StoredProduct | None = None


@dataclass(frozen=True, slots=True)
class ProductFinder:
    """Search for products that may answer a request.

    ``find`` raises UnavailableError if the DPM is unreachable, and InputError if no product can meet the
    request.
    """

    dpm: DpmClient
    clock: Clock
    profile: Callable[[], Profile]
    #: Matches of the last whole products by id: their delivered forms are kept with them.
    _matches: OrderedDict[str, ProductMatch] = field(init=False, default_factory=OrderedDict)
    _lock: threading.Lock = field(init=False, default_factory=threading.Lock)

    def find(
        self, request: ProductRequest, robots: Sequence[str], until_s: float
    ) -> tuple[tuple[ProductMatch, Assessment] | None, str]:
        """Return the best match with its assessment, and its unmet requirements or why there is none."""
        methods: dict[str, Callable[[ProductRequest, str, float], ProductMatch | None]] = {
            "pose": self._pose,
            "pointcloud": self._pointcloud,
            "dem": self._dem,
            "navigation_map": self._navigation_map,
        }
        find = methods.get(request.product, self._newest)
        matches, reasons = [], []
        # Elevation of several robots is pooled in one window; other products are of one robot.
        for robot in ("any",) if request.product == "dem" and request.robot == "any" else robots:
            try:
                match = find(request, robot, until_s)
            except (FrameNotFoundError, ExtrapolationError, ProductNotFoundError) as error:
                reasons.append(str(error))
                continue
            if match is None:
                location = "for it" if request.region is None else "in the region (coverage 0)"
                reasons.append(f"the DPM holds no {request.product} of {robot} {location}")
            else:
                matches.append(_with_accuracy(match) if request.accuracy.is_set else match)
        now_ns = self.clock.now_ns()
        choice = best_candidate([m.candidate for m in matches], request, now_ns)
        if choice is None:
            return None, "; ".join(reasons)
        match = next(m for m in matches if m.candidate is choice[0])
        return (match, choice[1]), choice[1].unmet

    def has_frame(self, frame: str, robots: Sequence[str], until_s: float) -> bool:
        """Return True if the frame tree of the DPM connects a frame to the site or a robot at any time."""
        for robot in robots:
            for other in ("site", f"{robot}/base"):
                try:
                    self.dpm.pose(robot, other, frame, None, until_s)
                except (FrameNotFoundError, ProductNotFoundError) as error:
                    if not error.retriable:
                        continue  # not connected; a retriable error means not connected at that time
                return True
        return False

    def coverage(
        self,
        request: ProductRequest,
        robots: Sequence[str],
        match: ProductMatch | None,
        until_s: float,
        horizon_s: float,
    ) -> RegionCoverage:
        """Return the part of the region in a match, and the part that each robot can observe in
        ``horizon_s``.

        Raises
        ------
        CdffError
            If the location of the region is unknown.
        """
        region, frame = (None, "") if match is None else (match.region, match.frame)
        if region is None:
            region, frame, _ = self._resolved_region(request, robots[0], until_s)
        # Larger than the cells of the match, so that each covered one contains the centre of one of those.
        resolution_m = 0.0 if match is None else match.candidate.resolution_m or 0.0
        cells = RegionCells.of(region, 1.5 * resolution_m)
        held_cells = 0
        if match is not None and match.value is not None and match.candidate.status != "FAILED":
            held_cells = cells.containing(observed_points(match.value))
        reach: dict[str, int] = {}
        for robot in robots:
            radius_m = reach_m(self.profile().robot(robot), horizon_s)
            if radius_m is None:
                continue
            try:
                T = self.dpm.pose(robot, frame, f"{robot}/base", None, until_s)
            except (FrameNotFoundError, ExtrapolationError, ProductNotFoundError):
                continue  # unknown position: the robot may be near
            reach[robot] = cells.near((float(T.matrix[0, 3]), float(T.matrix[1, 3])), radius_m)
        required_count = max(math.floor(request.min_coverage * len(cells.centres_m)), 1)
        pooled = request.product == "dem" and request.robot == "any"
        return RegionCoverage(cells.all, held_cells, required_count, reach, pooled)

    # -- one method per product type

    def _newest(self, request: ProductRequest, robot: str, until_s: float) -> ProductMatch | None:
        """Return the newest product, of those in the requested frame if there are any."""
        if request.product != "track" and request.t_ns is None:
            newest = self._newest_usable(request, robot, until_s, type=request.product)
            if newest is not None and newest.header.frame == request.frame:
                return self._whole(newest)
        items = self._search(request, until_s, type=request.product, robot=robot, limit=_NEWEST)
        if not items:
            return None
        in_frame = [i for i in items if i["frame"] == request.frame] or items
        item = _best_track(in_frame) if request.product == "track" else in_frame[0]
        stored = self.dpm.value(str(item["id"]), robot, until_s)
        return self._whole(stored)

    def _pose(self, request: ProductRequest, robot: str, until_s: float) -> ProductMatch | None:
        """Return the newest pose, or the one at the requested time, in the requested frame."""
        child = request.child or f"{robot}/base"
        newest: StoredProduct | None = None
        for frame in dict.fromkeys((child, f"{robot}/base")):
            newest = newest or self._newest_usable(request, robot, until_s, type="pose", child=frame)
        t_ns = request.t_ns
        if t_ns is None:
            if newest is None:
                return None
            if (newest.header.frame, newest.header.child) == (request.frame, child):
                return self._whole(newest)
            t_ns = newest.header.t1_ns
        T = self.dpm.pose(robot, request.frame, child, t_ns, until_s)
        source = () if newest is None else (newest.header,)
        status = "OK" if newest is None else str(newest.header.quality.status)
        candidate = ProductCandidate(source[0].id if source else "", robot, t_ns, t_ns, status=status)
        return ProductMatch(candidate, source, T, request.frame, child)

    def _pointcloud(self, request: ProductRequest, robot: str, until_s: float) -> ProductMatch | None:
        """Return the newest cloud of the region, or several merged to cover it, newest first."""
        if request.region is None:
            return self._newest(request, robot, until_s)
        region, frame, newest_ns = self._resolved_region(request, robot, until_s)
        now_ns = self._now_ns(request)
        cell_m = request.resolution_m or _CLOUD_CELL_M
        parts: list[Pointcloud] = []
        sources: list[Header] = []
        moved_by: UncertainTransform | None = None
        merged, coverage = None, 0.0
        for item in self._clouds(request, robot, region, frame, newest_ns, until_s):
            if sources and now_ns - int(item["t1_ns"]) > request.max_age_s * NS_PER_S:
                break
            stored = self.dpm.value(str(item["id"]), robot, until_s)
            h, cloud = stored.header, stored.value
            if h.frame != frame:
                # The transform is that at the time of the cloud, since the frame may move with the robot.
                T = self.dpm.pose(robot, frame, h.frame, h.t1_ns, until_s)
                cloud, moved_by = conversion.cloud_in(cloud, T, frame), moved_by or T
            part = conversion.cropped_cloud(cloud, region)
            if not len(part.points_m):
                continue
            parts.append(part)
            sources.append(h)
            merged = conversion.merged_clouds(parts)
            coverage = conversion.cloud_coverage(merged, region, cell_m)
            if coverage >= max(request.min_coverage, 1e-12):
                break
        if merged is None:
            return None
        if request.resolution_m is not None:
            merged = conversion.thinned_cloud(merged, request.resolution_m)
        candidate = self._candidate(sources, robot, coverage, request.resolution_m)
        return ProductMatch(candidate, tuple(sources), merged, frame, region=region, moved_by=moved_by)

    def _clouds(
        self,
        request: ProductRequest,
        robot: str,
        region: Region,
        frame: str,
        newest_ns: int | None,
        until_s: float,
    ) -> list[dict[str, Any]]:
        """Return clouds that may overlap the region, newest first; those in moving frames have no fixed
        position.
        """
        query = {"type": "pointcloud", "robot": robot, "limit": _CLOUDS}
        items = self._search(request, until_s, newest_ns, region=region.text, frame=frame, **query)
        return items or [i for i in self._search(request, until_s, newest_ns, **query) if i["frame"] != frame]

    def _dem(self, request: ProductRequest, robot: str, until_s: float) -> ProductMatch | None:
        """Return the window pooled from all patches of the region, if one is new enough."""
        if request.region is None:
            stored = self.dpm.window(until_s, robot=robot, resolution_m=request.resolution_m, t1=request.t_ns)
            return self._window(stored, None, robot)
        region, frame, newest_ns = self._resolved_region(request, robot, until_s)
        items = self._search(
            request, until_s, newest_ns, type="dem", robot=robot, region=region.text, frame=frame, limit=5
        )
        if not items:
            return None
        # Maps of several robots have different frames: the DPM resamples them into the requested one.
        dem_frame = request.frame if robot == "any" else str(items[0]["frame"])
        newest = ProductCandidate(str(items[0]["id"]), robot, int(items[0]["t1_ns"]), int(items[0]["t1_ns"]))
        local = self._region_in(region, frame, dem_frame, robot, newest.t1_ns, until_s)
        if any(
            m.startswith(("age", "time")) for m in assess(newest, request, self.clock.now_ns()).violations
        ):
            header = Header.from_dict(items[0])
            return ProductMatch(newest, (header,), None, dem_frame, region=local)
        stored = self.dpm.window(
            until_s,
            robot=robot,
            region=local.text,
            frame=dem_frame,
            resolution_m=request.resolution_m,
            t1=newest_ns,
        )
        return self._window(stored, local, robot)

    def _navigation_map(self, request: ProductRequest, robot: str, until_s: float) -> ProductMatch | None:
        """Return the newest navigation map of the region, or several of the same grid merged."""
        if request.region is None:
            return self._newest(request, robot, until_s)
        region, frame, newest_ns = self._resolved_region(request, robot, until_s)
        items = self._search(
            request,
            until_s,
            newest_ns,
            type="navigation_map",
            robot=robot,
            region=region.text,
            frame=frame,
            limit=_MAPS,
        )
        parts: list[NavigationMap] = []
        sources: list[Header] = []
        match: ProductMatch | None = None
        for item in items:
            if sources and self._now_ns(request) - int(item["t1_ns"]) > request.max_age_s * NS_PER_S:
                break
            stored = self.dpm.value(str(item["id"]), robot, until_s)
            h, value = stored.header, stored.value
            local = self._region_in(region, frame, h.frame, robot, h.t1_ns, until_s)
            grid, observed = value.geometry, conversion.observed_cells(value)
            if conversion.grid_coverage(grid, observed, local) <= 0.0:
                continue
            if parts and not grid.shares_cells_with(parts[0].geometry):
                continue
            parts.append(conversion.masked_map(value, local))
            sources.append(h)
            merged = conversion.coarser_map(conversion.merged_maps(parts), request.resolution_m)
            coverage = conversion.grid_coverage(merged.geometry, conversion.observed_cells(merged), local)
            candidate = self._candidate(sources, robot, coverage, merged.geometry.resolution_m)
            match = ProductMatch(candidate, tuple(sources), merged, h.frame, region=local)
            if coverage >= max(request.min_coverage, 1e-12):
                break
        return match

    # -- shared

    def _resolved_region(
        self, request: ProductRequest, robot: str, until_s: float
    ) -> tuple[Region, str, int | None]:
        """Return the resolved region of a request, its frame and the latest capture time that counts.

        ``near`` is resolved at the end of capture of the newest product; other regions are fixed. Without a
        product none counts, since the robot moves before the next one.
        """
        assert request.region is not None
        region, frame = request.region, request.region_frame
        if region.near_frame is None:
            return region, frame, request.t_ns
        newest = self._search(request, until_s, type=request.product, robot=robot, limit=10)
        t_ns = int(newest[0]["t1_ns"]) if newest else None
        try:
            T = self.dpm.pose(robot, frame, region.near_frame, t_ns, until_s)
        except ProductNotFoundError:  # unknown at that time
            T = self.dpm.pose(robot, frame, region.near_frame, None, until_s)
        resolved = region.resolved(float(T.matrix[0, 3]), float(T.matrix[1, 3]))
        return resolved, frame, _NEVER_NS if t_ns is None else t_ns

    def _region_in(
        self, region: Region, frame: str, target_frame: str, robot: str, t_ns: int, until_s: float
    ) -> Region:
        if target_frame == frame:
            return region
        return conversion.region_in(region, self.dpm.pose(robot, target_frame, frame, t_ns, until_s).matrix)

    def _now_ns(self, request: ProductRequest) -> int:
        """Return the reference time of ages: the requested time, else the mission time."""
        return self.clock.now_ns() if request.t_ns is None else request.t_ns

    def accuracies(self, provider: ProviderId, product: str, until_s: float) -> dict[str, Accuracy]:
        """Return the accuracy of the newest product of each implementation of a DFPC that the DPM holds."""
        parameters = {"type": product, "robot": provider.robot, "dfpc": provider.dfpc, "limit": _NEWEST}
        newest: dict[str, str] = {}
        for item in self._usable(self.dpm.search(until_s, **parameters)):
            _, _, implementation = str(item.get("producer", "")).partition("/")
            newest.setdefault(implementation.partition("/")[0], str(item["id"]))
        matches = {
            implementation: self._whole(self.dpm.value(product_id, provider.robot, until_s))
            for implementation, product_id in newest.items()
        }
        known = {name: _with_accuracy(match).candidate.accuracy for name, match in matches.items()}
        return {name: accuracy for name, accuracy in known.items() if accuracy is not None}

    def distance_m(self, request: ProductRequest, robot: str, until_s: float) -> float | None:
        """Return the distance from a robot to the farthest corner of the region; None if unknown, or without
        one.
        """
        if request.region is None:
            return None
        try:
            region, frame, _ = self._resolved_region(request, robot, until_s)
            T = self.dpm.pose(robot, frame, f"{robot}/base", None, until_s)
        except CdffError:
            return None
        x0, y0, x1, y1 = region.bounds
        x, y = float(T.matrix[0, 3]), float(T.matrix[1, 3])
        return math.hypot(max(abs(x0 - x), abs(x1 - x)), max(abs(y0 - y), abs(y1 - y)))

    def _newest_usable(
        self, request: ProductRequest, robot: str, until_s: float, **parameters: object
    ) -> StoredProduct | None:
        """Return the newest product that is neither FAILED nor derived.

        If the request has bounds on the accuracy, it is the best of the newest products of all DFPCs.
        """
        if not request.accuracy.is_set:
            newest = self.dpm.newest(until_s, robot, **parameters)
            if newest is None or newest.manifest.get("dfpc") not in _DERIVED:
                return newest
        items = self._usable(self.dpm.search(until_s, robot=robot, limit=_NEWEST, **parameters))
        newest_of: dict[str, dict[str, Any]] = {}
        for item in items if request.accuracy.is_set else items[:1]:
            newest_of.setdefault(str(item["dfpc"]), item)
        stored = {str(i["id"]): self.dpm.value(str(i["id"]), robot, until_s) for i in newest_of.values()}
        candidates = (_with_accuracy(self._whole(s)).candidate for s in stored.values())
        best = best_candidate(candidates, request, self.clock.now_ns())
        return None if best is None else stored[best[0].id]

    def _search(
        self, request: ProductRequest, until_s: float, newest_ns: int | None = None, **parameters: object
    ) -> list[dict[str, Any]]:
        """Return metadata of usable products that end by ``newest_ns``, newest first.

        The default of ``newest_ns`` is the requested time. ``until_s`` is the deadline of the search.
        """
        limit_ns = request.t_ns if newest_ns is None else newest_ns
        if limit_ns == _NEVER_NS:
            return []
        items = self._usable(self.dpm.search(until_s, **parameters, t1=limit_ns))
        return [i for i in items if limit_ns is None or int(i["t1_ns"]) <= limit_ns]

    @staticmethod
    def _usable(items: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        return [
            i
            for i in items
            if i.get("quality", {}).get("status") != "FAILED" and i.get("dfpc") not in _DERIVED
        ]

    @staticmethod
    def _candidate(
        sources: Sequence[Header], robot: str, coverage: float | None, resolution_m: float | None
    ) -> ProductCandidate:
        degraded = any(h.quality.status != "OK" for h in sources)
        return ProductCandidate(
            sources[0].id,
            robot,
            max(h.t1_ns for h in sources),
            min(h.t1_ns for h in sources),
            resolution_m,
            coverage,
            "DEGRADED" if degraded else "OK",
        )

    def _whole(self, stored: StoredProduct) -> ProductMatch:
        h = stored.header
        with self._lock:
            match = self._matches.get(h.id)
            if match is None or match.stored is not stored:
                candidate = self._candidate([h], stored.robot, None, h.resolution_m)
                match = ProductMatch(
                    candidate, (h,), stored.value, h.frame, h.child, is_unmodified=True, stored=stored
                )
                self._matches[h.id] = match
            self._matches.move_to_end(h.id)
            while len(self._matches) > CACHED:
                self._matches.popitem(last=False)
            return match

    def _window(self, stored: StoredProduct, region: Region | None, robot: str) -> ProductMatch:
        h, elevation, coverage = stored.header, stored.value, None
        if region is not None:
            coverage = float(h.quality.metrics.get("coverage", math.nan))
            if math.isnan(coverage):
                observed = conversion.observed_cells(elevation)
                coverage = conversion.grid_coverage(elevation.geometry, observed, region)
        candidate = ProductCandidate(
            id=h.id,
            robot=stored.robot,
            t1_ns=h.t1_ns,
            oldest_t1_ns=min(int(stored.manifest.get("oldest_ns", h.t0_ns)), h.t1_ns),
            resolution_m=h.resolution_m,
            coverage=coverage,
            status=str(h.quality.status),
        )
        robots = () if robot == "any" else (robot,)
        return ProductMatch(candidate, (h,), elevation, h.frame, region=region, robots=robots, stored=stored)


def _with_accuracy(match: ProductMatch) -> ProductMatch:
    """Return a match with the accuracy of its candidate."""
    sigma_m, sigma_deg = sigmas_of(match.value)
    kind = match.sources[0].quality.covariance_kind if match.sources else CovarianceKind.NONE
    if isinstance(match.value, UncertainTransform):  # composed over the frame tree
        kind = CovarianceKind.NONE if match.value.covariance is None else CovarianceKind.FORMAL
    accuracy = Accuracy(sigma_m, sigma_deg, kind, match.candidate.status)
    return replace(match, candidate=replace(match.candidate, accuracy=accuracy))


def _best_track(items: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the best track of the two newest capture times: one with a position, else a measured direction.

    The states of the objects of an image are stored one after the other: those of the newest one may still be
    incomplete, and without the previous one the answer would be an object that was only predicted.
    """
    newest_ns = sorted({int(i["t1_ns"]) for i in items})[-2:]
    candidates = [i for i in items if int(i["t1_ns"]) in newest_ns]
    predicted = {"coasting", "lost"}
    return max(
        candidates,
        key=lambda i: (
            i.get("box_m") is not None,
            predicted.isdisjoint(i.get("quality", {}).get("reasons", ())),
            int(i["t1_ns"]),
        ),
    )
