# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated rover that accepts drive commands: its motion and its sensor samples, leg by leg."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.errors import ConfigurationError, ConflictError, InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.covariance import compose_covariance
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, product_id
from cdff_common.types import IMUSensors, LidarScan, Time, TransformWithCovariance
from cdff_dev.logs import LogSample
from cdff_dev.missions.motion import (
    MAX_CORNER_RAD,
    motion_along_path,
    motion_at_rest,
    sharpest_turn_rad,
)
from cdff_dev.simulate.camera import StereoCamera, pair_of_images
from cdff_dev.simulate.lidar import scan
from cdff_dev.simulate.proprioception import imu_readings, wheel_odometry
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.rover_motion import Motion
from cdff_dev.simulate.world import World, generator

PRODUCER = "simulator"
#: Parameters of IMU errors that continue over all legs.
_PERSISTENT = (
    "acc_bias_sigma_m_s2",
    "gyro_bias_sigma_rad_s",
    "acc_walk_m_s3_sqrt_hz",
    "gyro_walk_rad_s2_sqrt_hz",
)
#: Last index of the random numbers of images, which differ from those of ``cdff simulate``.
_DRIVEN = 1
#: Largest distance of the start of a path from the rover, and smallest extent of a path, metres.
_PATH_TOLERANCE_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """The motion of a rover between two ticks, and the readings of its IMU and wheels, one row per sample."""

    motion: Motion
    first_tick: int
    last_tick: int
    acc_m_s2: FloatArray
    gyro_rad_s: FloatArray
    T_odom_base: FloatArray
    odometry_covariances: FloatArray


