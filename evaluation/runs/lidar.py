# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulate drives of the frozen scenario with other seeds, with lidar and without images, for map statistics.

Ground, rocks, sweeps, IMU and wheels come from the simulator; visual odometry is simulated at measurement
level (``runs/dead_reckoning.py``). ``position_manager`` estimates the poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, LidarScan, TransformWithCovariance
from cdff_dev.simulate.lidar import scan
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.traverse import sample_times_us
from cdff_dev.simulate.world import cast_scene, generator, make_world, true_heights
from evaluation.runs.dead_reckoning import EPOCH_NS, ROBOT, SCENARIO, SimulatedRun, simulate_measurements
from evaluation.runs.traverse import EXACT_MOUNTS, run

#: Cell size of the true terrain, metres.
TRUTH_M = 0.05
#: Start of mapping, seconds; period and standard deviation (roll and pitch) of attitude fixes.
LEVELLED_S, ATTITUDE_PERIOD_S, ATTITUDE_SIGMA_RAD = 1.0, 5.0, 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class LidarRun:
    """One drive.

    Attributes
    ----------
    sweeps : list of Sample
        Samples of the port ``scan``.
    truth : ElevationMap
        True terrain, including rocks.
    range_sigma_m : float
        Range noise of the lidar according to its data sheet.
    """

    drive: SimulatedRun
    sweeps: list[Sample]
    truth: ElevationMap
    range_sigma_m: float

    def true_poses(self) -> list[Sample]:
        """Return the exact ``T_site_base`` at 20 Hz."""
        t_us = sample_times_us(20.0, self.drive.duration_s)
        poses = zip(t_us, self.drive.motion.poses(t_us * 1e-6), strict=True)
        return [_pose("poses", k, int(us), T, np.zeros((6, 6))) for k, (us, T) in enumerate(poses)]

    def estimated_poses(self, *, levelled: bool = False) -> list[Sample]:
        """Return the poses that ``position_manager`` estimates from wheels, IMU and visual odometry.

        Parameters
        ----------
        levelled : bool
            Add attitude fixes (roll and pitch); the rover is at rest at the first fix.
        """
        inputs = self.drive.samples
        samples = [*inputs["imu"], *inputs["odometry"], *inputs["visual_odometry"]]
        parameters: dict[str, Any] = {**EXACT_MOUNTS}
        if levelled:
            rng = np.random.default_rng([79, self.drive.seed])
            covariance = np.diag([100.0] * 3 + [ATTITUDE_SIGMA_RAD**2] * 2 + [1.0])
            for k, t_s in enumerate(np.arange(0.8 * LEVELLED_S, self.drive.duration_s, ATTITUDE_PERIOD_S)):
                us = round(1e6 * t_s)
                error_rad = np.array([*rng.normal(0.0, ATTITUDE_SIGMA_RAD, 2), 0.0])
                T = self.drive.truth(EPOCH_NS + us * 1000)
                T_fix = se3.transform(se3.exp_so3(error_rad) @ T[:3, :3], T[:3, 3])
                samples.append(_pose("fix", k, us, T_fix, covariance))
            parameters["fixes"] = {"weighting": "kalman"}
        result = run("position_manager", self.drive.context, samples, parameters=parameters)
        return [
            Sample("poses", p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality) for p in result
        ]


def lidar_run(seed: int) -> LidarRun:
    """Return the drive of the first rover on the ground of a seed."""
    scenario = load_scenario(SCENARIO, seed)
    world = make_world(scenario.model_copy(update={"navcam": None}))  # without images, no texture is needed
    motion, scene = world.motions[ROBOT], cast_scene(world.relief, world.rocks)
    drive = simulate_measurements(
        scenario, motion, scenario.duration_s, np.random.default_rng([80, seed]), seed
    )
    sweeps = []
    period_us = round(scenario.lidar.sweep_s * 1e6)
    for k, us in enumerate(sample_times_us(scenario.lidar.rate_hz, scenario.duration_s)[:-1]):
        result = scan(scenario.lidar, scene, motion, us * 1e-6, generator(scenario, "lidar", 0, k))
        t0_ns = EPOCH_NS + int(us) * 1000
        value = LidarScan.from_arrays(
            result.points_m,
            result.time_offset_us,
            frame=f"{ROBOT}/lidar",
            t0_ns=t0_ns,
            t1_ns=t0_ns + period_us * 1000,
            intensity=result.intensity,
            ring=result.ring,
            sensor=f"{ROBOT}/lidar",
        )
        sweeps.append(Sample("scan", value.t1_ns, k, value))
    layers = true_heights(world, TRUTH_M)
    n = layers["mean"].shape[0]
    layers["count"], layers["age_s"] = np.full((n, n), 9.0, np.float32), np.zeros((n, n), np.float32)
    half_m = scenario.terrain.fine_half_width_m
    grid = GridGeometry("site", TRUTH_M, -half_m, half_m, n, n)
    truth = ElevationMap.from_layers(grid, layers, t0_ns=EPOCH_NS, t1_ns=EPOCH_NS)
    return LidarRun(drive, sweeps, truth, scenario.lidar.range_sigma_m)


def _pose(port: str, seq: int, us: int, T: np.ndarray, covariance: np.ndarray) -> Sample:
    stamp_ns = EPOCH_NS + us * 1000
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance),
        parent="site",
        child=f"{ROBOT}/base",
        stamp_ns=stamp_ns,
        producer="simulator",
    )
    return Sample(port, stamp_ns, seq, value)
