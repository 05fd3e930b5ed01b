# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated rovers as a log that is made while it is played, and that takes orders meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs import LogSample, LogWriter
from cdff_dev.logs.source import StreamInfo
from cdff_dev.missions.rover import Rover
from cdff_dev.simulate.world import World, cast_scene

#: What a rover's streams hold.
STREAMS = {"imu.sample": "IMUSensors", "wheels.odometry": "TransformWithCovariance", "lidar.scan": "LidarScan"}
#: A scan is at most so large a point, octets: position, time, intensity and ring.
_POINT_BYTES = 20
#: Longest mission, seconds: what a playing log needs to say of its end.
_LONGEST_S = 86_400


class Driven:
    """The rovers of a world as a ``LogSource`` without end; the truth goes to a writer and to nobody else.

    Parameters
    ----------
    truth : LogWriter or None
        Where the true poses go.
    """

    def __init__(self, world: World, truth: LogWriter | None) -> None:
        scenario = world.scenario
        if scenario.navcam is not None:
            raise InputError(f"scenario {scenario.name}: rovers that are driven have no cameras yet; leave navcam out")
        scene = cast_scene(world.relief, world.rocks)
        felt = world.relief.smoothed(scenario.chassis.wheel_footprint_m / float(np.min(np.diff(world.relief.x_m))))
        self.rovers = {robot: Rover(world, robot, scene, felt) for robot in sorted(scenario.robots)}
        self._epoch_ns = scenario.epoch_ns
        self._tick_ns = round(NS_PER_S / scenario.lidar.rate_hz)
        self._truth = truth
        self._made = self._handed = 0
        self._lock = threading.Lock()
        self._closed = threading.Event()
        #: Octets of the samples of two ticks: no more are made ahead.
        self.ahead_bytes = 2 * len(self.rovers) * scenario.lidar.rings * scenario.lidar.columns * _POINT_BYTES

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name; how many samples there will be is not known."""
        end_ns = self._epoch_ns + _LONGEST_S * NS_PER_S
        return {
            f"/{robot}/{stream}": StreamInfo(type_name, 0, self._epoch_ns, end_ns)
            for robot in self.rovers
            for stream, type_name in STREAMS.items()
        }

    def ready_ns(self) -> int:
        """Mission time before which every sample is made and was taken."""
        return self._epoch_ns + self._handed * self._tick_ns

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Make samples, tick after tick, until it is closed."""
        wanted = set(self.streams if streams is None else streams)
        while not self._closed.is_set():
            with self._lock:
                made = [sample for rover in self.rovers.values() for sample in rover.samples(self._made)]
                self._made += 1
            made.sort(key=lambda s: (s.stamp_ns, s.stream))
            for sample in made:
                if self._truth is not None and sample.stream.endswith("/truth.pose"):
                    self._truth.write(sample.stream, sample.value, sample.stamp_ns, sample.header)
            yield from (sample for sample in made if sample.stream in wanted)
            self._handed += 1

    def drive(self, robot: str, way_m: FloatArray) -> tuple[int, int]:
        """Tell a rover a way as ``Rover.drive``; returns when it begins and ends, mission nanoseconds."""
        with self._lock:
            return self._times(self.rovers[robot].drive(way_m, self._made))

    def follow(self, robot: str) -> tuple[int, int]:
        """Tell a rover to drive the scenario's own way; returns when it begins and ends."""
        with self._lock:
            return self._times(self.rovers[robot].follow(self._made))

    def close(self) -> None:
        """Make no more."""
        self._closed.set()

    def _times(self, ticks: tuple[int, int]) -> tuple[int, int]:
        return self._epoch_ns + ticks[0] * self._tick_ns, self._epoch_ns + ticks[1] * self._tick_ns
