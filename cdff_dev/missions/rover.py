# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One simulated rover that is driven while it is simulated: what it feels and sees, leg by leg."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.errors import ConflictError, InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.covariance import compose_covariance
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, product_id
from cdff_common.types import IMUSensors, LidarScan, Time, TransformWithCovariance
from cdff_dev.logs import LogSample
from cdff_dev.missions.motion import SHARPEST_RAD, along, sharpest_turn_rad, standing
from cdff_dev.simulate.drive import Motion
from cdff_dev.simulate.lidar import scan
from cdff_dev.simulate.proprioception import imu_readings, wheel_odometry
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.world import World, generator

PRODUCER = "simulator"
#: Errors of an IMU that go on from one leg to the next.
_LASTING = ("acc_bias_sigma_m_s2", "gyro_bias_sigma_rad_s", "acc_walk_m_s3_sqrt_hz", "gyro_walk_rad_s2_sqrt_hz")
#: A way begins within this of the rover, and is longer, metres.
_AT_ROVER_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """A motion from one tick to another, and what wheels and IMU read on it, a row for each sample."""

    motion: Motion
    first_tick: int
    last_tick: int
    acc_m_s2: FloatArray
    gyro_rad_s: FloatArray
    T_odom_base: FloatArray
    odometry_covariances: FloatArray


