# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulate the measurements of a skid-steered rover on level ground: wheels, IMU and visual odometry.

The wheel poses are alternately too far ahead and too far back, lag by a constant delay, slip and skid; the
IMU vibrates. The images of the camera are stamped late, and its baseline has an error of calibration. No
value is a parameter of the filter. The slip is not the filter's Gauss-Markov process: its mean, amplitude and
period are random.
"""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import compose_covariance
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import IMUSensors, Time, TransformWithCovariance
from evaluation.data_sets.husky import Drive

ROBOT, START_NS, DURATION_S = "rover", 1_785_585_600_000_000_000, 400.0
#: Rates of IMU, wheels and camera.
IMU_HZ, WHEELS_HZ, CAMERA_HZ = 30.0, 10.0, 3.0
#: Alternation of wheel increments relative to their length, and delay of wheel poses, seconds.
ALTERNATION, DELAY_S = 0.17, 0.1
GRAVITY_M_S2, VIBRATION_M_S2, GYRO_NOISE_RAD_S, GYRO_BIAS_RAD_S = 9.81, 0.75, 0.01, 5e-4
#: Standard deviation of the noise of an increment of visual odometry: translation, rotation.
CAMERA_SIGMA = np.array([1e-3] * 3 + [3e-4] * 3)
#: Delay of the stamps of visual odometry, seconds, and standard deviation of its scale error by calibration.
CAMERA_DELAY_S, CAMERA_SCALE_SIGMA = 0.06, 0.003
#: Variances that the wheels state with every pose.
STATED = np.diag([1e-3] * 5 + [0.03])
_T_BASE_CAMERA = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.3, 0.0, 0.5])


def simulate_drive(seed: int, duration_s: float = DURATION_S) -> Drive:
    """Return a drive that rests for three seconds, then follows random bends at about 1 m/s."""
    rng = np.random.default_rng([79, seed])
    t_s = np.arange(-1.0, duration_s + 1.0, 0.01)
    speed = np.clip(t_s - 3.0, 0.0, 1.0) * (1.0 + 0.15 * np.sin(2 * np.pi * t_s / rng.uniform(20, 60)))
    rate = sum(
        rng.uniform(0.0, 0.12) * np.sin(2 * np.pi * (t_s / rng.uniform(8.0, 90.0) + rng.uniform()))
        for _ in range(4)
    ) * np.clip(t_s - 3.0, 0.0, 1.0)
    heading = np.cumsum(rate) * 0.01
    xy = np.cumsum(speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0) * 0.01
    motion = np.column_stack([t_s, xy, heading, speed, rate])
    wheels, wheel_speed = _wheels(motion, duration_s, rng)
    frames = FrameGraph()
    frames.set_static("site", f"{ROBOT}/odom", UncertainTransform.exact(_poses(motion, np.zeros(1))[0]))
    frames.set_static(f"{ROBOT}/base", f"{ROBOT}/imu", UncertainTransform.exact(np.eye(4)))
    frames.set_static(f"{ROBOT}/base", f"{ROBOT}/camera", UncertainTransform.exact(_T_BASE_CAMERA))
    samples = {
        "odometry": wheels,
        "imu": _imu(motion, duration_s, rng),
        "visual_odometry": _camera(motion, duration_s, rng),
    }
    stamps = np.array([s.stamp_ns for s in wheels])
    truth = _poses(motion, (stamps - START_NS) * 1e-9)[:, :2, 3]
    no_error = np.zeros_like(truth)
    return Drive(DfpcContext(ROBOT, frames), samples, wheel_speed, stamps, truth, no_error, no_error)


def _at(motion: FloatArray, t_s: FloatArray) -> FloatArray:
    """Return x, y, heading, speed and rate (n, 5) at times (n,), interpolated."""
    return np.column_stack([np.interp(t_s, motion[:, 0], column) for column in motion[:, 1:].T])


def _poses(motion: FloatArray, t_s: FloatArray) -> FloatArray:
    x, y, heading, _, _ = _at(motion, t_s).T
    return np.array([_planar(*row) for row in np.column_stack([x, y, heading])])


def _planar(x: float, y: float, heading: float) -> FloatArray:
    return se3.transform(se3.exp_so3([0.0, 0.0, heading]), [x, y, 0.0])


def _wheels(
    motion: FloatArray, duration_s: float, rng: np.random.Generator
) -> tuple[list[Sample], FloatArray]:
    """Return poses and stated speeds of the wheels, measured ``DELAY_S`` before their stamps."""
    t_s = np.arange(0.0, duration_s, 1.0 / WHEELS_HZ)
    _, _, heading, _, _ = _at(motion, t_s - DELAY_S).T
    slip = rng.normal(0.0, 0.01) + 0.03 * np.sin(2 * np.pi * t_s / rng.uniform(5.0, 40.0))
    steps = np.hypot(*np.diff(_at(motion, t_s - DELAY_S)[:, :2], axis=0).T) * (1.0 + slip[1:])
    # Successive poses have opposite errors, each half of the alternation of the increment between them.
    pose_error_m = 0.5 * ALTERNATION * np.append(steps, 0.0) * (-1.0) ** np.arange(len(t_s))
    forward = steps + np.diff(pose_error_m)
    turns = (1.0 + rng.normal(0.0, 0.04)) * np.diff(heading) + rng.normal(0.0, 1.5e-3) * steps
    T, poses = np.eye(4), [np.eye(4)]
    for distance, turn in zip(forward, turns, strict=True):
        T = T @ _planar(distance * np.cos(turn / 2), distance * np.sin(turn / 2), turn)
        poses.append(T)
    samples = [
        _pose_sample("odometry", k, t, pose, STATED, "odom", "base")
        for k, (t, pose) in enumerate(zip(t_s, poses, strict=True))
    ]
    return samples, np.append(0.0, forward) * WHEELS_HZ


def _imu(motion: FloatArray, duration_s: float, rng: np.random.Generator) -> list[Sample]:
    t_s = np.arange(0.0, duration_s, 1.0 / IMU_HZ)
    _, _, _, speed, rate = _at(motion, t_s).T
    n, vibration = len(t_s), np.where(speed > 0.0, VIBRATION_M_S2, 0.02)[:, None]
    force = np.column_stack([np.gradient(speed, t_s), speed * rate, np.full(n, GRAVITY_M_S2)])
    force += vibration * rng.standard_normal((n, 3)) + 0.005 * rng.standard_normal(3)
    noise = np.where(speed > 0.0, GYRO_NOISE_RAD_S, 0.001)[:, None] * rng.standard_normal((n, 3))
    gyro = np.column_stack([np.zeros((n, 2)), rate]) + noise + GYRO_BIAS_RAD_S * rng.standard_normal(3)
    stamps = [_stamp_ns(t) for t in t_s]
    return [
        Sample("imu", stamp, k, IMUSensors(Time.from_ns(stamp), force[k], gyro[k], np.zeros(3)))
        for k, stamp in enumerate(stamps)
    ]


def _camera(motion: FloatArray, duration_s: float, rng: np.random.Generator) -> list[Sample]:
    t_s = np.arange(0.0, duration_s, 1.0 / CAMERA_HZ)
    true_poses = _poses(motion, t_s - CAMERA_DELAY_S) @ _T_BASE_CAMERA
    scale = 1.0 + CAMERA_SCALE_SIGMA * rng.standard_normal()
    T, C, samples = np.eye(4), np.zeros((6, 6)), []
    for k, t in enumerate(t_s):
        if k:
            noise = CAMERA_SIGMA * rng.standard_normal(6)
            step = se3.inverse(true_poses[k - 1]) @ true_poses[k]
            measured = se3.transform(se3.exp_so3(noise[3:]) @ step[:3, :3], scale * step[:3, 3] + noise[:3])
            C = compose_covariance(T, C, measured, np.diag(CAMERA_SIGMA**2))
            T = T @ measured
        samples.append(_pose_sample("visual_odometry", k, t, T, C, "vo", "camera"))
    return samples


def _stamp_ns(t_s: float) -> int:
    return START_NS + round(t_s * 1e6) * 1000


def _pose_sample(
    port: str, seq: int, t_s: float, T: FloatArray, C: FloatArray, parent: str, child: str
) -> Sample:
    stamp_ns = _stamp_ns(t_s)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, C), parent=f"{ROBOT}/{parent}", child=f"{ROBOT}/{child}", stamp_ns=stamp_ns
    )
    return Sample(port, stamp_ns, seq, value)
