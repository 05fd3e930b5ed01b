# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame
from evaluation.data_sets.image_pairs import marked_dlr
from tests.support.corridor import CAMERA, render, texture

VARIANTS = ("RootSift", "Sift", "Orb", "FastGrid", "GfttKlt")
T_WORLD_LEFT = np.eye(4)
T_WORLD_RIGHT = se3.transform(se3.exp_so3([0.0, 0.03, 0.0]), [0.25, 0.02, 0.1])


def make_configured_dfpc(implementation: str | None = None, **config: object) -> Dfpc:
    dfpc = Registry.default().make_dfpc("feature_matching")
    dfpc.configure(config, implementation=implementation)
    return dfpc


def frame(image: np.ndarray, camera: bool = False) -> Frame:
    return Frame.from_image(image, stamp_ns=0, camera_matrix=CAMERA if camera else None)


def process_pair(dfpc: Dfpc, left: Frame, right: Frame) -> list[Output]:
    return [
        o
        for port, f in (("left", left), ("right", right))
        for o in dfpc.step(Sample(port, 1000, 0, f, id=port))
    ]


def corridor(camera: bool = True) -> tuple[Frame, Frame]:
    rng = np.random.default_rng(0)
    return frame(render(T_WORLD_LEFT, rng), camera), frame(render(T_WORLD_RIGHT, rng), camera)


@pytest.mark.req("CDFF-CORE-090")
@pytest.mark.parametrize("variant", VARIANTS)
def test_every_implementation_matches_two_views_and_estimates_the_transform(variant: str) -> None:
    matches, transform = process_pair(make_configured_dfpc(variant), *corridor())
    assert matches.quality.status is not Status.FAILED
    assert matches.inputs == ("left", "right")
    T_right_left = se3.inverse(T_WORLD_RIGHT) @ T_WORLD_LEFT
    E = se3.skew(T_right_left[:3, 3]) @ T_right_left[:3, :3]
    F = np.linalg.inv(CAMERA).T @ E @ np.linalg.inv(CAMERA)
    from cdff_core.imaging.sampson import sampson

    distances = np.abs(sampson(F, matches.value.sources_px, matches.value.sinks_px))
    assert np.mean(distances < 1.5) > 0.9
    assert ((matches.value.probabilities > 0.0) & (matches.value.probabilities <= 1.0)).all()
    assert transform.quality.status is not Status.FAILED
    assert transform.quality.covariance_kind is CovarianceKind.FORMAL
    assert "scale_unknown" in transform.quality.reasons
    T_true = se3.inverse(T_WORLD_LEFT) @ T_WORLD_RIGHT
    T_true[:3, 3] /= np.linalg.norm(T_true[:3, 3])
    error = cov.pose_error(T_true, transform.value.transform.matrix)
    # ORB corners have a noise of a pixel, and the parallax is 2 px.
    max_rotation_deg, max_direction = {"FastGrid": (0.5, 0.06), "Orb": (0.5, 0.3)}.get(variant, (0.1, 0.06))
    assert np.degrees(np.linalg.norm(error[3:])) < max_rotation_deg
    assert np.linalg.norm(error[:3]) < max_direction
    # 99.9 % quantile of χ² with five degrees of freedom: the length of the translation is unknown.
    information = np.linalg.pinv(transform.value.transform.covariance, rcond=1e-9, hermitian=True)
    assert error @ information @ error < 20.5


def test_without_camera_matrices_only_matches_are_published_and_the_store_has_the_models() -> None:
    dfpc = make_configured_dfpc()
    (matches,) = process_pair(dfpc, *corridor(camera=False))
    assert matches.port == "matches"
    covariance = dfpc.store.get("fundamental_covariance").values
    assert dfpc.store.get("fundamental_matrix").values.shape == (3, 3)
    assert covariance.shape == (9, 9)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    assert dfpc.store.get("homography_covariance").values.shape == (9, 9)
    assert len(dfpc.store.get("features").points_px) > 100


def test_a_planar_scene_is_detected_and_the_transform_degraded() -> None:
    import cv2

    left = np.clip(texture(3, 256), 0, 255).astype(np.uint8)
    H = np.array([[0.95, -0.1, 12.0], [0.1, 0.95, 4.0], [1e-4, 0.0, 1.0]])
    right = cv2.warpPerspective(left, H, (256, 256))
    outputs = process_pair(make_configured_dfpc(), frame(left, True), frame(right, True))
    assert outputs[0].quality.metrics["planar_ratio"] == 1.0
    from cdff_core.imaging.two_view import transfer

    errors = np.hypot(*(transfer(H, outputs[0].value.sources_px) - outputs[0].value.sinks_px).T)
    assert np.mean(errors < 2.0) > 0.98
    assert outputs[1].quality.status is not Status.OK


