# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A view that the prediction does not locate is located by descriptors, within the bounds of the wheels."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.dfpcs.visual_odometry_sparse.keyframe_tracker import KeyframeTracker
from cdff_core.stereo_odometry.motion_hypotheses import MAX_AMBIGUITY
from evaluation.data_sets.pasted_object import PlanarObject, paste
from tests.support.corridor import drive, stereo_pair

STEP_NS = 200_000_000
#: An object over a third of the images.
LARGE = PlanarObject(corner_px=(60, 60), size_px=(200, 130), depth_m=2.0)


def run_with_wheels(
    monkeypatch: pytest.MonkeyPatch,
    thing: PlanarObject | None,
    step_m: float = 0.08,
    wheel_ratio: float = 1.0,
) -> list[Output]:
    """Return the outputs of a drive in which the first tracking of each view fails.

    The wheels measure ``wheel_ratio`` times the distance.
    """
    poses = drive(4, step_m)
    frames = FrameGraph()
    frames.set_static("mana/base", "mana/navcam_left", UncertainTransform.identity())
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext("mana", frames))
    track, stamps_ns = KeyframeTracker._track, set()

    def lost_first(self, view, keyframe, T):  # type: ignore[no-untyped-def]
        if view.stamp_ns not in stamps_ns:
            stamps_ns.add(view.stamp_ns)
            T = se3.transform(np.eye(3), [0.0, 0.0, 50.0]) @ T  # all points leave the image
        return track(self, view, keyframe, T)

    monkeypatch.setattr(KeyframeTracker, "_track", lost_first)
    outputs: list[Output] = []
    pairs = [stereo_pair(T, i * STEP_NS) for i, T in enumerate(poses)]
    for i, (T, pair) in enumerate(zip(poses, paste(pairs, thing) if thing else pairs, strict=True)):
        measured = se3.transform(T[:3, :3], wheel_ratio * T[:3, 3])
        wheels = TransformWithCovariance.from_transform(
            UncertainTransform(measured), parent="mana/odom", child="mana/base", stamp_ns=i * STEP_NS
        )
        list(dfpc.step(Sample("odometry", i * STEP_NS, i, wheels)))
        outputs += dfpc.step(Sample("stereo", i * STEP_NS, i, pair, id=f"pair{i}"))
    assert np.linalg.norm(outputs[-1].value.transform.matrix[:3, 3] - poses[-1, :3, 3]) < 0.02
    return outputs


def test_the_wheels_decide_between_competing_motions_after_a_search_by_descriptors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    outputs = run_with_wheels(monkeypatch, LARGE)
    assert all(o.quality.status is not Status.FAILED for o in outputs)
    assert max(o.quality.metrics["ambiguity"] for o in outputs[1:]) < MAX_AMBIGUITY


def test_a_motion_found_by_descriptors_that_contradicts_the_wheels_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    outputs = run_with_wheels(monkeypatch, None, step_m=0.15, wheel_ratio=0.0)
    for output in outputs[1:]:
        assert any(reason.startswith("motion_prior:") for reason in output.quality.reasons)
