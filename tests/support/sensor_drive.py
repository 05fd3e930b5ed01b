# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples of a rover with wheels, IMU, camera and lidar on rough ground given by a formula."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import IMUSensors, LidarScan, Time, TransformWithCovariance

#: Time of the first sample, ns.
T0 = 1_785_585_600_000_000_000
GRAVITY_M_S2 = 3.71
#: True mounts: a lidar tilted down by 20 degrees, a camera that looks forward, an IMU turned by 90 degrees.
MOUNTS = {
    "lidar": se3.transform(se3.exp_so3([0.0, np.radians(20.0), 0.0]), [0.1, 0.0, 0.85]),
    "navcam_left": se3.transform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), [0.35, 0.07, 0.95]),
    "imu": se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [-0.05, 0.02, 0.05]),
}
FRAME_OF = {"imu": "imu", "scan": "lidar", "lidar_odometry": "lidar", "visual_odometry": "navcam_left"}
_KINDS = {
    "imu": ("imu", "imu", {"sample": "IMUSensors"}),
    "wheels": ("wheels", "base", {"odometry": "TransformWithCovariance"}),
    "navcam": ("stereo_camera", "navcam_left", {"pair": "FramePair"}),
    "lidar": ("lidar", "lidar", {"scan": "LidarScan"}),
}


def sensors_of(robot: str) -> dict[str, dict[str, Any]]:
    """Return the sensors of a robot, as in its profile."""
    return {
        name: {"kind": kind, "frame": f"{robot}/{frame}", "streams": streams}
        for name, (kind, frame, streams) in _KINDS.items()
    }


SENSORS = sensors_of("mana")


def context(stated: Mapping[str, np.ndarray] | None = None) -> DfpcContext:
    """Return the context of the rover; ``stated`` replaces mounts (4, 4) by wrong ones."""
    graph = FrameGraph()
    for name, T in {**MOUNTS, **(stated or {})}.items():
        graph.set_static("mana/base", f"mana/{name}", UncertainTransform.exact(T))
    return DfpcContext("mana", graph, sensors=SENSORS)