@pytest.mark.req("CDFF-CORE-090")
@pytest.mark.parametrize("variant", VARIANTS)
def test_images_without_a_common_scene_fail_with_the_reason(variant: str) -> None:
    images = (frame(np.clip(texture(seed, 256), 0, 255).astype(np.uint8)) for seed in (1, 2))
    (output,) = process_pair(make_configured_dfpc(variant), *images)
    assert output.value is None
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0] == "no_common_scene"


def test_a_right_image_waits_for_its_left_image_until_forget_is_called() -> None:
    dfpc = make_configured_dfpc("Orb")
    left, right = corridor()
    assert not list(dfpc.step(Sample("right", 1000, 0, right)))
    assert len(list(dfpc.step(Sample("left", 2000, 0, left)))) == 2
    dfpc.call("forget", {})
    assert not list(dfpc.step(Sample("right", 3000, 0, right)))


def test_a_camera_matrix_that_is_not_finite_fails_with_the_reason() -> None:
    left, right = corridor()
    wrong = Frame.from_image(np.array(left.image), stamp_ns=0, camera_matrix=np.full((3, 3), np.nan))
    (failed,) = process_pair(make_configured_dfpc(), wrong, right)
    assert failed.quality.status is Status.FAILED
    assert failed.quality.reasons[0].startswith("bad_left:camera matrix")


def test_an_image_without_texture_or_of_wrong_type_fails_with_the_reason() -> None:
    flat = frame(np.full((100, 120), 90, np.uint8))
    (output,) = process_pair(make_configured_dfpc(), flat, flat)
    assert output.quality.reasons == ("no_common_scene", "few_matches:0<12")
    (output,) = make_configured_dfpc().step(
        Sample("left", 0, 0, Frame.from_image(np.zeros((90, 90), np.uint16), stamp_ns=0))
    )
    assert output.quality.reasons[0].startswith("bad_left")


@pytest.mark.req("CDFF-CORE-090")
def test_the_hand_marked_points_of_the_satellite_mock_up_are_matched_within_five_pixels(
    real_data: Callable[[str], Path],
) -> None:
    pair = marked_dlr(real_data("cdff_upstream").parent)
    value = process_pair(make_configured_dfpc(), frame(pair.left), frame(pair.right))[0].value
    for source, sink in zip(pair.points, pair.partners, strict=True):
        errors = np.maximum(np.hypot(*(value.sources_px - source).T), np.hypot(*(value.sinks_px - sink).T))
        assert errors.min() <= 5.0


def test_the_pose_does_not_use_pairs_found_along_epipolar_lines() -> None:
    dfpc = make_configured_dfpc()
    left, right = corridor()
    views = [dfpc._matcher.view(Sample(port, 0, 0, f)) for port, f in (("left", left), ("right", right))]
    verified, unguided = dfpc._match(*views)
    assert verified.count > unguided.count
    _, transform = process_pair(dfpc, left, right)
    assert transform.quality.metrics["inliers"] <= unguided.count


def test_a_small_baseline_is_named_and_claims_no_direction() -> None:
    rng = np.random.default_rng(0)
    T_right = se3.transform(se3.exp_so3([0.0, 0.02, 0.0]), [0.05, 0.0, 0.0])
    left, right = (frame(render(T, rng), camera=True) for T in (T_WORLD_LEFT, T_right))
    _, transform = process_pair(make_configured_dfpc(), left, right)
    assert transform.quality.status is Status.DEGRADED
    assert any(reason.startswith("small_baseline:") for reason in transform.quality.reasons)
    T, covariance = transform.value.transform.matrix, transform.value.transform.covariance
    np.testing.assert_allclose(covariance[:3, :3], np.eye(3) / 3.0 + np.outer(T[:3, 3], T[:3, 3]), atol=1e-9)
    assert np.degrees(np.linalg.norm(cov.pose_error(T_right, T)[3:])) < 1.0


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
@pytest.mark.parametrize("length_m", [0.01, 0.04])
def test_with_a_tiny_baseline_no_wrong_direction_is_ok(
    direction: tuple[float, float, float], length_m: float
) -> None:
    """Noise can place the points behind the cameras of the true pose: the direction is then its opposite."""
    rng = np.random.default_rng(int(1000 * length_m))
    T_right = T_WORLD_LEFT @ se3.transform(se3.exp_so3([0.0, 0.01, 0.0]), length_m * np.array(direction))
    left, right = (frame(render(T, rng), camera=True) for T in (T_WORLD_LEFT, T_right))
    outputs = process_pair(make_configured_dfpc(), left, right)
    transform = outputs[1]
    if transform.quality.status is Status.OK:
        assert transform.value.transform.matrix[:3, 3] @ direction > np.cos(np.radians(30.0))
    elif transform.value is not None:
        sigmas = np.sqrt(np.diag(transform.value.transform.covariance)[:3])
        error = transform.value.transform.matrix[:3, 3] - direction
        assert (np.abs(error) < 4.0 * sigmas + 1e-3).all()
