# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""LidarTargetTracking: a rotating satellite, motion during a scan, occlusion, loss, wrong input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import (
    LidarScan,
    Mesh,
    ObjectDetection,
    ObjectDetections,
    Pointcloud,
    Time,
    TransformWithCovariance,
)
from tests.support import satellite

PREPARE = {"points": 8000, "views": 60, "view_pixels": 128, "grid_cells": 64}
LIDAR = {"pixels": 48, "field_deg": 20.0, "sigma_m": 0.01}
RATE = np.radians([3.0, 2.0, -1.5])
CENTRE = np.array([0.1, 0.0, 0.05])
R_START = se3.exp_so3([0.4, -1.0, 0.3])


def truth(t_s: float, rate: np.ndarray = RATE) -> np.ndarray:
    """Return T_sensor_body at a time."""
    R = R_START @ se3.exp_so3(t_s * rate)
    return se3.transform(R, np.array([0.1, 0.0, 5.0]) + t_s * np.array([0.0, 0.002, -0.001]) - R @ CENTRE)


def points_at(t_s: float, rng: np.random.Generator) -> np.ndarray:
    return satellite.scan(satellite.satellite(), truth(t_s), rng=rng, **LIDAR)


def cloud(t_s: float, points: np.ndarray) -> Sample:
    stamp_ns = round(1e9 * t_s)
    value = Pointcloud.from_points(points, frame="servicer/lidar", stamp_ns=stamp_ns)
    return Sample("cloud", stamp_ns, 0, value, id=f"c{stamp_ns}")


def model(name: str = "client", mesh: satellite.Mesh | None = None) -> Sample:
    vertices, triangles = satellite.satellite() if mesh is None else mesh
    value = Mesh.from_arrays(vertices, triangles, frame=f"{name}/body", stamp_ns=0)
    return Sample("model", 0, 0, value, id="m")


def guess(T: np.ndarray) -> Sample:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T), parent="servicer/lidar", child="client/body", stamp_ns=0
    )
    return Sample("guess", 0, 0, value)


