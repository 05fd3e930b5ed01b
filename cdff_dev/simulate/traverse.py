# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulation of a scenario: the samples of all sensors of all rovers, in the order of a log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap, IMUSensors, LidarScan, Time
from cdff_dev.simulate.camera import camera_of_world, pair_of_images
from cdff_dev.simulate.faults.model import Faults
from cdff_dev.simulate.faults.spinning_lidar import FaultyLidar
from cdff_dev.simulate.faults.stereo_camera import FaultyStereoCamera
from cdff_dev.simulate.faults.timing import Timing, stamps
from cdff_dev.simulate.lidar import scan
from cdff_dev.simulate.proprioception import faulty_imu_readings, imu_readings, wheel_odometry
from cdff_dev.simulate.render_pool import RenderPool, Task
from cdff_dev.simulate.rovers_in_view import RoverView
from cdff_dev.simulate.samples import Entry, header, pose, sample_times_us
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.surface import sun_direction
from cdff_dev.simulate.world import World, cast_scene, generator, make_world, true_heights

Progress = Callable[[int, int], None]


def levelled(T: FloatArray) -> FloatArray:
    """Return a pose ``(4, 4)`` with the position and heading of ``T`` and without its tilt.

    For ``T_site_base`` at the epoch it is ``T_site_odom``.
    """
    heading = np.arctan2(T[1, 0], T[0, 0])
    return se3.transform(se3.exp_so3([0.0, 0.0, heading]), T[:3, 3])


