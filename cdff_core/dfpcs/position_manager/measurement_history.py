# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The last measurements in order of time, with the estimate after each."""

from __future__ import annotations

from bisect import bisect_left, bisect_right

from cdff_common.errors import CdffError
from cdff_core.dfpcs.position_manager.estimate import Estimate
from cdff_core.dfpcs.position_manager.estimator import Estimator
from cdff_core.dfpcs.position_manager.measurement import Measurement, MeasurementResult
from cdff_core.dfpcs.position_manager.pose_timeline import PoseTimeline


class MeasurementHistory:
    """Accepts measurements in any order of arrival, delayed by up to ``memory_ns``.

    After a late measurement, all later ones are processed again, which replaces the end of the timeline.
    """

    def __init__(self, estimator: Estimator, timeline: PoseTimeline, memory_ns: int) -> None:
        self._estimator, self._timeline, self._memory_ns = estimator, timeline, memory_ns
        self._base: Estimate | None = None
        self._measurements: list[Measurement] = []
        self._stamps: list[int] = []
        self._estimates: list[Estimate] = []
        self._outdated_ns: int | None = None

    def start(self, estimate: Estimate) -> None:
        """Set the first estimate."""
        self._base = estimate
        self._timeline.append(estimate)

    @property
    def is_started(self) -> bool:
        """True once there is an estimate."""
        return self._base is not None

    @property
    def oldest(self) -> Estimate:
        """Estimate before the measurements that may be processed again."""
        assert self._base is not None  # callers check is_started
        return self._base

    @property
    def newest(self) -> Estimate:
        """Estimate at the newest time."""
        self.refresh()
        return self._estimates[-1] if self._estimates else self.oldest

    def extrapolate(self, stamp_ns: int, limit_ns: int) -> Estimate | None:
        """Return an estimate after the newest one; None inside the history or beyond the limit."""
        if not self.is_started or not 0 < stamp_ns - self.newest.stamp_ns <= limit_ns:
            return None
        return self._estimator.extrapolate(self.newest, stamp_ns)

    def invalidate(self, stamp_ns: int) -> None:
        """Mark the estimates after a time as outdated, because a late IMU reading was inserted."""
        if self._estimates and stamp_ns < self._estimates[-1].stamp_ns:
            self._outdated_ns = stamp_ns if self._outdated_ns is None else min(self._outdated_ns, stamp_ns)

    def refresh(self) -> None:
        """Compute outdated estimates again."""
        if self._outdated_ns is not None:
            index = bisect_left(self._stamps, self._outdated_ns)
            self._outdated_ns = None
            self._process(index)

    def insert(self, measurement: Measurement) -> MeasurementResult:
        """Insert a measurement, not older than ``oldest``, in time order; process it and all later
        measurements.

        A measurement that cannot be processed raises its error and leaves the history unchanged.
        """
        self.refresh()
        stamp_ns = measurement.stamp_ns
        k = bisect_right(self._stamps, stamp_ns)
        # Equal times are sorted by source, so that the order of arrival has no effect.
        while k and self._stamps[k - 1] == stamp_ns and self._measurements[k - 1].source > measurement.source:
            k -= 1
        self._stamps.insert(k, stamp_ns)
        self._measurements.insert(k, measurement)
        try:
            result = self._process(k)
        except CdffError:
            del self._stamps[k], self._measurements[k]
            self._process(k)
            raise
        self._remove_before(self._stamps[-1] - self._memory_ns)
        return result

    def _process(self, index: int) -> MeasurementResult:
        """Process the measurements from an index on; return the result of the measurement at that index."""
        estimate = self._estimates[index - 1] if index else self.oldest
        del self._estimates[index:]
        self._timeline.remove_after(estimate.stamp_ns)
        results = []
        for measurement in self._measurements[index:]:
            estimate, result = self._estimator.update(estimate, measurement)
            results.append(result)
            self._estimates.append(estimate)
            self._timeline.append(estimate)
        return results[0] if results else MeasurementResult(False)

    def _remove_before(self, stamp_ns: int) -> None:
        first_retained = bisect_left(self._stamps, stamp_ns)
        if first_retained > 64:  # in blocks, since removal from the front moves all others
            self._base = self._estimates[first_retained - 1]
            del (
                self._stamps[:first_retained],
                self._measurements[:first_retained],
                self._estimates[:first_retained],
            )
