# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection and verification of loop closures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.interfaces.product import Quality, Status
from cdff_core.cloud_matching.acceptance import registration_quality
from cdff_core.cloud_matching.configuration import MatchingGates
from cdff_core.cloud_matching.matcher import Cloud, CloudMatcher, Registration
from cdff_core.cloud_matching.search import AlignmentSearch
from cdff_core.dfns.loop_detection.interface import LoopDetectionInputs, LoopDetectionOutputs
from cdff_core.dfpcs.lidar_slam.configuration import LoopGates
from cdff_core.dfpcs.lidar_slam.keyframe_map import Keyframe, KeyframeMap
from cdff_core.keyframe_graph.loops import DriftLimits, Loop

Float = NDArray[np.float64]

#: Gates of the registration of two keyframes. The bounds of OK equal those of FAILED: a loop is accepted or
#: refused by overlap and agreement. A loop is also accepted if only the iteration limit was reached
#: (``not_converged``, DEGRADED), since the result passes the same gates and is compared with the graph.
MATCHING_GATES = MatchingGates(max_cliques=2, min_overlap=0.4, good_overlap=0.4, good_agreement=0.5)
#: Maximum number of prepared clouds in the cache.
_CACHED_CLOUDS = 16
#: Largest drift that may separate a loop from the graph.
_DRIFT = DriftLimits(translation_m=0.5, translation_ratio=0.03, rotation_rad=0.05, rotation_rad_per_m=0.001)