class _Renderer:
    """State of a worker process: the scene, its appearance and the cameras."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._scene = cast_scene(world.relief, world.rocks)
        self._faulty_cameras: dict[str, FaultyStereoCamera] = {}
        self._faulty_lidars: dict[str, FaultyLidar] = {}
        camera = camera_of_world(world, self._scene)
        if camera is not None:
            self._camera = camera
            self._rover_view = self._make_rover_view(world)

    def _make_rover_view(self, world: World) -> RoverView | None:
        """Return the view of rovers in images; None if the scenario has none."""
        scenario, surface = world.scenario, world.scenario.terrain.surface
        if scenario.rovers_in_view is None or surface is None:
            return None
        return RoverView(
            scenario.rovers_in_view,
            self._camera,
            self._scene,
            world.motions,
            sun_direction(surface),
            surface.ambient,
            surface.haze_distance_m,
        )

    def render(self, task: Task) -> Any:
        """Return the image pair or scan of a task."""
        kind, robot, index = task
        scenario, faults = self._world.scenario, self._world.scenario.faults
        motion = self._world.motions[robot]
        robot_index = sorted(scenario.robots).index(robot)
        rng = generator(scenario, kind, robot_index, index)
        if kind == "navcam" and scenario.navcam is not None:
            t_s = sample_times_us(scenario.navcam.rate_hz, scenario.duration_s)[index] * 1e-6
            if faults is not None:
                fault_rng = generator(scenario, "fault_navcam", robot_index, index)
                return self._faulty_camera(robot).pair(t_s, rng, fault_rng)
            T_site_base = motion.poses(np.array([t_s]))[0]
            if self._rover_view is not None:
                return self._rover_view.pair(T_site_base, robot, t_s, rng)
            return self._camera.pair(T_site_base, rng)
        t0_s = sample_times_us(scenario.lidar.rate_hz, scenario.duration_s)[index] * 1e-6
        if faults is not None:
            fault_rng = generator(scenario, "fault_lidar", robot_index, index)
            return self._faulty_lidar(robot).scan(t0_s, rng, fault_rng)
        return scan(scenario.lidar, self._scene, motion, t0_s, rng)

    def _faulty_camera(self, robot: str) -> FaultyStereoCamera:
        if robot not in self._faulty_cameras:
            self._faulty_cameras[robot] = FaultyStereoCamera(self._world, robot, self._camera)
        return self._faulty_cameras[robot]

    def _faulty_lidar(self, robot: str) -> FaultyLidar:
        if robot not in self._faulty_lidars:
            self._faulty_lidars[robot] = FaultyLidar(self._world, robot, self._scene)
        return self._faulty_lidars[robot]


def stamped_samples(
    scenario: Scenario, robot: str, sensor: str, t_us: np.ndarray
) -> Iterator[tuple[int, int]]:
    """Yield index and stamp, microseconds since the epoch, of each sample that arrives.

    The samples are measured at the times ``(n,)``; their indices are the sequence numbers.
    """
    timing = (scenario.faults and scenario.faults.timing) or Timing()
    clock = getattr(timing, sensor)
    if clock is None:
        yield from ((i, int(us)) for i, us in enumerate(t_us))
        return
    rng = generator(scenario, f"clock_{sensor}", sorted(scenario.robots).index(robot))
    stamped_us, arrives = stamps(clock, t_us, rng)
    yield from ((int(i), int(stamped_us[i])) for i in np.flatnonzero(arrives))


def proprioceptive_entries(world: World, robot: str) -> Iterator[Entry]:
    """Yield the samples of IMU and wheels, and the true poses, of one rover."""
    scenario, motion = world.scenario, world.motions[robot]
    faults = scenario.faults or Faults()
    index = sorted(scenario.robots).index(robot)

    t_us = sample_times_us(scenario.imu.rate_hz, scenario.duration_s)
    imu = imu_readings(
        scenario.imu, motion, t_us * 1e-6, scenario.gravity_m_s2, generator(scenario, "imu", index)
    )
    if faults.imu is not None:
        fault_rng = generator(scenario, "fault_imu", index)
        imu = faulty_imu_readings(imu, faults.imu, motion, t_us * 1e-6, fault_rng)
    stream = f"/{robot}/imu.sample"
    for i, us in stamped_samples(scenario, robot, "imu", t_us):
        at = scenario.epoch_ns + us * 1000
        value = IMUSensors(Time.from_ns(at), imu.acc_m_s2[i], imu.gyro_rad_s[i], np.zeros(3))
        yield Entry(stream, at, header(scenario, stream, i, at, at, f"{robot}/imu"), value)

    t_us = sample_times_us(scenario.wheels.rate_hz, scenario.duration_s)
    wheel_faults = None
    if faults.wheels is not None:
        wheel_faults = (faults.wheels, generator(scenario, "fault_wheels", index))
    rng = generator(scenario, "wheels", index)
    wheels = wheel_odometry(scenario.wheels, motion, t_us * 1e-6, rng, wheel_faults)
    yield from _poses(
        scenario,
        f"/{robot}/wheels.odometry",
        stamped_samples(scenario, robot, "wheels", t_us),
        wheels.poses,
        wheels.covariances,
        f"{robot}/odom",
        f"{robot}/base",
    )

    t_us = sample_times_us(scenario.truth_rate_hz, scenario.duration_s)
    true_poses = motion.poses(t_us * 1e-6)
    no_covariance = np.zeros((len(true_poses), 6, 6))
    true_times = [(i, int(us)) for i, us in enumerate(t_us)]
    yield from _poses(
        scenario, f"/{robot}/truth.pose", true_times, true_poses, no_covariance, "site", f"{robot}/base"
    )


def _poses(
    scenario: Scenario,
    stream: str,
    samples: Iterable[tuple[int, int]],
    T: FloatArray,
    covariance: FloatArray,
    parent: str,
    child: str,
) -> Iterator[Entry]:
    """Yield poses; ``samples`` are their indices and stamps in microseconds since the epoch."""
    for i, us in samples:
        at = scenario.epoch_ns + us * 1000
        yield Entry(
            stream,
            at,
            header(scenario, stream, i, at, at, parent, child),
            pose(T[i], covariance[i], parent, child, at),
        )


def _rendered_entries(scenario: Scenario, robot: str) -> Iterator[Entry]:
    """Yield the stereo pairs and lidar scans of one rover, without values."""
    if scenario.navcam is not None:
        stream, frame = f"/{robot}/navcam.pair", f"{robot}/navcam_left"
        t_us = sample_times_us(scenario.navcam.rate_hz, scenario.duration_s)
        for i, us in stamped_samples(scenario, robot, "navcam", t_us):
            at = scenario.epoch_ns + us * 1000
            yield Entry(stream, at, header(scenario, stream, i, at, at, frame), render=("navcam", robot, i))
    stream = f"/{robot}/lidar.scan"
    sweep_us = round(scenario.lidar.sweep_s * 1e6)
    t_us = sample_times_us(scenario.lidar.rate_hz, scenario.duration_s)[:-1]
    for i, us in stamped_samples(scenario, robot, "lidar", t_us):
        t0_ns = scenario.epoch_ns + us * 1000
        t1_ns = t0_ns + sweep_us * 1000
        yield Entry(
            stream,
            t1_ns,
            header(scenario, stream, i, t0_ns, t1_ns, f"{robot}/lidar"),
            render=("lidar", robot, i),
        )


def _true_map(world: World) -> Entry:
    """Return the true elevation map of the site."""
    scenario, model = world.scenario, world.scenario.terrain
    resolution_m = scenario.truth_map_m or 0.05
    layers = true_heights(world, resolution_m)
    n = layers["mean"].shape[0]
    layers["count"] = np.full((n, n), 9.0, dtype=np.float32)
    layers["age_s"] = np.zeros((n, n), dtype=np.float32)
    grid = GridGeometry("site", resolution_m, -model.fine_half_width_m, model.fine_half_width_m, n, n)
    at = scenario.epoch_ns
    value = ElevationMap.from_layers(grid, layers, t0_ns=at, t1_ns=at)
    return Entry("/site/truth.terrain", at, header(scenario, "/site/truth.terrain", 0, at, at, "site"), value)


def _value(scenario: Scenario, entry: Entry, rendered: Any) -> Any:
    """Return the value of an entry; ``rendered`` is the result of its rendering task, if it has one."""
    if entry.render is None:
        return entry.value
    if entry.render[0] == "navcam" and scenario.navcam is not None:
        return pair_of_images(scenario.navcam, rendered, entry.stamp_ns, entry.header.frame)
    return LidarScan.from_arrays(
        rendered.points_m,
        rendered.time_offset_us,
        frame=entry.header.frame,
        t0_ns=entry.header.t0_ns,
        t1_ns=entry.header.t1_ns,
        intensity=rendered.intensity,
        ring=rendered.ring,
        sensor=entry.header.frame,
    )


def simulate(
    scenario: Scenario, workers: int = 2, progress: Progress | None = None, world: World | None = None
) -> Iterator[tuple[Entry, Any]]:
    """Yield every sample of a scenario with its value, in (stamp, stream) order.

    Parameters
    ----------
    workers : int
        Number of processes that cast rays; 0: this process casts them. The samples do not depend on it.
    progress : callable, optional
        Called with the number of finished ray-cast samples and their total.
    world : World, optional
        World of the scenario; by default it is made.
    """
    with RenderPool(workers) as pool:
        world = world or make_world(scenario)
        entries, tasks = _plan(world)
        rendered = pool.map(partial(_Renderer, world), tasks)
        yield from _with_values(scenario, entries, rendered, len(tasks), progress)


def _plan(world: World) -> tuple[list[Entry], list[Task]]:
    """Return all entries in the order of a log, and their rendering tasks in the same order."""
    scenario = world.scenario
    entries = [_true_map(world)]
    for robot in scenario.robots:
        entries += proprioceptive_entries(world, robot)
        entries += _rendered_entries(scenario, robot)
    last_ns = scenario.epoch_ns + round(scenario.duration_s * NS_PER_S)
    entries = sorted((e for e in entries if e.stamp_ns <= last_ns), key=lambda e: (e.stamp_ns, e.stream))
    return entries, [e.render for e in entries if e.render is not None]


def _with_values(
    scenario: Scenario, entries: list[Entry], rendered: Iterator[Any], total: int, progress: Progress | None
) -> Iterator[tuple[Entry, Any]]:
    """Yield each entry of the log with its value.

    ``rendered`` yields the results of the ``total`` rendering tasks, in the order of their entries.
    """
    rendered_count = 0
    for entry in entries:
        value = _value(scenario, entry, next(rendered) if entry.render is not None else None)
        if entry.render is not None:
            rendered_count += 1
            if progress is not None:
                progress(rendered_count, total)
        yield entry, value
