# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A log of a guided servicer that is computed while it is played."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs import LogSample, LogWriter
from cdff_dev.logs.source import LogSource, StreamInfo
from cdff_dev.missions.orbit.servicer import GuidedServicer
from cdff_dev.simulate.orbit.scenario import OrbitScenario

#: Longest mission, seconds: a log must state its end before it is played.
_MAX_DURATION_S = 86_400


class GuidedLog(LogSource):
    """The samples of a guided servicer as a ``LogSource`` without end.

    The ground truth is not among its samples.

    Parameters
    ----------
    scenario : OrbitScenario
    truth : LogWriter or None
        Log to which the ground truth is written.
    """

    def __init__(self, scenario: OrbitScenario, truth: LogWriter | None) -> None:
        self.servicer = GuidedServicer(scenario)
        self._epoch_ns, self._truth = scenario.epoch_ns, truth
        self._step_ns = round(NS_PER_S * self.servicer.step_s)
        self._computed_steps = self._delivered_steps = 0
        self._lock, self._closed = threading.Lock(), threading.Event()
        #: Size of the samples of two steps, bytes: the player reads no further ahead.
        self.ahead_bytes = 2 * self.servicer.largest_step_bytes

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name; the number of their samples is unknown (0)."""
        end_ns = self._epoch_ns + _MAX_DURATION_S * NS_PER_S
        return {
            stream: StreamInfo(type_name, 0, self._epoch_ns, end_ns)
            for stream, type_name in self.servicer.streams.items()
        }

    def ready_ns(self) -> int:
        """Return the mission time up to which all samples have been delivered."""
        return self._epoch_ns + self._delivered_steps * self._step_ns

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of each step until the log is closed."""
        selected = set(self.streams if streams is None else streams)
        while not self._closed.is_set():
            with self._lock:
                samples = list(self.servicer.samples(self._computed_steps))
                self._computed_steps += 1
            for sample in samples:
                if self._truth is not None and "/truth." in sample.stream:
                    self._truth.write(sample.stream, sample.value, sample.stamp_ns, sample.header)
            yield from (sample for sample in samples if sample.stream in selected)
            self._delivered_steps += 1

    def move(self, displacement_m: FloatArray, duration_s: float, *, in_base: bool) -> tuple[int, int]:
        """Move the servicer, see ``GuidedServicer.move``; return start and end of the motion, nanoseconds."""
        with self._lock:
            begin_s, end_s = self.servicer.move(
                np.asarray(displacement_m, float), duration_s, self._now_s(), in_base=in_base
            )
        return self._stamp_ns(begin_s), self._stamp_ns(end_s)

    def lose_sensor(self, sensor: str, duration_s: float) -> tuple[int, int]:
        """Withhold the samples of a sensor; return start and end of the loss, nanoseconds."""
        with self._lock:
            begin_s = self._now_s()
            end_s = self.servicer.lose_sensor(sensor, duration_s, begin_s)
        return self._stamp_ns(begin_s), self._stamp_ns(end_s)

    def close(self) -> None:
        """End ``samples``."""
        self._closed.set()

    def _now_s(self) -> float:
        """Return the end of the computed steps, seconds since the epoch."""
        return self._computed_steps * self.servicer.step_s

    def _stamp_ns(self, t_s: float) -> int:
        return self._epoch_ns + round(t_s * 1e6) * 1000
