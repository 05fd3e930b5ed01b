# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of the position manager: each new pose, and the trajectory at a limited rate."""

from __future__ import annotations

from collections.abc import Iterator

from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.pose_timeline import PoseTimeline
from cdff_core.dfpcs.position_manager.source_monitor import SourceMonitor

#: Nanoseconds per second.
_NS = 1e9


class Publisher:
    """Builds the outputs from the timeline, and thins the timeline."""

    def __init__(
        self,
        config: PositionManagerConfig,
        timeline: PoseTimeline,
        sources: SourceMonitor,
        base: str,
        producer: str,
    ) -> None:
        self._config, self._timeline, self._sources = config, timeline, sources
        self._base, self._producer = base, producer
        #: Deficiencies of the start pose, which are reasons of every pose.
        self.start_reasons: tuple[str, ...] = ()
        #: Time of the last published pose; no pose at an earlier time is published.
        self.published_ns = -1
        self._trajectory_ns = self._thinned_ns = 0

    def start(self, stamp_ns: int, reasons: tuple[str, ...]) -> None:
        """Set the start of the timeline."""
        self._trajectory_ns = self._thinned_ns = stamp_ns
        self.start_reasons = reasons

    def publish(self, sample: Sample, reasons: tuple[str, ...], oldest_ns: int) -> Iterator[Output]:
        """Yield the pose at the time of a sample, unless a later pose was published, and the trajectory if
        it is due.

        ``oldest_ns`` is the time from which measurements may be processed again: later nodes are not thinned.
        """
        t_ns = sample.stamp_ns
        if t_ns <= self.published_ns:
            return
        self.published_ns = t_ns
        T = self._timeline.pose_at(t_ns)
        inputs = (sample.id,)
        yield Output.of_pose(
            "pose",
            T,
            stamp_ns=t_ns // 1000 * 1000,
            frame="site",
            child=self._base,
            quality=self._sources.quality(t_ns, T, (*reasons, *self.start_reasons)),
            inputs=inputs,
            producer=self._producer,
        )
        c, period_s = self._config.timeline, self._config.publication.trajectory_period_s
        if t_ns - self._thinned_ns >= period_s * _NS:
            self._thinned_ns = t_ns
            dense_ns = min(t_ns - int(c.dense_s * _NS), oldest_ns)
            self._timeline.thin(dense_ns, int(c.thin_s * _NS), t_ns - int(c.history_s * _NS))
        length_s = min((t_ns - self._timeline.stamps_ns[0]) / _NS, c.history_s)
        growth_s = self._config.publication.trajectory_growth * length_s
        if t_ns - self._trajectory_ns >= max(period_s, growth_s) * _NS:
            self._trajectory_ns = t_ns
            yield self.trajectory(inputs)

    def trajectory(self, inputs: tuple[str, ...] = ()) -> Output:
        """Return the whole trajectory."""
        value = self._timeline.trajectory(-1, -1, self._base, self._producer)
        stamps, degraded_poses = value.stamps_ns, self._sources.degraded_poses
        reasons = ["source:wheels_only_sometimes"] if degraded_poses else []
        metrics = {"poses": len(stamps), "degraded_poses": degraded_poses}
        quality = Quality.from_reasons(reasons, CovarianceKind.FORMAL, metrics)
        return Output(
            "trajectory", value, int(stamps[0]), int(stamps[-1]), "site", self._base, quality, inputs
        )