def make_dfpc(**config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("lidar_target_tracking")
    dfpc.configure({"prepare": PREPARE, **config})
    assert list(dfpc.step(model())) == []
    return dfpc


def step(dfpc: Dfpc, sample: Sample) -> tuple[Output, Output]:
    pose, track = dfpc.step(sample)
    assert (pose.port, track.port) == ("pose", "track")
    assert pose.quality == track.quality
    return pose, track


def errors(pose: Output, t_s: float) -> tuple[float, float]:
    error = pose_error(truth(t_s), pose.value.transform.matrix)
    return float(np.degrees(np.linalg.norm(error[3:]))), float(np.linalg.norm(error[:3]))


def tracked(rng: np.random.Generator, count: int, **config: Any) -> Dfpc:
    """Return a tracker after ``count`` scans, one per second."""
    dfpc = make_dfpc(**config)
    for i in range(count):
        step(dfpc, cloud(float(i), points_at(float(i), rng)))
    return dfpc


@pytest.mark.slow
def test_a_rotating_body_is_detected_and_tracked_with_its_rate(rng: np.random.Generator) -> None:
    dfpc, all_errors, nees = make_dfpc(), [], []
    for i in range(30):
        pose, state = step(dfpc, cloud(float(i), points_at(float(i), rng)))
        assert all(reason.startswith(("new_track", "degenerate:")) for reason in pose.quality.reasons)
        assert pose.quality.status is (Status.DEGRADED if pose.quality.reasons else Status.OK)
        all_errors.append(errors(pose, float(i)))
        error = pose_error(truth(float(i)), pose.value.transform.matrix)
        nees.append(error @ np.linalg.solve(pose.value.transform.covariance, error))
    assert np.median(all_errors[10:], axis=0)[0] < 0.3
    assert np.median(all_errors[10:], axis=0)[1] < 0.004
    assert 1.5 < np.mean(nees) < 15.0
    R = truth(29.0)[:3, :3]
    np.testing.assert_allclose(
        state.value.velocities[0, 3:], R @ RATE, atol=0.02 * float(np.linalg.norm(RATE))
    )
    assert pose.value.child_frame == "client/body"
    assert state.value.metadata.label == "client"
    assert {"agreement", "points", "innovation", "unconstrained"} <= set(pose.quality.metrics)


def test_the_motion_during_a_scan_is_removed(rng: np.random.Generator) -> None:
    def error_of(*, with_times: bool) -> float:
        dfpc, angles = make_dfpc(), []
        for i in range(14):
            end_s = float(i + 1)
            parts, offsets_us = [], []
            # Eight strips of the scan, one after another within a second.
            for k in range(8):
                points = points_at(end_s - 1.0 + (k + 1) / 8.0, rng)
                rows = points[:, 1] / points[:, 2]
                edges = np.linspace(-0.18, 0.18, 9)
                parts.append(points[(rows >= edges[k]) & (rows < edges[k + 1])])
                offsets_us.append(np.full(len(parts[-1]), (k + 1) * 125_000 if with_times else 1_000_000))
            end_ns = round(1e9 * end_s)
            value = LidarScan.from_arrays(
                np.concatenate(parts),
                np.concatenate(offsets_us).astype(np.uint32),
                frame="servicer/lidar",
                t0_ns=end_ns - 10**9,
                t1_ns=end_ns,
            )
            pose, _ = step(dfpc, Sample("scan", end_ns, 0, value))
            angles.append(errors(pose, end_s)[0])
        return float(np.median(angles[6:]))

    assert error_of(with_times=True) < 0.2 * error_of(with_times=False)


def test_outliers_and_occlusion_are_survived(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 12)
    for i in range(12, 22):
        points = points_at(float(i), rng)
        ranges = np.linalg.norm(points, axis=1)
        wrong = rng.random(len(points)) < 0.3
        points[wrong] *= (1.0 + rng.uniform(-1.0, 1.0, wrong.sum()) / ranges[wrong])[:, None]
        if i >= 17:
            points = points[points[:, 0] > np.median(points[:, 0])]
        pose, _ = step(dfpc, cloud(float(i), points))
        assert pose.quality.status is not Status.FAILED
        assert "coasting" not in pose.quality.reasons
        assert errors(pose, float(i))[0] < 0.8
        assert errors(pose, float(i))[1] < 0.015


def test_lost_scans_are_bridged_and_the_body_is_found_again(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 15, detect_after=1000)
    for i in range(15, 27):
        pose, _ = step(dfpc, cloud(float(i), np.zeros((0, 3))))
        assert pose.quality.status is Status.DEGRADED
        assert pose.quality.reasons[0] == "coasting"
        assert pose.quality.reasons[1] == "few_points:0<20"
    pose, state = step(dfpc, cloud(27.0, points_at(27.0, rng)))
    assert "coasting" not in pose.quality.reasons
    assert errors(pose, 27.0)[0] < 0.8
    assert state.value.metadata.track_id == 1


def test_a_body_that_jumped_starts_a_new_track(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 8, detect_after=2)
    jumped, reasons = [], []
    for i in range(8, 12):
        pose, state = step(dfpc, cloud(float(i), points_at(float(i) + 30.0, rng)))
        jumped.append(state.value.metadata.track_id)
        reasons.append(pose.quality.reasons)
    assert jumped[0] == 1
    assert jumped[-1] == 2, reasons
    assert errors(pose, 41.0)[0] < 1.0


def test_a_guess_starts_the_track_and_wrong_times_keep_it(rng: np.random.Generator) -> None:
    dfpc = make_dfpc()
    T = truth(0.0)
    list(dfpc.step(guess(se3.transform(se3.exp_so3([0.08, 0, 0]) @ T[:3, :3], T[:3, 3] + 0.03))))
    pose, _ = step(dfpc, cloud(1.0, points_at(0.0, rng)))
    assert pose.quality.reasons == ("new_track",)
    assert errors(pose, 0.0)[0] < 1.0
    for t_s, reason in ((0.5, "late:0.5s"), (1.0, "repeated_stamp")):
        pose, _ = step(dfpc, cloud(t_s, points_at(0.0, rng)))
        assert (pose.quality.status, pose.quality.reasons, pose.value) == (Status.FAILED, (reason,), None)


def test_without_model_or_body_nothing_is_tracked(rng: np.random.Generator) -> None:
    dfpc = Registry.default().make_dfpc("lidar_target_tracking")
    dfpc.configure({"prepare": PREPARE})
    pose, _ = step(dfpc, cloud(0.0, points_at(0.0, rng)))
    assert pose.quality.reasons == ("no_model",)
    list(dfpc.step(model()))
    noise = rng.normal([0, 0, 5.0], 0.4, (300, 3))
    pose, _ = step(dfpc, cloud(1.0, noise))
    assert pose.quality.status is Status.FAILED
    assert pose.quality.reasons[0] == "not_found"
    pose, _ = step(dfpc, cloud(2.0, np.full((50, 3), np.nan)))
    assert pose.quality.reasons == ("not_found", "few_points:0<20")


def test_another_model_ends_the_track_and_the_same_one_does_not(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 4)
    list(dfpc.step(model()))
    pose, _ = step(dfpc, cloud(4.0, points_at(4.0, rng)))
    assert pose.quality.status is Status.OK
    list(dfpc.step(model("box", satellite.box((1.0, 0.5, 0.3)))))
    pose, _ = step(dfpc, cloud(5.0, points_at(5.0, rng)))
    assert pose.quality.status is Status.FAILED
    assert pose.quality.reasons[0] == "not_found"


def test_a_track_without_use_for_long_is_lost(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 5, lost_after_s=3.0)
    statuses = [step(dfpc, cloud(5.0 + i, np.zeros((0, 3))))[0].quality.status for i in range(5)]
    assert statuses == [Status.DEGRADED] * 3 + [Status.FAILED] * 2
    pose, _ = step(dfpc, cloud(10.0, points_at(10.0, rng)))
    assert pose.value is not None
    assert errors(pose, 10.0)[0] < 1.0


@pytest.mark.parametrize("scale", [1000.0, 1e-3])
def test_a_model_with_the_wrong_unit_is_refused(rng: np.random.Generator, scale: float) -> None:
    dfpc = Registry.default().make_dfpc("lidar_target_tracking")
    dfpc.configure({"prepare": PREPARE})
    vertices, triangles = satellite.satellite()
    list(dfpc.step(model(mesh=(scale * vertices, triangles))))
    pose, _ = step(dfpc, cloud(0.0, points_at(0.0, rng)))
    assert pose.quality.status is Status.FAILED
    assert "wrong_unit" in pose.quality.reasons


def sensor_attitude(t_s: float) -> np.ndarray:
    """Return R_inertial_lidar of a servicer that turns about the line of sight and swings across it."""
    swing = np.radians(8.0) * np.sin(2.0 * np.pi * t_s / 20.0)
    return np.asarray(se3.exp_so3([0.0, 0.0, np.radians(2.0) * t_s]) @ se3.exp_so3([swing, 0.5 * swing, 0.0]))


def seen_from_turning(t_s: float) -> np.ndarray:
    """Return T_lidar_body: the motion ``truth`` is that in the inertial axes."""
    return np.asarray(se3.inverse(se3.transform(sensor_attitude(t_s), np.zeros(3))) @ truth(t_s))


def attitude(t_s: float) -> Sample:
    stamp_ns, covariance = round(1e9 * t_s), np.zeros((6, 6))
    covariance[3:, 3:] = np.radians(0.005) ** 2 * np.eye(3)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(se3.transform(sensor_attitude(t_s), np.zeros(3)), covariance),
        parent="inertial",
        child="servicer/lidar",
        stamp_ns=stamp_ns,
    )
    return Sample("attitude", stamp_ns, 0, value, id=f"a{stamp_ns}")