class LoopCloser:
    """Describes keyframes, detects loop candidates and verifies them."""

    def __init__(self, dfpc: Dfpc, gates: LoopGates) -> None:
        self._gates = gates
        self._detect, self._voxel_choice = dfpc.dfn("detect"), dfpc.dfn("voxel_choice")
        self._matcher = CloudMatcher(dfpc, MATCHING_GATES)
        self._clouds: dict[int, Cloud] = {}
        #: Number of refused candidates by reason.
        self.refusals: Counter[str] = Counter()

    def clear(self) -> None:
        """Remove all cached clouds and reset the counts."""
        self._clouds.clear()
        self.refusals.clear()

    def evict(self, key: int) -> None:
        """Remove the cached cloud of a keyframe that has changed."""
        self._clouds.pop(key, None)

    def with_place_descriptor(self, keyframe: Keyframe) -> Keyframe:
        """Return the keyframe with the descriptor of its place, by which similar places are found."""
        return replace(keyframe, descriptor=self._detect_in(keyframe, None).descriptor)

    def close(self, keyframes: KeyframeMap, key: int, excluded: Collection[int] = ()) -> Iterator[Loop]:
        """Yield the verified loops between a completed keyframe and near keyframes, then between it and
        similar ones.

        Keyframes in ``excluded``, such as the most recent ones, are not compared.
        """
        path_lengths_m = keyframes.path_lengths_m(key)
        is_closed = False
        for old in self._near(keyframes, key, path_lengths_m, excluded):
            guess = se3.inverse(keyframes.poses[old]) @ keyframes.poses[key]
            if loop := self.verify(keyframes, old, key, guess, path_lengths_m):
                is_closed = True
                yield loop
        if is_closed and keyframes.root in path_lengths_m:
            return  # without a connection to the root, similar keyframes are compared as well
        for old, guess in self._similar(keyframes, key, path_lengths_m, excluded):
            loop = self.verify(keyframes, old, key, guess, path_lengths_m)
            if loop := loop or self._search(keyframes, old, key, path_lengths_m):
                yield loop
                return

    def relocalise(self, keyframes: KeyframeMap, key: int, older_keys: Iterable[int]) -> list[Loop]:
        """Return the loops between a keyframe and older ones, registered without a guess."""
        loops = (self._search(keyframes, old, key, {}) for old in older_keys)
        return [loop for loop in loops if loop is not None]

    def verify(
        self, keyframes: KeyframeMap, old: int, key: int, guess: Float, path_lengths_m: dict[int, float]
    ) -> Loop | None:
        """Return the loop from a guess of ``T_old_key``; None if clouds or graph contradict it.

        ``path_lengths_m`` contains the length of the path from ``key`` to each connected keyframe. A loop
        with a keyframe that is not connected with ``key`` is not compared with the graph.
        """
        source, target = self._cloud(keyframes, key), self._cloud(keyframes, old)
        if source is None or target is None:
            return None
        try:
            registration = self._matcher.refine(source, target, guess, {})
        except RefusedError as error:
            self.refusals[next(iter(error.reasons), "not_registered")] += 1
            return None
        return self._accept(keyframes, old, key, registration, path_lengths_m)

    def _near(
        self, keyframes: KeyframeMap, key: int, path_lengths_m: dict[int, float], excluded: Collection[int]
    ) -> list[int]:
        """Return the nearest completed keyframes within the search radius."""
        position_m = keyframes.poses[key][:3, 3]
        distances = {
            k: keyframes.distance_m(k, position_m)
            for k in path_lengths_m
            if k != key and k not in excluded and keyframes.keyframes[k].descriptor is not None
        }
        nearby_keyframes = [
            k for k, distance_m in distances.items() if distance_m < self._gates.search_radius_m
        ]
        return sorted(nearby_keyframes, key=lambda k: (distances[k], k))[: self._gates.max_loop_candidates]

    def _similar(
        self, keyframes: KeyframeMap, key: int, path_lengths_m: dict[int, float], excluded: Collection[int]
    ) -> list[tuple[int, Float]]:
        """Return the keyframes with the most similar descriptors, with a guess of ``T_old_key``.

        Connected keyframes are omitted if they are farther away than drift along the path explains.
        """
        descriptors = {
            k: keyframe.descriptor
            for k, keyframe in keyframes.keyframes.items()
            if k != key and k not in excluded and keyframe.descriptor is not None
        }
        position_m = keyframes.poses[key][:3, 3]
        for k, length_m in path_lengths_m.items():
            range_m = _DRIFT.translation(length_m) + self._gates.search_radius_m
            if keyframes.distance_m(k, position_m) >= range_m:
                descriptors.pop(k, None)
        if not descriptors:
            return []
        detected = self._detect_in(keyframes.keyframes[key], np.stack(list(descriptors.values())))
        rows = zip(detected.candidates, detected.transforms, strict=True)
        keys = list(descriptors)
        return [(keys[int(row)], T) for row, T in rows][: self._gates.max_loop_candidates]

    def _detect_in(self, keyframe: Keyframe, database: NDArray[np.float32] | None) -> LoopDetectionOutputs:
        """Describe a keyframe and compare it with a database of descriptors (n, d)."""
        points_m = np.asarray(keyframe.points_m, dtype=np.float64)
        detected: LoopDetectionOutputs = self._detect.process(
            LoopDetectionInputs(points=points_m, database=database)
        )
        return detected

    def _search(
        self, keyframes: KeyframeMap, old: int, key: int, path_lengths_m: dict[int, float]
    ) -> Loop | None:
        """Return the loop registered without a guess; None if clouds or graph contradict it."""
        source, target = self._cloud(keyframes, key), self._cloud(keyframes, old)
        if source is None or target is None:
            return None
        try:
            search = AlignmentSearch(self._matcher, source, target, MATCHING_GATES, self._quality)
            registration, _ = next(search.acceptable(), (None, None))
        except InputError:
            return None
        if registration is None:
            return None
        return self._accept(keyframes, old, key, registration, path_lengths_m)

    def _accept(
        self,
        keyframes: KeyframeMap,
        old: int,
        key: int,
        registration: Registration,
        path_lengths_m: dict[int, float],
    ) -> Loop | None:
        """Return the loop if the registration passes the gates and agrees with the graph."""
        quality, T_old_key = self._quality(registration), registration.T_target_source
        if quality.status is Status.FAILED:
            self.refusals[quality.reasons[0].split(":")[0]] += 1
            return None
        if old in path_lengths_m and not _DRIFT.explain(keyframes, old, key, T_old_key, path_lengths_m[old]):
            self.refusals["contradicts_graph"] += 1
            return None
        return Loop(old, key, registration.transform)

    @staticmethod
    def _quality(registration: Registration) -> Quality:
        return registration_quality(registration, registration.overlap, MATCHING_GATES)

    def _cloud(self, keyframes: KeyframeMap, key: int) -> Cloud | None:
        """Return the prepared cloud of a keyframe; None if too few points remain."""
        if key not in self._clouds:
            points_m = keyframes.keyframes[key].points_m
            try:
                cloud = self._matcher.prepare(points_m, "keyframe", self._voxel_choice)
            except InputError:
                self.refusals["bad_cloud"] += 1
                return None
            while len(self._clouds) >= _CACHED_CLOUDS:
                self._clouds.pop(next(iter(self._clouds)))
            self._clouds[key] = cloud
        return self._clouds[key]
