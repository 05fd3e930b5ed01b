# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of PointCloudMatching: prepare, describe, match, prune, solve, refine, assess, publish."""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_common.types import TransformWithCovariance
from cdff_core.cloud_matching.acceptance import registration_quality
from cdff_core.cloud_matching.matcher import Cloud, CloudMatcher, Registration
from cdff_core.cloud_matching.reference import ReferenceCloud
from cdff_core.cloud_matching.search import AlignmentSearch
from cdff_core.dfpcs.point_cloud_matching.configuration import PointCloudMatchingConfig
from cdff_core.dfpcs.point_cloud_matching.interface import PointCloudMatchingInterface


class PointCloudMatching(PointCloudMatchingInterface):
    """Registration of each source cloud with the target cloud, without a guess."""

    Config = PointCloudMatchingConfig
    config: PointCloudMatchingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store items."""
        self._matcher = CloudMatcher(self, self.config)
        self._voxel_choice = self.dfn("voxel_choice")
        self._last: TransformWithCovariance | None = None
        self._target = ReferenceCloud(self._prepare)
        self.store.offer("target", self._target.cloud)
        self.store.offer("last_transform", lambda: self._last)

    def forget(self) -> None:
        """Clear target and waiting source."""
        self._target.clear()

    def on_target(self, sample: Sample) -> Iterable[Output]:
        """Prepare and store the target; process the source that waited for one."""
        waiting = self._target.replace(sample)
        return () if waiting is None else self.on_source(waiting)

    def on_source(self, sample: Sample) -> Iterable[Output]:
        """Match the source with the target; without a target the source waits."""
        if self._target.sample is None:
            self._target.waiting = sample
            return ()
        target = self._target
        T: UncertainTransform | None = None
        try:
            registration, quality = self._match(target.prepared(), sample)
            if registration is not None:
                T = registration.transform
        except (InputError, RefusedError) as error:
            quality = Quality.from_error(error)
        output = Output.of_pose(
            "transform",
            T,
            stamp_ns=sample.stamp_ns,
            frame=target.frame,
            child=sample.value.frame,
            quality=quality,
            inputs=(target.id, sample.id),
            producer=self.name,
        )
        self._last = output.value or self._last
        return [output]

    def _prepare(self, sample: Sample) -> Cloud:
        return self._matcher.prepare(sample.value.points_m, sample.port, self._voxel_choice)

    def _match(self, target: Cloud, sample: Sample) -> tuple[Registration | None, Quality]:
        """Return the first acceptable registration and its quality; None and FAILED without one."""
        search = AlignmentSearch(self._matcher, self._prepare(sample), target, self.config, self._quality)
        accepted = next(search.acceptable(), None)
        return accepted or (None, Quality.failed("no_overlap", *search.refusals))

    def _quality(self, registration: Registration) -> Quality:
        """Return the quality by the gates; the larger overlap counts, since the clouds may differ in size."""
        return registration_quality(registration, registration.overlap, self.config)
