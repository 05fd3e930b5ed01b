# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulation of a scenario in orbit: samples of all sensors and their truth, in the order of a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import (
    Frame,
    FrameAttribT,
    IMUSensors,
    LidarScan,
    ObjectDetection,
    ObjectDetections,
    Pointcloud,
    RigidBodyState,
    Time,
    Vector4d,
)
from cdff_dev.simulate.lidar import Scan
from cdff_dev.simulate.orbit.images import CameraImage, CameraSimulator
from cdff_dev.simulate.orbit.motion import OrbitMotion
from cdff_dev.simulate.orbit.navigation import (
    AttitudeTrack,
    gnss_states,
    imu_track,
    star_tracker_attitudes,
    star_tracker_bias,
)
from cdff_dev.simulate.orbit.random_streams import generator
from cdff_dev.simulate.orbit.scans import LidarSimulator
from cdff_dev.simulate.orbit.scenario import OrbitScenario
from cdff_dev.simulate.orbit.world import OrbitWorld
from cdff_dev.simulate.render_pool import RenderPool, Task
from cdff_dev.simulate.samples import PRODUCER, Entry, header, pose, sample_times_us

Progress = Callable[[int, int], None]

#: Frame of the truth and of the navigation: axes of the GCRF, origin at the central body.
INERTIAL = "inertial"
#: Streams of the truth of an image, after the name of its camera.
IMAGE_TRUTH = ("target", "mask", "centroid", "sun", "points")
#: Variance of an unknown position, m²: it is larger than that of any orbit about the Earth.
_UNKNOWN_M2 = 1e18


class _Renderer:
    """State of a worker process: the world and its cameras and lidars."""

    def __init__(self, scenario: OrbitScenario) -> None:
        self._world = OrbitWorld(scenario)
        self._cameras: dict[str, CameraSimulator] = {}
        self._lidars: dict[str, LidarSimulator] = {}

    def render(self, task: Task) -> CameraImage | Scan:
        """Return an image or a scan."""
        kind, name, index = task
        servicer = self._world.scenario.servicer
        if kind == "camera":
            if name not in self._cameras:
                self._cameras[name] = CameraSimulator(self._world, name)
            return self._cameras[name].image(
                float(_times_s(servicer.cameras[name], self._duration_s)[index]), index
            )
        if name not in self._lidars:
            self._lidars[name] = LidarSimulator(self._world, name)
        return self._lidars[name].scan(float(_times_s(servicer.lidars[name], self._duration_s)[index]), index)

    @property
    def _duration_s(self) -> float:
        return self._world.scenario.duration_s


def simulate_orbit(
    scenario: OrbitScenario, workers: int = 2, progress: Progress | None = None
) -> Iterator[tuple[Entry, Any]]:
    """Yield every sample of a scenario with its value, in (stamp, stream) order.

    Parameters
    ----------
    workers : int
        Number of processes that cast rays; 0: this process casts them. The samples do not depend on it.
    progress : callable, optional
        Called with the number of finished images and scans and their total.

    Raises
    ------
    ConfigurationError
        If a mesh is missing or implausible, the path is impossible, or a body is too close to a sensor.
    """
    OrbitWorld(scenario)  # the errors of the scenario are reported before the worker processes start
    entries = sorted(_entries(scenario), key=lambda e: (e.stamp_ns, e.stream))
    tasks = list(dict.fromkeys(e.render for e in entries if e.render is not None))
    with RenderPool(workers) as pool:
        rendered = pool.map(partial(_Renderer, scenario), tasks)
        values: dict[Task, Any] = {}
        waiting = Counter(e.render for e in entries if e.render is not None)
        completed_tasks = 0
        for entry in entries:
            if entry.render is None:
                yield entry, entry.value
                continue
            while entry.render not in values:
                values[tasks[completed_tasks]] = next(rendered)
                completed_tasks += 1
                if progress is not None:
                    progress(completed_tasks, len(tasks))
            yield entry, rendered_value(scenario, entry, values[entry.render])
            waiting[entry.render] -= 1
            if waiting[entry.render] == 0:
                del values[entry.render]


