# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""TargetDetection: the pose of a satellite in one scan, symmetric bodies, and everything that is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, Mesh, ObjectDetection, Pointcloud, TransformWithCovariance
from tests.support import satellite
from tests.support.kernels import compiled_signatures

PREPARE = {"points": 8000, "views": 60, "view_pixels": 128, "grid_cells": 64}
NEAR = {"pixels": 96, "field_deg": 20.0, "sigma_m": 0.01}
FAR = {"pixels": 40, "field_deg": 8.0, "sigma_m": 0.02}


def model(mesh: satellite.Mesh, name: str = "client", scale: float = 1.0) -> Sample:
    value = Mesh.from_arrays(scale * mesh[0], mesh[1], frame=f"{name}/body", stamp_ns=0)
    return Sample("model", 0, 0, value, id=f"model-{name}")


def cloud(points: np.ndarray, stamp_ns: int = 1000) -> Sample:
    value = Pointcloud.from_points(points, frame="servicer/lidar", stamp_ns=stamp_ns)
    return Sample("cloud", stamp_ns, 0, value, id=f"cloud-{stamp_ns}")


def make_dfpc(**config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("target_detection")
    dfpc.configure({"prepare": PREPARE, **config})
    return dfpc


@pytest.fixture(scope="module")
def client() -> Dfpc:
    """A detector of the satellite."""
    dfpc = make_dfpc()
    assert list(dfpc.step(model(satellite.satellite()))) == []
    return dfpc


def detect(dfpc: Dfpc, points: np.ndarray) -> Output:
    (output,) = dfpc.step(cloud(points))
    return output


def errors(detection: ObjectDetection, T: np.ndarray) -> tuple[float, float]:
    """Return the errors of the closest of the equivalent poses, degrees and metres."""
    poses = np.stack([detection.pose.transform.matrix, *detection.symmetric_matrices])
    angles = np.degrees(se3.rotation_angle(np.swapaxes(poses[:, :3, :3], 1, 2) @ T[:3, :3]))
    best = int(np.argmin(angles))
    return float(angles[best]), float(np.linalg.norm(poses[best, :3, 3] - T[:3, 3]))


def test_the_first_scan_compiles_nothing(client: Dfpc) -> None:
    """All kernels of the detection are compiled when the compound is configured."""
    compiled = compiled_signatures("cdff_core.object_models.")
    T = se3.transform(np.eye(3), [0, 0, 8])
    output = detect(client, satellite.scan(satellite.satellite(), T, rng=np.random.default_rng(1), **NEAR))
    assert output.value is not None
    assert len(compiled) > 5
    assert compiled_signatures("cdff_core.object_models.") == compiled


@pytest.mark.slow
def test_the_pose_is_found_from_all_sides_with_covariance(client: Dfpc, rng: np.random.Generator) -> None:
    nees = []
    for _ in range(6):
        T = satellite.random_pose(rng, 5.0)
        output = detect(client, satellite.scan(satellite.satellite(), T, rng=rng, **NEAR))
        assert output.quality.status is Status.OK, output.quality.reasons
        assert output.quality.covariance_kind is CovarianceKind.FORMAL
        (detection,) = output.value.detections
        assert detection.label == "client"
        assert (detection.pose.parent_frame, detection.pose.child_frame) == ("servicer/lidar", "client/body")
        assert len(detection.symmetric_matrices) == 0
        angle_deg, distance_m = errors(detection, T)
        assert angle_deg < 1.0
        assert distance_m < 0.01
        error = pose_error(T, detection.pose.transform.matrix)
        nees.append(error @ np.linalg.solve(detection.pose.transform.covariance, error))
    assert 1.0 < np.mean(nees) < 30.0


def test_about_a_hundred_points_suffice(client: Dfpc, rng: np.random.Generator) -> None:
    correct_count = 0
    for _ in range(5):
        T = satellite.random_pose(rng, 20.0)
        points = satellite.scan(satellite.satellite(), T, rng=rng, **FAR)
        assert 40 < len(points) < 250
        output = detect(client, points)
        if output.value is not None:
            angle_deg, distance_m = errors(output.value.detections[0], T)
            correct_count += angle_deg < 5.0 and distance_m < 0.06
    assert correct_count >= 4


def test_the_sensor_may_look_in_any_direction(client: Dfpc, rng: np.random.Generator) -> None:
    T = satellite.random_pose(rng, 5.0)
    points = satellite.scan(satellite.satellite(), T, rng=rng, **NEAR)
    turned = se3.transform(se3.exp_so3([0.3, -2.0, 1.0]), np.zeros(3))
    output = detect(client, se3.transform_points(turned, points))
    angle_deg, distance_m = errors(output.value.detections[0], turned @ T)
    assert (angle_deg < 1.0, distance_m < 0.01) == (True, True)


def test_outliers_mixed_pixels_and_invalid_points_are_tolerated(
    client: Dfpc, rng: np.random.Generator
) -> None:
    T = satellite.random_pose(rng, 5.0)
    points = satellite.scan(satellite.satellite(), T, rng=rng, **NEAR)
    outliers = points[rng.permutation(len(points))[: len(points) // 10]]
    outliers = outliers * rng.uniform(0.8, 1.2, (len(outliers), 1))
    invalid = np.array([[np.nan] * 3, [np.inf, 0.0, 1.0], [0.0, 0.0, 0.0]])
    output = detect(client, np.vstack([points, outliers, invalid]))
    angle_deg, distance_m = errors(output.value.detections[0], T)
    assert (angle_deg < 1.5, distance_m < 0.015) == (True, True)


def test_a_body_beside_the_client_is_not_detected(client: Dfpc, rng: np.random.Generator) -> None:
    T = satellite.random_pose(rng, 5.0)
    points = satellite.scan(satellite.satellite(), T, rng=rng, **NEAR)
    other = satellite.scan(satellite.box((0.9, 0.9, 0.9)), satellite.random_pose(rng, 5.0), rng=rng, **NEAR)
    output = detect(client, np.vstack([points, other + np.array([2.5, 0.0, 0.0])]))
    (detection,) = output.value.detections
    assert errors(detection, T)[0] < 1.0


def test_two_clients_are_two_detections(client: Dfpc, rng: np.random.Generator) -> None:
    first, second = (satellite.random_pose(rng, 5.0) for _ in range(2))
    second[0, 3] += 2.5
    scans = [
        satellite.scan(satellite.satellite(), T, rng=rng, **{**NEAR, "field_deg": 80.0, "pixels": 400})
        for T in (first, second)
    ]
    output = detect(client, np.vstack(scans))
    assert len(output.value.detections) == 2
    for T in (first, second):
        assert min(errors(d, T)[0] for d in output.value.detections) < 1.0


@pytest.mark.slow
def test_a_cube_has_a_set_of_equal_poses(rng: np.random.Generator) -> None:
    mesh = satellite.box((0.9, 0.9, 0.9))
    dfpc = make_dfpc()
    list(dfpc.step(model(mesh, "cube")))
    T = satellite.random_pose(rng, 4.0)
    output = detect(dfpc, satellite.scan(mesh, T, rng=rng, **NEAR))
    (detection,) = output.value.detections
    assert output.quality.status is Status.DEGRADED
    assert "symmetric_model:24" in output.quality.reasons
    assert len(detection.symmetric_matrices) == 23
    assert errors(detection, T)[0] < 1.0


def test_a_plate_that_is_nearly_symmetric_has_alternatives_half_a_turn_apart(
    rng: np.random.Generator,
) -> None:
    # The bracket on the back makes the turns different; a scan of the front does not show it.
    plate = satellite.merged(
        satellite.box((1.3, 0.5, 0.02)), satellite.box((0.12, 0.12, 0.06), (0.4, 0.12, 0.04))
    )
    dfpc = make_dfpc()
    list(dfpc.step(model(plate)))
    T = se3.transform(se3.exp_so3([0.2, -0.15, 0.3]), [0.1, -0.2, 6.0])
    output = detect(dfpc, satellite.scan(plate, T, rng=rng, pixels=64, field_deg=14.0, sigma_m=0.01))
    assert output.quality.status is Status.DEGRADED
    assert output.quality.reasons[0].startswith("ambiguous:")
    poses = [detection.pose.transform.matrix for detection in output.value.detections]
    angles_deg = [float(np.degrees(se3.rotation_angle(P[:3, :3].T @ T[:3, :3]))) for P in poses]
    assert min(angles_deg) < 2.0
    assert max(angles_deg) > 178.0


@pytest.mark.parametrize("body", ["box", "cylinder"])
def test_another_body_is_refused(client: Dfpc, rng: np.random.Generator, body: str) -> None:
    mesh = satellite.box((1.0, 0.5, 0.8)) if body == "box" else satellite.cylinder(0.4, 1.1)
    for _ in range(3):
        output = detect(client, satellite.scan(mesh, satellite.random_pose(rng, 5.0), rng=rng, **NEAR))
        assert output.quality.status is Status.FAILED
        assert output.value is None
        assert output.quality.reasons[0] == "not_found"


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.zeros((0, 3)), "few_points:0<20"),
        (np.full((50, 3), np.nan), "few_points:0<20"),
        (np.random.default_rng(1).normal([0, 0, 5], 0.2, (10, 3)), "few_points:10<20"),
        (np.random.default_rng(1).normal([0, 0, 500], 0.2, (10, 3)) * 30.0, "few_points:10<20"),
    ],
)
def test_too_few_points_are_refused(client: Dfpc, points: np.ndarray, reason: str) -> None:
    output = detect(client, points)
    assert output.quality.status is Status.FAILED
    assert reason in output.quality.reasons