@dataclass
class Drive:
    """A drive of ``duration_s`` at 0.4 m/s, after two seconds of rest.

    ``relief_m`` scales the heights of the ground; ``offset_s`` shifts the stamps of a port; frames are those
    of ``robot``.
    """

    seed: int = 0
    duration_s: float = 25.0
    relief_m: float = 0.06
    offset_s: Mapping[str, float] = field(default_factory=dict)
    robot: str = "mana"

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        direction = self._rng.uniform(0, 2 * np.pi, 24)
        self._wave_m = np.geomspace(1.2, 12.0, 24)
        self._k = (2 * np.pi / self._wave_m)[:, None] * np.column_stack(
            [np.cos(direction), np.sin(direction)]
        )
        self._phase = self._rng.uniform(0, 2 * np.pi, 24)
        turn = self._rng.uniform(0.05, 0.12) * self._rng.choice([-1.0, 1.0])
        self._path_m = np.linspace(0.0, 0.4 * self.duration_s, 2000)
        self._heading = 1.2 * np.sin(3.0 * turn * self._path_m)
        step_m = self._path_m[1]
        self._x_m = np.cumsum(np.cos(self._heading)) * step_m
        self._y_m = np.cumsum(np.sin(self._heading)) * step_m

    def height_m(self, xy: np.ndarray) -> np.ndarray:
        """Return the height (n,) of the ground at positions (n, 2)."""
        amplitude = self.relief_m * (self._wave_m / 12.0) ** 0.8
        return np.sin(xy @ self._k.T + self._phase) @ amplitude

    def pose(self, t_s: float) -> np.ndarray:
        """Return ``T_site_base`` (4, 4) at a time."""
        path_m = 0.4 * max(t_s - 2.0 - 0.5 * min(max(t_s - 2.0, 0.0), 1.0), 0.0)
        heading, x_m, y_m = (
            float(np.interp(path_m, self._path_m, v)) for v in (self._heading, self._x_m, self._y_m)
        )
        xy = np.array([x_m, y_m])
        forward = np.array([np.cos(heading), np.sin(heading)])
        left = np.array([-forward[1], forward[0]])
        h = self.height_m(
            np.array([xy + 0.4 * forward, xy - 0.4 * forward, xy + 0.4 * left, xy - 0.4 * left])
        )
        pitch, roll = -np.arctan2(h[0] - h[1], 0.8), np.arctan2(h[2] - h[3], 0.8)
        R = se3.exp_so3([0, 0, heading]) @ se3.exp_so3([0, pitch, 0]) @ se3.exp_so3([roll, 0, 0])
        return se3.transform(R, [*xy, float(h.mean()) + 0.3])

    def samples(self, *ports: str) -> list[Sample]:
        """Return the samples of ports in the order of their stamps."""
        makers = {
            "imu": (0.01, self._imu),
            "odometry": (0.1, self._wheels),
            "visual_odometry": (0.25, self._odometry),
            "lidar_odometry": (0.5, self._odometry),
            "scan": (0.5, self._scan),
            "poses": (0.1, self._fused),
        }
        out = []
        for port in ports:
            period_s, make = makers[port]
            shift_ns = round(self.offset_s.get(port, 0.0) * 1e9)
            self._previous = None
            for i in range(1, int(self.duration_s / period_s)):
                t_s = i * period_s
                value = make(port, t_s)
                frame = f"{self.robot}/{FRAME_OF.get(port, 'base')}"
                out.append(Sample(port, T0 + round(t_s * 1e9) + shift_ns, i, value, f"{port} {i}", frame))
        return sorted(out, key=lambda s: (s.stamp_ns, s.port))

    def _imu(self, _port: str, t_s: float) -> IMUSensors:
        before, T, after = (self.pose(t_s + d) for d in (-0.01, 0.0, 0.01))
        R = MOUNTS["imu"][:3, :3]
        gyro = se3.log_so3(before[:3, :3].T @ after[:3, :3]) / 0.02 + self._rng.normal(0, 2e-3, 3) + 5e-4
        acc = T[:3, :3].T @ [0.0, 0.0, GRAVITY_M_S2] + self._rng.normal(0, 0.02, 3)
        return IMUSensors(timestamp=Time.from_ns(T0), acc=R.T @ acc, gyro=R.T @ gyro)

    def _wheels(self, _port: str, t_s: float) -> TransformWithCovariance:
        last, T = self._previous, self.pose(t_s)
        if last is None:
            last = (T, np.eye(4))
        step = se3.inverse(last[0]) @ T
        distance_m = float(np.linalg.norm(step[:3, 3])) * (1.0 + self._rng.normal(0, 0.05))
        yaw = float(se3.log_so3(step[:3, :3])[2]) * (1.0 + self._rng.normal(0, 0.1))
        planar = last[1] @ se3.transform(se3.exp_so3([0, 0, yaw]), [distance_m, 0, 0])
        self._previous = (T, planar)
        return self._pose(planar, f"{self.robot}/odom", f"{self.robot}/base")

    def _odometry(self, port: str, t_s: float) -> TransformWithCovariance:
        name = FRAME_OF[port]
        if self._previous is None:
            self._previous = (self.pose(0.0) @ MOUNTS[name], np.eye(4))
        T = self.pose(t_s) @ MOUNTS[name]
        noise = se3.exp_se3(self._rng.normal(0, [1e-3] * 3 + [2e-4] * 3))
        measured = self._previous[1] @ se3.inverse(self._previous[0]) @ T @ noise
        self._previous = (T, measured)
        return self._pose(measured, port, f"{self.robot}/{name}")

    def _fused(self, _port: str, t_s: float) -> TransformWithCovariance:
        return self._pose(
            self.pose(t_s) @ se3.exp_se3(self._rng.normal(0, 2e-4, 6)), "site", f"{self.robot}/base"
        )

    def _scan(self, _port: str, t_s: float) -> LidarScan:
        T = self.pose(t_s) @ MOUNTS["lidar"]
        azimuth, range_m = self._rng.uniform(0, 2 * np.pi, 9000), self._rng.uniform(1.0, 9.0, 9000)
        xy = T[:2, 3] + range_m[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
        points = np.column_stack([xy, self.height_m(xy) + self._rng.normal(0, 0.01, 9000)])
        local = (points - T[:3, 3]) @ T[:3, :3]
        stamp_ns = T0 + round(t_s * 1e9)
        return LidarScan.from_arrays(
            local, np.zeros(9000, np.uint32), frame=f"{self.robot}/lidar", t0_ns=stamp_ns, t1_ns=stamp_ns
        )

    @staticmethod
    def _pose(T: np.ndarray, parent: str, child: str) -> TransformWithCovariance:
        return TransformWithCovariance.from_transform(
            UncertainTransform(T, np.eye(6) * 1e-6), parent=parent, child=child, stamp_ns=T0, producer="test"
        )