def _times_s(sensor: Any, duration_s: float) -> FloatArray:
    """Return the times (n,) of the images or scans of a sensor, seconds since the epoch."""
    times_us = sample_times_us(sensor.rate_hz, duration_s - sensor.start_s)
    return np.asarray(sensor.start_s + times_us * 1e-6)


def _entries(scenario: OrbitScenario) -> Iterator[Entry]:
    """Yield the entries of the log of a rendezvous."""
    motion = OrbitMotion(scenario)
    yield from true_states(scenario, motion, sample_times_us(scenario.truth_rate_hz, scenario.duration_s))
    yield from _navigation(scenario, motion)
    name = scenario.servicer.name
    last_ns = scenario.epoch_ns + round(scenario.duration_s * NS_PER_S)
    for camera, model in scenario.servicer.cameras.items():
        frame = f"{name}/{camera}"
        for i, t_s in enumerate(_times_s(model, scenario.duration_s)):
            at = stamp_of(scenario, t_s)
            streams = [f"/{name}/{camera}.image", *(f"/{name}/truth.{camera}_{k}" for k in IMAGE_TRUTH)]
            for stream in streams:
                yield Entry(
                    stream, at, header(scenario, stream, i, at, at, frame), render=("camera", camera, i)
                )
    for lidar, sensor in scenario.servicer.lidars.items():
        stream = f"/{name}/{lidar}.scan"
        truth = f"/{name}/truth.{lidar}_target"
        for i, t_s in enumerate(_times_s(sensor, scenario.duration_s)):
            t0_ns, t1_ns = stamp_of(scenario, t_s), stamp_of(scenario, t_s + sensor.sweep_s)
            if t1_ns > last_ns:
                continue
            head = header(scenario, stream, i, t0_ns, t1_ns, f"{name}/{lidar}")
            yield Entry(stream, t1_ns, head, render=("lidar", lidar, i))
            T = se3.inverse(sensor.mount.matrix()) @ np.stack(
                [motion.poses_in_base(b.name, np.array([t_s + sensor.sweep_s]))[0] for b in scenario.bodies]
            )
            poses = {body.name: T[k] for k, body in enumerate(scenario.bodies)}
            value = true_detections(poses, t1_ns, f"{name}/{lidar}")
            yield Entry(truth, t1_ns, header(scenario, truth, i, t1_ns, t1_ns, f"{name}/{lidar}"), value)


def stamp_of(scenario: OrbitScenario, t_s: float) -> int:
    """Return the mission time, nanoseconds, of a time since the epoch, seconds."""
    return scenario.epoch_ns + round(float(t_s) * 1e6) * 1000


def true_states(
    scenario: OrbitScenario, motion: OrbitMotion, t_us: np.ndarray, first: int = 0
) -> Iterator[Entry]:
    """Yield true poses and states of servicer, client and companions at times (n,), microseconds.

    ``first`` is the number of the first sample in its stream.
    """
    t_s = t_us * 1e-6
    position, velocity = motion.servicer_states(t_s)
    R_base = motion.base_attitudes(t_s)
    rates = np.einsum("nij,nj->ni", R_base, motion.base_rates(t_s))
    name = scenario.servicer.name
    yield from _true_states(scenario, name, f"{name}/base", t_us, (position, velocity, R_base, rates), first)
    centre = motion.client_positions_m(t_s)
    for body in scenario.bodies:
        R = motion.body_attitudes(body.name, t_s)
        spin = np.einsum("nij,nj->ni", R, motion.body_rates(body.name, t_s))
        at = centre + motion.body_offsets_m(body.name, t_s)
        half_step_s = 0.05
        ahead, behind = (
            motion.client_positions_m(t_s + s) + motion.body_offsets_m(body.name, t_s + s)
            for s in (half_step_s, -half_step_s)
        )
        yield from _true_states(
            scenario,
            body.name,
            f"{body.name}/body",
            t_us,
            (at, (ahead - behind) / (2.0 * half_step_s), R, spin),
            first,
        )