def turning_track(
    rng: np.random.Generator, *, with_attitude: bool, dark_s: tuple[float, float] = (99.0, 99.0)
) -> tuple[list[Output], list[float], list[float]]:
    """Return the tracks by a turning lidar, the errors of their inertial rates, rad/s, and the squared
    normalised errors of their poses.
    """
    dfpc = make_dfpc(predict={"angular_acceleration_noise": 2e-4}, sensor_rate_sigma_radps=0.06)
    states, rate_errors, nees = [], [], []
    for t_s in np.arange(0.0, 25.0):
        if with_attitude and not dark_s[0] <= t_s <= dark_s[1]:
            assert list(dfpc.step(attitude(t_s))) == []
        T = seen_from_turning(t_s)
        points = satellite.scan(satellite.satellite(), T, rng=rng, **LIDAR)
        pose, track = step(dfpc, cloud(t_s, points))
        states.append(track)
        error = pose_error(T, pose.value.transform.matrix)
        nees.append(float(error @ np.linalg.solve(pose.value.transform.covariance, error)))
        rate_errors.append(float(np.linalg.norm(track.value.velocities[0, 3:] - T[:3, :3] @ RATE)))
    return states, rate_errors, nees


@pytest.mark.slow
def test_the_rates_by_a_turning_lidar_are_inertial_with_its_attitude(rng: np.random.Generator) -> None:
    states, rate_errors, nees = turning_track(rng, with_attitude=True)
    assert max(rate_errors[12:]) < np.radians(0.2)
    assert 1.5 < np.mean(nees[5:]) < 15.0
    assert all(track.quality.metrics["inertial_rates"] == 1.0 for track in states)
    relative, relative_errors, _ = turning_track(rng, with_attitude=False)
    assert np.median(relative_errors[12:]) > np.radians(1.5)
    assert all(track.quality.metrics["inertial_rates"] == 0.0 for track in relative)


