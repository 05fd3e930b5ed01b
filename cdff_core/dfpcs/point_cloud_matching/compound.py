# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of PointCloudMatching: prepare, describe, match, prune, solve, refine, assess, answer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, ClassVar

from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.cloud_matching.acceptance import judged, refused
from cdff_core.cloud_matching.matcher import Cloud, CloudMatcher, Found
from cdff_core.cloud_matching.search import Search
from cdff_core.dfpcs.point_cloud_matching._interface import PointCloudMatchingInterface


class PointCloudMatchingConfig(DfpcConfig):
    """Parameters of the DFN slots, scales in voxels of the matched clouds, and the gates an answer must pass."""

    filter: dict[str, Any] = Field({}, description="Of PointCloudFiltering, on the clouds as they come")
    thin: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for refinement and assessment")
    thin_matched: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for keypoints and descriptors")
    outliers: dict[str, Any] = Field({}, description="Of PointCloudFiltering, after thinning")
    normals: dict[str, Any] = Field({}, description="Of NormalsEstimation")
    keypoints: dict[str, Any] = Field({}, description="Of FeaturesExtraction3D")
    describe: dict[str, Any] = Field({}, description="Of FeaturesDescription3D")
    match: dict[str, Any] = Field({}, description="Of FeaturesMatching3D")
    solve: dict[str, Any] = Field({}, description="Of GlobalRegistration3D")
    refine: dict[str, Any] = Field({}, description="Of Registration3D")
    assess: dict[str, Any] = Field({}, description="Of RegistrationAssessment")
    keypoint_voxels: float = Field(1.5, ge=1.0, le=50.0, description="Scale of the keypoints, in voxels")
    support_voxels: tuple[Annotated[float, Field(ge=2.0, le=100.0)], ...] = Field(
        (11.0, 8.0), min_length=1, max_length=8, description="Radii of the descriptors, in voxels, tried in turn"
    )
    candidates: int = Field(3, ge=1, le=20, description="Cliques of the matches that are tried, for each radius")
    noise_voxels: float = Field(1.0, gt=0.0, le=20.0, description="Noise of right pairs, in voxels")
    min_overlap: float = Field(0.2, gt=0, le=1, description="Larger of both overlaps below which it is FAILED")
    good_overlap: float = Field(0.3, gt=0, le=1, description="Larger of both overlaps below which it is DEGRADED")
    min_inlier_ratio: float = Field(0.5, gt=0, le=1, description="Share of pairs the kernel keeps, FAILED below")
    max_rms_gates: float = Field(0.25, gt=0, le=1, description="Residuals in gates of the overlap, FAILED above")
    min_agreement: float = Field(0.5, ge=0, le=1, description="Agreement of a direction below which it is FAILED")
    good_agreement: float = Field(0.7, ge=0, le=1, description="Agreement of a direction below which it is DEGRADED")
    max_chance: float = Field(1e-3, gt=0, description="Cliques expected among random matches, FAILED above")


class PointCloudMatching(PointCloudMatchingInterface):
    """Match each source with the target."""

    Config: ClassVar[type[DfpcConfig]] = PointCloudMatchingConfig

    config: PointCloudMatchingConfig

    def setup(self) -> None:
        """Make the DFNs, forget everything, offer the store's items."""
        c = self.config
        self._matcher = CloudMatcher(self, c.keypoint_voxels, c.noise_voxels)
        self._thin_matched = self.dfn("thin_matched")
        self._last: TransformWithCovariance | None = None
        self.forget()
        self.store.offer("target", self._target_cloud)
        self.store.offer("last_transform", lambda: self._last)

    def forget(self) -> None:
        """Forget target and waiting source."""
        self._target: Sample | None = None
        self._target_prepared: Cloud | None = None
        self._target_fault = ""
        self._waiting: Sample | None = None

    def on_target(self, sample: Sample) -> Iterable[Output]:
        """Prepare and keep the target; meet the source that waited for one."""
        self._target, self._target_prepared, self._target_fault = sample, None, ""
        try:
            self._target_prepared = self._matcher.prepared(sample, self._thin_matched)
        except InputError as error:
            self._target_fault = f"bad_target:{error}"
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else self.on_source(waiting)

    def on_source(self, sample: Sample) -> Iterable[Output]:
        """Match the source with the target; without a target the source waits."""
        if self._target is None:
            self._waiting = sample
            return
        if self._target_prepared is None:
            yield self._output(sample, self._target, None, Quality(Status.FAILED, (self._target_fault,)))
            return
        try:
            source = self._matcher.prepared(sample, self._thin_matched)
            search = Search(self._matcher, source, self._target_prepared, self.config, self._judged)
            found, quality = next(search.acceptable(), (None, None))
        except InputError as error:
            yield self._output(sample, self._target, None, Quality(Status.FAILED, (f"bad_input:{error}",)))
            return
        yield self._output(sample, self._target, found, quality or refused("no_overlap", search.refusals))

    def _judged(self, found: Found) -> Quality:
        """By the larger overlap: the clouds may be of different sizes."""
        overlap = max(float(found.assessment.overlap_source), float(found.assessment.overlap_target))
        return judged(found, overlap, self.config)

    def _output(self, source: Sample, target: Sample, found: Found | None, quality: Quality) -> Output:
        frame, child = target.value.frame, source.value.frame
        value = None
        if found is not None and quality.status is not Status.FAILED:
            T = UncertainTransform(found.T_target_source, found.assessment.covariance)
            value = self._last = TransformWithCovariance.from_transform(
                T, parent=frame, child=child, stamp_ns=source.stamp_ns, producer=self.name
            )
        used = tuple(i for i in (target.id, source.id) if i)
        return Output("transform", value, source.stamp_ns, source.stamp_ns, frame, child, quality, used)

    def _target_cloud(self) -> Pointcloud | None:
        if self._target is None or self._target_prepared is None:
            return None
        points = self._target_prepared.points_m
        return Pointcloud.from_points(points, frame=self._target.value.frame, stamp_ns=self._target.stamp_ns)