def _true_states(
    scenario: OrbitScenario,
    owner: str,
    frame: str,
    t_us: np.ndarray,
    states: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    first: int,
) -> Iterator[Entry]:
    """Yield poses and states; positions, velocities, attitudes and rates are in inertial axes."""
    position, velocity, R, rate = states
    for i, us in enumerate(t_us):
        at = scenario.epoch_ns + int(us) * 1000
        T = se3.transform(R[i], position[i])
        stream = f"/{owner}/truth.pose"
        head = header(scenario, stream, first + i, at, at, INERTIAL, frame)
        yield Entry(stream, at, head, pose(T, np.zeros((6, 6)), INERTIAL, frame, at))
        stream = f"/{owner}/truth.state"
        value = RigidBodyState(
            timestamp=Time.from_ns(at),
            source_frame=frame,
            target_frame=INERTIAL,
            pos=position[i],
            cov_position=np.zeros((3, 3)),
            orient=se3.quaternion_xyzw_from_matrix(R[i]),
            cov_orientation=np.zeros((3, 3)),
            velocity=velocity[i],
            cov_velocity=np.zeros((3, 3)),
            angular_velocity=rate[i],
            cov_angular_velocity=np.zeros((3, 3)),
        )
        yield Entry(stream, at, header(scenario, stream, first + i, at, at, INERTIAL, frame), value)


def _navigation(scenario: OrbitScenario, motion: OrbitMotion) -> Iterator[Entry]:
    """Yield the samples of star tracker, IMU and GNSS receiver."""
    servicer = scenario.servicer
    name = servicer.name
    if servicer.star_tracker is not None:
        t_us = sample_times_us(servicer.star_tracker.rate_hz, scenario.duration_s)
        rng = generator(scenario, "star_tracker")
        bias = star_tracker_bias(servicer.star_tracker, rng)
        track = star_tracker_attitudes(servicer.star_tracker, motion, t_us * 1e-6, bias, rng)
        yield from attitude_entries(scenario, track, t_us)
    if servicer.imu is not None:
        t_us = sample_times_us(servicer.imu.rate_hz, scenario.duration_s)
        imu = imu_track(servicer.imu, motion, t_us * 1e-6, generator(scenario, "imu"))
        stream = f"/{name}/imu.sample"
        for i, us in enumerate(t_us):
            at = scenario.epoch_ns + int(us) * 1000
            sample = IMUSensors(Time.from_ns(at), imu.acc_m_s2[i], imu.gyro_rad_s[i], np.zeros(3))
            yield Entry(stream, at, header(scenario, stream, i, at, at, f"{name}/imu"), sample)
    if servicer.gnss is not None:
        t_us = sample_times_us(servicer.gnss.rate_hz, scenario.duration_s)
        states = gnss_states(servicer.gnss, motion, t_us * 1e-6, generator(scenario, "gnss"))
        yield from gnss_entries(scenario, states, t_us)


def attitude_entries(
    scenario: OrbitScenario, track: AttitudeTrack, t_us: np.ndarray, first: int = 0
) -> Iterator[Entry]:
    """Yield the attitudes that the star tracker measured at those of the times (n,) at which it delivers.

    ``first`` is the number of the first time in the stream.
    """
    name = scenario.servicer.name
    stream, frame = f"/{name}/star_tracker.attitude", f"{name}/base"
    for i, R, covariance in zip(track.index, track.R_inertial_base, track.covariances, strict=True):
        at = scenario.epoch_ns + int(t_us[i]) * 1000
        full = np.zeros((6, 6))
        full[:3, :3], full[3:, 3:] = _UNKNOWN_M2 * np.eye(3), covariance
        head = header(scenario, stream, first + int(i), at, at, INERTIAL, frame)
        T = se3.transform(R, np.zeros(3))
        yield Entry(stream, at, head, pose(T, full, INERTIAL, frame, at))


