# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An unknown, rotating body: each lidar scan is registered with the surface of the previous scans."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan, Mesh, Pointcloud, TransformWithCovariance
from cdff_core.dfpcs.reconstruction_3d.compound import Reconstruction3D
from tests.support import satellite

SIGMA_M = 0.01
RATE = np.radians([3.0, 2.0, -1.5])
R_START = se3.exp_so3([0.4, -1.0, 0.3])


def true_pose(t_s: float, rate: np.ndarray = RATE) -> np.ndarray:
    """Return T_sensor_body of a body 4 m away."""
    return se3.transform(R_START @ se3.exp_so3(t_s * rate), [0.05, 0.0, 4.0])


def scan(t_s: float, rng: np.random.Generator, mesh: satellite.Mesh, rate: np.ndarray = RATE) -> np.ndarray:
    pose = true_pose(t_s, rate)
    return satellite.scan(mesh, pose, rng=rng, pixels=80, field_deg=24.0, sigma_m=SIGMA_M)


def cloud(t_s: float, points: np.ndarray) -> Sample:
    stamp_ns = round(1e9 * t_s)
    value = Pointcloud.from_points(points, frame="servicer/lidar", stamp_ns=stamp_ns)
    return Sample("cloud", stamp_ns, 0, value, id=f"c{stamp_ns}", frame="servicer/lidar")


def make_dfpc(**parameters: object) -> Reconstruction3D:
    dfpc = Reconstruction3D()
    dfpc.configure(
        {"solve_poses": True, "body": "debris", "range_sigma_m": SIGMA_M, "voxel_m": 0.02, **parameters}
    )
    return dfpc


def run(dfpc: Reconstruction3D, samples: Iterable[Sample]) -> list[Output]:
    outputs = [output for sample in samples for output in dfpc.step(sample)]
    return [*outputs, *dfpc.finish()]


def reconstructed(seconds: range, mesh: satellite.Mesh | None = None) -> list[Output]:
    rng = np.random.default_rng(5)
    shape = satellite.satellite() if mesh is None else mesh
    return run(make_dfpc(), [cloud(float(t), scan(float(t), rng, shape)) for t in seconds])


@pytest.fixture(scope="module")
def revolution() -> list[Output]:
    """Outputs of more than one revolution, at 3.9 degrees per second."""
    return reconstructed(range(100))


@pytest.mark.slow
def test_the_poses_of_one_revolution_stay_within_their_covariance(revolution: list[Output]) -> None:
    poses = [o for o in revolution if o.port == "pose"]
    assert len(poses) == 100
    assert {o.frame for o in poses} == {"debris/body"}
    T_model_body = poses[0].value.transform.matrix @ true_pose(0.0)
    squared = []
    for output in poses[1:]:
        truth = T_model_body @ se3.inverse(true_pose(1e-9 * output.t1_ns))
        error = pose_error(truth, output.value.transform.matrix)
        assert np.linalg.norm(error[3:]) < np.radians(2.0)
        squared.append(error @ np.linalg.solve(output.value.transform.covariance, error))
    assert np.mean(squared) < 12.0


@pytest.mark.slow
def test_the_surface_of_the_unknown_body_tracks_it_at_once(revolution: list[Output]) -> None:
    *_, mesh = (o.value for o in revolution if o.port == "mesh")
    assert mesh.frame == "debris/body"
    rng, shape = np.random.default_rng(6), satellite.satellite()
    tracker = Registry.default().make_dfpc("lidar_target_tracking")
    tracker.configure({"prepare": {"points": 8000, "views": 60, "view_pixels": 128, "grid_cells": 64}})
    list(tracker.step(Sample("model", 0, 0, mesh, id="m")))
    poses = [
        next(iter(tracker.step(cloud(float(t), scan(float(t), rng, shape))))).value for t in range(100, 112)
    ]
    # A different axis of the body differs by the same transform at all times: the detected pose is constant.
    offsets = [pose.transform.matrix for pose in poses[4:]]
    T_body_model = [se3.inverse(true_pose(float(104 + k))) @ T for k, T in enumerate(offsets)]
    for T in T_body_model:
        error = pose_error(T_body_model[0], T)
        assert np.linalg.norm(error[:3]) < 0.04
        assert np.linalg.norm(error[3:]) < np.radians(2.0)


