# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import (
    BundleObservations,
    BundleProblem,
    CorrespondenceMap2D,
    FramePair,
    TransformWithCovariance,
)
from evaluation.triangulation import CAMERA, scene
from tests.support.corridor import CAMERA as K
from tests.support.corridor import SHAPE, texture


def make_configured_dfpc(**config: object) -> Dfpc:
    dfpc = Registry.default().make_dfpc("triangulation")
    dfpc.configure(config)
    return dfpc


def process(dfpc: Dfpc, **values: object) -> list[Output]:
    return [o for port, value in values.items() for o in dfpc.step(Sample(port, 1000, 0, value, id=port))]


@pytest.mark.req("CDFF-CORE-091")
def test_tracks_become_landmarks_with_covariances_and_a_cloud() -> None:
    problem, truth = scene(3, (4.0, 20.0), 500)
    landmarks, cloud = process(make_configured_dfpc(triangulate={"max_residual_px": 100.0}), tracks=problem)
    assert landmarks.quality.status is Status.OK
    assert landmarks.quality.covariance_kind is CovarianceKind.FORMAL
    error = landmarks.value.data.positions - truth[landmarks.value.data.ids]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(landmarks.value.covariances), error) / 3.0
    assert 0.8 < nees.mean() < 1.25
    assert (landmarks.value.data.observations == 3).all()
    assert cloud.value.frame == "site"
    assert len(cloud.value.points_m) == len(error)


def test_matches_wait_for_the_pose_and_need_a_camera() -> None:
    problem, truth = scene(2, (4.0, 20.0), 200)
    pixels = problem.observations.pixels[:, :2].reshape(-1, 2, 2)
    matches = CorrespondenceMap2D.from_arrays(pixels[:, 0], pixels[:, 1])
    T = problem.cameras.matrices
    T_left_right = se3.inverse(T[0]) @ T[1]
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(T_left_right), parent="mana/left", child="mana/right", stamp_ns=1000
    )
    dfpc = make_configured_dfpc(camera=CAMERA)
    assert not process(dfpc, matches=matches)
    landmarks, _ = process(dfpc, pose=pose)
    assert landmarks.frame == "mana/left"
    assert landmarks.inputs == ("matches", "pose")
    expected = se3.transform_points(se3.inverse(T[0]), truth)[landmarks.value.data.ids]
    assert np.median(np.linalg.norm(landmarks.value.data.positions - expected, axis=1)) < 0.6
    (failed,) = process(make_configured_dfpc(), matches=matches, pose=pose)
    assert failed.quality.reasons[0].startswith("no_camera")


@pytest.mark.req("CDFF-CORE-091")
def test_a_stereo_pair_becomes_a_cloud_with_grey_values_and_the_uncertainty_of_its_depths() -> None:
    image = np.clip(texture(3, 512), 0, 255).astype(np.uint8)
    rows, columns = SHAPE
    left, right = (np.ascontiguousarray(image[:rows, start : start + columns]) for start in (0, 12))
    pair = FramePair.from_images(left, right, baseline_m=0.2, camera_matrix=K, stamp_ns=1000)
    dfpc = make_configured_dfpc(disparity={"num_disparities": 32})
    (cloud,) = process(dfpc, stereo=pair)
    depth_m = K[0, 0] * 0.2 / 12.0
    points = cloud.value.points_m
    assert np.median(points[:, 2]) == pytest.approx(depth_m, rel=0.01)
    sigmas = dfpc.store.get("depth_sigmas").values
    noise_m = points[:, 2] ** 2 / (K[0, 0] * 0.2) * 0.3
    calibration_m = np.hypot(0.005, 0.005) * points[:, 2]
    assert np.allclose(sigmas, np.hypot(noise_m, calibration_m))
    pixels = np.rint(points[:, :2] / points[:, 2:] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]).astype(int)
    assert np.array_equal(cloud.value.intensity, left[pixels[:, 1], pixels[:, 0]])


def test_exchanged_images_fail_and_a_row_offset_is_degraded() -> None:
    image = np.clip(texture(3, 512), 0, 255).astype(np.uint8)
    rows, columns = SHAPE
    left, right = (np.ascontiguousarray(image[:rows, start : start + columns]) for start in (0, 12))
    lower = np.roll(right, 1, axis=0)
    qualities = []
    for images in ((right, left), (left, lower)):
        pair = FramePair.from_images(*images, baseline_m=0.2, camera_matrix=K, stamp_ns=1000)
        (cloud,) = process(make_configured_dfpc(disparity={"num_disparities": 32}), stereo=pair)
        qualities.append(cloud.quality)
    assert qualities[0].status is Status.FAILED
    assert qualities[1].status is Status.DEGRADED
    assert qualities[1].reasons[0].startswith("row_error:1.0")


def test_unusable_input_fails_with_the_reason_and_much_noise_is_degraded() -> None:
    flat = np.full(SHAPE, 90, np.uint8)
    pair = FramePair.from_images(flat, flat, baseline_m=0.2, camera_matrix=K, stamp_ns=1000)
    (failed,) = process(make_configured_dfpc(), stereo=pair)
    assert failed.quality.reasons[0] == "no_points"
    problem, _ = scene(3, (4.0, 20.0), 300)
    landmarks, _ = process(
        make_configured_dfpc(triangulate={"sigma_px": 0.1, "max_residual_px": 100.0}), tracks=problem
    )
    assert landmarks.quality.status is Status.DEGRADED
    assert landmarks.quality.reasons[0].startswith("residuals_exceed_noise")
    (failed,) = process(make_configured_dfpc(triangulate={"max_residual_px": 1e-6}), tracks=problem)
    assert failed.quality.reasons == ("no_points", "mostly:large_residual")


def test_many_wrong_observations_degrade_the_landmarks_and_a_lens_without_focal_length_fails() -> None:
    problem, _ = scene(3, (4.0, 20.0), 300)
    o = problem.observations
    pixels = o.pixels.copy()
    pixels[(o.points < 180) & (o.cameras == 1), :2] += 60.0
    wrong = replace(problem, observations=BundleObservations(o.cameras, o.points, pixels))
    landmarks, _ = process(make_configured_dfpc(), tracks=wrong)
    assert landmarks.quality.status is Status.DEGRADED
    assert landmarks.quality.reasons[0].startswith("few_valid:0.4")
    assert landmarks.quality.metrics["large_residual"] == 180.0
    without_lens = BundleProblem.from_arrays(
        [np.eye(4)], [0.0] * 4, [[0, 0, 0]], ([0], [0]), [[1.0, 2.0]], frame="site"
    )
    (failed,) = process(make_configured_dfpc(), tracks=without_lens)
    assert failed.quality.status is Status.FAILED
    assert failed.quality.reasons[0].startswith("bad_input")


def test_points_observed_once_fail_with_the_reason() -> None:
    observed_once = BundleProblem.from_arrays(
        [np.eye(4)], CAMERA, np.zeros((2, 3)), ([0, 0], [0, 1]), [[320.0, 240.0]] * 2, frame="site"
    )
    (failed,) = process(make_configured_dfpc(), tracks=observed_once)
    assert failed.quality.reasons == ("no_points", "mostly:few_views")