def gnss_entries(
    scenario: OrbitScenario, states: tuple[FloatArray, FloatArray], t_us: np.ndarray, first: int = 0
) -> Iterator[Entry]:
    """Yield the measured positions and velocities (n, 3) of the GNSS receiver at times (n,)."""
    model, name = scenario.servicer.gnss, scenario.servicer.name
    assert model is not None  # checked by the caller
    positions, velocities = states
    stream, frame = f"/{name}/gnss.state", f"{name}/base"
    variance_m2 = model.position_sigma_m**2 + model.slow_sigma_m**2
    for i, us in enumerate(t_us):
        at = scenario.epoch_ns + int(us) * 1000
        value = RigidBodyState(
            timestamp=Time.from_ns(at),
            source_frame=frame,
            target_frame=INERTIAL,
            pos=positions[i],
            cov_position=variance_m2 * np.eye(3),
            velocity=velocities[i],
            cov_velocity=model.velocity_sigma_m_s**2 * np.eye(3),
            angular_velocity=np.full(3, np.nan),
        )
        yield Entry(stream, at, header(scenario, stream, first + i, at, at, INERTIAL, frame), value)


def rendered_value(scenario: OrbitScenario, entry: Entry, result: CameraImage | Scan) -> Any:
    """Return the value of a sample of a rendered image or scan."""
    head = entry.header
    if isinstance(result, Scan):
        return LidarScan.from_arrays(
            result.points_m,
            result.time_offset_us,
            frame=head.frame,
            t0_ns=head.t0_ns,
            t1_ns=head.t1_ns,
            intensity=result.intensity,
            ring=result.ring,
            sensor=head.frame,
        )
    port = entry.stream.rpartition("_")[2] if "/truth." in entry.stream else "image"
    if port in ("image", "mask"):
        assert entry.render is not None  # it is a rendered sample
        model = scenario.servicer.cameras[entry.render[1]].model
        frame = Frame.from_image(
            result.image if port == "image" else result.mask,
            stamp_ns=entry.stamp_ns,
            camera_matrix=model.matrix,
            dist_coeffs=model.distortion,
            sensor=head.frame,
        )
        attributes = (
            FrameAttribT(name="exposure_s", data=f"{result.exposure_s:.9g}"),
            FrameAttribT(name="simulated", data=scenario.name),
        )
        return replace(frame, metadata=replace(frame.metadata, attributes=attributes))
    if port == "centroid":
        return Vector4d(values=result.centroids_px)
    if port == "sun":
        return Vector4d(values=result.sun)
    if port == "points":
        return Pointcloud.from_points(result.points_m, frame=head.frame, stamp_ns=entry.stamp_ns)
    return true_detections(
        result.T_camera_body, entry.stamp_ns, head.frame, {scenario.client.name: (result.box_px, result.lit)}
    )


def true_detections(
    poses: dict[str, FloatArray],
    stamp_ns: int,
    frame: str,
    boxes: dict[str, tuple[FloatArray, float]] | None = None,
) -> ObjectDetections:
    """Return the true poses ``T_sensor_body`` by name, with the box in the image and the lit fraction."""
    detections = []
    for name, T in poses.items():
        box, lit = (boxes or {}).get(name, (np.zeros(4), 1.0))
        true = pose(T, np.zeros((6, 6)), frame, f"{name}/body", stamp_ns)
        detections.append(ObjectDetection(label=name, score=lit, pose=true, image_box=box))
    return ObjectDetections(
        time_stamp=Time.from_ns(stamp_ns),
        producer_id=PRODUCER,
        sensor_id=frame,
        frame_id=frame,
        detections=tuple(detections),
    )