def test_scans_of_a_lidar_are_captures_and_given_poses_are_ignored(rng: np.random.Generator) -> None:
    dfpc, shape = make_dfpc(), satellite.satellite()
    points = scan(0.0, rng, shape)
    value = LidarScan.from_arrays(
        points, np.zeros(len(points), np.int64), frame="servicer/lidar", t0_ns=10**9, t1_ns=10**9
    )
    pose = TransformWithCovariance.from_transform(
        UncertainTransform.exact(np.eye(4)), parent="site", child="servicer/lidar", stamp_ns=10**9
    )
    assert list(dfpc.step(Sample("poses", 10**9, 0, pose))) == []
    (output,) = dfpc.step(Sample("scan", 10**9, 0, value, id="s", frame="servicer/lidar"))
    assert output.port == "pose"


@pytest.mark.parametrize(
    "shape", [satellite.box((1.0, 1.0, 0.02)), satellite.cylinder(0.5, 1.0)], ids=["plate", "cylinder"]
)
def test_bodies_whose_surface_does_not_determine_the_pose_are_refused(shape: satellite.Mesh) -> None:
    outputs = reconstructed(range(6), shape)
    (mesh,) = [o for o in outputs if o.port == "mesh"]
    assert mesh.quality.status is Status.FAILED
    assert any(reason.startswith("degenerate:") for reason in mesh.quality.reasons)


def test_a_capture_of_one_plane_is_located_only_with_an_accurate_prediction(rng: np.random.Generator) -> None:
    dfpc, shape = make_dfpc(), satellite.satellite()
    for t in range(5):
        list(dfpc.step(cloud(float(t), scan(float(t), rng, shape))))
    points = scan(5.0, rng, shape)
    body_m = se3.transform_points(se3.inverse(true_pose(5.0)), points)
    sides = [np.abs(body_m[:, i] - d) < 0.03 for i, h in enumerate((0.4, 0.3, 0.25)) for d in (-h, h)]
    largest_side = cloud(5.0, points[max(sides, key=np.count_nonzero)])
    registration = dfpc._registration
    assert registration is not None
    accurate, registration._covariances[-1] = registration._covariances[-1], np.eye(6)
    assert list(dfpc.step(largest_side)) == []
    registration._covariances[-1] = accurate
    (pose,) = dfpc.step(largest_side)
    assert pose.quality.status is Status.DEGRADED
    assert any(reason.startswith("degenerate:") for reason in pose.quality.reasons)


def test_two_bodies_are_refused(rng: np.random.Generator) -> None:
    points = scan(0.0, rng, satellite.satellite())
    outputs = run(make_dfpc(), [cloud(0.0, np.concatenate([points, points + np.array([3.0, 0.0, 0.0])]))])
    assert outputs[0].quality.reasons[-1].startswith("several_bodies")


def test_other_bodies_and_old_scans_are_not_added(rng: np.random.Generator) -> None:
    shape = satellite.satellite()
    scans = [cloud(float(t), scan(float(t), rng, shape)) for t in range(4)]
    other = cloud(4.0, scan(4.0, rng, satellite.box((0.5, 0.5, 0.5))) + np.array([0.0, 0.0, 6.0]))
    outputs = run(make_dfpc(), [*scans, other, scans[1], cloud(5.0, np.zeros((0, 3)))])
    (mesh,) = [o for o in outputs if o.port == "mesh"]
    assert set(mesh.quality.reasons) == {"few_points:1", "late:1", "malformed:1"}
    assert len([o for o in outputs if o.port == "pose"]) == 4
    assert isinstance(mesh.value, Mesh)
