# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A log of simulated rovers that is computed while it is played, and whose rovers accept drive commands."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs import LogSample, LogWriter
from cdff_dev.logs.source import LogSource, StreamInfo
from cdff_dev.missions.rover import Rover
from cdff_dev.simulate.camera import camera_of_world
from cdff_dev.simulate.world import World, cast_scene

#: Type of each stream of a rover.
STREAMS = {
    "imu.sample": "IMUSensors",
    "wheels.odometry": "TransformWithCovariance",
    "lidar.scan": "LidarScan",
}
#: Type of each stream of the stereo camera.
CAMERA_STREAMS = {"navcam.pair": "FramePair"}
#: Upper bound of the size of a scan per point, bytes: position, time, intensity and ring.
_POINT_BYTES = 20
#: Longest mission, seconds: a log must state its end before it is played.
_MAX_DURATION_S = 86_400


class GrowingLog(LogSource):
    """The rovers of a world as a ``LogSource`` without end.

    True poses are not among its samples.

    Parameters
    ----------
    truth : LogWriter or None
        Log to which the true poses are written.
    """

    def __init__(self, world: World, truth: LogWriter | None) -> None:
        scenario = world.scenario
        if scenario.rovers_in_view is not None:
            raise InputError(
                f"scenario {scenario.name}: rovers_in_view: expected none, because driven rovers are "
                "not visible in images; remove the section"
            )
        scene = cast_scene(world.relief, world.rocks)
        camera = camera_of_world(world, scene)
        wheel_relief = world.relief.smoothed(
            scenario.chassis.wheel_footprint_m / float(np.min(np.diff(world.relief.x_m)))
        )
        self._stream_types = STREAMS | ({} if camera is None else CAMERA_STREAMS)
        self.rovers = {
            robot: Rover(world, robot, scene, wheel_relief, camera) for robot in sorted(scenario.robots)
        }
        self._epoch_ns = scenario.epoch_ns
        self._tick_ns = round(NS_PER_S / scenario.lidar.rate_hz)
        self._truth = truth
        self._computed_ticks = self._delivered_ticks = 0
        self._lock = threading.Lock()
        self._closed = threading.Event()
        #: Size of the samples of two ticks, bytes: the player reads no further ahead.
        tick_bytes = scenario.lidar.rings * scenario.lidar.columns * _POINT_BYTES
        if camera is not None:
            tick_bytes += 2 * camera.model.rows * camera.model.columns
        self.ahead_bytes = 2 * len(self.rovers) * tick_bytes

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name; the number of their samples is unknown (0)."""
        end_ns = self._epoch_ns + _MAX_DURATION_S * NS_PER_S
        return {
            f"/{robot}/{stream}": StreamInfo(type_name, 0, self._epoch_ns, end_ns)
            for robot in self.rovers
            for stream, type_name in self._stream_types.items()
        }

    def ready_ns(self) -> int:
        """Return the mission time up to which all samples have been delivered."""
        return self._epoch_ns + self._delivered_ticks * self._tick_ns

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of each tick until the log is closed."""
        selected = set(self.streams if streams is None else streams)
        while not self._closed.is_set():
            with self._lock:
                samples = [
                    sample for rover in self.rovers.values() for sample in rover.samples(self._computed_ticks)
                ]
                self._computed_ticks += 1
            samples.sort(key=lambda s: (s.stamp_ns, s.stream))
            for sample in samples:
                if self._truth is not None and sample.stream.endswith("/truth.pose"):
                    self._truth.write(sample.stream, sample.value, sample.stamp_ns, sample.header)
            yield from (sample for sample in samples if sample.stream in selected)
            self._delivered_ticks += 1

    def drive(self, robot: str, path_m: FloatArray) -> tuple[int, int]:
        """Drive a path, see ``Rover.drive``; return start and end of the motion, mission nanoseconds."""
        with self._lock:
            return self._times_ns(self.rovers[robot].drive(path_m, self._computed_ticks))

    def follow(self, robot: str) -> tuple[int, int]:
        """Drive the path of the scenario; return start and end of the motion."""
        with self._lock:
            return self._times_ns(self.rovers[robot].follow(self._computed_ticks))

    def close(self) -> None:
        """End ``samples``."""
        self._closed.set()

    def _times_ns(self, ticks: tuple[int, int]) -> tuple[int, int]:
        """Return the times of the first and the last tick of a leg, nanoseconds."""
        return self._epoch_ns + ticks[0] * self._tick_ns, self._epoch_ns + ticks[1] * self._tick_ns
