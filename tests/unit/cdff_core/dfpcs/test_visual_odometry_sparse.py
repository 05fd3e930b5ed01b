# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""VisualOdometrySparse on a ray-cast corridor: known motion is found, and what cannot be stood for is not said."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.codecs import encode
from cdff_common.errors import ConfigurationError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from tests import corridor
from tests.corridor import BASELINE_M, CAMERA, SHAPE, drive, stereo_pair, texture

STEP_NS = 200_000_000
Images = tuple[NDArray[np.uint8], NDArray[np.uint8]]
TRUTH = drive(9)  # 0.64 m


@pytest.fixture(scope="module")
def pairs() -> list[FramePair]:
    return [stereo_pair(T, i * STEP_NS) for i, T in enumerate(TRUTH)]


def made(seed: int = 0, **config: Any) -> Dfpc:
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
def test_a_known_motion_is_found_within_its_covariance(pairs: list[FramePair]) -> None:
    outputs = run(made(), pairs)
    assert [o.quality.status for o in outputs] == [Status.OK] * len(pairs)
    first, last = outputs[0], outputs[-1]
    np.testing.assert_allclose(first.value.transform.matrix, np.eye(4), atol=1e-12)
    assert (last.frame, last.child) == ("mana/vo", "mana/navcam_left")
    assert last.quality.covariance_kind is CovarianceKind.FORMAL
    travelled = float(np.sum(np.linalg.norm(np.diff(TRUTH[:, :3, 3], axis=0), axis=1)))
    for output, truth in zip(outputs[1:], TRUTH[1:], strict=True):
        T = output.value.transform
        error = cov.pose_error(truth, T.matrix)
        assert np.linalg.norm(error[:3]) < 0.01 * travelled
        assert error @ np.linalg.solve(T.covariance, error) < 40.0
    assert last.quality.metrics["inliers"] > 100


def test_equal_seeds_give_equal_bytes_and_reset_forgets(pairs: list[FramePair]) -> None:
    dfpc = made(seed=3)
    first = [encode(o.value, "uper") for o in run(dfpc, pairs[:4])]
    dfpc.reset()
    assert [encode(o.value, "uper") for o in run(dfpc, pairs[:4])] == first
    assert [encode(o.value, "uper") for o in run(made(seed=3), pairs[:4])] == first


def test_the_number_of_opencv_threads_does_not_change_a_byte(pairs: list[FramePair]) -> None:
    threads, results = cv2.getNumThreads(), []
    try:
        for n in (1, 2):
            cv2.setNumThreads(n)
            results.append([encode(o.value, "uper") for o in run(made(), pairs[:3])])
    finally:
        cv2.setNumThreads(threads)
    assert results[0] == results[1]


def test_the_other_implementation_agrees(pairs: list[FramePair]) -> None:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="mana"), "KeyframeOpenCv")
    T = run(dfpc, pairs)[-1].value.transform.matrix
    assert np.linalg.norm(T[:3, 3] - TRUTH[-1, :3, 3]) < 0.02


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
@pytest.mark.parametrize(("spoil", "reason"), FAILURES, ids=[f[0].__name__ for f in FAILURES])
def test_a_pair_that_shows_nothing_usable_fails_and_the_next_good_one_recovers(
    pairs: list[FramePair], spoil: Callable[[Images], Images], reason: str
) -> None:
    dfpc = made()
    run(dfpc, pairs[:3])
    bad = step(dfpc, pair_of(spoil(images(pairs[3])), 3), 3)
    assert bad.quality.status is Status.FAILED
    assert any(r.startswith(reason) for r in bad.quality.reasons)
    good = step(dfpc, pairs[4], 4)
    assert good.quality.status is Status.OK
    assert np.linalg.norm(good.value.transform.matrix[:3, 3] - TRUTH[4, :3, 3]) < 0.01


def test_a_blurred_pair_is_said_to_be(pairs: list[FramePair]) -> None:
    dfpc = made()
    run(dfpc, pairs[:3])
    blurred = tuple(cv2.GaussianBlur(image, (0, 0), 2.0) for image in images(pairs[3]))
    output = step(dfpc, pair_of(blurred, 3), 3)  # type: ignore[arg-type]  # two images
    assert output.quality.status is not Status.OK
    if output.value is not None:
        assert any(r.startswith("blurred") for r in output.quality.reasons)
        assert np.linalg.norm(output.value.transform.matrix[:3, 3] - TRUTH[3, :3, 3]) < 0.02


def test_a_repeated_pair_repeats_the_pose_as_uncertain_as_the_motion_since(pairs: list[FramePair]) -> None:
    dfpc = made()
    before = run(dfpc, pairs[:4])[-1]
    again = step(dfpc, pair_of(images(pairs[3]), 4), 4)
    assert again.quality.status is Status.DEGRADED
    assert again.quality.reasons == ("repeated_image",)
    np.testing.assert_array_equal(again.value.transform.matrix, before.value.transform.matrix)
    assert again.value.transform.covariance[2, 2] > 0.08**2
    assert step(dfpc, pairs[5], 5).quality.status is Status.OK


