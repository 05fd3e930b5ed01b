# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sparse visual odometry on a ray-cast corridor: accuracy of known motion, refusal of unusable input."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.codecs import encode
from cdff_common.errors import ConfigurationError, RefusedError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from tests.support import corridor
from tests.support.corridor import BASELINE_M, CAMERA, SHAPE, drive, stereo_pair, texture

STEP_NS = 200_000_000
Images = tuple[NDArray[np.uint8], NDArray[np.uint8]]
TRUE_POSES = drive(9)  # 0.64 m


@pytest.fixture(scope="module")
def pairs() -> list[FramePair]:
    return [stereo_pair(T, i * STEP_NS) for i, T in enumerate(TRUE_POSES)]


def make_configured_dfpc(seed: int = 0, **config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(config, DfpcContext(robot="mana", seed=seed))
    return dfpc


def step(dfpc: Dfpc, pair: FramePair, i: int) -> Output:
    (output,) = dfpc.step(Sample("stereo", i * STEP_NS, i, pair, id=f"pair{i}"))
    assert (output.value is None) == (output.quality.status is Status.FAILED)
    return output


def pair_of(images: Images, i: int) -> FramePair:
    return FramePair.from_images(*images, baseline_m=BASELINE_M, camera_matrix=CAMERA, stamp_ns=i * STEP_NS)


def images(pair: FramePair) -> Images:
    return np.array(pair.left.image), np.array(pair.right.image)


def run(dfpc: Dfpc, pairs: list[FramePair]) -> list[Output]:
    return [step(dfpc, pair, i) for i, pair in enumerate(pairs)]


@pytest.mark.req("CDFF-CORE-070")
def test_a_known_motion_is_estimated_within_its_covariance(pairs: list[FramePair]) -> None:
    outputs = run(make_configured_dfpc(), pairs)
    assert [o.quality.status for o in outputs] == [Status.OK] * len(pairs)
    first, last = outputs[0], outputs[-1]
    np.testing.assert_allclose(first.value.transform.matrix, np.eye(4), atol=1e-12)
    assert (last.frame, last.child) == ("mana/vo", "mana/navcam_left")
    assert last.quality.covariance_kind is CovarianceKind.FORMAL
    path_length_m = float(np.sum(np.linalg.norm(np.diff(TRUE_POSES[:, :3, 3], axis=0), axis=1)))
    for output, truth in zip(outputs[1:], TRUE_POSES[1:], strict=True):
        T = output.value.transform
        error = cov.pose_error(truth, T.matrix)
        assert np.linalg.norm(error[:3]) < 0.01 * path_length_m
        assert error @ np.linalg.solve(T.covariance, error) < 40.0
    assert last.quality.metrics["inliers"] > 100


def test_equal_seeds_give_equal_bytes_also_after_a_reset(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc(seed=3)
    first = [encode(o.value, "uper") for o in run(dfpc, pairs[:4])]
    dfpc.reset()
    assert [encode(o.value, "uper") for o in run(dfpc, pairs[:4])] == first
    assert [encode(o.value, "uper") for o in run(make_configured_dfpc(seed=3), pairs[:4])] == first


def test_the_number_of_opencv_threads_does_not_change_a_byte(pairs: list[FramePair]) -> None:
    threads, results = cv2.getNumThreads(), []
    try:
        for n in (1, 2):
            cv2.setNumThreads(n)
            results.append([encode(o.value, "uper") for o in run(make_configured_dfpc(), pairs[:3])])
    finally:
        cv2.setNumThreads(threads)
    assert results[0] == results[1]


def test_the_implementation_with_opencv_agrees_with_the_true_motion(pairs: list[FramePair]) -> None:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="mana"), "KeyframeOpenCv")
    T = run(dfpc, pairs)[-1].value.transform.matrix
    assert np.linalg.norm(T[:3, 3] - TRUE_POSES[-1, :3, 3]) < 0.02


def flat(_: Images) -> Images:
    return np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.uint8)


def other_right(pair: Images) -> Images:
    return pair[0], np.clip(texture(21, 512)[: SHAPE[0], : SHAPE[1]], 0, 255).astype(np.uint8)


def other_scene(_: Images) -> Images:
    image = np.clip(texture(22, 512)[: SHAPE[0], : SHAPE[1]], 0, 255).astype(np.uint8)
    return image, np.roll(image, -9, axis=1)


def swapped(pair: Images) -> Images:
    return pair[1], pair[0]


