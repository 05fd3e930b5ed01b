# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The steps from two point clouds to an assessed alignment, one DFN slot per step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Dfpc
from cdff_core.cloud_matching.configuration import MatchingGates
from cdff_core.cloud_matching.roughness import roughness_m
from cdff_core.dfns.features_description_3d.interface import FeaturesDescription3DInputs
from cdff_core.dfns.features_extraction_3d.interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_matching_3d.interface import FeaturesMatching3DInputs
from cdff_core.dfns.global_registration_3d.interface import (
    GlobalRegistration3DInputs,
    GlobalRegistration3DOutputs,
)
from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
from cdff_core.dfns.point_cloud_downsampling.interface import PointCloudDownsamplingInputs
from cdff_core.dfns.point_cloud_filtering.interface import PointCloudFilteringInputs
from cdff_core.dfns.registration_3d.interface import Registration3DInputs, Registration3DOutputs
from cdff_core.dfns.registration_assessment.interface import (
    RegistrationAssessmentInputs,
    RegistrationAssessmentOutputs,
)

if TYPE_CHECKING:
    from cdff_common.interfaces.dfn import Dfn

Float = NDArray[np.float64]
Pairs = tuple[Float, Float]

#: Least number of points of a cloud after filtering.
_MIN_POINTS = 100