def test_one_frozen_camera_fails(pairs: list[FramePair]) -> None:
    dfpc = made()
    run(dfpc, pairs[:3])
    output = step(dfpc, pair_of((images(pairs[2])[0], images(pairs[3])[1]), 3), 3)
    assert output.quality.reasons == ("frozen_image:left",)


def test_standing_still_is_no_motion_and_no_drift() -> None:
    dfpc = made()
    outputs = run(dfpc, [stereo_pair(np.eye(4), i * STEP_NS) for i in range(3)])
    assert all(o.quality.status is Status.OK for o in outputs)
    assert np.linalg.norm(outputs[-1].value.transform.matrix[:3, 3]) < 0.002
    assert len({o.inputs[0] for o in outputs}) == 1, "one key frame serves them all"


def test_creeping_adds_up_to_the_way_and_not_to_drift() -> None:
    """Two millimetres a pair are a sixth of a pixel nearby: less than the noise of one point, ten times over."""
    truth = np.tile(np.eye(4), (6, 1, 1))
    truth[:, 2, 3] = 0.002 * np.arange(6)
    outputs = run(made(), [stereo_pair(T, i * STEP_NS) for i, T in enumerate(truth)])
    assert [o.quality.status for o in outputs] == [Status.OK] * 6
    assert {o.inputs[0] for o in outputs} == {"pair0"}  # one key frame for the whole way
    errors = [cov.pose_error(T, o.value.transform.matrix) for T, o in zip(truth, outputs, strict=True)]
    assert np.abs(np.array(errors)[:, :3]).max() < 0.002


