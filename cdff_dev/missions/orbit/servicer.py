# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated servicer that executes commanded displacements, and whose samples are computed step by step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs import LogSample
from cdff_dev.simulate.orbit.images import CameraSimulator
from cdff_dev.simulate.orbit.navigation import (
    measured_states,
    next_slow_error,
    star_tracker_attitudes,
    star_tracker_bias,
)
from cdff_dev.simulate.orbit.random_streams import generator
from cdff_dev.simulate.orbit.rendezvous import (
    IMAGE_TRUTH,
    attitude_entries,
    gnss_entries,
    rendered_value,
    true_detections,
    true_states,
)
from cdff_dev.simulate.orbit.scans import LidarSimulator
from cdff_dev.simulate.orbit.scenario import OrbitScenario, Thrust
from cdff_dev.simulate.orbit.sensors import Camera, OrbitLidar
from cdff_dev.simulate.orbit.world import OrbitWorld, check_distances
from cdff_dev.simulate.samples import Entry, header

#: Streams of the ground truth that are written for each image; masks and points would be large.
_TRUTH_OF_IMAGES = tuple(kind for kind in IMAGE_TRUTH if kind not in ("mask", "points"))


class GuidedServicer:
    """The servicer of a scenario, which keeps its position after the scenario's path and can be moved.

    Parameters
    ----------
    scenario : OrbitScenario
        Without IMU. All sensors deliver at multiples of ``step_s``.

    Raises
    ------
    ConfigurationError
        If a sensor of the scenario is not supported.
    """

    #: Time simulated in one step, seconds.
    step_s = 1.0

    def __init__(self, scenario: OrbitScenario) -> None:
        servicer = scenario.servicer
        if servicer.imu is not None:
            raise ConfigurationError(f"scenario {scenario.name}: a guided servicer has no imu; remove it")
        sensors: dict[str, Camera | OrbitLidar] = {**servicer.cameras, **servicer.lidars}
        for name, sensor in sensors.items():
            if sensor.start_s or sensor.rate_hz > 1.0 / self.step_s:
                raise ConfigurationError(
                    f"scenario {scenario.name}: {name}: a guided servicer supports start_s 0 and rates up to "
                    f"{1.0 / self.step_s:g} Hz"
                )
        self.scenario, self._world = scenario, OrbitWorld(scenario)
        self._motion = self._world.motion
        self._cameras = {name: CameraSimulator(self._world, name) for name in servicer.cameras}
        self._lidars = {name: LidarSimulator(self._world, name) for name in servicer.lidars}
        self._attitude_rng, self._gnss_rng = generator(scenario, "star_tracker"), generator(scenario, "gnss")
        self._thrust_rng = generator(scenario, "thrust")
        if servicer.star_tracker is not None:
            self._bias = star_tracker_bias(servicer.star_tracker, self._attitude_rng)
        self._slow_m = np.zeros(3)
        if servicer.gnss is not None:
            self._slow_m = servicer.gnss.slow_sigma_m * self._gnss_rng.standard_normal(3)
        self._rest_s = scenario.duration_s
        self._lost_until_s: dict[str, float] = {}

    @property
    def streams(self) -> dict[str, str]:
        """ASN.1 type of each sensor stream."""
        servicer = self.scenario.servicer
        streams = {f"/{servicer.name}/{name}.image": "Frame" for name in servicer.cameras}
        streams |= {f"/{servicer.name}/{name}.scan": "LidarScan" for name in servicer.lidars}
        if servicer.star_tracker is not None:
            streams[f"/{servicer.name}/star_tracker.attitude"] = "TransformWithCovariance"
        if servicer.gnss is not None:
            streams[f"/{servicer.name}/gnss.state"] = "RigidBodyState"
        return streams

    @property
    def largest_step_bytes(self) -> int:
        """Upper bound of the size of the samples of one step."""
        servicer = self.scenario.servicer
        pixels = sum(2 * c.rows * c.columns for c in servicer.cameras.values())
        return 4096 + pixels + sum(20 * s.rows * s.columns for s in servicer.lidars.values())

    def move(
        self, displacement_m: FloatArray, duration_s: float, t_s: float, *, in_base: bool
    ) -> tuple[float, float]:
        """Move along a straight line, from rest to rest, with the errors of the thrusters.

        Parameters
        ----------
        displacement_m : ndarray (3,)
            Inertial axes, or those of the base at the start.
        t_s : float
            Earliest start, seconds since the epoch.

        Returns
        -------
        tuple of (float, float)
            Start and end of the motion, seconds since the epoch.

        Raises
        ------
        InputError
            If the servicer still moves, the displacement is not finite, or a sensor would come too close to a
            body.
        """
        if not (np.isfinite(displacement_m).all() and 1.0 <= duration_s <= 86400.0):
            raise InputError(
                f"displacement_m {displacement_m.tolist()}, duration_s {duration_s:g}: expected finite "
                "numbers, and a duration between 1 and 86400"
            )
        if t_s < self._rest_s:
            raise InputError(f"the servicer moves for another {self._rest_s - t_s:.1f} s; repeat it then")
        errors = self.scenario.servicer.thrust or Thrust()
        scale = 1.0 + errors.scale_sigma * self._thrust_rng.standard_normal()
        noise_m = errors.position_sigma_m * self._thrust_rng.standard_normal(3)
        executed_m = scale * displacement_m + noise_m
        if in_base:
            executed_m = self._motion.base_attitudes(np.array([t_s]))[0] @ executed_m
        try:
            with self._motion.tentative_move(executed_m, t_s, duration_s):
                t_check_s = np.linspace(t_s, t_s + duration_s, 200)
                check_distances(self.scenario, self._motion, self._world.scenes, t_check_s)
        except ConfigurationError as error:
            raise InputError(f"displacement {np.round(displacement_m, 2).tolist()} m: {error}") from error
        self._rest_s = t_s + duration_s
        return t_s, self._rest_s

    def lose_sensor(self, sensor: str, duration_s: float, t_s: float) -> float:
        """Withhold the samples of a sensor; return the time at which it delivers again, seconds.

        Raises
        ------
        InputError
            If there is no such sensor.
        """
        known = {stream.split("/")[2].split(".")[0] for stream in self.streams}
        if sensor not in known:
            raise InputError(f"sensor {sensor!r}: expected one of {', '.join(sorted(known))}")
        self._lost_until_s[sensor] = t_s + duration_s
        return self._lost_until_s[sensor]

    def samples(self, step: int) -> Iterator[LogSample]:
        """Yield the samples of a step, those of the ground truth included, in the order of their stamps."""
        begin_s = step * self.step_s
        entries = [*self._truth(begin_s), *self._navigation(begin_s), *self._images(begin_s)]
        entries += self._scans(begin_s)
        lost = {sensor for sensor, until_s in self._lost_until_s.items() if begin_s < until_s}
        for entry in sorted(entries, key=lambda e: (e.stamp_ns, e.stream)):
            if entry.stream.split("/")[2].split(".")[0] not in lost:
                type_name = type(entry.value).__name__
                yield LogSample(
                    entry.stream, type_name, entry.stamp_ns, entry.header.seq, entry.value, entry.header
                )

    def _times(self, rate_hz: float, begin_s: float) -> tuple[np.ndarray, int]:
        """Return the sample times (n,) of a step, microseconds since the epoch, and the first number."""
        first = int(np.ceil(round(begin_s * rate_hz, 6)))
        end = int(np.ceil(round((begin_s + self.step_s) * rate_hz, 6)))
        return np.round(np.arange(first, end) / rate_hz * 1e6).astype(np.int64), first

    def _truth(self, begin_s: float) -> Iterator[Entry]:
        t_us, first = self._times(self.scenario.truth_rate_hz, begin_s)
        if len(t_us):
            yield from true_states(self.scenario, self._motion, t_us, first)

    def _navigation(self, begin_s: float) -> Iterator[Entry]:
        """Yield the samples of star tracker and GNSS receiver."""
        servicer = self.scenario.servicer
        if servicer.star_tracker is not None:
            t_us, first = self._times(servicer.star_tracker.rate_hz, begin_s)
            track = star_tracker_attitudes(
                servicer.star_tracker, self._motion, t_us * 1e-6, self._bias, self._attitude_rng
            )
            yield from attitude_entries(self.scenario, track, t_us, first)
        if servicer.gnss is not None:
            t_us, first = self._times(servicer.gnss.rate_hz, begin_s)
            slow = []
            for _ in t_us:
                self._slow_m = next_slow_error(servicer.gnss, self._slow_m, self._gnss_rng.standard_normal(3))
                slow.append(self._slow_m)
            if slow:
                states = measured_states(
                    servicer.gnss, self._motion, t_us * 1e-6, np.array(slow), self._gnss_rng
                )
                yield from gnss_entries(self.scenario, states, t_us, first)

    def _images(self, begin_s: float) -> Iterator[Entry]:
        name = self.scenario.servicer.name
        for camera, simulator in self._cameras.items():
            t_us, first = self._times(simulator.model.rate_hz, begin_s)
            for i, us in enumerate(t_us, start=first):
                image = simulator.image(float(us) * 1e-6, i)
                streams = [
                    f"/{name}/{camera}.image",
                    *(f"/{name}/truth.{camera}_{kind}" for kind in _TRUTH_OF_IMAGES),
                ]
                for stream in streams:
                    yield self._rendered(stream, int(us), i, f"{name}/{camera}", ("camera", camera, i), image)

    def _scans(self, begin_s: float) -> Iterator[Entry]:
        """Yield the scans that end within the step, with the true poses of the bodies at their ends."""
        scenario = self.scenario
        name = scenario.servicer.name
        for lidar, simulator in self._lidars.items():
            model = simulator.model
            t_us, first = self._times(model.rate_hz, begin_s)
            for i, us in enumerate(t_us, start=first):
                scan = simulator.scan(float(us) * 1e-6, i)
                end_us = int(us) + round(model.sweep_s * 1e6)
                stream, frame = f"/{name}/{lidar}.scan", f"{name}/{lidar}"
                yield self._rendered(stream, end_us, i, frame, ("lidar", lidar, i), scan, begin_us=int(us))
                T_lidar_base = se3.inverse(model.mount.matrix())
                end_s = np.array([end_us * 1e-6])
                poses = {
                    body.name: T_lidar_base @ self._motion.poses_in_base(body.name, end_s)[0]
                    for body in scenario.bodies
                }
                stamp_ns = scenario.epoch_ns + end_us * 1000
                stream = f"/{name}/truth.{lidar}_target"
                head = header(scenario, stream, i, stamp_ns, stamp_ns, frame)
                yield Entry(stream, stamp_ns, head, true_detections(poses, stamp_ns, frame))

    def _rendered(
        self,
        stream: str,
        end_us: int,
        seq: int,
        frame: str,
        render: tuple[str, str, int],
        result: Any,
        begin_us: int | None = None,
    ) -> Entry:
        """Return a sample of an image or scan."""
        epoch_ns = self.scenario.epoch_ns
        t1_ns = epoch_ns + end_us * 1000
        t0_ns = t1_ns if begin_us is None else epoch_ns + begin_us * 1000
        entry = Entry(stream, t1_ns, header(self.scenario, stream, seq, t0_ns, t1_ns, frame), render=render)
        return Entry(stream, t1_ns, entry.header, rendered_value(self.scenario, entry, result))
