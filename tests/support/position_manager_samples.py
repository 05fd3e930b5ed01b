# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor samples of a robot on a known curve, and a position manager to process them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

import numpy as np

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import IMUSensors, Time, TransformWithCovariance
from cdff_core.dfpcs.position_manager.compound import PositionManager

#: Nanoseconds in a millisecond.
MS = 1_000_000
#: Time of the first sample, ns.
T0 = 1_785_585_600_000_000_000

MARS_GRAVITY_M_S2 = 3.71
#: Variances of the pose of the odometry frame in the site: x y z in m², rx ry rz in rad².
VARIANCES = np.square([0.02, 0.02, 0.02, 0.01, 0.01, 0.01])

T_SITE_ODOM = se3.transform(se3.exp_so3([0, 0, 0.7]), [3.0, -2.0, 0.5])
T_BASE_CAMERA = se3.exp_se3([0.3, 0.1, 0.9, -1.2, 1.2, -1.1])
T_BASE_IMU = se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [0.1, 0.0, 0.0])
LEVEL_ROTATION = np.eye(3)
TILTED_ROTATION = se3.exp_so3([0, 0.1, 0]) @ se3.exp_so3([0.05, 0, 0])
URDF = """<robot name="mana"><link name="base"/><link name="mast"/><link name="head"/>
<joint name="lift" type="fixed"><parent link="base"/><child link="mast"/><origin xyz="0 0 1"/></joint>
<joint name="pan" type="revolute"><parent link="mast"/><child link="head"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
HOUR_NS = 3_600_000 * MS


def frames(anchor_variances: np.ndarray = VARIANCES) -> FrameGraph:
    """Return the frame graph of the robot: odometry frame, camera and IMU."""
    graph = FrameGraph()
    graph.set_static("site", "mana/odom", UncertainTransform(T_SITE_ODOM, np.diag(anchor_variances)))
    graph.set_static("mana/base", "mana/navcam_left", UncertainTransform.exact(T_BASE_CAMERA))
    graph.set_static("mana/base", "mana/imu", UncertainTransform.exact(T_BASE_IMU))
    return graph


def manager(**config: object) -> PositionManager:
    """Return a configured position manager of robot ``mana``."""
    dfpc = PositionManager()
    dfpc.configure(config, DfpcContext("mana", frames()))
    return dfpc


def path_progress(t_s: float) -> tuple[float, float, float]:
    """Return the equivalent time at full speed (s), the relative speed, and its rate (1/s).

    The robot rests for a second and then accelerates for a second.
    """
    moving_s = t_s - 1.0
    if moving_s <= 0.0:
        return 0.0, 0.0, 0.0
    return (0.5 * moving_s**2, moving_s, 1.0) if moving_s < 1.0 else (moving_s - 0.5, 1.0, 0.0)


def true_pose(t_s: float, tilt: np.ndarray = LEVEL_ROTATION) -> np.ndarray:
    """Return ``T_odom_base`` on a curve at 0.4 m/s and 0.1 rad/s in the tilted plane."""
    return se3.transform(tilt, [0, 0, 0]) @ se3.exp_se3(
        path_progress(t_s)[0] * np.array([0.4, 0, 0, 0, 0, 0.1])
    )


def pose(
    port: str,
    t_s: float,
    T: np.ndarray,
    covariance: np.ndarray | None,
    parent: str,
    child: str,
    status: Status,
) -> Sample:
    """Return a pose ``T_parent_child`` as a sample of an input port."""
    stamp_ns = T0 + round(t_s * 1000) * MS
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent=parent, child=child, stamp_ns=stamp_ns
    )
    return Sample(port, stamp_ns, 0, value, f"{port}@{t_s:.3f}", quality=Quality(status))


@cache
def wheels(t_s: float, scale: float = 1.0) -> Sample:
    """Return a sample of wheel odometry without covariance; ``scale`` multiplies the distance travelled."""
    T_odom_base = true_pose(t_s)
    T_odom_base[:3, 3] *= scale
    return pose("odometry", t_s, T_odom_base, None, "mana/odom", "mana/base", Status.OK)


def visual(
    t_s: float,
    first_s: float = 0.0,
    status: Status = Status.OK,
    tilt: np.ndarray = LEVEL_ROTATION,
    mount: np.ndarray = LEVEL_ROTATION,
) -> Sample:
    """Return a sample of visual odometry: the camera pose relative to that at ``first_s``.

    The camera is rotated by ``mount`` (base axes) from its stated mount.
    """
    T_base_camera = se3.transform(mount @ T_BASE_CAMERA[:3, :3], T_BASE_CAMERA[:3, 3])
    T_first_camera = (
        se3.inverse(true_pose(first_s, tilt) @ T_base_camera) @ true_pose(t_s, tilt) @ T_base_camera
    )
    covariance = 1e-6 * (1.0 + t_s) * np.eye(6)
    return pose("visual_odometry", t_s, T_first_camera, covariance, "mana/vo", "mana/navcam_left", status)


def imu(t_s: float, tilt: np.ndarray = TILTED_ROTATION) -> Sample:
    """Return a sample of the IMU without noise and bias."""
    stamp_ns = T0 + round(t_s * 1000) * MS
    _, speed, acceleration = path_progress(t_s)
    rate, rate_change = np.array([0, 0, 0.1 * speed]), np.array([0, 0, 0.1 * acceleration])
    R, lever = T_BASE_IMU[:3, :3], T_BASE_IMU[:3, 3]
    base_acceleration = np.array([0.4 * acceleration, 0.04 * speed**2, 0.0])
    base_acceleration += np.cross(rate_change, lever) + np.cross(rate, np.cross(rate, lever))
    up = true_pose(t_s, tilt)[:3, :3].T @ [0, 0, MARS_GRAVITY_M_S2]
    value = IMUSensors(Time.from_ns(stamp_ns), R.T @ (up + base_acceleration), R.T @ rate, np.zeros(3))
    return Sample("imu", stamp_ns, 0, value)


def times(rate_hz: float, end_s: float, start_s: float = 0.0) -> list[float]:
    """Return the times of samples at a rate, start and end included."""
    return [k / rate_hz for k in range(round(start_s * rate_hz), round(end_s * rate_hz) + 1)]


def feed(dfpc: PositionManager, samples: Iterable[Sample], in_order: bool = True) -> list[Output]:
    """Process samples, by default in order of time; return all outputs."""
    ordered = sorted(samples, key=lambda s: (s.stamp_ns, s.port)) if in_order else samples
    return [output for sample in ordered for output in dfpc.step(sample)]


def poses(outputs: Iterable[Output]) -> list[Output]:
    """Return the outputs of the port ``pose``."""
    return [o for o in outputs if o.port == "pose"]


def error_m(output: Output, tilt: np.ndarray = LEVEL_ROTATION) -> float:
    """Return the norm of the difference between an estimated and the true ``T_site_base``."""
    expected = T_SITE_ODOM @ true_pose((output.t1_ns - T0) * 1e-9, tilt)
    return float(np.linalg.norm(output.value.transform.matrix - expected))


@cache
def level_imu(t_s: float) -> Sample:
    """Return a sample of the IMU on level ground."""
    return imu(t_s, LEVEL_ROTATION)


def wheels_and_imu(end_s: float, scale: float = 1.0) -> list[Sample]:
    """Return samples of wheels and IMU on level ground from the start to ``end_s``."""
    return [wheels(t, scale) for t in times(10, end_s)] + [level_imu(t) for t in times(100, end_s)]


def fix(t_s: float, error_m: np.ndarray, sigma_m: float = 0.05, parent: str = "site") -> Sample:
    """Return a position fix in the site, or in a map frame that is the base frame at 1 s."""
    T = T_SITE_ODOM @ true_pose(t_s) if parent == "site" else se3.inverse(true_pose(1.0)) @ true_pose(t_s)
    C = sigma_m**2 * np.diag([1, 1, 1, 0.01, 0.01, 0.01])
    return pose("fix", t_s, se3.transform(T[:3, :3], T[:3, 3] + error_m), C, parent, "mana/base", Status.OK)


def delayed(sample: Sample, delay_ns: int) -> Sample:
    """Return a sample with a later time stamp."""
    return replace(sample, stamp_ns=sample.stamp_ns + delay_ns)


def wheels_imu_and_vision(start_s: float, end_s: float) -> list[Sample]:
    """Return samples of wheels, IMU and visual odometry between two times."""
    samples = wheels_and_imu(end_s) + [visual(t) for t in times(5, end_s)]
    return [s for s in samples if s.stamp_ns > T0 + round(start_s * 1000) * MS or start_s == 0.0]
