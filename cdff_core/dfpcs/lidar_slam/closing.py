# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loops: which places may be the same, and whether they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import Pointcloud
from cdff_core.cloud_matching.acceptance import judged
from cdff_core.cloud_matching.matcher import Cloud, CloudMatcher, Found
from cdff_core.cloud_matching.search import Search
from cdff_core.dfns.loop_detection._interface import LoopDetectionInputs, LoopDetectionOutputs
from cdff_core.dfpcs.lidar_slam.configuration import LidarSlamConfig
from cdff_core.dfpcs.lidar_slam.keyframe_map import KeyFrame, KeyFrameMap

Float = NDArray[np.float64]

#: Key frames that are kept prepared for registration.
_PREPARED = 16


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A verified loop: ``T_old_new`` of two key frames."""

    old: int
    new: int
    T: UncertainTransform


class LoopCloser:
    """Describe, detect, verify.

    Parameters
    ----------
    dfpc : Dfpc
        Whose slots detect and those of ``CloudMatcher`` are used.
    config : LidarSlamConfig
    """

    def __init__(self, dfpc: Dfpc, config: LidarSlamConfig) -> None:
        c = self._config = config
        self._detect, self._thin_matched = dfpc.dfn("detect"), dfpc.dfn("thin_matched")
        self._matcher = CloudMatcher(dfpc, c.loops.keypoint_voxels, c.loops.noise_voxels)
        self._prepared: dict[int, Cloud] = {}
        self.refusals: Counter[str] = Counter()

    def described(self, frame: KeyFrame) -> KeyFrame:
        """The key frame with its descriptor."""
        return KeyFrame(frame.stamp_ns, frame.points_m, self._look(frame, None).descriptor)

    def loops(self, places: KeyFrameMap, key: int, recent: Collection[int] = ()) -> Iterator[Loop]:
        """Verified loops of a key frame that has ended: near ones by the graph first, then those that look alike.

        Parameters
        ----------
        recent : collection of int
            Key frames on the way just come, which are no news.
        """
        ways = places.ways_m(key)
        near = self._near(places, key, ways, recent)
        found = False
        for old in near[: self._config.candidates]:
            loop = self.verified(places, old, key, se3.inverse(places.poses[old]) @ places.poses[key], ways)
            if loop is not None:
                found = True
                yield loop
        if found and places.root in ways:
            return  # a part of its own looks on for the rest of the map
        for old, guess in self._alike(places, key, ways, recent):
            loop = self.verified(places, old, key, guess, ways) or self._searched(places, old, key, ways)
            if loop is not None:
                yield loop
                return

    def found_again(self, places: KeyFrameMap, key: int, around: Iterable[int]) -> list[Loop]:
        """The loops of a key frame with some others, found without a guess."""
        found = (self._searched(places, old, key, {}) for old in around)
        return [loop for loop in found if loop is not None]

    def forget(self, key: int) -> None:
        """Drop what is kept of a key frame."""
        self._prepared.pop(key, None)

    def _near(self, places: KeyFrameMap, key: int, ways: dict[int, float], recent: Collection[int]) -> list[int]:
        """Ended places that the graph puts within the search radius, nearest first."""
        here = places.poses[key][:3, 3]
        distance = {
            k: float(np.linalg.norm(places.poses[k][:3, 3] - here))
            for k in ways
            if k != key and k not in recent and places.frames[k].descriptor is not None
        }
        near = [k for k, d in distance.items() if d < self._config.search_radius_m]
        return sorted(near, key=lambda k: (distance[k], k))

    def _alike(
        self, places: KeyFrameMap, key: int, ways: dict[int, float], recent: Collection[int]
    ) -> list[tuple[int, Float]]:
        """Places that look alike and that the graph does not put elsewhere, with a guess of T_old_key."""
        others = [
            k
            for k, f in places.frames.items()
            if k not in (key, *recent)
            and f.descriptor is not None
            and (k not in ways or self._may_meet(places, k, key, ways[k]))
        ]
        if not others:
            return []
        database = np.stack([d for d in (places.frames[k].descriptor for k in others) if d is not None])
        seen = self._look(places.frames[key], database)
        rows = zip(seen.candidates, seen.transforms, strict=True)
        return [(others[int(row)], T) for row, T in rows][: self._config.candidates]

    def _look(self, frame: KeyFrame, database: NDArray[np.float32] | None) -> LoopDetectionOutputs:
        found: LoopDetectionOutputs = self._detect.process(
            LoopDetectionInputs(np.asarray(frame.points_m, dtype=np.float64), database)
        )
        return found

    def _may_meet(self, places: KeyFrameMap, old: int, key: int, way_m: float) -> bool:
        """Whether two places of one part may be one after the drift that is allowed on the way between them."""
        c = self._config
        apart_m = float(np.linalg.norm(places.poses[old][:3, 3] - places.poses[key][:3, 3]))
        allowed_m = c.drift_allowed_m + c.drift_allowed_share * way_m + c.search_radius_m
        return apart_m < allowed_m

    def verified(self, places: KeyFrameMap, old: int, key: int, guess: Float, ways: dict[int, float]) -> Loop | None:
        """Register from a guess of T_old_key; None where the clouds or the graph do not bear it out.

        Parameters
        ----------
        ways : dict of int to float
            Ways along the graph from ``key``; places that are not in it are not compared with the graph.
        """
        source, target = self._cloud(places, key), self._cloud(places, old)
        if source is None or target is None:
            return None
        try:
            found = self._matcher.refined(source, target, guess, {})
        except (RefusedError, DegenerateGeometryError) as error:
            self.refusals[next(iter(error.reasons), "not_registered")] += 1
            return None
        return self._accepted(places, old, key, found, ways)

    def _searched(self, places: KeyFrameMap, old: int, key: int, ways: dict[int, float]) -> Loop | None:
        """Register without a guess."""
        source, target = self._cloud(places, key), self._cloud(places, old)
        if source is None or target is None:
            return None
        try:
            search = Search(self._matcher, source, target, self._config.loops, self._judged)
            found, _ = next(search.acceptable(), (None, None))
        except InputError:
            found = None
        return None if found is None else self._accepted(places, old, key, found, ways)

    def _accepted(self, places: KeyFrameMap, old: int, key: int, found: Found, ways: dict[int, float]) -> Loop | None:
        """The loop, where both clouds agree on it and the graph allows it."""
        quality = self._judged(found)
        if quality.status is Status.FAILED:
            self.refusals[quality.reasons[0].split(":")[0]] += 1
            return None
        if old in ways and not self._allowed(places, old, key, found.T_target_source, ways[old]):
            self.refusals["contradicts_graph"] += 1
            return None
        T = UncertainTransform(found.T_target_source, found.assessment.covariance)
        return Loop(old, key, T)

    def _judged(self, found: Found) -> Quality:
        overlap = max(float(found.assessment.overlap_source), float(found.assessment.overlap_target))
        return judged(found, overlap, self._config.loops)

    def _allowed(self, places: KeyFrameMap, old: int, key: int, T: Float, way_m: float) -> bool:
        """Whether a loop differs from the graph by no more than drift on the way round explains."""
        c = self._config
        off = T @ se3.inverse(places.poses[key]) @ places.poses[old]
        turn = float(se3.rotation_angle(off[:3, :3]))
        shift_m = float(np.linalg.norm((se3.inverse(places.poses[old]) @ places.poses[key] - T)[:3, 3]))
        return (
            shift_m <= c.drift_allowed_m + c.drift_allowed_share * way_m
            and turn <= c.turn_allowed_rad + c.turn_allowed_rad_m * way_m
        )

    def _cloud(self, places: KeyFrameMap, key: int) -> Cloud | None:
        """A key frame's cloud thinned and with normals; None where too little is left."""
        if key not in self._prepared:
            frame = places.frames[key]
            value = Pointcloud.from_points(frame.points_m, frame="keyframe", stamp_ns=frame.stamp_ns)
            try:
                cloud = self._matcher.prepared(Sample("keyframe", frame.stamp_ns, key, value), self._thin_matched)
            except InputError:
                self.refusals["bad_cloud"] += 1
                return None
            while len(self._prepared) >= _PREPARED:
                self._prepared.pop(next(iter(self._prepared)))
            self._prepared[key] = cloud
        return self._prepared[key]