def test_a_model_in_another_unit_is_named(rng: np.random.Generator) -> None:
    points = satellite.scan(satellite.satellite(), satellite.random_pose(rng, 5.0), rng=rng, **NEAR)
    wrong = make_dfpc()
    list(wrong.step(model(satellite.satellite(), scale=1000.0)))
    output = detect(wrong, points)
    assert output.quality.status is Status.FAILED
    assert "wrong_unit" in output.quality.reasons
    right = make_dfpc(unit="mm")
    list(right.step(model(satellite.satellite(), scale=1000.0)))
    assert detect(right, points).quality.status is Status.OK


def test_a_scan_waits_for_the_model_and_a_scan_without_model_fails(rng: np.random.Generator) -> None:
    points = satellite.scan(satellite.satellite(), satellite.random_pose(rng, 5.0), rng=rng, **NEAR)
    dfpc = make_dfpc()
    assert list(dfpc.step(cloud(points))) == []
    (output,) = dfpc.step(model(satellite.satellite()))
    assert output.quality.status is Status.OK
    assert set(output.inputs) == {"model-client", "cloud-1000"}
    dfpc.clear_models()
    assert list(dfpc.step(cloud(points, 2000))) == []
    (failed,) = dfpc.finish()
    assert failed.quality.reasons == ("no_model",)


