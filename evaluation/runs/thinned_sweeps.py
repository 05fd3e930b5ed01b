# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar sweeps with fewer points or rings: simulated drives, some with a fast turn, and KITTI sweeps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import LidarScan
from cdff_dev.simulate.lidar import scan as lidar_scan
from cdff_dev.simulate.rover_motion import Motion
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.traverse import sample_times_us
from cdff_dev.simulate.world import cast_scene, generator, make_world
from evaluation.runs.lidar_slam import ROBOT

#: Number of points of a thinned sweep; every fourth ring of 64 leaves 16.
POINTS, RING_STEP = 20_000, 4
#: Half the edge of the simulated terrain, which contains all that the lidar observes in half a minute.
_HALF_WIDTH_M = 90.0


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """Rotation of the lidar about its own axis at constant rate, in addition to the motion of the rover."""

    start_s: float
    duration_s: float
    angle_deg: float

    def poses(self, t_s: FloatArray) -> FloatArray:
        """Return the rotation at each time as transforms (n, 4, 4)."""
        progress = np.clip((t_s - self.start_s) / self.duration_s, 0.0, 1.0)
        axis = np.array([0.0, 0.0, np.radians(self.angle_deg)])
        T = np.tile(np.eye(4), (len(t_s), 1, 1))
        T[:, :3, :3] = se3.exp_so3(progress[:, None] * axis)
        return T


@dataclass(frozen=True, slots=True, eq=False)
class _TurnedMotion:
    motion: Motion
    turn: Turn

    def poses(self, t_s: FloatArray) -> FloatArray:
        """Return ``T_site_base`` at each time, (n, 4, 4)."""
        return np.asarray(self.motion.poses(t_s) @ self.turn.poses(np.asarray(t_s)))


@dataclass(slots=True, eq=False)
class SweepDrive:
    """Sweeps with the true pose ``T_site_lidar`` at the end of each.

    Attributes
    ----------
    scenario : Scenario
    sweeps : list of LidarScan
    truth : dict of int to ndarray, shape (4, 4)
        By stamp, nanoseconds.
    """

    scenario: Scenario
    sweeps: list[LidarScan]
    truth: dict[int, FloatArray]


def simulated_drive(
    seed: int, duration_s: float, progress: Callable[[str], None], turn: Turn | None = None
) -> SweepDrive:
    """Simulate the start of ``lidar_traverse`` with all points."""
    scenario = short_traverse(seed, duration_s)
    world = make_world(scenario.model_copy(update={"navcam": None}))
    motion, scene = world.motions[ROBOT], cast_scene(world.relief, world.rocks)
    moving = motion if turn is None else _TurnedMotion(motion, turn)
    period_us, mount = round(scenario.lidar.sweep_s * 1e6), scenario.lidar.mount.matrix()
    result = SweepDrive(scenario, [], {})
    for k, us in enumerate(sample_times_us(scenario.lidar.rate_hz, duration_s)[:-1]):
        progress(f"lidar slam: seed {seed}, simulated sweep {k}")
        rng = generator(scenario, "lidar", 0, k)
        rays = lidar_scan(scenario.lidar, scene, moving, us * 1e-6, rng)  # type: ignore[arg-type]
        t0_ns = int(us) * 1000
        value = LidarScan.from_arrays(
            rays.points_m,
            rays.time_offset_us,
            frame=f"{ROBOT}/lidar",
            t0_ns=t0_ns,
            t1_ns=t0_ns + period_us * 1000,
            ring=rays.ring,
        )
        result.sweeps.append(value)
        result.truth[value.t1_ns] = moving.poses(np.array([1e-9 * value.t1_ns]))[0] @ mount
    return result


def short_traverse(seed: int, duration_s: float) -> Scenario:
    """Return the start of the traverse, on smaller terrain with the same feature density."""
    base = load_scenario("lidar_traverse", seed)
    ground: dict[str, object] = {"fine_half_width_m": _HALF_WIDTH_M}
    for name in ("craters", "rocks"):
        features = getattr(base.terrain, name)
        count = round(features.count * (_HALF_WIDTH_M / features.half_width_m) ** 2)
        ground[name] = features.model_copy(update={"count": count, "half_width_m": _HALF_WIDTH_M})
    terrain = base.terrain.model_copy(update=ground)
    return base.model_copy(update={"duration_s": duration_s, "terrain": terrain})


def thinned(sweeps: list[LidarScan], kind: str, seed: int = 0) -> Iterator[LidarScan]:
    """Yield the sweeps with all points (full), random ones (points) or every fourth ring (rings)."""
    rng = np.random.default_rng(seed)
    for sweep in sweeps:
        n = len(sweep.points_m)
        if kind == "full":
            rows = np.arange(n)
        elif kind == "points":
            rows = np.sort(rng.choice(n, min(n, POINTS), replace=False))
        else:
            assert sweep.ring is not None  # both sources number the rings
            rows = np.flatnonzero(np.asarray(sweep.ring) % RING_STEP == 0)
        yield LidarScan.from_arrays(
            np.asarray(sweep.points_m)[rows],
            np.asarray(sweep.time_offset_us)[rows],
            frame=f"{ROBOT}/lidar",
            t0_ns=sweep.t0_ns,
            t1_ns=sweep.t1_ns,
        )


def kitti_sweeps(paths: list[Path], T_last: FloatArray | None = None) -> list[LidarScan]:
    """Return KITTI sweeps at 10 Hz, without point times, with ring numbers.

    ``T_last`` (4, 4) moves the points of the last sweep, as if the lidar had moved by its inverse.
    """
    sweeps = []
    for i, path in enumerate(paths):
        points = read_kitti_bin(path).points_m
        ring = _rings(points)
        if T_last is not None and i == len(paths) - 1:
            points = se3.transform_points(T_last, points)
        stamp_ns = i * 100_000_000
        times = np.zeros(len(points), np.uint32)
        sweeps.append(
            LidarScan.from_arrays(
                points, times, frame=f"{ROBOT}/lidar", t0_ns=stamp_ns, t1_ns=stamp_ns, ring=ring
            )
        )
    return sweeps


def _rings(points: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
    """Return the ring of each point of a KITTI file, which lists ring after ring, each from azimuth zero."""
    azimuth = np.arctan2(points[:, 1], points[:, 0]) % (2.0 * np.pi)
    is_start = np.diff(azimuth, prepend=azimuth[0]) < -np.pi
    return np.cumsum(is_start).astype(np.uint16)
