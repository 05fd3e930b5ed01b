# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A textured object that covers a fifth of the images is masked, or not selected as the scene."""

from __future__ import annotations

import base64

import cv2
import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair, TransformWithCovariance
from cdff_core.stereo_odometry.motion_hypotheses import MAX_AMBIGUITY
from evaluation.data_sets.pasted_object import PlanarObject, mask_of, paste
from tests.support.corridor import SHAPE, drive, stereo_pair

STEP_NS, STEPS = 200_000_000, 6
TRUE_POSES = drive(STEPS)
FAST_POSES = drive(STEPS, step_m=0.3)
ARM = PlanarObject(corner_px=(0, 130), size_px=(160, 110), depth_m=1.5)
PASSER_BY = PlanarObject(corner_px=(60, 70), size_px=(170, 105), depth_m=3.0, step_m=(0.03, 0.0, 0.05))
#: An object over a third of the images; it covers about as many cells with points as the scene.
LARGE = PlanarObject(corner_px=(60, 60), size_px=(200, 130), depth_m=2.0)

HIDES_MOST = PlanarObject(corner_px=(0, 40), size_px=(215, 200), depth_m=1.2)
APPROACHING = PlanarObject(corner_px=(0, 20), size_px=(210, 205), depth_m=2.5, step_m=(0.0, 0.0, 0.02))


@pytest.fixture(scope="module")
def pairs() -> list[FramePair]:
    return [stereo_pair(T, i * STEP_NS) for i, T in enumerate(TRUE_POSES)]


@pytest.fixture(scope="module")
def fast_pairs() -> list[FramePair]:
    return [stereo_pair(T, i * STEP_NS) for i, T in enumerate(FAST_POSES)]


def png(image: np.ndarray) -> str:
    return base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()


def camera(left: str = "", right: str = "") -> dict[str, dict[str, str]]:
    return {
        "navcam": {"kind": "stereo_camera", "frame": "mana/navcam_left", "mask": left, "mask_right": right}
    }


def run(pairs: list[FramePair], context: DfpcContext, wheels: np.ndarray | None = None) -> list[Output]:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, context)
    outputs: list[Output] = []
    for i, pair in enumerate(pairs):
        if wheels is not None:
            T = TransformWithCovariance.from_transform(
                UncertainTransform(wheels[i]), parent="mana/odom", child="mana/base", stamp_ns=i * STEP_NS
            )
            outputs += dfpc.step(Sample("odometry", i * STEP_NS, i, T))
        outputs += dfpc.step(Sample("stereo", i * STEP_NS, i, pair, id=f"pair{i}"))
    return outputs


def end_error_m(outputs: list[Output]) -> float:
    return float(np.linalg.norm(outputs[-1].value.transform.matrix[:3, 3] - TRUE_POSES[-1, :3, 3]))


def test_an_arm_in_the_mask_has_no_points_and_no_effect(pairs: list[FramePair]) -> None:
    disturbed = paste(pairs, ARM)
    masks = [png(mask_of(pairs, ARM, right=right)) for right in (False, True)]
    outputs = run(disturbed, DfpcContext("mana", sensors=camera(*masks)))
    assert [o.quality.status for o in outputs] == [Status.OK] * STEPS
    assert end_error_m(outputs) < 0.004
    assert {o.quality.metrics.get("hypotheses", 1.0) for o in outputs} == {1.0}
    unmasked = run(disturbed[:1], DfpcContext("mana"))
    assert outputs[0].quality.metrics["features"] < 0.9 * unmasked[0].quality.metrics["features"]


@pytest.mark.parametrize("thing", [ARM, PASSER_BY], ids=["arm", "passer-by"])
def test_an_object_over_a_fifth_of_the_images_is_not_the_scene(
    pairs: list[FramePair], thing: PlanarObject
) -> None:
    assert 0.2 < thing.coverage(pairs[0]) < 0.25
    outputs = run(paste(pairs, thing), DfpcContext("mana"))
    assert all(o.quality.status is not Status.FAILED for o in outputs)
    assert end_error_m(outputs) < 0.01


def test_an_object_that_could_be_the_scene_is_reported(pairs: list[FramePair]) -> None:
    outputs = run(paste(pairs, LARGE), DfpcContext("mana"))
    reasons = [reason for o in outputs[1:] for reason in o.quality.reasons]
    assert any(reason.startswith("competing_motion:") for reason in reasons)
    T = outputs[-1].value.transform
    assert end_error_m(outputs) < 3.0 * np.sqrt(T.covariance[:3, :3].trace())


def test_the_motion_by_the_wheels_decides_between_competing_motions(pairs: list[FramePair]) -> None:
    frames = FrameGraph()
    frames.set_static("mana/base", "mana/navcam_left", UncertainTransform.identity())
    outputs = run(paste(pairs, LARGE), DfpcContext("mana", frames), wheels=TRUE_POSES)
    assert end_error_m(outputs) < 0.02
    assert max(o.quality.metrics["ambiguity"] for o in outputs[1:]) < MAX_AMBIGUITY


@pytest.mark.parametrize("thing", [HIDES_MOST, APPROACHING], ids=["arm", "approaching"])
def test_an_object_over_more_than_half_of_the_images_is_reported(
    fast_pairs: list[FramePair], thing: PlanarObject
) -> None:
    assert thing.coverage(fast_pairs[0]) > 0.5
    outputs = run(paste(fast_pairs, thing), DfpcContext("mana"))
    assert all(o.quality.status is Status.DEGRADED for o in outputs[1:])
    T = outputs[-1].value.transform
    error_m = np.linalg.norm(T.matrix[:3, 3] - FAST_POSES[-1, :3, 3])
    assert error_m < 4.0 * np.sqrt(T.covariance[:3, :3].trace())


@pytest.mark.parametrize("thing", [HIDES_MOST, APPROACHING], ids=["arm", "approaching"])
def test_the_wheels_find_the_scene_next_to_an_object_over_more_than_half_of_the_images(
    fast_pairs: list[FramePair], thing: PlanarObject
) -> None:
    frames = FrameGraph()
    frames.set_static("mana/base", "mana/navcam_left", UncertainTransform.identity())
    outputs = run(paste(fast_pairs, thing), DfpcContext("mana", frames), wheels=FAST_POSES)
    T = outputs[-1].value.transform.matrix
    assert np.linalg.norm(T[:3, 3] - FAST_POSES[-1, :3, 3]) < 0.05


def test_a_mask_of_another_size_fails_each_pair_with_the_reason(pairs: list[FramePair]) -> None:
    mask = png(np.full((SHAPE[0] // 2, SHAPE[1] // 2), 255, np.uint8))
    (output,) = run(pairs[:1], DfpcContext("mana", sensors=camera(mask)))
    assert output.quality.status is Status.FAILED
    assert "mask of the left camera" in output.quality.reasons[0]


def test_a_mask_that_is_no_image_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="expected an image"):
        run([], DfpcContext("mana", sensors=camera(base64.b64encode(b"nothing").decode())))
