# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Dense visual odometry on a ray-cast corridor: accuracy of known motion, attitude fixes, refusals."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry import covariance as cov
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, FramePair, TransformWithCovariance
from tests.support import textured_walls as walls
from tests.support.corridor import BASELINE_M, CAMERA, drive, stereo_pair

STEP_NS = 200_000_000
TRUE_POSES = drive(9)  # 0.64 m
T_BASE_LEFT = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.2, 0.1, 1.0])


@pytest.fixture(scope="module")
def pairs() -> list[FramePair]:
    return [stereo_pair(T, i * STEP_NS) for i, T in enumerate(TRUE_POSES)]


def make_configured_dfpc(**config: Any) -> Dfpc:
    frames = FrameGraph()
    frames.set_static("mana/base", "mana/navcam_left", UncertainTransform.exact(T_BASE_LEFT))
    dfpc = Registry.default().make_dfpc("visual_odometry_dense")
    dfpc.configure(config, DfpcContext("mana", frames))
    return dfpc


def step(dfpc: Dfpc, pair: FramePair, i: int) -> Output:
    (output,) = dfpc.step(Sample("stereo", i * STEP_NS, i, pair, id=f"pair{i}"))
    assert (output.value is None) == (output.quality.status is Status.FAILED)
    return output


def pair_of(left: NDArray[np.uint8], right: NDArray[np.uint8], i: int) -> FramePair:
    return FramePair.from_images(
        left, right, baseline_m=BASELINE_M, camera_matrix=CAMERA, stamp_ns=i * STEP_NS
    )


def error(output: Output, i: int) -> NDArray[np.float64]:
    T_true = se3.inverse(TRUE_POSES[0]) @ TRUE_POSES[i]
    return cov.pose_error(T_true, output.value.transform.matrix)


def test_a_drive_is_measured_within_one_per_cent_and_its_standard_deviations(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    outputs = [step(dfpc, pair, i) for i, pair in enumerate(pairs)]
    assert all(output.quality.status is Status.OK for output in outputs)
    last = error(outputs[-1], len(pairs) - 1)
    assert np.linalg.norm(last[:3]) < 0.01 * 0.64
    covariance = outputs[-1].value.transform.covariance
    assert last @ np.linalg.solve(covariance, last) < 22.5  # chi-squared, 6 degrees of freedom, 0.1 %


def test_a_change_of_exposure_does_not_change_the_motion(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    step(dfpc, pairs[0], 0)
    images = [np.array(image.image) for image in (pairs[2].left, pairs[2].right)]
    brighter = [np.clip(0.7 * image.astype(float) + 20, 0, 255).astype(np.uint8) for image in images]
    assert np.linalg.norm(error(step(dfpc, pair_of(*brighter, 2), 2), 2)[:3]) < 0.003


@pytest.mark.parametrize(("ratio", "contradicts"), [(1.0, False), (0.0, True)])
def test_the_wheels_are_compared_with_the_motion(
    pairs: list[FramePair], ratio: float, contradicts: bool
) -> None:
    dfpc = make_configured_dfpc()
    T_base = TRUE_POSES @ se3.inverse(T_BASE_LEFT)
    for i, pair in enumerate(pairs[:4]):
        measured = se3.inverse(T_base[0]) @ T_base[i]
        wheels = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(measured[:3, :3], ratio * measured[:3, 3])),
            parent="mana/odom",
            child="mana/base",
            stamp_ns=i * STEP_NS,
        )
        list(dfpc.step(Sample("odometry", i * STEP_NS, i, wheels)))
        output = step(dfpc, pair, i)
    assert output.quality.metrics["prior_ratio"] > 0.0
    assert any(reason.startswith("motion_prior") for reason in output.quality.reasons) == contradicts