@pytest.mark.slow
def test_a_lost_attitude_is_reported_and_the_track_continues(rng: np.random.Generator) -> None:
    states, rate_errors, nees = turning_track(rng, with_attitude=True, dark_s=(10.0, 14.0))
    reasons = [track.quality.reasons for track in states]
    missing = [any(r.startswith("attitude_missing") for r in names) for names in reasons]
    assert missing == [12.0 <= t_s <= 14.0 for t_s in np.arange(0.0, 25.0)]
    assert all(track.quality.status is Status.DEGRADED for track in states[12:15])
    assert max(nees[10:12]) < 22.5  # extrapolated attitudes; 99.9 % of chi squared with 6 degrees of freedom
    for i, track in enumerate(states[12:16]):
        error = pose_error(seen_from_turning(12.0 + i), track.value.matrices[-1])
        for rows in (slice(0, 3), slice(3, 6)):
            largest = np.linalg.eigvalsh(track.value.covariances[-1][rows, rows])[-1]
            assert np.linalg.norm(error[rows]) < 4.0 * np.sqrt(largest)
    for track, rate_error in zip(states[15:], rate_errors[15:], strict=True):
        largest = np.linalg.eigvalsh(track.value.velocity_covariances[-1][3:, 3:])[-1]
        assert rate_error < 4.0 * np.sqrt(largest)


def test_the_rotation_of_the_lidar_during_a_scan_is_removed(rng: np.random.Generator) -> None:
    dfpc, angles = make_dfpc(), []
    for i in range(10):
        end_s = float(i + 1)
        for t_s in (end_s - 0.75, end_s - 0.5, end_s - 0.25, end_s):
            list(dfpc.step(attitude(t_s)))
        parts, offsets_us = [], []
        for k in range(8):
            T = seen_from_turning(end_s - 1.0 + (k + 1) / 8.0)
            points = satellite.scan(satellite.satellite(), T, rng=rng, **LIDAR)
            rows = points[:, 1] / points[:, 2]
            edges = np.linspace(-0.18, 0.18, 9)
            parts.append(points[(rows >= edges[k]) & (rows < edges[k + 1])])
            offsets_us.append(np.full(len(parts[-1]), (k + 1) * 125_000))
        end_ns = round(1e9 * end_s)
        value = LidarScan.from_arrays(
            np.concatenate(parts),
            np.concatenate(offsets_us).astype(np.uint32),
            frame="servicer/lidar",
            t0_ns=end_ns - 10**9,
            t1_ns=end_ns,
        )
        pose, _ = step(dfpc, Sample("scan", end_ns, 0, value))
        error = pose_error(seen_from_turning(end_s), pose.value.transform.matrix)
        angles.append(float(np.degrees(np.linalg.norm(error[3:]))))
    assert np.median(angles[4:]) < 0.25


def detections(t_s: float, *poses: np.ndarray, label: str = "client") -> Sample:
    """Return the detections of one body with poses that explain the scan equally well."""
    stamp_ns = round(1e9 * t_s)
    values = [
        TransformWithCovariance.from_transform(
            UncertainTransform(T), parent="servicer/lidar", child=f"{label}/body", stamp_ns=stamp_ns
        )
        for T in poses
    ]
    value = ObjectDetections(
        time_stamp=Time.from_ns(stamp_ns),
        frame_id="servicer/lidar",
        detections=tuple(ObjectDetection.from_pose(label, 0.9, v, size_m=np.ones(3)) for v in values),
    )
    return Sample("detections", stamp_ns, 0, value)


@pytest.mark.slow
def test_without_its_own_search_it_starts_from_the_detections_of_the_body(rng: np.random.Generator) -> None:
    dfpc = make_dfpc(search_scans=False)
    pose, _ = step(dfpc, cloud(0.0, points_at(0.0, rng)))
    assert pose.quality.reasons == ("not_found", "no_detections")
    list(dfpc.step(detections(0.0, truth(0.0), label="other")))
    pose, _ = step(dfpc, cloud(1.0, points_at(1.0, rng)))
    assert pose.quality.reasons == ("not_found", "no_detections")
    list(dfpc.step(detections(1.0, truth(1.0))))
    for k in range(2, 8):
        pose, _ = step(dfpc, cloud(float(k), points_at(float(k), rng)))
        assert pose.quality.status is not Status.FAILED
    angle_deg, distance_m = errors(pose, 7.0)
    assert angle_deg < 1.0
    assert distance_m < 0.02