class Rover:
    """Sensor samples of one rover, tick by tick; it stands unless it was told a way.

    A tick is the period of the lidar. Legs begin and end on ticks, at rest. Errors that belong to a rover (the biases
    of its IMU) last; those that belong to the ground under it (slip, gain of skid steering) are drawn for each leg.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Of the world.
    felt : Relief
        Ground as wheels feel it.

    Notes
    -----
    Not thread-safe: whoever drives and whoever samples take turns (``Driven``).
    """

    def __init__(self, world: World, robot: str, scene: Any, felt: Relief) -> None:
        self._world, self._scenario, self.robot = world, world.scenario, robot
        self._scene, self._felt = scene, felt
        self._index = sorted(self._scenario.robots).index(robot)
        self.tick_s = 1.0 / self._scenario.lidar.rate_hz
        self._per_tick = {
            name: _whole(rate * self.tick_s, f"{name}.rate_hz {rate:g} at lidar.rate_hz {1 / self.tick_s:g}")
            for name, rate in (
                ("imu", self._scenario.imu.rate_hz),
                ("wheels", self._scenario.wheels.rate_hz),
                ("truth", self._scenario.truth_rate_hz),
            )
        }
        bias = generator(self._scenario, "imu", self._index)
        self._acc_bias = self._scenario.imu.acc_bias_sigma_m_s2 * bias.standard_normal(3)
        self._gyro_bias = self._scenario.imu.gyro_bias_sigma_rad_s * bias.standard_normal(3)
        self._T_odom_base, self._odom_covariance = np.eye(4), np.zeros((6, 6))
        self._legs = 0
        self._counts: Counter[str] = Counter()
        self._leg = self._rest(world.motions[robot].poses(np.zeros(1))[0], 0)

    def drive(self, way_m: FloatArray, tick: int) -> tuple[int, int]:
        """Follow a way from the tick on; returns first and last tick.

        Parameters
        ----------
        way_m : ndarray, shape (n, 2)
            Corners ahead of and left of the rover as it stands (level base frame), metres, from (0, 0).

        Raises
        ------
        ConflictError
            While an earlier way is driven.
        InputError
            On fewer than two corners, a way that does not begin at the rover, turns back in one corner, or leaves the
        ground.
        """
        self._check_free(tick)
        corners = np.asarray(way_m, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 2 or not np.isfinite(corners).all():
            raise InputError(f"way of shape {corners.shape}: expected at least two finite corners (n, 2)")
        if np.linalg.norm(corners[0]) > _AT_ROVER_M or np.ptp(corners, axis=0).max() < _AT_ROVER_M:
            ends = f"from {corners[0].round(2).tolist()} to {corners[-1].round(2).tolist()}"
            raise InputError(f"way {ends}: expected one that begins at the rover, (0, 0), and leads away from it")
        sharpest_rad = sharpest_turn_rad(corners)
        if sharpest_rad > SHARPEST_RAD:
            said = f"turns by {math.degrees(sharpest_rad):.0f} deg at a corner, expected at most"
            raise InputError(f"way {said} {math.degrees(SHARPEST_RAD):.0f}; tell it as two ways")
        T = self.pose()
        heading = float(np.arctan2(T[1, 0], T[0, 0]))
        c, s = math.cos(heading), math.sin(heading)
        ground_xy = T[:2, 3] - self._scenario.chassis.base_height_m * T[:2, 2]
        way = ground_xy + corners @ np.array([[c, s], [-s, c]])
        half_m = self._scenario.terrain.fine_half_width_m
        if np.abs(way).max() > half_m:
            raise InputError(f"way to {way[-1].round(1).tolist()}: the ground ends {half_m:g} m from the middle")
        drive = self._scenario.robots[self.robot]
        motion, end_s = along(way, heading, drive.speed_m_s, drive.ramp_s, self._scenario.chassis, self._felt)
        return self._set_out(motion, tick, math.ceil(end_s / self.tick_s))

    def follow(self, tick: int) -> tuple[int, int]:
        """Drive the scenario's own way from the tick on; raises ConflictError anywhere but at its begin."""
        self._check_free(tick)
        motion = self._world.motions[self.robot]
        if np.linalg.norm(motion.poses(np.zeros(1))[0] - self.pose()) > 1e-6:
            raise ConflictError(f"{self.robot} has left the begin of its scenario's way")
        return self._set_out(motion, tick, math.floor(self._scenario.duration_s / self.tick_s))

    def pose(self) -> FloatArray:
        """``T_site_base``, shape (4, 4), at the end of the leg that is sampled last: the truth."""
        return self._leg.motion.poses(np.array([(self._leg.last_tick - self._leg.first_tick) * self.tick_s]))[0]

    def samples(self, tick: int) -> Iterator[LogSample]:
        """What the sensors give between two ticks, and the truth; ticks are asked for one after another."""
        if tick >= self._leg.last_tick:
            self._leg = self._rest(self.pose(), tick)
        leg, ticks = self._leg, tick - self._leg.first_tick
        for i in range(ticks * self._per_tick["imu"], (ticks + 1) * self._per_tick["imu"]):
            stamp_ns = self._stamp_ns(leg, "imu", i)
            value = IMUSensors(Time.from_ns(stamp_ns), leg.acc_m_s2[i], leg.gyro_rad_s[i], np.zeros(3))
            yield self._sample("imu.sample", value, stamp_ns, stamp_ns, f"{self.robot}/imu")
        for i in range(ticks * self._per_tick["wheels"], (ticks + 1) * self._per_tick["wheels"]):
            stamp_ns = self._stamp_ns(leg, "wheels", i)
            T = UncertainTransform(leg.T_odom_base[i], leg.odometry_covariances[i])
            yield self._pose_sample("wheels.odometry", T, f"{self.robot}/odom", stamp_ns)
        steps = np.arange(ticks * self._per_tick["truth"], (ticks + 1) * self._per_tick["truth"])
        for i, T in zip(steps, leg.motion.poses(steps / self._scenario.truth_rate_hz), strict=True):
            at = UncertainTransform(T, np.zeros((6, 6)))
            yield self._pose_sample("truth.pose", at, "site", self._stamp_ns(leg, "truth", int(i)))
        yield self._swept(leg, tick)

    def _swept(self, leg: Leg, tick: int) -> LogSample:
        """The revolution that begins with the tick."""
        model, frame = self._scenario.lidar, f"{self.robot}/lidar"
        t0_s = (tick - leg.first_tick) * self.tick_s
        made = scan(model, self._scene, leg.motion, t0_s, generator(self._scenario, "lidar", self._index, tick))
        t0_ns = self._scenario.epoch_ns + round(tick * self.tick_s * NS_PER_S)
        t1_ns = t0_ns + round(model.sweep_s * 1e6) * 1000
        value = LidarScan.from_arrays(
            made.points_m, made.time_offset_us, frame=frame, t0_ns=t0_ns, t1_ns=t1_ns,
            intensity=made.intensity, ring=made.ring, sensor=frame,
        )  # fmt: skip
        return self._sample("lidar.scan", value, t0_ns, t1_ns, frame)

    def _check_free(self, tick: int) -> None:
        if tick < self._leg.last_tick:
            left_s = (self._leg.last_tick - tick) * self.tick_s
            raise ConflictError(f"{self.robot} drives for another {left_s:.1f} s; tell it the next way then")

    def _set_out(self, motion: Motion, tick: int, ticks: int) -> tuple[int, int]:
        self._leg = self._felt_on(motion, tick, tick + ticks)
        return self._leg.first_tick, self._leg.last_tick

    def _rest(self, T_site_base: FloatArray, tick: int) -> Leg:
        return self._felt_on(standing(T_site_base, 2.0 * self.tick_s), tick, tick + 1)

    def _felt_on(self, motion: Motion, first_tick: int, last_tick: int) -> Leg:
        """The leg with what wheels and IMU read on it; their errors go on from the leg before."""
        self._legs += 1
        imu, wheels = self._scenario.imu, self._scenario.wheels
        rng = generator(self._scenario, "imu", self._index, self._legs)
        t_s = np.arange((last_tick - first_tick) * self._per_tick["imu"]) / imu.rate_hz
        noisy = imu.model_copy(update=dict.fromkeys(_LASTING, 0.0))
        read = imu_readings(noisy, motion, t_s, self._scenario.gravity_m_s2, rng)
        root_dt = math.sqrt(1.0 / imu.rate_hz)
        acc = self._acc_bias + np.cumsum(imu.acc_walk_m_s3_sqrt_hz * root_dt * rng.standard_normal((len(t_s), 3)), 0)
        gyro = self._gyro_bias + np.cumsum(
            imu.gyro_walk_rad_s2_sqrt_hz * root_dt * rng.standard_normal((len(t_s), 3)), 0
        )
        self._acc_bias, self._gyro_bias = acc[-1], gyro[-1]
        t_s = np.arange((last_tick - first_tick) * self._per_tick["wheels"] + 1) / wheels.rate_hz
        rolled = wheel_odometry(wheels, motion, t_s, generator(self._scenario, "wheels", self._index, self._legs))
        poses, covariances = self._gone_on(rolled.poses, rolled.covariances)
        return Leg(
            motion, first_tick, last_tick, read.acc_m_s2 + acc, read.gyro_rad_s + gyro, poses[:-1], covariances[:-1]
        )

    def _gone_on(self, poses: FloatArray, covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A leg's dead reckoning after that of the legs before; tilt, which is never measured, counts once."""
        tilt = np.zeros((6, 6))
        tilt[3, 3] = tilt[4, 4] = self._scenario.wheels.reported_tilt_sigma_rad**2
        begin, begin_covariance = self._T_odom_base, self._odom_covariance
        grown = [
            compose_covariance(begin, begin_covariance, T, C - tilt * (i > 0))
            for i, (T, C) in enumerate(zip(poses, covariances, strict=True))
        ]
        self._T_odom_base, self._odom_covariance = begin @ poses[-1], grown[-1]
        return begin @ poses, np.array(grown) + tilt * (self._legs > 1)

    def _stamp_ns(self, leg: Leg, sensor: str, row: int) -> int:
        us = round((leg.first_tick * self.tick_s + row * self.tick_s / self._per_tick[sensor]) * 1e6)
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
        self._counts[stream] += 1
        seq = self._counts[stream] - 1
        sensor, _, port = stream.partition(".")
        kind = CovarianceKind.NONE if child is None else CovarianceKind.FORMAL
        header = Header(
            id=product_id(self.robot, sensor, port, t1_ns, seq, self._scenario.digest), seq=seq,
            t0_ns=t0_ns, t1_ns=t1_ns, frame=frame, child=child, producer=PRODUCER,
            config_hash=self._scenario.digest, quality=Quality(reasons=("simulated",), covariance_kind=kind),
        )  # fmt: skip
        return LogSample(f"/{self.robot}/{stream}", type(value).__name__, t1_ns, seq, value, header)


def _whole(ratio: float, what: str) -> int:
    if abs(ratio - round(ratio)) > 1e-9 or round(ratio) < 1:
        raise InputError(f"{what}: expected a whole number of samples in each period of the lidar")
    return round(ratio)
