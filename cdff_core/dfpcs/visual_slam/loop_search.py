# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search and verification of loops between keyframes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_core.dfpcs.visual_slam.configuration import LoopGates
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframeMap
from cdff_core.dfpcs.visual_slam.view_locator import ViewLocator
from cdff_core.keyframe_graph.loops import DriftLimits, Loop
from cdff_core.visual_map.place_index import GrowingPlaceIndex

#: Largest angle between the optical axes of near keyframes, and largest distance in median depths.
_MAX_ANGLE, _MAX_DEPTHS = np.radians(45.0), 0.7
#: Largest drift over a loop: constant translation, m, constant rotation, rad, and rotation per metre.
_DRIFT_M, _DRIFT_RAD, _DRIFT_RAD_PER_M = 0.5, 0.1, 0.01


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedLoop(Loop):
    """Loop with the rows of the common points in both keyframes."""

    rows_old: IntArray
    rows_new: IntArray


class LoopSearch:
    """Selects loop candidates and verifies them."""

    def __init__(self, locator: ViewLocator, index: GrowingPlaceIndex, gates: LoopGates) -> None:
        self._locator, self._index, self._gates = locator, index, gates
        self._drift = DriftLimits(_DRIFT_M, gates.drift_ratio, _DRIFT_RAD, _DRIFT_RAD_PER_M)
        #: Number of refused candidates by reason.
        self.refusals: Counter[str] = Counter()

    def clear(self) -> None:
        """Reset the counts."""
        self.refusals.clear()

    def of_keyframe(self, keyframes: VisualKeyframeMap, key: int) -> Iterator[VerifiedLoop]:
        """Yield the verified loops of a keyframe: with near keyframes first, then with similar ones."""
        lengths_m = keyframes.path_lengths_m(key)
        linked_keys = {key, *keyframes.linked_with(key)}
        nearby_keys = self._near(keyframes, key, linked_keys, lengths_m)
        descriptors = keyframes.keyframes[key].points.descriptors
        similar = self._index.nearest(descriptors, self._gates.similar, {*linked_keys, *nearby_keys})
        for old in [*nearby_keys, *similar]:
            if loop := self.verify(keyframes, old, key, lengths_m):
                yield loop

    def verify(
        self, keyframes: VisualKeyframeMap, old: int, key: int, lengths_m: dict[int, float]
    ) -> VerifiedLoop | None:
        """Return the loop between two keyframes; None if their points or the graph contradict it.

        ``lengths_m`` are the lengths of the paths from ``key``; keyframes that are not connected with it are
        not compared with the graph.
        """
        new = keyframes.keyframes[key]
        try:
            located_view = self._locator.locate(
                new.features(), new.focal_px, keyframes, [old], None, self._gates.min_inliers
            )
        except RefusedError as error:
            self.refusals[next(iter(error.reasons), "not_located").split(":")[0]] += 1
            return None
        T_old_key = located_view.T_reference_camera
        if old in lengths_m and not self._drift.explain(
            keyframes, old, key, T_old_key.matrix, lengths_m[old]
        ):
            self.refusals["contradicts_graph"] += 1
            return None
        rows_new, rows_old = located_view.shared[old]
        return VerifiedLoop(old, key, T_old_key, rows_old, rows_new)

    def _near(
        self, keyframes: VisualKeyframeMap, key: int, known: set[int], lengths_m: dict[int, float]
    ) -> list[int]:
        """Return the nearest connected keyframes that look in a similar direction."""
        T, depth_m = keyframes.poses[key], keyframes.keyframes[key].median_depth_m
        differences = {}
        for k in lengths_m:
            if k in known:
                continue
            T_key_k = se3.inverse(T) @ keyframes.poses[k]
            depths = float(np.linalg.norm(T_key_k[:3, 3])) / depth_m
            angle = float(np.arccos(np.clip(T_key_k[2, 2], -1.0, 1.0)))
            if depths < _MAX_DEPTHS and angle < _MAX_ANGLE:
                differences[k] = depths + angle
        return sorted(differences, key=lambda k: (differences[k], k))[: self._gates.near]
