# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulate drives at measurement level, without images and sweeps, for statistics of position estimates.

The models of ground, rover, IMU and slipping wheels are those of the frozen scenario ``rover_traverse``; the
seed selects their random values. Visual and lidar odometry are the true motion with noise of the size that
was measured on the images and sweeps of that scenario; their stated covariances are smaller than this noise.
Fixes have a stated sigma.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import compose_covariance
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import IMUSensors, Time, TransformWithCovariance
from cdff_dev.simulate.proprioception import imu_readings, wheel_odometry
from cdff_dev.simulate.relief import Relief, make_relief
from cdff_dev.simulate.rover_motion import Motion, make_motion
from cdff_dev.simulate.scenario import RoverPath, Scenario, load_scenario
from cdff_dev.simulate.traverse import levelled, sample_times_us

SCENARIO, ROBOT = "rover_traverse", "mana"
#: Time of the start of a drive.
EPOCH_NS = 1_785_585_600_000_000_000
#: Time at rest before and after the drive.
REST_BEFORE_S, REST_AFTER_S = 2.0, 1.0


@dataclass(frozen=True, slots=True)
class Odometry:
    """Error model of an odometry; errors are per increment, in the axes of the sensor.

    Attributes
    ----------
    sigma_m, sigma_rad : tuple of float
        Standard deviation of the noise of an increment.
    stated : float
        Ratio of stated to true variances.
    """

    port: str
    parent: str
    child: str
    rate_hz: float
    sigma_m: tuple[float, float, float]
    sigma_rad: tuple[float, float, float]
    stated: float


#: Errors of the increments on ``rover_traverse``. The ratio of stated to true variances is the smallest that
#: was measured: on ``visual_rocks`` the mean NEES of visual odometry was 9.55 (6 expected).
VISUAL = Odometry(
    "visual_odometry",
    f"{ROBOT}/vo",
    f"{ROBOT}/navcam_left",
    3.0,
    (0.8e-4, 0.7e-4, 1.4e-4),
    (2.6e-5, 3.3e-5, 2.7e-5),
    0.63,
)
#: Odometry with independent errors of the increments, like sweep-to-sweep registration. ``lidar_slam``
#: registers sweeps to a map and is more accurate.
LIDAR = Odometry(
    "lidar_odometry",
    f"{ROBOT}/lidar_odom",
    f"{ROBOT}/lidar",
    2.0,
    (2.5e-3, 2.5e-3, 2.0e-3),
    (2.5e-4, 2.5e-4, 3e-4),
    0.5,
)


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRun:
    """Samples of one simulated drive, and its true motion.

    Attributes
    ----------
    samples : dict of str to list of Sample
        Samples by port.
    """

    seed: int
    context: DfpcContext
    motion: Motion
    duration_s: float
    samples: dict[str, list[Sample]]

    @property
    def path_length_m(self) -> float:
        """Length of the driven path."""
        return float(self.motion.distance(self.duration_s))

    def truth(self, stamp_ns: int) -> FloatArray:
        """Return the true ``T_site_base``, shape (4, 4)."""
        return np.asarray(self.motion.poses(np.array([(stamp_ns - EPOCH_NS) * 1e-9]))[0])


@cache
def _ground(seed: int) -> tuple[Scenario, Relief]:
    """Return the scenario with coarser relief, without rocks, and another seed."""
    full = load_scenario(SCENARIO).model_dump()
    full["terrain"] |= {"resolution_m": 0.2, "fine_half_width_m": 60.0, "far_half_width_m": 100.0}
    full["terrain"]["surface"] |= {"texel_m": 0.5}
    full["terrain"]["rocks"] |= {"count": 0}
    full["seed"] = 900_000 + seed
    scenario = Scenario.model_validate(full)
    return scenario, make_relief(scenario.terrain, np.random.default_rng(scenario.seed))


def simulate_drive(seed: int, path_length_m: float = 60.0, ground: int = 0) -> SimulatedRun:
    """Return a drive on a winding path of about the path length; anchor and mounts are exact."""
    rng = np.random.default_rng([77, seed])
    scenario, relief = _ground(ground)
    speed_m_s = 0.4
    duration_s = round(path_length_m / speed_m_s + REST_BEFORE_S + REST_AFTER_S + 1.5, 1)
    path = _winding_path(rng, path_length_m, speed_m_s)
    motion = make_motion(path, scenario.chassis, relief, duration_s)
    return simulate_measurements(scenario, motion, duration_s, rng, seed)


def simulate_measurements(
    scenario: Scenario, motion: Motion, duration_s: float, rng: np.random.Generator, seed: int
) -> SimulatedRun:
    """Return the simulated samples of all ports for a motion; the scenario must have a navcam."""
    T_site_base0 = motion.poses(np.zeros(1))[0]
    frames, mounts = (
        FrameGraph(),
        {
            "imu": scenario.imu.mount.matrix(),
            "lidar": scenario.lidar.mount.matrix(),
            "navcam_left": scenario.navcam.T_base_left,  # type: ignore[union-attr]
        },
    )
    frames.set_static("site", f"{ROBOT}/odom", UncertainTransform.exact(levelled(T_site_base0)))
    for name, T in mounts.items():
        frames.set_static(f"{ROBOT}/base", f"{ROBOT}/{name}", UncertainTransform.exact(T))
    samples = {
        "imu": _imu(scenario, motion, duration_s, rng),
        "odometry": _wheels(scenario, motion, duration_s, rng),
        "visual_odometry": _odometry(VISUAL, motion, mounts["navcam_left"], duration_s, rng),
        "lidar_odometry": _odometry(LIDAR, motion, mounts["lidar"], duration_s, rng),
        "fix": _fixes(motion, duration_s, rng),
    }
    return SimulatedRun(seed, DfpcContext(ROBOT, frames), motion, duration_s, samples)


