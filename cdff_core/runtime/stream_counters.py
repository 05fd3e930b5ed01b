# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of one input stream: rate, stamps against mission time, gaps of the numbers, and its frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from statistics import median
from typing import Any

from cdff_common.clock import NS_PER_S
from cdff_common.interfaces.dfpc import Sample
from cdff_common.value_text import value_summary

#: Number of the newest samples of which rate and offset are computed.
_WINDOW = 50


class StreamCounters:
    """Measurements of a stream since its subscription.

    Parameters
    ----------
    frames : collection of str
        Frames of the robot.

    Notes
    -----
    The offset of a stamp is its time minus mission time when the sample is received, so that it is negative
    for a correct clock (the delay of the sample) and positive for a clock that is ahead. The median of the
    newest samples is not affected by a single late one.
    """

    def __init__(self, frames: Collection[str]) -> None:
        self._frames = frames
        self._stamps_ns: deque[int] = deque(maxlen=_WINDOW)
        self._offsets_ns: deque[int] = deque(maxlen=_WINDOW)
        self._last: Sample | None = None
        self._received_s = 0.0
        self.count = self.gaps = self.lost = self.backwards = 0

    def add(self, sample: Sample, now_ns: int, received_s: float) -> None:
        """Add a sample received at mission time ``now_ns``, and at ``received_s``, monotonic seconds."""
        last = self._last
        if last is not None:
            missing = sample.seq - last.seq - 1
            if missing > 0:  # after a restart of its source a stream is numbered from 0
                self.gaps, self.lost = self.gaps + 1, self.lost + missing
            if sample.stamp_ns <= last.stamp_ns:
                self.backwards += 1
                self._stamps_ns.clear()
        self.count += 1
        self._stamps_ns.append(sample.stamp_ns)
        self._offsets_ns.append(sample.stamp_ns - now_ns)
        self._last, self._received_s = sample, received_s

    @property
    def rate_hz(self) -> float | None:
        """Rate by the stamps of the newest samples; None for fewer than two."""
        if len(self._stamps_ns) < 2:
            return None
        return (len(self._stamps_ns) - 1) * NS_PER_S / (self._stamps_ns[-1] - self._stamps_ns[0])

    @property
    def offset_s(self) -> float | None:
        """Median of stamp minus mission time at reception, seconds; None without samples."""
        return median(self._offsets_ns) / NS_PER_S if self._offsets_ns else None

    @property
    def frame(self) -> str:
        """Frame whose place on the robot is needed: the child of a pose, else the frame of the samples."""
        return "" if self._last is None else self._last.child or self._last.frame

    def to_dict(self, now_s: float) -> dict[str, Any]:
        """Return the measurements at ``now_s``, monotonic seconds, with the last value in words."""
        sample = self._last
        return {
            "count": self.count,
            "rate_hz": self.rate_hz,
            "offset_s": self.offset_s,
            "silent_s": None if sample is None else max(now_s - self._received_s, 0.0),
            "gaps": self.gaps,
            "lost": self.lost,
            "backwards": self.backwards,
            "frame": self.frame,
            "frame_known": not self.frame or self.frame in self._frames,
            "stamp_ns": None if sample is None else sample.stamp_ns,
            "last": "" if sample is None else value_summary(sample.value),
        }