def test_the_light_may_change_from_one_pair_to_the_next(pairs: list[FramePair]) -> None:
    """Exposure halved and an offset added, then as before: what the images say of the motion stays the same."""
    darker = [pair_of((images(p)[0] // 2 + 20, images(p)[1] // 2 + 20), i) for i, p in enumerate(pairs)]
    mixed = [darker[i] if i in (2, 3, 5) else pair for i, pair in enumerate(pairs)]
    outputs = run(made(), mixed)
    assert [o.quality.status for o in outputs] == [Status.OK] * len(pairs)
    for T, output in zip(TRUTH, outputs, strict=True):
        assert np.linalg.norm(cov.pose_error(T, output.value.transform.matrix)[:3]) < 0.006


@pytest.mark.parametrize(("survival", "renewed"), [(0.3, False), (0.9, True)])
def test_a_key_frame_is_kept_until_too_few_of_its_points_are_left(
    pairs: list[FramePair], survival: float, renewed: bool
) -> None:
    outputs = run(made(keyframe_survival=survival), pairs)
    key = "pair0"
    for output in outputs[1:]:
        assert output.inputs[0] == key
        if output.quality.metrics["inliers"] < survival * output.quality.metrics["features"]:
            key = output.inputs[1]
    assert (key != "pair0") == renewed


def test_a_longer_loss_leaves_a_gap_that_is_said_and_covered(pairs: list[FramePair]) -> None:
    dfpc = made()
    run(dfpc, pairs[:3])
    for i in (3, 4):
        scene = tuple(np.roll(image, 3 * i, axis=0) for image in other_scene(images(pairs[i])))
        assert step(dfpc, pair_of(scene, i), i).quality.status is Status.FAILED  # type: ignore[arg-type]  # two images
    for i in (5, 6):
        assert step(dfpc, pairs[i], i).quality.status is Status.FAILED
    back = step(dfpc, pairs[7], 7)
    assert back.quality.status is Status.DEGRADED
    assert "gap" in back.quality.reasons
    T = back.value.transform
    error = cov.pose_error(TRUTH[7], T.matrix)
    assert error @ np.linalg.solve(T.covariance, error) < 20.0
    assert step(dfpc, pairs[8], 8).quality.metrics["gaps"] >= 1.0


@pytest.mark.req("CDFF-SUP-014")
def test_a_motorway_without_near_points_is_not_followed_silently(monkeypatch: pytest.MonkeyPatch) -> None:
    """Much texture, tracked well, all of it beyond 5 m: nothing has the 10 px of disparity that carry a translation."""
    monkeypatch.setattr(corridor, "PLANES", ((0, -7.0, 1, 2), (0, 7.0, 1, 2), (1, 5.0, 0, 2), (2, 60.0, 0, 1)))
    monkeypatch.setattr(corridor, "TEXEL_M", 0.06)
    scene = [stereo_pair(se3.transform(np.eye(3), [0.0, 0.0, 1.2 * i]), i * STEP_NS) for i in range(3)]
    outputs = run(made(), scene)
    assert [o.quality.status for o in outputs] == [Status.DEGRADED, Status.FAILED, Status.FAILED]
    assert all(o.quality.reasons[0].startswith("few_near_points") for o in outputs)


def with_a_noisy_key_frame(pairs: list[FramePair], seed: int) -> list[FramePair]:
    """The first seven pairs, the fourth of them, which becomes a key frame, in noise of 20 DN."""
    rng = np.random.default_rng(seed)
    left, right = (
        np.clip(np.rint(image + rng.normal(0.0, 20.0, SHAPE)), 0, 255).astype(np.uint8) for image in images(pairs[3])
    )
    return [*pairs[:3], pair_of((left, right), 3), *pairs[4:7]]


def disturbance(pairs: list[FramePair], undisturbed: Output, window: int) -> NDArray[np.float64]:
    """How far a noisy key frame moves, and turns, the last pose: root mean square of three drawings, metres and rad."""
    moved = []
    for seed in range(3):
        outputs = run(made(window=window, keyframe_survival=0.95), with_a_noisy_key_frame(pairs, seed))
        assert {o.quality.status for o in outputs} == {Status.OK}
        assert "pair3" in {o.inputs[0] for o in outputs}
        error = cov.pose_error(undisturbed.value.transform.matrix, outputs[-1].value.transform.matrix)
        moved.append([error[:3] @ error[:3], error[3:] @ error[3:]])
    return np.asarray(np.sqrt(np.mean(moved, axis=0)))


@pytest.fixture(scope="module")
def chained(pairs: list[FramePair]) -> tuple[Output, NDArray[np.float64]]:
    """The last pose where each key frame is located against the one before only, and what noise in one does to it."""
    last = run(made(keyframe_survival=0.95), pairs[:7])[-1]
    return last, disturbance(pairs, last, 1)


@pytest.mark.parametrize(("window", "turn_share"), [(2, 0.5), (4, 0.2)])
def test_a_window_of_key_frames_makes_little_of_a_noisy_one(
    pairs: list[FramePair], chained: tuple[Output, NDArray[np.float64]], window: int, turn_share: float
) -> None:
    """The ones before it still see what comes after it; four of them more than two."""
    outputs = run(made(window=window, keyframe_survival=0.95), pairs)
    assert [o.quality.status for o in outputs] == [Status.OK] * len(pairs)
    T, error = outputs[-1].value.transform, cov.pose_error(TRUTH[-1], outputs[-1].value.transform.matrix)
    assert np.linalg.norm(error[:3]) < 0.003
    assert error @ np.linalg.solve(T.covariance, error) < 40.0
    assert np.all(disturbance(pairs, outputs[6], window) < np.array([0.6, turn_share]) * chained[1])
    stated, of_chain = (o.value.transform.covariance.trace() for o in (outputs[6], chained[0]))
    assert stated < 0.9 * of_chain


@pytest.mark.parametrize("described", [True, False])
def test_pairs_dropped_over_a_turn_are_bridged_by_descriptors_alone(pairs: list[FramePair], described: bool) -> None:
    """Four pairs are missing while the camera turns by 17 degrees, which no constant velocity foretells."""
    dfpc = made(matching={} if described else {"max_ratio": 1e-6})
    turned = [TRUTH[1] @ se3.transform(se3.exp_so3([0.0, 0.3, 0.0]), [0.05, 0.0, z]) for z in (0.25, 0.33)]
    kept = {0: pairs[0], 1: pairs[1]} | {i: stereo_pair(T, i * STEP_NS) for i, T in zip((6, 7), turned, strict=True)}
    outputs = [step(dfpc, pair, i) for i, pair in kept.items()]
    statuses = [o.quality.status for o in outputs[2:]]
    if not described:
        assert statuses == [Status.FAILED, Status.FAILED]
        return
    assert Status.FAILED not in statuses
    for T, output in zip(turned, outputs[2:], strict=True):
        assert np.linalg.norm(cov.pose_error(T, output.value.transform.matrix)[:3]) < 0.01


def test_stamps_must_rise(pairs: list[FramePair]) -> None:
    dfpc = made()
    run(dfpc, pairs[:2])
    assert step(dfpc, pairs[1], 1).quality.reasons[0].startswith("stamp_not_after")


def test_the_local_store_and_the_operation_tell_the_path(pairs: list[FramePair]) -> None:
    dfpc = made()
    outputs = run(dfpc, pairs[:4])
    trajectory = dfpc.call("get_trajectory", {})
    assert trajectory.stamps_ns.tolist() == [i * STEP_NS for i in range(4)]
    np.testing.assert_allclose(trajectory.matrices[-1], outputs[-1].value.transform.matrix, atol=1e-9)
    assert dfpc.store.items == ("keyframe", "trajectory")
    assert dfpc.store.get("keyframe").left.image.shape == SHAPE


def test_unknown_parameters_are_refused_in_the_slots_too() -> None:
    with pytest.raises(ConfigurationError, match="misspelt"):
        made(tracking={"misspelt": 1})