@pytest.mark.parametrize("is_first", [True, False])
def test_later_scans_choose_between_the_poses_of_an_ambiguous_detection(
    rng: np.random.Generator, is_first: bool
) -> None:
    dfpc = make_dfpc(search_scans=False)
    wrong = truth(0.0) @ se3.transform(se3.exp_so3([0.0, 0.0, np.pi]), np.zeros(3))
    poses = (truth(0.0), wrong) if is_first else (wrong, truth(0.0))
    list(dfpc.step(detections(0.0, *poses)))
    statuses = []
    for k in range(4):
        pose, _ = step(dfpc, cloud(float(k), points_at(float(k), rng)))
        statuses.append((pose.quality.status, pose.quality.reasons))
        if errors(pose, float(k))[0] > 90.0:  # the wrong pose is never stated as OK
            assert pose.quality.status is not Status.OK
    assert errors(pose, 3.0)[0] < 1.0
    assert not any(reason.startswith("ambiguous") for reason in statuses[-1][1])
    assert any(reason == "ambiguous:1" for reason in statuses[0][1])


@pytest.mark.slow
def test_detections_from_a_long_time_ago_are_not_used(rng: np.random.Generator) -> None:
    dfpc = make_dfpc(search_scans=False, lost_after_s=5.0)
    list(dfpc.step(detections(0.0, truth(0.0))))
    pose, _ = step(dfpc, cloud(30.0, points_at(30.0, rng)))
    assert pose.quality.reasons == ("not_found", "detections_old:30s>5s")


def approaching(t_s: float) -> np.ndarray:
    """Return T_sensor_body of a body that comes nearer by more than its size between two scans."""
    T = truth(t_s)
    T[2, 3] += 12.0 - 3.0 * t_s
    return T


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0, 1, 3])
def test_detections_that_arrive_late_start_a_track_of_a_fast_body(
    rng: np.random.Generator, delay: int
) -> None:
    dfpc = make_dfpc(search_scans=False, initial_velocity_sigma_mps=3.0)
    poses = []
    for k in range(6):
        if k >= delay:
            list(dfpc.step(detections(float(k - delay), approaching(float(k - delay)))))
        points = satellite.scan(satellite.satellite(), approaching(float(k)), rng=rng, **LIDAR)
        poses.append(step(dfpc, cloud(float(k), points))[0])
    assert [pose.quality.reasons[0] for pose in poses[:delay]] == ["not_found"] * delay
    assert delay == 0 or poses[delay].quality.status is Status.DEGRADED
    for k in range(delay + 1, 6):
        error_m = poses[k].value.transform.matrix[:3, 3] - approaching(float(k))[:3, 3]
        assert np.linalg.norm(error_m) < 0.05


@pytest.mark.slow
def test_a_lost_track_continues_with_late_detections(rng: np.random.Generator) -> None:
    dfpc = make_dfpc(search_scans=False, lost_after_s=4.0)
    list(dfpc.step(detections(0.0, truth(0.0))))
    for k in range(3):
        step(dfpc, cloud(float(k), points_at(float(k), rng)))
    empty = [step(dfpc, cloud(float(k), np.zeros((0, 3))))[0].quality for k in range(3, 10)]
    assert empty[-1].status is Status.FAILED
    step(dfpc, cloud(10.0, points_at(10.0, rng)))
    list(dfpc.step(detections(10.0, truth(10.0))))
    pose, _ = step(dfpc, cloud(11.0, points_at(11.0, rng)))
    assert pose.quality.status is not Status.FAILED
    assert errors(pose, 11.0)[1] < 0.02


def test_detections_before_the_last_used_scan_are_not_used(rng: np.random.Generator) -> None:
    dfpc = make_dfpc(search_scans=False)
    list(dfpc.step(detections(1.0, truth(1.0))))
    step(dfpc, cloud(1.0, points_at(1.0, rng)))
    list(dfpc.step(detections(0.0, truth(0.0))))
    reasons = [step(dfpc, cloud(float(k), np.zeros((0, 3))))[0].quality.reasons for k in range(2, 5)]
    assert reasons[-1] == ("coasting", "few_points:0<20", "no_new_detections")
