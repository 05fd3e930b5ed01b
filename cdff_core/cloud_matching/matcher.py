# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The steps from two clouds to a judged alignment, each by the DFN of a slot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc
from cdff_core.dfns.features_description_3d._interface import FeaturesDescription3DInputs
from cdff_core.dfns.features_extraction_3d._interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_matching_3d._interface import FeaturesMatching3DInputs
from cdff_core.dfns.global_registration_3d._interface import (
    GlobalRegistration3DInputs,
    GlobalRegistration3DOutputs,
)
from cdff_core.dfns.normals_estimation._interface import NormalsEstimationInputs
from cdff_core.dfns.point_cloud_downsampling._interface import PointCloudDownsamplingInputs
from cdff_core.dfns.point_cloud_filtering._interface import PointCloudFilteringInputs
from cdff_core.dfns.registration_3d._interface import Registration3DInputs
from cdff_core.dfns.registration_assessment._interface import (
    RegistrationAssessmentInputs,
    RegistrationAssessmentOutputs,
)

if TYPE_CHECKING:
    from cdff_common.interfaces.dfn import Dfn
    from cdff_common.interfaces.dfpc import Sample

Float = NDArray[np.float64]
Pairs = tuple[Float, Float]

_LEAST_POINTS = 100


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """A cloud as it is registered.

    Attributes
    ----------
    points_m, normals : ndarray, shape (n, 3)
        Thinned, with the outliers dropped.
    voxel_m : float
        Edge of the voxels it would be described in on its own, metres.
    """

    points_m: Float
    normals: Float
    voxel_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A cloud thinned to the voxels that both clouds share.

    Attributes
    ----------
    points_m, normals : ndarray, shape (n, 3)
    keypoints_m : ndarray, shape (k, 3)
    """

    points_m: Float
    normals: Float
    keypoints_m: Float


@dataclass(frozen=True, slots=True, eq=False)
class Described:
    """The keypoints of a surface that could be described.

    Attributes
    ----------
    keypoints_m : ndarray, shape (k, 3)
    descriptors : ndarray, shape (k, d)
    """

    keypoints_m: Float
    descriptors: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A candidate with what is known of it.

    Attributes
    ----------
    T_target_source : ndarray, shape (4, 4)
    assessment : RegistrationAssessmentOutputs
        On the finely thinned clouds.
    converged : bool
        Of the last refinement.
    moved_m : float
        How far the refinement moved the middle of the overlap, and points at its radius, from where the matches put it.
    metrics : dict
        Counts of the matching, if there was any.
    """

    T_target_source: Float
    assessment: RegistrationAssessmentOutputs
    converged: bool
    moved_m: float
    metrics: dict[str, float]