def test_a_missing_pair_is_bridged(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    outputs = [step(dfpc, pairs[i], i) for i in (0, 1, 3, 4)]
    assert np.linalg.norm(error(outputs[-1], 4)[:3]) < 0.005


def test_a_rotation_far_from_the_prediction_is_measured_by_matched_descriptors(
    pairs: list[FramePair],
) -> None:
    dfpc = make_configured_dfpc()
    step(dfpc, pairs[0], 0)
    T_first_turned = se3.transform(se3.exp_so3([0.0, 0.3, 0.0]), [0.1, 0.0, 0.2])
    output = step(dfpc, stereo_pair(TRUE_POSES[0] @ T_first_turned, STEP_NS), 1)
    last = cov.pose_error(T_first_turned, output.value.transform.matrix)
    assert np.linalg.norm(last[:3]) < 0.01
    assert np.linalg.norm(last[3:]) < 2e-3


@pytest.mark.parametrize(
    ("left", "right", "reason"),
    [(0, 0, "low_contrast_left"), (255, 255, "saturated_left"), (90, 90, "low_contrast_left")],
)
def test_black_saturated_and_flat_images_are_refused(
    pairs: list[FramePair], left: int, right: int, reason: str
) -> None:
    dfpc = make_configured_dfpc()
    step(dfpc, pairs[0], 0)
    shape = pairs[0].left.image.shape[:2]
    output = step(dfpc, pair_of(np.full(shape, left, np.uint8), np.full(shape, right, np.uint8), 1), 1)
    assert output.quality.status is Status.FAILED
    assert any(r.startswith(reason) for r in output.quality.reasons)
    assert step(dfpc, pairs[2], 2).value is not None


def test_images_of_different_sizes_or_80_ms_apart_are_refused(pairs: list[FramePair]) -> None:
    left, right = (np.array(image.image) for image in (pairs[1].left, pairs[1].right))

    def refused(right: NDArray[np.uint8], delay_ns: int) -> str:
        images = [
            Frame.from_image(image, stamp_ns=stamp_ns, camera_matrix=CAMERA, sensor="camera")
            for image, stamp_ns in ((left, STEP_NS), (right, STEP_NS + delay_ns))
        ]
        pair = FramePair(left=images[0], right=images[1], baseline=BASELINE_M)
        output = step(make_configured_dfpc(), pair, 1)
        assert output.quality.status is Status.FAILED
        return output.quality.reasons[0]

    assert "of left" in refused(right[:100].copy(), 0)
    assert "right image +0.080 s after the left one" in refused(right, 80_000_000)


def test_a_pure_rotation_is_measured() -> None:
    dfpc = make_configured_dfpc()
    for i in range(3):
        T = TRUE_POSES[0] @ se3.transform(se3.exp_so3([0.0, 0.02 * i, 0.0]), np.zeros(3))
        output = step(dfpc, stereo_pair(T, i * STEP_NS), i)
    T_last = se3.transform(se3.exp_so3([0.0, 0.04, 0.0]), np.zeros(3))
    last = cov.pose_error(T_last, output.value.transform.matrix)
    assert output.quality.status is Status.OK
    assert np.linalg.norm(last[:3]) < 0.003
    assert np.linalg.norm(last[3:]) < 1e-3


def test_a_motion_over_planar_ground_is_measured() -> None:
    dfpc, down = make_configured_dfpc(), se3.exp_so3([-0.4, 0.0, 0.0])
    path = [se3.transform(down, [0.08 * i, 0.3, 0.0]) for i in range(3)]
    for i, T in enumerate(path):
        output = step(dfpc, walls.pair(T, planes=walls.PLANE), i)
    last = cov.pose_error(se3.inverse(path[0]) @ path[-1], output.value.transform.matrix)
    assert output.quality.status is Status.OK
    assert np.linalg.norm(last[:3]) < 0.005


def test_the_opposite_view_is_refused(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    step(dfpc, pairs[0], 0)
    opposite = se3.transform(se3.exp_so3([0.0, np.pi, 0.0]), [0.0, 0.0, 6.0])
    output = step(dfpc, stereo_pair(TRUE_POSES[0] @ opposite, STEP_NS), 1)
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0].split(":")[0] in {"low_correlation", "low_overlap"}


def test_a_single_pair_is_the_origin_and_a_wrong_camera_matrix_is_refused(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    first = step(dfpc, pairs[0], 0)
    np.testing.assert_allclose(first.value.transform.matrix, np.eye(4), atol=1e-12)
    assert len(dfpc.call("get_trajectory", {}).stamps_ns) == 1
    left, right = (np.array(image.image) for image in (pairs[1].left, pairs[1].right))
    wrong = FramePair.from_images(
        left,
        right,
        baseline_m=BASELINE_M,
        camera_matrix=np.diag([2.0, 2.0, 1.0]) @ CAMERA,
        stamp_ns=STEP_NS,
    )
    refused = step(dfpc, wrong, 1)
    assert refused.quality.status is Status.FAILED
    assert "principal point" in refused.quality.reasons[0]


def test_swapped_cameras_are_refused(pairs: list[FramePair]) -> None:
    swapped = pair_of(np.array(pairs[0].right.image), np.array(pairs[0].left.image), 0)
    output = step(make_configured_dfpc(), swapped, 0)
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0].startswith("stereo_mismatch")


def test_an_attitude_fix_corrects_the_rotation_and_reduces_its_covariance(pairs: list[FramePair]) -> None:
    def last(sigma_rad: float) -> Output:
        dfpc = make_configured_dfpc()
        for i, pair in enumerate(pairs):
            T = TRUE_POSES[i] @ se3.inverse(T_BASE_LEFT)
            fix = UncertainTransform(T, np.diag([1e6] * 3 + [sigma_rad**2] * 3))
            pose = TransformWithCovariance.from_transform(
                fix, parent="site", child="mana/base", stamp_ns=i * STEP_NS
            )
            assert list(dfpc.step(Sample("attitude", i * STEP_NS, i, pose))) == []
            output = step(dfpc, pair, i)
        return output

    free, fixed = last(10.0), last(1e-5)
    assert np.linalg.norm(error(fixed, 8)[3:]) < 1e-4
    rotations = [np.trace(output.value.transform.covariance[3:, 3:]) for output in (fixed, free)]
    assert rotations[0] < 0.1 * rotations[1]


def test_the_trajectory_contains_all_poses(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    for i in range(3):
        step(dfpc, pairs[i], i)
    assert len(dfpc.get_trajectory().stamps_ns) == 3


def test_a_right_image_two_thirds_of_a_row_lower_is_corrected_and_reported(pairs: list[FramePair]) -> None:
    dfpc, offset_px = make_configured_dfpc(), 0.67
    for i in (0, 2):
        right = np.array(pairs[i].right.image)
        lower = cv2.warpAffine(
            right,
            np.array([[1, 0, 0], [0, 1, offset_px]]),
            right.shape[::-1],
            borderMode=cv2.BORDER_REPLICATE,
        )
        output = step(dfpc, pair_of(np.array(pairs[i].left.image), lower, i), i)
        if i == 0:
            assert [reason.split(":")[0] for reason in output.quality.reasons] == ["row_offset"]
    last = error(output, 2)
    assert np.linalg.norm(last[:3]) < 0.003
    assert np.linalg.norm(last[3:]) < 5e-4
