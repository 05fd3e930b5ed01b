# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sparse visual odometry with a change of the camera, and pairs with a wrong calibration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from tests.support import corridor
from tests.support.corridor import BASELINE_M, CAMERA, SHAPE, drive, stereo_pair

STEP_NS = 200_000_000
TRUTH = drive(6)
#: Changes of the corridor's camera from the fourth pair on.
CAMERA_CHANGES = {
    "size": {"SHAPE": (220, 320)},
    "camera_matrix": {"CAMERA": CAMERA * np.array([[1.15], [1.15], [1.0]])},
    "baseline": {"BASELINE_M": 0.3},
}


@pytest.fixture(scope="module")
def pairs() -> list[FramePair]:
    return [stereo_pair(T, i * STEP_NS) for i, T in enumerate(TRUTH)]


def make_configured_dfpc(**parameters: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(parameters, DfpcContext(robot="mana"))
    return dfpc


def step(dfpc: Dfpc, pair: FramePair, i: int) -> Output:
    (output,) = dfpc.step(Sample("stereo", i * STEP_NS, i, pair, id=f"pair{i}"))
    return output


def of_camera(pair: FramePair, camera_matrix: np.ndarray) -> FramePair:
    intrinsic = replace(pair.left.intrinsic, camera_matrix=camera_matrix)
    return replace(pair, left=replace(pair.left, intrinsic=intrinsic))


def trajectory(dfpc: Dfpc) -> Any:
    return dfpc.call("get_trajectory", {})


@pytest.mark.parametrize("change", CAMERA_CHANGES)
def test_a_changed_camera_continues_at_the_predicted_pose_and_is_reported(
    pairs: list[FramePair], monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    dfpc = make_configured_dfpc()
    *_, last = (step(dfpc, pairs[i], i) for i in range(3))
    covariance_before = last.value.transform.covariance
    for name, value in CAMERA_CHANGES[change].items():
        monkeypatch.setattr(corridor, name, value)
    changed, *after = (step(dfpc, stereo_pair(TRUTH[i], i * STEP_NS), i) for i in (3, 4, 5))
    assert changed.quality.status is Status.DEGRADED
    assert changed.quality.reasons == ("camera_changed",)
    assert (changed.frame, changed.quality.metrics["gaps"]) == ("mana/vo", 1.0)
    T = changed.value.transform
    error = cov.pose_error(TRUTH[3], T.matrix)
    assert np.linalg.norm(error[:3]) < 0.05
    assert error @ np.linalg.solve(T.covariance, error) < 20.0
    assert np.linalg.eigvalsh(T.covariance - covariance_before)[0] > 1e-3
    assert [o.quality.status for o in after] == [Status.OK] * 2
    motion, truth = (
        se3.inverse(a) @ b for a, b in ((T.matrix, after[-1].value.transform.matrix), TRUTH[[3, 5]])
    )
    assert np.linalg.norm(cov.pose_error(truth, motion)[:3]) < 0.005
    assert len(trajectory(dfpc).stamps_ns) == 6


def test_after_a_change_of_camera_the_first_usable_pair_is_located(
    pairs: list[FramePair], monkeypatch: pytest.MonkeyPatch
) -> None:
    dfpc = make_configured_dfpc()
    for i in range(3):
        step(dfpc, pairs[i], i)
    monkeypatch.setattr(corridor, "BASELINE_M", 0.3)
    dark = np.zeros(SHAPE, np.uint8)
    dark_pair = FramePair.from_images(dark, dark, baseline_m=0.3, camera_matrix=CAMERA, stamp_ns=3 * STEP_NS)
    assert step(dfpc, dark_pair, 3).quality.status is Status.FAILED
    output = step(dfpc, stereo_pair(TRUTH[4], 4 * STEP_NS), 4)
    assert output.quality.reasons == ("camera_changed",)
    assert np.linalg.norm(cov.pose_error(TRUTH[4], output.value.transform.matrix)[:3]) < 0.05


def test_rounding_of_a_camera_matrix_is_not_a_camera_change(pairs: list[FramePair]) -> None:
    dfpc = make_configured_dfpc()
    outputs = [step(dfpc, of_camera(pairs[i], CAMERA * (1.0 + i * 1e-12)), i) for i in range(3)]
    assert [o.quality.status for o in outputs] == [Status.OK] * 3
    assert outputs[-1].quality.metrics["gaps"] == 0.0


@pytest.mark.parametrize("wrong", [{"baseline": 0.0}, {"baseline": np.nan}, {"K": np.zeros((3, 3))}])
def test_only_the_pair_with_a_wrong_calibration_fails(pairs: list[FramePair], wrong: dict[str, Any]) -> None:
    dfpc = make_configured_dfpc()
    for i in range(2):
        step(dfpc, pairs[i], i)
    bad = of_camera(pairs[2], wrong["K"]) if "K" in wrong else replace(pairs[2], **wrong)
    output = step(dfpc, bad, 2)
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0].startswith("input:")
    next_output = step(dfpc, pairs[3], 3)
    assert (next_output.quality.status, next_output.quality.metrics["gaps"]) == (Status.OK, 0.0)
    assert pairs[3].baseline == BASELINE_M