class CloudMatcher:
    """Runs the DFNs of the slots filter, thin, outliers, normals, keypoints, describe, match, solve, refine, assess.

    Parameters
    ----------
    dfpc : Dfpc
        Whose slots these are.
    keypoint_voxels, noise_voxels : float
        Scale of the keypoints and noise of right pairs, in voxels of the clouds that are described.
    """

    def __init__(self, dfpc: Dfpc, keypoint_voxels: float, noise_voxels: float) -> None:
        self._filter, self._thin, self._outliers = dfpc.dfn("filter"), dfpc.dfn("thin"), dfpc.dfn("outliers")
        self._normals, self._keypoints = dfpc.dfn("normals"), dfpc.dfn("keypoints")
        self._describe, self._match, self._solve = dfpc.dfn("describe"), dfpc.dfn("match"), dfpc.dfn("solve")
        self._refine, self._assess = dfpc.dfn("refine"), dfpc.dfn("assess")
        self._keypoint_voxels, self._noise_voxels = keypoint_voxels, noise_voxels

    def prepared(self, sample: Sample, thin_matched: Dfn[Any, Any, Any]) -> Cloud:
        """Filter, thin, drop outliers, estimate normals; raises InputError where too little is left.

        ``thin_matched`` says in what voxels the cloud would be described on its own; a cloud that it would leave as it
        is is described by half as many points as it has.
        """
        from cdff_common.geometry.voxels import voxel_for

        raw = self._filter.process(PointCloudFilteringInputs(sample.value.points_m)).filtered_points
        if len(raw) < _LEAST_POINTS:
            raise InputError(f"{sample.port}: {len(raw)} points are left, expected at least {_LEAST_POINTS}")
        thinned = self._thin.process(PointCloudDownsamplingInputs(raw))
        points = self._outliers.process(PointCloudFilteringInputs(thinned.points)).filtered_points
        voxel_m = float(thin_matched.process(PointCloudDownsamplingInputs(points)).voxel_m)
        voxel_m = voxel_m or voxel_for(points, len(points) // 2)
        normals = self._normals.process(NormalsEstimationInputs(points)).normals
        return Cloud(points, normals, voxel_m)

    def surfaces(self, clouds: Sequence[Cloud], voxel_m: float) -> list[Surface]:
        """Thin clouds to voxels of one size, estimate normals, find keypoints."""
        found = []
        for cloud in clouds:
            points = self._thin.process(PointCloudDownsamplingInputs(cloud.points_m, np.array(voxel_m))).points
            if len(points) < _LEAST_POINTS:
                raise InputError(f"{len(points)} points are left of {len(cloud.points_m)} in voxels of {voxel_m:.3g} m")
            normals = self._normals.process(NormalsEstimationInputs(points)).normals
            scale_m = np.array(self._keypoint_voxels * voxel_m)
            keypoints = self._keypoints.process(FeaturesExtraction3DInputs(points, scale_m)).keypoints
            found.append(Surface(points, normals, keypoints))
        return found

    def described(self, surface: Surface, radius_m: float) -> Described:
        """Describe the keypoints; those whose support holds too little are left out."""
        points, normals, keypoints = surface.points_m, surface.normals, surface.keypoints_m
        if not len(keypoints):
            return Described(keypoints, np.zeros((0, 1), np.float32))
        signature = self._describe.process(FeaturesDescription3DInputs(points, normals, keypoints, np.array(radius_m)))
        return Described(keypoints[signature.valid], signature.descriptors[signature.valid])

    def matched(self, source: Described, target: Described) -> tuple[Pairs, dict[str, float]]:
        """Keypoints of source and target that are paired, row by row, and how many there were."""
        if len(source.keypoints_m) and len(target.keypoints_m):
            matches = self._match.process(FeaturesMatching3DInputs(source.descriptors, target.descriptors)).matches
        else:
            matches = np.zeros((0, 2), np.int64)
        return (source.keypoints_m[matches[:, 0]], target.keypoints_m[matches[:, 1]]), {
            "keypoints_source": float(len(source.keypoints_m)),
            "keypoints_target": float(len(target.keypoints_m)),
            "matches": float(len(matches)),
        }

    def solved(self, pairs: Pairs, voxel_m: float) -> GlobalRegistration3DOutputs:
        """Prune and solve; raises RefusedError or DegenerateGeometryError where the pairs do not agree."""
        return self._solve.process(GlobalRegistration3DInputs(*pairs, np.array(self._noise_voxels * voxel_m)))

    def refined(self, source: Cloud | Surface, target: Cloud | Surface, T: Float, metrics: dict[str, float]) -> Found:
        """Register from a candidate, and assess; raises RefusedError without overlap."""
        step = self._refine.process(Registration3DInputs(source.points_m, target.points_m, target.normals, T))
        assessment = self._assess.process(
            RegistrationAssessmentInputs(
                source.points_m, source.normals, target.points_m, target.normals, step.transform
            )
        )
        moved_m = displacement_m(T, step.transform, assessment.centre_m, float(assessment.radius_m))
        return Found(step.transform, assessment, bool(step.converged), moved_m, metrics)


def counts(solution: GlobalRegistration3DOutputs) -> dict[str, float]:
    """What speaks for a solution, as metrics."""
    return {
        "match_inliers": float(np.count_nonzero(solution.inliers)),
        "clique": float(solution.clique_size),
        "expected_by_chance": float(solution.expected_by_chance),
    }


def displacement_m(T_first: Float, T_second: Float, centre_m: Float, radius_m: float) -> float:
    """How far points within ``radius_m`` of ``centre_m``, where the second puts them, lie from where the first does."""
    change = T_first @ se3.inverse(T_second)
    shift = change[:3, :3] @ centre_m + change[:3, 3] - centre_m
    return float(np.linalg.norm(shift) + radius_m * se3.rotation_angle(change[:3, :3]))
