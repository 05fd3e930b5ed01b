# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search for acceptable alignments over descriptor radii and cliques of matches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.product import Quality, Status
from cdff_core.cloud_matching.configuration import MatchingGates
from cdff_core.cloud_matching.matcher import (
    Cloud,
    CloudMatcher,
    DescribedKeypoints,
    Float,
    Registration,
    solution_metrics,
)

QualityFunction = Callable[[Registration], Quality]
AssessedRegistration = tuple[Registration, Quality]

#: A registration explains the keypoints of the target within this distance of the registered source, in
#: voxels.
_EXPLAINED_VOXELS = 3.0
#: Lower bound of the joint roughness, in voxels, for exact planes.
_MIN_ROUGHNESS_VOXELS = 0.01


class AlignmentSearch:
    """Candidate alignments of two clouds, best supported first; ``quality_of`` assesses a registration."""

    def __init__(
        self,
        matcher: CloudMatcher,
        source: Cloud,
        target: Cloud,
        gates: MatchingGates,
        quality_of: QualityFunction,
    ) -> None:
        self._matcher, self._gates, self._quality_of = matcher, gates, quality_of
        self._fine = source, target
        self._voxel_m = max(source.voxel_m, target.voxel_m)
        self._coarse = matcher.extract_keypoints(self._fine, self._voxel_m)
        self._described: dict[float, tuple[DescribedKeypoints, DescribedKeypoints]] = {}
        #: Reasons for the refusal of the first refused alignment, which has most matches.
        self.refusals: tuple[str, ...] = ()

    def acceptable(self) -> Iterator[AssessedRegistration]:
        """Yield the registrations that pass the gates on the fine clouds."""
        for voxels in self._gates.support_voxels:
            yield from self._clique_registrations(*self._describe(voxels))

    def excluding(self, registration: Registration) -> Iterator[AssessedRegistration]:
        """Yield acceptable registrations without the part of the target that a registration explains."""
        from cdff_common.geometry.kdtree import kd_tree, nearest

        tree_of_model = kd_tree(se3.transform_points(registration.T_target_source, self._coarse[0].points_m))
        for voxels in self._gates.support_voxels:
            source, target = self._describe(voxels)
            is_unexplained = nearest(tree_of_model, target.keypoints_m)[0] > _EXPLAINED_VOXELS * self._voxel_m
            unexplained = DescribedKeypoints(
                target.keypoints_m[is_unexplained], target.descriptors[is_unexplained]
            )
            yield from self._clique_registrations(source, unexplained)

    def _describe(self, voxels: float) -> tuple[DescribedKeypoints, DescribedKeypoints]:
        """Return the described keypoints of both clouds for a support radius, cached."""
        if voxels not in self._described:
            source, target = (self._matcher.describe(c, voxels * self._voxel_m) for c in self._coarse)
            self._described[voxels] = source, target
        return self._described[voxels]

    def _clique_registrations(
        self, source: DescribedKeypoints, target: DescribedKeypoints
    ) -> Iterator[AssessedRegistration]:
        """Yield an acceptable registration for each clique of consistent matches, largest first."""
        pairs, metrics = self._matcher.match(source, target)
        for _ in range(self._gates.max_cliques):
            try:
                solution = self._matcher.solve(pairs, self._voxel_m)
            except RefusedError as error:
                self._record_refusal(tuple(error.reasons))
                return
            candidate = self._refine(solution.transform, metrics | solution_metrics(solution))
            if candidate is not None:
                yield candidate
            # The other matches may agree on a different alignment.
            pairs = pairs[0][~solution.inliers], pairs[1][~solution.inliers]

    def _refine(self, T_target_source: Float, metrics: dict[str, float]) -> AssessedRegistration | None:
        """Refine on the coarse clouds, then on the fine clouds; None if either fails the gates."""
        try:
            for source, target in (self._coarse, self._fine):
                registration = self._matcher.refine(source, target, T_target_source, metrics)
                quality = self._quality_of(registration)
                failures = quality.reasons if quality.status is Status.FAILED else ()
                if source is self._coarse[0]:
                    failures = failures or self._roughness_reasons(registration)
                if failures:
                    self._record_refusal(failures)
                    return None
                T_target_source = registration.T_target_source
        except RefusedError as error:
            self._record_refusal(tuple(error.reasons))
            return None
        return registration, quality

    def _roughness_reasons(self, registration: Registration) -> tuple[str, ...]:
        """Return the reason against a registration of the coarse clouds with too large residuals, if any.

        At the correct pose, the points of one cloud are about as near to the planes of the other as
        neighbouring points of a cloud are to each other's planes. The fine clouds of a lidar do not permit
        this test: neighbouring points of a scan line have common errors, which the roughness does not
        contain.
        """
        limit_m = self._gates.max_roughnesses * self._joint_roughness_m
        rms_m = registration.assessment.rms_m
        return (f"large_residuals:{rms_m:.3g}m>{limit_m:.3g}m",) if rms_m > limit_m else ()

    @cached_property
    def _joint_roughness_m(self) -> float:
        """Standard deviation of the distances between the coarse clouds if their errors are independent."""
        roughness_m = math.hypot(*(cloud.roughness_m for cloud in self._coarse))
        return max(roughness_m, _MIN_ROUGHNESS_VOXELS * self._voxel_m)

    def _record_refusal(self, reasons: tuple[str, ...]) -> None:
        self.refusals = self.refusals or reasons
