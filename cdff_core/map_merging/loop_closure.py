# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loop closures between robots: selection of pairs of keyframes, and registration of their clouds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Generic, TypeVar

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from cdff_core.map_merging.robot_maps import Closure, KeyframeId, RobotMap

Pair = tuple[KeyframeId, KeyframeId]
#: Measurements at a keyframe: a cloud, or the points of an image.
PlaceT = TypeVar("PlaceT")


class InterRobotCloser(ABC, Generic[PlaceT]):
    """Selects pairs of keyframes by the anchors of the maps; estimates their relative poses without a guess.

    Since no guess is needed, an anchor may be wrong by metres.
    """

    def __init__(self, config: MergingConfig) -> None:
        self._config = config
        #: Number of keyframes in both maps at the last comparison of a pair.
        self._compared: dict[Pair, int] = {}
        #: Number of refused pairs by reason.
        self.refusals: Counter[str] = Counter()

    def pairs(self, maps: Sequence[RobotMap], closures: Iterable[Closure]) -> list[Pair]:
        """Return the pairs to compare, nearest first, at most ``trials`` of the configuration.

        Pairs that ``is_comparable`` excludes by their assumed relative pose are omitted.

        A refused pair is compared again when both maps together have grown by two keyframes.
        """
        closures = tuple(closures)
        closed_pairs = {closure.ends for closure in closures}
        closed = Counter(keyframe for closure in closures for keyframe in closure.ends)
        pairs: list[tuple[float, Pair]] = []
        for one, other in combinations(sorted(maps, key=lambda m: m.robot), 2):
            radius_m = self._config.search_radius_m + _sigma_m(one) + _sigma_m(other)
            keyframes = len(one.keyframes) + len(other.keyframes)
            for a, T_one_a in one.keyframes.items():
                for b, T_other_b in other.keyframes.items():
                    T_site_a, T_site_b = one.anchor.matrix @ T_one_a, other.anchor.matrix @ T_other_b
                    distance_m = np.linalg.norm(T_site_a[:3, 3] - T_site_b[:3, 3])
                    is_closed = (a, b) in closed_pairs or min(closed[a], closed[b]) >= self._config.candidates
                    if (
                        distance_m < radius_m
                        and not is_closed
                        and self.is_comparable(T_site_a, T_site_b)
                        and self._compared.get((a, b), -2) + 2 <= keyframes
                    ):
                        pairs.append((float(distance_m), (a, b)))
        return [pair for _, pair in sorted(pairs)[: self._config.trials]]

    def compare(self, pair: Pair, first: PlaceT, second: PlaceT, keyframes: int) -> Closure | None:
        """Return the closure of a pair, or None if it is refused.

        ``first`` and ``second`` are the measurements at its keyframes, each in the frame of its keyframe;
        ``keyframes`` is their number in both maps together.
        """
        self._compared[pair] = keyframes
        T_first_second = self.relative_pose(first, second)
        return None if T_first_second is None else Closure(*pair, T_first_second)

    def is_comparable(self, T_site_first: FloatArray, T_site_second: FloatArray) -> bool:
        """Return whether two keyframes may show the same place, by their assumed poses, (4, 4) each."""
        return True

    @abstractmethod
    def relative_pose(self, first: PlaceT, second: PlaceT) -> UncertainTransform | None:
        """Return ``T_first_second``; None, with the reason in ``refusals``, if it is not reliable."""


class LidarCloser(InterRobotCloser[Pointcloud]):
    """Loop closures of lidar maps: ``point_cloud_matching`` registers the clouds of two keyframes."""

    def __init__(self, config: MergingConfig) -> None:
        super().__init__(config)
        self._matching = Registry.default().make_dfpc("point_cloud_matching")
        self._matching.configure(config.matching)

    def relative_pose(self, first: Pointcloud, second: Pointcloud) -> UncertainTransform | None:
        """Return ``T_first_second`` of two clouds; None if the registration is not OK."""
        self._matching.call("forget", {})
        list(self._matching.step(Sample("target", first.stamp_ns, 0, first)))
        (output,) = self._matching.step(Sample("source", second.stamp_ns, 0, second))
        if output.quality.status is not Status.OK:
            self.refusals[next(iter(output.quality.reasons), "degraded").split(":")[0]] += 1
            return None
        registered: UncertainTransform = output.value.transform
        return registered


def _sigma_m(robot_map: RobotMap) -> float:
    """Return the largest standard deviation of the position of a map's anchor."""
    covariance = robot_map.anchor.covariance
    return 0.0 if covariance is None else float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
