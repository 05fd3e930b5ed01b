# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Closures between robots: which key frames may show the same ground, and whether they do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np

from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.merging import MergingConfig
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from cdff_core.map_merging.places import Closure, Place, RobotMap

Pair = tuple[Place, Place]


class InterRobotCloser:
    """Choose pairs of key frames and compare their surroundings.

    The anchors only say which pairs are worth a comparison. The comparison itself has no guess
    (``point_cloud_matching``), so that an anchor may be wrong by metres.

    Parameters
    ----------
    config : MergingConfig
    """

    def __init__(self, config: MergingConfig) -> None:
        self._config = config
        self._matching = Registry.default().make_dfpc("point_cloud_matching")
        self._matching.configure(config.matching)
        self._compared: dict[Pair, int] = {}
        self.refusals: Counter[str] = Counter()

    def pairs(self, maps: Sequence[RobotMap], closures: Iterable[Closure]) -> list[Pair]:
        """Pairs worth a comparison, nearest first, ``trials`` at most.

        A pair that was refused is compared again when both maps together have grown by two key frames.
        """
        closures = tuple(closures)
        linked = {closure.ends for closure in closures}
        closed = Counter(place for closure in closures for place in closure.ends)
        found: list[tuple[float, Pair]] = []
        for one, other in combinations(sorted(maps, key=lambda m: m.robot), 2):
            reach_m = self._config.search_radius_m + _sigma_m(one) + _sigma_m(other)
            grown = len(one.places) + len(other.places)
            for a, T_one_a in one.places.items():
                for b, T_other_b in other.places.items():
                    apart_m = np.linalg.norm(
                        (one.anchor.matrix @ T_one_a)[:3, 3] - (other.anchor.matrix @ T_other_b)[:3, 3]
                    )
                    enough = (a, b) in linked or min(closed[a], closed[b]) >= self._config.candidates
                    if apart_m < reach_m and not enough and self._compared.get((a, b), -2) + 2 <= grown:
                        found.append((float(apart_m), (a, b)))
        return [pair for _, pair in sorted(found)[: self._config.trials]]

    def compared(self, pair: Pair, first: Pointcloud, second: Pointcloud, places: int) -> Closure | None:
        """The closure of a pair, or None where the clouds do not bear one out.

        Parameters
        ----------
        first, second : Pointcloud
            Surroundings of either place, in the frame of the place itself.
        places : int
            Key frames of both maps together at this time.
        """
        self._compared[pair] = places
        self._matching.call("forget", {})
        list(self._matching.step(Sample("target", first.stamp_ns, 0, first)))
        (output,) = self._matching.step(Sample("source", second.stamp_ns, 0, second))
        if output.quality.status is not Status.OK:
            self.refusals[next(iter(output.quality.reasons), "degraded").split(":")[0]] += 1
            return None
        return Closure(*pair, output.value.transform)


def _sigma_m(robot_map: RobotMap) -> float:
    """One standard deviation of the anchor's position, the largest direction."""
    covariance = robot_map.anchor.covariance
    return 0.0 if covariance is None else float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