def test_of_two_models_the_right_one_is_named(client: Dfpc, rng: np.random.Generator) -> None:
    dfpc = make_dfpc()
    list(dfpc.step(model(satellite.box((1.0, 0.5, 0.8)), "brick")))
    list(dfpc.step(model(satellite.satellite(), "client")))
    points = satellite.scan(satellite.satellite(), satellite.random_pose(rng, 5.0), rng=rng, **NEAR)
    (detection,) = detect(dfpc, points).value.detections
    assert detection.label == "client"


def test_the_same_scan_gives_the_same_bytes(client: Dfpc, rng: np.random.Generator) -> None:
    points = satellite.scan(satellite.satellite(), satellite.random_pose(rng, 5.0), rng=rng, **NEAR)
    first, second = (detect(client, points).value.detections[0] for _ in range(2))
    np.testing.assert_array_equal(first.pose.transform.matrix, second.pose.transform.matrix)
    np.testing.assert_array_equal(first.pose.transform.covariance, second.pose.transform.covariance)


def test_wrong_parameters_and_meshes_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="unit"):
        make_dfpc(unit="inch")
    with pytest.raises(InputError, match="no triangle"):
        list(make_dfpc().step(model((np.zeros((3, 3)), np.zeros((0, 3), np.int64)))))


def position(xyz_m: tuple[float, float, float], sigma_m: float, frame: str = "servicer/lidar") -> Sample:
    covariance = np.diag([sigma_m**2] * 3 + [10.0] * 3)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(se3.transform(np.eye(3), xyz_m), covariance),
        parent=frame,
        child="client/body",
        stamp_ns=0,
    )
    return Sample("position", 0, 0, value)


@pytest.mark.slow
def test_bodies_far_from_the_expected_position_are_not_examined() -> None:
    dfpc = make_dfpc()
    list(dfpc.step(model(satellite.satellite())))
    T = se3.transform(np.eye(3), [0, 0, 8])
    points = satellite.scan(satellite.satellite(), T, rng=np.random.default_rng(1), **NEAR)
    list(dfpc.step(position((0.0, 0.0, 30.0), 1.0)))
    output = detect(dfpc, points)
    assert output.value is None
    assert "away_from_position:1" in output.quality.reasons
    list(dfpc.step(position((0.0, 0.0, 10.0), 1.0)))
    assert detect(dfpc, points).value is not None
    # An expected position in a frame without a known mount is not used.
    list(dfpc.step(position((0.0, 0.0, 30.0), 1.0, frame="other/camera")))
    assert detect(dfpc, points).value is not None


@pytest.mark.slow
def test_stated_symmetries_that_the_mesh_does_not_have_are_reported() -> None:
    dfpc = make_dfpc()
    stated = replace(model(satellite.satellite()), quality=Quality(metrics={"symmetries": 4.0}))
    list(dfpc.step(stated))
    T = se3.transform(np.eye(3), [0, 0, 8])
    output = detect(dfpc, satellite.scan(satellite.satellite(), T, rng=np.random.default_rng(1), **NEAR))
    assert output.quality.status is Status.DEGRADED
    assert "symmetries_of_client:4 stated, 1 found" in output.quality.reasons


def test_an_image_without_a_camera_and_a_dark_one_are_refused(client: Dfpc) -> None:
    for camera, reason in ((None, "camera"), (np.diag([700.0, 700.0, 1.0]), "no_light")):
        frame = Frame.from_image(
            np.full((240, 320), 8, np.uint8),
            stamp_ns=1000,
            mode="GRAY",
            sensor="camera",
            camera_matrix=camera,
        )
        (output,) = client.step(Sample("image", 1000, 0, frame, id="image"))
        assert output.quality.status is Status.FAILED
        assert any(reason in text for text in output.quality.reasons)
