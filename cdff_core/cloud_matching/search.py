# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Candidates until one can be stood for: several supports of the descriptors, several cliques of their matches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol

from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.product import Quality, Status
from cdff_core.cloud_matching.matcher import Cloud, CloudMatcher, Described, Float, Found, Surface, counts

Judge = Callable[[Found], Quality]

#: Keypoints of the target this near to the source where it was found belong to it.
_EXPLAINED_VOXELS = 3.0


class Scales(Protocol):
    """What a configuration says on the search."""

    support_voxels: tuple[float, ...]
    candidates: int


class Search:
    """Candidate alignments of two clouds, in the order of what speaks for them.

    Parameters
    ----------
    matcher : CloudMatcher
    source, target : Cloud
    scales : Scales
    judge : callable
        Quality of an alignment.
    """

    def __init__(self, matcher: CloudMatcher, source: Cloud, target: Cloud, scales: Scales, judge: Judge) -> None:
        self._matcher, self._clouds, self._scales, self._judge = matcher, (source, target), scales, judge
        self._voxel_m = max(source.voxel_m, target.voxel_m)
        self._surfaces: list[Surface] = matcher.surfaces(self._clouds, self._voxel_m)
        self._described: dict[float, tuple[Described, Described]] = {}
        self.refusals: tuple[str, ...] = ()

    def acceptable(self) -> Iterator[tuple[Found, Quality]]:
        """Alignments that pass, judged on the finely thinned clouds; what the others fail by is kept in refusals."""
        for voxels in self._scales.support_voxels:
            yield from self._solved(*self._at(voxels))

    def elsewhere(self, found: Found) -> Iterator[tuple[Found, Quality]]:
        """The same without the part of the target that an alignment explains."""
        from cdff_common.geometry.kdtree import kd_tree, nearest

        moved = se3.transform_points(found.T_target_source, self._surfaces[0].points_m)
        tree = kd_tree(moved)
        for voxels in self._scales.support_voxels:
            source, target = self._at(voxels)
            is_free = nearest(tree, target.keypoints_m)[0] > _EXPLAINED_VOXELS * self._voxel_m
            yield from self._solved(source, Described(target.keypoints_m[is_free], target.descriptors[is_free]))

    def _at(self, voxels: float) -> tuple[Described, Described]:
        """Both surfaces described with supports of a radius; once."""
        if voxels not in self._described:
            source, target = (self._matcher.described(each, voxels * self._voxel_m) for each in self._surfaces)
            self._described[voxels] = source, target
        return self._described[voxels]

    def _solved(self, source: Described, target: Described) -> Iterator[tuple[Found, Quality]]:
        pairs, metrics = self._matcher.matched(source, target)
        for _ in range(self._scales.candidates):
            try:
                solution = self._matcher.solved(pairs, self._voxel_m)
            except (RefusedError, DegenerateGeometryError) as error:
                self._refuse(tuple(error.reasons))
                return
            judged = self._refined(solution.transform, metrics | counts(solution))
            if judged is not None:
                yield judged
            # What is left may agree on another place.
            pairs = pairs[0][~solution.inliers], pairs[1][~solution.inliers]

    def _refined(self, T: Float, metrics: dict[str, float]) -> tuple[Found, Quality] | None:
        """Refine on the coarse surfaces, and where that passes on the fine clouds; None where either does not."""
        try:
            for source, target in (self._surfaces, self._clouds):
                found = self._matcher.refined(source, target, T, metrics)
                quality = self._judge(found)
                if quality.status is Status.FAILED:
                    self._refuse(quality.reasons)
                    return None
                T = found.T_target_source
        except (RefusedError, DegenerateGeometryError) as error:
            self._refuse(tuple(error.reasons))
            return None
        return found, quality

    def _refuse(self, reasons: tuple[str, ...]) -> None:
        """Keep what spoke against the first candidate: it had most matches behind it."""
        self.refusals = self.refusals or reasons