def _winding_path(rng: np.random.Generator, path_length_m: float, speed_m_s: float) -> RoverPath:
    """Return a path of random bends; its constant mean curvature keeps it on the terrain."""
    knots = np.arange(0.0, path_length_m + 6.0, 3.0)
    bends = 0.18 * rng.standard_normal(len(knots)) + rng.choice([-1.0, 1.0]) * 0.05
    return RoverPath(
        start_xy_m=tuple(rng.uniform(-25.0, 25.0, 2)),
        heading_deg=float(rng.uniform(-180.0, 180.0)),
        curvature_1pm=tuple(
            (float(s), float(np.clip(b, -0.4, 0.4))) for s, b in zip(knots, bends, strict=True)
        ),
        speed_m_s=speed_m_s,
        rest_before_s=REST_BEFORE_S,
        rest_after_s=REST_AFTER_S,
        ramp_s=1.2,
    )


def _imu(scenario: Scenario, motion: Motion, duration_s: float, rng: np.random.Generator) -> list[Sample]:
    t_us = sample_times_us(scenario.imu.rate_hz, duration_s)
    track = imu_readings(scenario.imu, motion, t_us * 1e-6, scenario.gravity_m_s2, rng)
    samples = []
    for k, t in enumerate(t_us):
        stamp_ns = EPOCH_NS + int(t) * 1000
        value = IMUSensors(Time.from_ns(stamp_ns), track.acc_m_s2[k], track.gyro_rad_s[k], np.zeros(3))
        samples.append(Sample("imu", stamp_ns, k, value))
    return samples


def _wheels(scenario: Scenario, motion: Motion, duration_s: float, rng: np.random.Generator) -> list[Sample]:
    t_us = sample_times_us(scenario.wheels.rate_hz, duration_s)
    track = wheel_odometry(scenario.wheels, motion, t_us * 1e-6, rng)
    return [
        _pose("odometry", k, int(us), T, C, f"{ROBOT}/odom", f"{ROBOT}/base")
        for k, (us, T, C) in enumerate(zip(t_us, track.poses, track.covariances, strict=True))
    ]


def _odometry(
    model: Odometry, motion: Motion, mount: FloatArray, duration_s: float, rng: np.random.Generator
) -> list[Sample]:
    """Return the odometry: accumulated noisy increments of the true motion, with the stated covariance."""
    t_us = sample_times_us(model.rate_hz, duration_s)
    true_poses = motion.poses(t_us * 1e-6) @ mount
    sigma = np.array([*model.sigma_m, *model.sigma_rad])
    step_covariance = np.diag(model.stated * sigma**2)
    T, C = np.eye(4), np.zeros((6, 6))
    samples = [_pose(model.port, 0, int(t_us[0]), T, C, model.parent, model.child)]
    for k in range(1, len(t_us)):
        step = se3.inverse(true_poses[k - 1]) @ true_poses[k]
        noise = sigma * rng.standard_normal(6)
        T_measured = se3.transform(se3.exp_so3(noise[3:]) @ step[:3, :3], step[:3, 3] + noise[:3])
        C = compose_covariance(T, C, T_measured, step_covariance)
        T = T @ T_measured
        samples.append(_pose(model.port, k, int(t_us[k]), T, C, model.parent, model.child))
    return samples


def _fixes(motion: Motion, duration_s: float, rng: np.random.Generator, shared: float = 0.0) -> list[Sample]:
    """Return ``T_site_base`` every five seconds; ``shared`` is the fraction of the error variance common to
    all.
    """
    sigma = np.array([0.10, 0.10, 0.15, 0.02, 0.02, 0.02])
    t_us = sample_times_us(0.2, duration_s)[1:]
    common = np.sqrt(shared) * sigma * rng.standard_normal(6)
    samples = []
    for k, (us, T) in enumerate(zip(t_us, motion.poses(t_us * 1e-6), strict=True)):
        noise = common + np.sqrt(1.0 - shared) * sigma * rng.standard_normal(6)
        T_measured = se3.transform(se3.exp_so3(noise[3:]) @ T[:3, :3], T[:3, 3] + noise[:3])
        samples.append(_pose("fix", k, int(us), T_measured, np.diag(sigma**2), "site", f"{ROBOT}/base"))
    return samples


def shared_fixes(drive: SimulatedRun, shared: float) -> list[Sample]:
    """Return fixes with partly common errors, like poses in the same map."""
    return _fixes(drive.motion, drive.duration_s, np.random.default_rng([78, drive.seed]), shared)


def _pose(port: str, seq: int, time_us: int, T: FloatArray, C: FloatArray, parent: str, child: str) -> Sample:
    stamp_ns = EPOCH_NS + time_us * 1000
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, C), parent=parent, child=child, stamp_ns=stamp_ns, producer="simulator"
    )
    return Sample(port, stamp_ns, seq, value)