class Rover:
    """A simulated rover, which produces its sensor samples tick by tick.

    Without a commanded path it is at rest.

    A tick is one period of the lidar. Legs start and end at rest, on ticks. Errors of the rover (biases of
    its IMU) continue over all legs; errors that depend on the terrain (slip, gain of skid steering) are
    drawn for each leg.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Terrain and rocks of the world.
    wheel_relief : Relief
        Terrain smoothed over the footprint of a wheel.
    camera : StereoCamera, optional
        Camera of the world, if its scenario has one.

    Notes
    -----
    Not thread-safe: ``GrowingLog`` serialises commands and sampling.
    """

    def __init__(
        self,
        world: World,
        robot: str,
        scene: Any,
        wheel_relief: Relief,
        camera: StereoCamera | None = None,
    ) -> None:
        self._world, self._scenario, self.robot = world, world.scenario, robot
        self._camera = camera
        if self._scenario.faults is not None:
            raise ConfigurationError(
                f"scenario {self._scenario.name}: faults: expected none, because driven rovers do not "
                "simulate them; use cdff simulate, or remove the section"
            )
        self._scene, self._wheel_relief = scene, wheel_relief
        self._index = sorted(self._scenario.robots).index(robot)
        self.tick_s = 1.0 / self._scenario.lidar.rate_hz
        self._samples_per_tick = {
            name: _whole_number(
                rate * self.tick_s, f"{name}.rate_hz {rate:g} at lidar.rate_hz {1 / self.tick_s:g}"
            )
            for name, rate in (
                ("imu", self._scenario.imu.rate_hz),
                ("wheels", self._scenario.wheels.rate_hz),
                ("truth", self._scenario.truth_rate_hz),
                *((("navcam", camera.model.rate_hz),) if camera is not None else ()),
            )
        }
        rng = generator(self._scenario, "imu", self._index)
        self._acc_bias = self._scenario.imu.acc_bias_sigma_m_s2 * rng.standard_normal(3)
        self._gyro_bias = self._scenario.imu.gyro_bias_sigma_rad_s * rng.standard_normal(3)
        self._T_odom_base, self._odom_covariance = np.eye(4), np.zeros((6, 6))
        self._legs = 0
        self._counts: Counter[str] = Counter()
        self._leg = self._rest(world.motions[robot].poses(np.zeros(1))[0], 0)

    def drive(self, path_m: FloatArray, tick: int) -> tuple[int, int]:
        """Drive a path that starts at a tick; return the first and the last tick of the motion.

        Parameters
        ----------
        path_m : ndarray, shape (n, 2)
            Corners in the current level base frame (x forward, y left), metres, the first at (0, 0).

        Raises
        ------
        ConflictError
            If the rover is still driving a previous path.
        InputError
            If the path has fewer than two corners, does not start at the rover, turns too sharply,
            or leaves the terrain.
        """
        self._check_at_rest(tick)
        corners = np.asarray(path_m, dtype=np.float64)
        if (
            corners.ndim != 2
            or corners.shape[1:] != (2,)
            or len(corners) < 2
            or not np.isfinite(corners).all()
        ):
            raise InputError(f"path of shape {corners.shape}: expected at least two finite corners (n, 2)")
        if (
            np.linalg.norm(corners[0]) > _PATH_TOLERANCE_M
            or np.ptp(corners, axis=0).max() < _PATH_TOLERANCE_M
        ):
            ends = f"from {corners[0].round(2).tolist()} to {corners[-1].round(2).tolist()}"
            raise InputError(
                f"path {ends}: expected one that starts at the rover, (0, 0), and leads away from it"
            )
        sharpest_rad = sharpest_turn_rad(corners)
        if sharpest_rad > MAX_CORNER_RAD:
            excess = f"turns by {math.degrees(sharpest_rad):.0f} deg at a corner, expected at most"
            raise InputError(f"path {excess} {math.degrees(MAX_CORNER_RAD):.0f}; split it into two paths")
        T_site_base = self.pose()
        heading = float(np.arctan2(T_site_base[1, 0], T_site_base[0, 0]))
        c, s = math.cos(heading), math.sin(heading)
        ground_xy = T_site_base[:2, 3] - self._scenario.chassis.base_height_m * T_site_base[:2, 2]
        path = ground_xy + corners @ np.array([[c, s], [-s, c]])
        half_m = self._scenario.terrain.fine_half_width_m
        if np.abs(path).max() > half_m:
            raise InputError(
                f"path to {path[-1].round(1).tolist()}: the terrain ends {half_m:g} m from its centre"
            )
        drive = self._scenario.robots[self.robot]
        motion, end_s = motion_along_path(
            path, heading, drive.speed_m_s, drive.ramp_s, self._scenario.chassis, self._wheel_relief
        )
        return self._start_leg(motion, tick, math.ceil(end_s / self.tick_s))

    def follow(self, tick: int) -> tuple[int, int]:
        """Drive the path of the scenario from a tick on.

        Raises ConflictError if the rover has left its start.
        """
        self._check_at_rest(tick)
        motion = self._world.motions[self.robot]
        if np.linalg.norm(motion.poses(np.zeros(1))[0] - self.pose()) > 1e-6:
            raise ConflictError(f"{self.robot} has left the start of the path of its scenario")
        return self._start_leg(motion, tick, math.floor(self._scenario.duration_s / self.tick_s))

    def pose(self) -> FloatArray:
        """Return the true ``T_site_base``, shape (4, 4), at the end of the current leg."""
        ticks = self._leg.last_tick - self._leg.first_tick
        end_pose: FloatArray = self._leg.motion.poses(np.array([ticks * self.tick_s]))[0]
        return end_pose

    def samples(self, tick: int) -> Iterator[LogSample]:
        """Yield the sensor samples and true poses of one tick; calls must be for consecutive ticks."""
        if tick >= self._leg.last_tick:
            self._leg = self._rest(self.pose(), tick)
        leg, ticks = self._leg, tick - self._leg.first_tick
        for i in range(ticks * self._samples_per_tick["imu"], (ticks + 1) * self._samples_per_tick["imu"]):
            stamp_ns = self._stamp_ns(leg, "imu", i)
            value = IMUSensors(Time.from_ns(stamp_ns), leg.acc_m_s2[i], leg.gyro_rad_s[i], np.zeros(3))
            yield self._sample("imu.sample", value, stamp_ns, stamp_ns, f"{self.robot}/imu")
        for i in range(
            ticks * self._samples_per_tick["wheels"], (ticks + 1) * self._samples_per_tick["wheels"]
        ):
            stamp_ns = self._stamp_ns(leg, "wheels", i)
            T = UncertainTransform(leg.T_odom_base[i], leg.odometry_covariances[i])
            yield self._pose_sample("wheels.odometry", T, f"{self.robot}/odom", stamp_ns)
        steps = np.arange(
            ticks * self._samples_per_tick["truth"], (ticks + 1) * self._samples_per_tick["truth"]
        )
        for k, T in zip(steps, leg.motion.poses(steps / self._scenario.truth_rate_hz), strict=True):
            pose = UncertainTransform.exact(T)
            yield self._pose_sample("truth.pose", pose, "site", self._stamp_ns(leg, "truth", int(k)))
        yield self._lidar_sample(leg, tick)
        if self._camera is not None:
            pairs = self._samples_per_tick["navcam"]
            for i in range(ticks * pairs, (ticks + 1) * pairs):
                yield self._camera_sample(self._camera, leg, i)

    def _camera_sample(self, camera: StereoCamera, leg: Leg, row: int) -> LogSample:
        """Return a stereo pair of a leg; all its rows are exposed at one time."""
        stamp_ns, frame = self._stamp_ns(leg, "navcam", row), f"{self.robot}/navcam_left"
        rng = generator(self._scenario, "navcam", self._index, self._counts["navcam.pair"], _DRIVEN)
        T_site_base = leg.motion.poses(np.array([row / camera.model.rate_hz]))[0]
        value = pair_of_images(camera.model, camera.pair(T_site_base, rng), stamp_ns, frame)
        return self._sample("navcam.pair", value, stamp_ns, stamp_ns, frame)

    def _lidar_sample(self, leg: Leg, tick: int) -> LogSample:
        """Return the lidar scan that starts at a tick."""
        model, frame = self._scenario.lidar, f"{self.robot}/lidar"
        t0_s = (tick - leg.first_tick) * self.tick_s
        revolution = scan(
            model, self._scene, leg.motion, t0_s, generator(self._scenario, "lidar", self._index, tick)
        )
        t0_ns = self._scenario.epoch_ns + round(tick * self.tick_s * NS_PER_S)
        t1_ns = t0_ns + round(model.sweep_s * 1e6) * 1000
        value = LidarScan.from_arrays(
            revolution.points_m,
            revolution.time_offset_us,
            frame=frame,
            t0_ns=t0_ns,
            t1_ns=t1_ns,
            intensity=revolution.intensity,
            ring=revolution.ring,
            sensor=frame,
        )
        return self._sample("lidar.scan", value, t0_ns, t1_ns, frame)

    def _check_at_rest(self, tick: int) -> None:
        if tick < self._leg.last_tick:
            remaining_s = (self._leg.last_tick - tick) * self.tick_s
            raise ConflictError(
                f"{self.robot} drives for another {remaining_s:.1f} s; command the next path after that"
            )

    def _start_leg(self, motion: Motion, tick: int, ticks: int) -> tuple[int, int]:
        """Start a motion at a tick; return its first and its last tick."""
        self._leg = self._leg_with_readings(motion, tick, tick + ticks)
        return self._leg.first_tick, self._leg.last_tick

    def _rest(self, T_site_base: FloatArray, tick: int) -> Leg:
        return self._leg_with_readings(motion_at_rest(T_site_base, 2.0 * self.tick_s), tick, tick + 1)

    def _leg_with_readings(self, motion: Motion, first_tick: int, last_tick: int) -> Leg:
        """Return a leg with its readings; IMU biases and odometry continue from the previous leg."""
        self._legs += 1
        imu, wheels = self._scenario.imu, self._scenario.wheels
        rng = generator(self._scenario, "imu", self._index, self._legs)
        t_s = np.arange((last_tick - first_tick) * self._samples_per_tick["imu"]) / imu.rate_hz
        white_noise_only = imu.model_copy(update=dict.fromkeys(_PERSISTENT, 0.0))
        readings = imu_readings(white_noise_only, motion, t_s, self._scenario.gravity_m_s2, rng)
        root_dt = math.sqrt(1.0 / imu.rate_hz)
        acc_bias = self._acc_bias + np.cumsum(
            imu.acc_walk_m_s3_sqrt_hz * root_dt * rng.standard_normal((len(t_s), 3)), 0
        )
        gyro_bias = self._gyro_bias + np.cumsum(
            imu.gyro_walk_rad_s2_sqrt_hz * root_dt * rng.standard_normal((len(t_s), 3)), 0
        )
        self._acc_bias, self._gyro_bias = acc_bias[-1], gyro_bias[-1]
        t_s = np.arange((last_tick - first_tick) * self._samples_per_tick["wheels"] + 1) / wheels.rate_hz
        odometry = wheel_odometry(
            wheels, motion, t_s, generator(self._scenario, "wheels", self._index, self._legs)
        )
        poses, covariances = self._continue_odometry(odometry.poses, odometry.covariances)
        return Leg(
            motion,
            first_tick,
            last_tick,
            readings.acc_m_s2 + acc_bias,
            readings.gyro_rad_s + gyro_bias,
            poses[:-1],
            covariances[:-1],
        )

    def _continue_odometry(self, poses: FloatArray, covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the odometry of a leg in the odometry frame of the rover, and its covariances.

        The variance of the tilt, which is not measured, is the same for one leg and for many: the parts of
        previous legs are not added up.
        """
        tilt = np.zeros((6, 6))
        tilt[3, 3] = tilt[4, 4] = self._scenario.wheels.reported_tilt_sigma_rad**2
        T_odom_start, start_covariance = self._T_odom_base, self._odom_covariance
        composed = [
            compose_covariance(T_odom_start, start_covariance, T, C - tilt * (i > 0))
            for i, (T, C) in enumerate(zip(poses, covariances, strict=True))
        ]
        self._T_odom_base, self._odom_covariance = T_odom_start @ poses[-1], composed[-1]
        return T_odom_start @ poses, np.array(composed) + tilt * (self._legs > 1)

    def _stamp_ns(self, leg: Leg, sensor: str, row: int) -> int:
        us = round((leg.first_tick * self.tick_s + row * self.tick_s / self._samples_per_tick[sensor]) * 1e6)
        return self._scenario.epoch_ns + us * 1000

    def _pose_sample(self, stream: str, T: UncertainTransform, parent: str, stamp_ns: int) -> LogSample:
        child = f"{self.robot}/base"
        value = TransformWithCovariance.from_transform(
            T, parent=parent, child=child, stamp_ns=stamp_ns, producer=PRODUCER
        )
        return self._sample(stream, value, stamp_ns, stamp_ns, parent, child)

    def _sample(
        self, stream: str, value: Any, t0_ns: int, t1_ns: int, frame: str, child: str | None = None
    ) -> LogSample:
        """Return a sample of a stream with its header."""
        self._counts[stream] += 1
        seq = self._counts[stream] - 1
        sensor, _, port = stream.partition(".")
        kind = CovarianceKind.NONE if child is None else CovarianceKind.FORMAL
        header = Header(
            id=product_id(self.robot, sensor, port, t1_ns, seq, self._scenario.digest),
            seq=seq,
            t0_ns=t0_ns,
            t1_ns=t1_ns,
            frame=frame,
            child=child,
            producer=PRODUCER,
            config_hash=self._scenario.digest,
            quality=Quality(reasons=("simulated",), covariance_kind=kind),
        )
        return LogSample(f"/{self.robot}/{stream}", type(value).__name__, t1_ns, seq, value, header)


def _whole_number(ratio: float, name: str) -> int:
    if abs(ratio - round(ratio)) > 1e-9 or round(ratio) < 1:
        raise InputError(f"{name}: expected a whole number of samples in each period of the lidar")
    return round(ratio)