class FewPointsError(InputError):
    """Too few points of a cloud remain in voxels of the size that the other cloud requires."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """A point cloud prepared for registration: thinned, without outliers."""

    points_m: Float  # (n, 3)
    #: Voxel size for feature matching that this cloud requires; the larger one of two clouds is used.
    voxel_m: float
    estimate_normals: Callable[[Float], Float]

    @cached_property
    def normals(self) -> Float:
        """Unit normals (n, 3), estimated at their first use: only the last refinement needs them."""
        return self.estimate_normals(self.points_m)


@dataclass(frozen=True, eq=False)
class KeypointCloud:
    """A cloud thinned to the voxel size common to both clouds, with its keypoints."""

    points_m: Float  # (n, 3)
    normals: Float  # (n, 3)
    keypoints_m: Float  # (k, 3)

    @cached_property
    def roughness_m(self) -> float:
        """Standard deviation of distances of points from the planes of their neighbours, metres."""
        return roughness_m(self.points_m, self.normals)


@dataclass(frozen=True, slots=True, eq=False)
class DescribedKeypoints:
    """The keypoints of a cloud that have a descriptor."""

    keypoints_m: Float  # (k, 3)
    descriptors: NDArray[np.float32]  # (k, d)


class Surface(Protocol):
    """Points with normals."""

    @property
    def points_m(self) -> Float:
        """Points (n, 3)."""

    @property
    def normals(self) -> Float:
        """Unit normals (n, 3)."""


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """A refined alignment of two clouds with its assessment, both on the clouds of the last refinement."""

    step: Registration3DOutputs
    assessment: RegistrationAssessmentOutputs
    refinement_m: float  # largest displacement of a point of the overlap by the refinement
    metrics: Mapping[str, float]  # counts of the feature matching; empty for a registration from a guess

    @property
    def T_target_source(self) -> Float:
        """Refined transform (4, 4)."""
        return self.step.transform

    @property
    def transform(self) -> UncertainTransform:
        """``T_target_source`` with the covariance of the assessment."""
        return UncertainTransform(self.T_target_source, self.assessment.covariance)

    @property
    def overlap(self) -> float:
        """Larger of the overlaps of source and target."""
        return max(self.assessment.overlap_source, self.assessment.overlap_target)


class CloudMatcher:
    """Runs the steps of a registration with the DFNs of a compound.

    The compound has the slots filter, thin, outliers, normals, keypoints, describe, match, solve, refine and
    assess.
    """

    def __init__(self, dfpc: Dfpc, gates: MatchingGates) -> None:
        self._filter, self._thin, self._outliers = dfpc.dfn("filter"), dfpc.dfn("thin"), dfpc.dfn("outliers")
        self._normals, self._keypoints = dfpc.dfn("normals"), dfpc.dfn("keypoints")
        self._describe, self._match, self._solve = dfpc.dfn("describe"), dfpc.dfn("match"), dfpc.dfn("solve")
        self._refine, self._assess = dfpc.dfn("refine"), dfpc.dfn("assess")
        self._gates = gates

    def prepare(self, points_m: NDArray[Any], name: str, voxel_choice: Dfn[Any, Any, Any]) -> Cloud:
        """Filter, thin, remove outliers; raises InputError if too few points remain.

        ``voxel_choice`` is a PointCloudDownsampling. Only the voxel size it returns is used: it becomes
        ``Cloud.voxel_m``, the size for feature matching. If it returns none, the size that halves the number
        of points is used.
        """
        from cdff_common.geometry.voxels import voxel_for

        filtered = self._filter.process(PointCloudFilteringInputs(points=points_m)).filtered_points
        if len(filtered) < _MIN_POINTS:
            raise InputError(f"{name}: {len(filtered)} points remain, expected at least {_MIN_POINTS}")
        thinned_points = self._thin.process(PointCloudDownsamplingInputs(points=filtered)).points
        points = self._outliers.process(PointCloudFilteringInputs(points=thinned_points)).filtered_points
        voxel_m = voxel_choice.process(PointCloudDownsamplingInputs(points=points)).voxel_m
        voxel_m = voxel_m or voxel_for(points, len(points) // 2)
        return Cloud(points, voxel_m, self._estimate_normals)

    def extract_keypoints(self, clouds: Sequence[Cloud], voxel_m: float) -> list[KeypointCloud]:
        """Thin clouds to voxels of one size, estimate normals, extract keypoints."""
        results = []
        for cloud in clouds:
            points = self._thin.process(
                PointCloudDownsamplingInputs(points=cloud.points_m, edge_m=voxel_m)
            ).points
            if len(points) < _MIN_POINTS:
                raise FewPointsError(
                    f"{len(points)} points remain of {len(cloud.points_m)} in voxels of {voxel_m:.3g} m"
                )
            normals = self._estimate_normals(points)
            radius_m = self._gates.keypoint_voxels * voxel_m
            keypoints = self._keypoints.process(
                FeaturesExtraction3DInputs(points=points, radius_m=radius_m)
            ).keypoints
            results.append(KeypointCloud(points, normals, keypoints))
        return results

    def _estimate_normals(self, points_m: Float) -> Float:
        """Return the unit normals (n, 3) of points (n, 3)."""
        normals: Float = self._normals.process(NormalsEstimationInputs(points=points_m)).normals
        return normals

    def describe(self, cloud: KeypointCloud, radius_m: float) -> DescribedKeypoints:
        """Describe the keypoints; omit keypoints with too few points in their support."""
        keypoints = cloud.keypoints_m
        if not len(keypoints):
            return DescribedKeypoints(keypoints, np.zeros((0, 1), np.float32))
        described = self._describe.process(
            FeaturesDescription3DInputs(
                points=cloud.points_m,
                normals=cloud.normals,
                keypoints=keypoints,
                radius_m=radius_m,
            )
        )
        return DescribedKeypoints(keypoints[described.valid], described.descriptors[described.valid])

    def match(self, source: DescribedKeypoints, target: DescribedKeypoints) -> tuple[Pairs, dict[str, float]]:
        """Return the matched keypoints of source and target, row by row, and the counts as metrics."""
        if len(source.keypoints_m) and len(target.keypoints_m):
            matches = self._match.process(
                FeaturesMatching3DInputs(source=source.descriptors, target=target.descriptors)
            ).matches
        else:
            matches = np.zeros((0, 2), np.int64)
        return (source.keypoints_m[matches[:, 0]], target.keypoints_m[matches[:, 1]]), {
            "keypoints_source": len(source.keypoints_m),
            "keypoints_target": len(target.keypoints_m),
            "matches": len(matches),
        }

    def solve(self, pairs: Pairs, voxel_m: float) -> GlobalRegistration3DOutputs:
        """Prune and solve; raises RefusedError or DegenerateGeometryError for inconsistent matches."""
        source, target = pairs
        noise_m = self._gates.noise_voxels * voxel_m
        solution: GlobalRegistration3DOutputs = self._solve.process(
            GlobalRegistration3DInputs(source=source, target=target, noise_m=noise_m)
        )
        return solution

    def refine(
        self, source: Surface, target: Surface, T_target_source: Float, metrics: Mapping[str, float]
    ) -> Registration:
        """Register from a candidate pose and assess the result; raises RefusedError without overlap."""
        return refine_and_assess(self._refine, self._assess, source, target, T_target_source, metrics)


def refine_and_assess(
    refine: Dfn[Any, Any, Any],
    assess: Dfn[Any, Any, Any],
    source: Surface,
    target: Surface,
    T_target_source: Float,
    metrics: Mapping[str, float],
    coarser: tuple[Surface, Surface] | None = None,
) -> Registration:
    """Return the assessed registration from a candidate pose; raises RefusedError without overlap.

    ``coarser`` are source and target with fewer points. They are registered from the result, and the
    difference is added to the covariance as resolution error.
    """
    step = refine.process(
        Registration3DInputs(
            source=source.points_m,
            target=target.points_m,
            target_normals=target.normals,
            guess=T_target_source,
        )
    )
    coarser_transform = None
    if coarser is not None:
        coarser_transform = refine.process(
            Registration3DInputs(
                source=coarser[0].points_m,
                target=coarser[1].points_m,
                target_normals=coarser[1].normals,
                guess=step.transform,
            )
        ).transform
    assessment = assess.process(
        RegistrationAssessmentInputs(
            source=source.points_m,
            source_normals=source.normals,
            target=target.points_m,
            target_normals=target.normals,
            transform=step.transform,
            coarser_transform=coarser_transform,
        )
    )
    refinement_m = displacement_m(T_target_source, step.transform, assessment.centre_m, assessment.radius_m)
    return Registration(step, assessment, refinement_m, metrics)


def solution_metrics(solution: GlobalRegistration3DOutputs) -> dict[str, float]:
    """Return the number of consistent matches and their significance as metrics."""
    return {
        "match_inliers": float(np.count_nonzero(solution.inliers)),
        "clique": float(solution.clique_size),
        "expected_by_chance": solution.expected_by_chance,
    }


def displacement_m(T_first: Float, T_second: Float, centre_m: Float, radius_m: float) -> float:
    """Return a bound on the distance between the images of a point under two transforms, metres.

    It holds for all points whose images under ``T_second`` are within ``radius_m`` of ``centre_m`` (3,).
    """
    change = T_first @ se3.inverse(T_second)
    translation = change[:3, :3] @ centre_m + change[:3, 3] - centre_m
    return float(np.linalg.norm(translation) + radius_m * se3.rotation_angle(change[:3, :3]))