def right_black(pair: Images) -> Images:
    return pair[0], np.zeros(SHAPE, np.uint8)


FAILURES = [
    (flat, "low_contrast_left"),
    (other_right, "stereo_mismatch"),
    (other_scene, "few_"),
    (swapped, ""),
    (right_black, "low_contrast_right"),
]


@pytest.mark.req("CDFF-SUP-014")
@pytest.mark.parametrize(("corrupt", "reason"), FAILURES, ids=[f[0].__name__ for f in FAILURES])
def test_an_unusable_pair_fails_and_the_next_usable_pair_is_located(
    pairs: list[FramePair], corrupt: Callable[[Images], Images], reason: str
) -> None:
    dfpc = make_configured_dfpc()
    run(dfpc, pairs[:3])
    failed = step(dfpc, pair_of(corrupt(images(pairs[3])), 3), 3)
    assert failed.quality.status is Status.FAILED
    assert any(r.startswith(reason) for r in failed.quality.reasons)
    located = step(dfpc, pairs[4], 4)
    assert located.quality.status is Status.OK
    assert np.linalg.norm(located.value.transform.matrix[:3, 3] - TRUE_POSES[4, :3, 3]) < 0.01


def test_a_blurred_pair_is_reported(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    run(dfpc, pairs[:3])
    blurred = tuple(cv2.GaussianBlur(image, (0, 0), 2.0) for image in images(pairs[3]))
    output = step(dfpc, pair_of(blurred, 3), 3)  # type: ignore[arg-type]  # two images
    assert output.quality.status is not Status.OK
    if output.value is not None:
        assert any(r.startswith("blurred") for r in output.quality.reasons)
        assert np.linalg.norm(output.value.transform.matrix[:3, 3] - TRUE_POSES[3, :3, 3]) < 0.02


def test_a_repeated_pair_repeats_the_pose_with_the_covariance_of_the_unobserved_motion(
    pairs: list[FramePair],
) -> None:
    dfpc = make_configured_dfpc()
    last = run(dfpc, pairs[:4])[-1]
    repeated = step(dfpc, pair_of(images(pairs[3]), 4), 4)
    assert repeated.quality.status is Status.DEGRADED
    assert repeated.quality.reasons == ("repeated_image",)
    np.testing.assert_array_equal(repeated.value.transform.matrix, last.value.transform.matrix)
    assert repeated.value.transform.covariance[2, 2] > 0.08**2
    assert step(dfpc, pairs[5], 5).quality.status is Status.OK


def test_one_frozen_camera_fails(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    run(dfpc, pairs[:3])
    output = step(dfpc, pair_of((images(pairs[2])[0], images(pairs[3])[1]), 3), 3)
    assert output.quality.reasons == ("frozen_image:left",)


def test_a_camera_at_rest_does_not_drift() -> None:
    dfpc = make_configured_dfpc()
    outputs = run(dfpc, [stereo_pair(np.eye(4), i * STEP_NS) for i in range(3)])
    assert all(o.quality.status is Status.OK for o in outputs)
    assert np.linalg.norm(outputs[-1].value.transform.matrix[:3, 3]) < 0.002
    assert len({o.inputs[0] for o in outputs}) == 1, "more than one keyframe was used"


def test_slow_motion_is_estimated_without_drift() -> None:
    """Each pair moves by 2 mm, at most a sixth of a pixel: much less than the noise of a point."""
    truth = np.tile(np.eye(4), (6, 1, 1))
    truth[:, 2, 3] = 0.002 * np.arange(6)
    outputs = run(make_configured_dfpc(), [stereo_pair(T, i * STEP_NS) for i, T in enumerate(truth)])
    assert [o.quality.status for o in outputs] == [Status.OK] * 6
    assert {o.inputs[0] for o in outputs} == {"pair0"}  # one keyframe for the whole path
    errors = [cov.pose_error(T, o.value.transform.matrix) for T, o in zip(truth, outputs, strict=True)]
    assert np.abs(np.array(errors)[:, :3]).max() < 0.002


def test_a_change_of_brightness_does_not_change_the_motion(pairs: list[FramePair]) -> None:
    """Some pairs have half the exposure and an offset; the estimated motion does not change."""
    darker = [pair_of((images(p)[0] // 2 + 20, images(p)[1] // 2 + 20), i) for i, p in enumerate(pairs)]
    mixed = [darker[i] if i in (2, 3, 5) else pair for i, pair in enumerate(pairs)]
    outputs = run(make_configured_dfpc(), mixed)
    assert [o.quality.status for o in outputs] == [Status.OK] * len(pairs)
    for T, output in zip(TRUE_POSES, outputs, strict=True):
        assert np.linalg.norm(cov.pose_error(T, output.value.transform.matrix)[:3]) < 0.006


def test_a_pair_is_searched_at_the_predicted_motion_since_the_keyframe(
    pairs: list[FramePair], monkeypatch: pytest.MonkeyPatch
) -> None:
    dfpc: Any = make_configured_dfpc(keyframe_survival=0.9)
    run(dfpc, pairs[:6])
    predicted = se3.exp_se3([0.5, -0.1, 0.2, 0.1, -0.2, 0.3])
    starts = []

    def refuse(view: Any, keyframe: Any, T_current_keyframe: NDArray[np.float64], *_: Any, **__: Any) -> None:
        starts.append((keyframe.pose.matrix, T_current_keyframe))
        raise RefusedError("no match", ["few_inliers:0<1"])

    monkeypatch.setattr(dfpc._path, "predict", lambda stamp_ns: predicted)
    monkeypatch.setattr(dfpc._tracker, "locate", refuse)
    assert step(dfpc, pairs[6], 6).quality.status is Status.FAILED
    ((T_start_keyframe, T_current_keyframe),) = starts
    assert np.linalg.norm(T_start_keyframe[:3, 3]) > 0.05
    np.testing.assert_allclose(predicted @ T_current_keyframe, T_start_keyframe, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("survival", "renewed"), [(0.3, False), (0.9, True)])
def test_a_keyframe_is_replaced_when_too_few_of_its_points_are_tracked(
    pairs: list[FramePair], survival: float, renewed: bool
) -> None:
    outputs = run(make_configured_dfpc(keyframe_survival=survival), pairs)
    key = "pair0"
    for output in outputs[1:]:
        assert output.inputs[0] == key
        if output.quality.metrics["inliers"] < survival * output.quality.metrics["features"]:
            key = output.inputs[1]
    assert (key != "pair0") == renewed


@pytest.mark.slow
def test_after_several_unusable_pairs_a_gap_is_reported_with_a_consistent_covariance(
    pairs: list[FramePair],
) -> None:
    dfpc = make_configured_dfpc()
    run(dfpc, pairs[:3])
    for i in (3, 4):
        scene = tuple(np.roll(image, 3 * i, axis=0) for image in other_scene(images(pairs[i])))
        assert step(dfpc, pair_of(scene, i), i).quality.status is Status.FAILED  # type: ignore[arg-type]  # two images
    for i in (5, 6):
        assert step(dfpc, pairs[i], i).quality.status is Status.FAILED
    after_gap = step(dfpc, pairs[7], 7)
    assert after_gap.quality.status is Status.DEGRADED
    assert "gap" in after_gap.quality.reasons
    T = after_gap.value.transform
    error = cov.pose_error(TRUE_POSES[7], T.matrix)
    assert error @ np.linalg.solve(T.covariance, error) < 20.0
    assert step(dfpc, pairs[8], 8).quality.metrics["gaps"] >= 1.0


@pytest.mark.req("CDFF-SUP-014")
def test_a_scene_without_near_points_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """All points are beyond 5 m, with less than the 10 px of disparity that a translation requires."""
    monkeypatch.setattr(
        corridor, "PLANES", ((0, -7.0, 1, 2), (0, 7.0, 1, 2), (1, 5.0, 0, 2), (2, 60.0, 0, 1))
    )
    monkeypatch.setattr(corridor, "TEXEL_M", 0.06)
    scene = [stereo_pair(se3.transform(np.eye(3), [0.0, 0.0, 1.2 * i]), i * STEP_NS) for i in range(3)]
    outputs = run(make_configured_dfpc(), scene)
    assert [o.quality.status for o in outputs] == [Status.DEGRADED, Status.FAILED, Status.FAILED]
    assert all(o.quality.reasons[0].startswith("few_near_points") for o in outputs)


def with_a_noisy_keyframe(pairs: list[FramePair], seed: int) -> list[FramePair]:
    """Return the first seven pairs; the fourth, which becomes a keyframe, has noise of 20 grey levels."""
    rng = np.random.default_rng(seed)
    left, right = (
        np.clip(np.rint(image + rng.normal(0.0, 20.0, SHAPE)), 0, 255).astype(np.uint8)
        for image in images(pairs[3])
    )
    return [*pairs[:3], pair_of((left, right), 3), *pairs[4:7]]


def disturbance(pairs: list[FramePair], undisturbed: Output, window: int) -> NDArray[np.float64]:
    """Return the effect of a noisy keyframe on the last pose: RMS of three trials, metres and radians."""
    squared_changes = []
    for seed in range(3):
        outputs = run(
            make_configured_dfpc(window=window, keyframe_survival=0.95), with_a_noisy_keyframe(pairs, seed)
        )
        assert {o.quality.status for o in outputs} == {Status.OK}
        assert "pair3" in {o.inputs[0] for o in outputs}
        error = cov.pose_error(undisturbed.value.transform.matrix, outputs[-1].value.transform.matrix)
        squared_changes.append([error[:3] @ error[:3], error[3:] @ error[3:]])
    return np.asarray(np.sqrt(np.mean(squared_changes, axis=0)))


@pytest.fixture(scope="module")
def without_window(pairs: list[FramePair]) -> tuple[Output, NDArray[np.float64]]:
    """Return the last pose without window, and the effect of a noisy keyframe on it."""
    last = run(make_configured_dfpc(keyframe_survival=0.95), pairs[:7])[-1]
    return last, disturbance(pairs, last, 1)


@pytest.mark.slow
@pytest.mark.parametrize(("window", "rotation_ratio"), [(2, 0.5), (4, 0.2)])
def test_a_window_of_keyframes_reduces_the_effect_of_a_noisy_one(
    pairs: list[FramePair],
    without_window: tuple[Output, NDArray[np.float64]],
    window: int,
    rotation_ratio: float,
) -> None:
    """Older keyframes also constrain later pairs, four of them more than two."""
    outputs = run(make_configured_dfpc(window=window, keyframe_survival=0.95), pairs)
    assert [o.quality.status for o in outputs] == [Status.OK] * len(pairs)
    T, error = outputs[-1].value.transform, cov.pose_error(TRUE_POSES[-1], outputs[-1].value.transform.matrix)
    assert np.linalg.norm(error[:3]) < 0.003
    assert error @ np.linalg.solve(T.covariance, error) < 40.0
    assert np.all(
        disturbance(pairs, outputs[6], window) < np.array([0.6, rotation_ratio]) * without_window[1]
    )
    with_window, without = (o.value.transform.covariance.trace() for o in (outputs[6], without_window[0]))
    # More keyframes do not reduce the part of the covariance due to calibration.
    assert with_window < 0.95 * without


@pytest.mark.parametrize("with_descriptors", [True, False])
def test_pairs_dropped_during_a_rotation_are_bridged_by_descriptors(
    pairs: list[FramePair], with_descriptors: bool
) -> None:
    """Four pairs are missing while the camera rotates by 17 degrees; the prediction contains no rotation."""
    dfpc = make_configured_dfpc(matching={} if with_descriptors else {"max_ratio": 1e-6})
    rotated_poses = [
        TRUE_POSES[1] @ se3.transform(se3.exp_so3([0.0, 0.3, 0.0]), [0.05, 0.0, z]) for z in (0.25, 0.33)
    ]
    results = {0: pairs[0], 1: pairs[1]} | {
        i: stereo_pair(T, i * STEP_NS) for i, T in zip((6, 7), rotated_poses, strict=True)
    }
    outputs = [step(dfpc, pair, i) for i, pair in results.items()]
    statuses = [o.quality.status for o in outputs[2:]]
    if not with_descriptors:
        assert statuses == [Status.FAILED, Status.FAILED]
        return
    assert Status.FAILED not in statuses
    for T, output in zip(rotated_poses, outputs[2:], strict=True):
        assert np.linalg.norm(cov.pose_error(T, output.value.transform.matrix)[:3]) < 0.01


def test_stamps_must_increase(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    run(dfpc, pairs[:2])
    assert step(dfpc, pairs[1], 1).quality.reasons[0].startswith("stamp_not_after")


def test_the_store_and_get_trajectory_return_the_poses_so_far(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    outputs = run(dfpc, pairs[:4])
    trajectory = dfpc.call("get_trajectory", {})
    assert trajectory.stamps_ns.tolist() == [i * STEP_NS for i in range(4)]
    np.testing.assert_allclose(trajectory.matrices[-1], outputs[-1].value.transform.matrix, atol=1e-9)
    assert dfpc.store.items == ("keyframe", "trajectory")
    assert dfpc.store.get("keyframe").left.image.shape == SHAPE


def test_unknown_parameters_of_slots_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="misspelt"):
        make_configured_dfpc(tracking={"misspelt": 1})
