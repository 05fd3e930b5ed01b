# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of PointCloudMatching: prepare, describe, match, prune, solve, refine, assess, answer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.cloud_matching.acceptance import judged, refused
from cdff_core.cloud_matching.configuration import MatchingConfig
from cdff_core.cloud_matching.matcher import Cloud, CloudMatcher, Found
from cdff_core.cloud_matching.search import Search
from cdff_core.dfpcs.point_cloud_matching._interface import PointCloudMatchingInterface


class PointCloudMatchingConfig(MatchingConfig):
    """As shared, and in what voxels clouds are matched."""

    thin_matched: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for keypoints and descriptors")


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
