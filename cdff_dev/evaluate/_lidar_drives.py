# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drives of the frozen scenario on other seeds, with its lidar and without images: for statistics of maps.

Ground, rocks, sweeps, IMU and wheels are those of the simulator; visual odometry is drawn (``_dead_reckoning``). The
poses are those of ``position_manager``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, LidarScan, TransformWithCovariance
from cdff_dev.evaluate._dead_reckoning import EPOCH_NS, ROBOT, SCENARIO, Travel, measured
from cdff_dev.evaluate.traverse import run
from cdff_dev.simulate.lidar import scan
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.traverse import sample_times_us
from cdff_dev.simulate.world import cast_scene, generator, make_world, true_heights

TRUTH_M = 0.05
#: When a rover whose attitude is told begins to map; how often, and how well it is told: roll and pitch, one sigma.
LEVELLED_S, TOLD_EVERY_S, LEVELLED_RAD = 1.0, 5.0, 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class LidarDrive:
    """One drive.

    Attributes
    ----------
    sweeps : list of Sample
        Port ``scan``.
    truth : ElevationMap
        Rocks included.
    range_sigma_m : float
        Noise of the lidar, by its data sheet.
    """

    travel: Travel
    sweeps: list[Sample]
    truth: ElevationMap
    range_sigma_m: float

    def true_poses(self) -> list[Sample]:
        """``T_site_base`` at 20 Hz, exact."""
        t_us = sample_times_us(20.0, self.travel.duration_s)
        poses = zip(t_us, self.travel.motion.poses(t_us * 1e-6), strict=True)
        return [_pose("poses", k, int(us), T, np.zeros((6, 6))) for k, (us, T) in enumerate(poses)]

    def estimated_poses(self, *, levelled: bool = False) -> list[Sample]:
        """Those of ``position_manager`` from wheels, IMU and visual odometry.

        Parameters
        ----------
        levelled : bool
            Whether roll and pitch are told now and then, to ``LEVELLED_RAD``, first while the rover still stands.
        """
        given = self.travel.samples
        samples = [*given["imu"], *given["odometry"], *given["visual_odometry"]]
        parameters = {}
        if levelled:
            rng = np.random.default_rng([79, self.travel.seed])
            told = np.diag([100.0] * 3 + [LEVELLED_RAD**2] * 2 + [1.0])
            for k, t_s in enumerate(np.arange(0.8 * LEVELLED_S, self.travel.duration_s, TOLD_EVERY_S)):
                us = round(1e6 * t_s)
                turn = np.array([*rng.normal(0.0, LEVELLED_RAD, 2), 0.0])
                T = self.travel.truth(EPOCH_NS + us * 1000)
                samples.append(_pose("fix", k, us, se3.transform(se3.exp_so3(turn) @ T[:3, :3], T[:3, 3]), told))
            parameters = {"fix_weighting": "kalman"}
        found = run("position_manager", self.travel.context, samples, parameters=parameters)
        return [Sample("poses", p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality) for p in found]


def lidar_drive(seed: int) -> LidarDrive:
    """The first rover's drive on the ground of a seed."""
    scenario = load_scenario(SCENARIO, seed)
    world = make_world(scenario.model_copy(update={"navcam": None}))  # no look: nothing takes images
    motion, scene = world.motions[ROBOT], cast_scene(world.relief, world.rocks)
    travel = measured(scenario, motion, scenario.duration_s, np.random.default_rng([80, seed]), seed)
    sweeps = []
    period_us = round(scenario.lidar.sweep_s * 1e6)
    for k, us in enumerate(sample_times_us(scenario.lidar.rate_hz, scenario.duration_s)[:-1]):
        made = scan(scenario.lidar, scene, motion, us * 1e-6, generator(scenario, "lidar", 0, k))
        t0_ns = EPOCH_NS + int(us) * 1000
        value = LidarScan.from_arrays(
            made.points_m, made.time_offset_us, frame=f"{ROBOT}/lidar", t0_ns=t0_ns, t1_ns=t0_ns + period_us * 1000,
            intensity=made.intensity, ring=made.ring, sensor=f"{ROBOT}/lidar",
        )  # fmt: skip
        sweeps.append(Sample("scan", value.t1_ns, k, value))
    layers = true_heights(world, TRUTH_M)
    n = layers["mean"].shape[0]
    layers["count"], layers["age_s"] = np.full((n, n), 9.0, np.float32), np.zeros((n, n), np.float32)
    half_m = scenario.terrain.fine_half_width_m
    grid = GridGeometry("site", TRUTH_M, -half_m, half_m, n, n)
    truth = ElevationMap.from_layers(grid, layers, t0_ns=EPOCH_NS, t1_ns=EPOCH_NS)
    return LidarDrive(travel, sweeps, truth, scenario.lidar.range_sigma_m)


def _pose(port: str, seq: int, us: int, T: np.ndarray, covariance: np.ndarray) -> Sample:
    at = EPOCH_NS + us * 1000
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent="site", child=f"{ROBOT}/base", stamp_ns=at, producer="simulator"
    )
    return Sample(port, at, seq, value)
