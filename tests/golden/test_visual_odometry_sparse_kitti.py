# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""VisualOdometrySparse on real images: KITTI odometry 06, frames 0 to 50 (59.9 m), and a step of the rover Minnie."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from cdff_dev.evaluate import _visual_kitti as kitti

pytestmark = pytest.mark.golden
FRAME_NS = 100_000_000
#: End position of the recorded run in its first left camera, metres; library versions may move it by centimetres.
REFERENCE_END_M = (-0.643, -0.890, 59.749)
#: Minnie's turn between its two records, from the .meta files, about the left camera's axes.
RECORDED_TURN_RAD = np.radians([-0.2011, 0.04388, -0.00264])
RealData = Callable[[str], Path]


def run(pairs: list[FramePair], seed: int) -> list[Output]:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="car", seed=seed))
    samples = (Sample("stereo", pair.stamp_ns, i, pair, id=str(i)) for i, pair in enumerate(pairs))
    return [output for sample in samples for output in dfpc.step(sample)]


@pytest.mark.req("CDFF-CORE-070")
def test_a_real_drive_is_followed_without_a_doubt_to_where_it_ended_before(real_data: RealData) -> None:
    pairs, truth = kitti.read(real_data("kitti_stereo/KITTI_sequence_1"))
    outputs = run(pairs, seed=0)
    assert [o.quality.status for o in outputs] == [Status.OK] * 51
    end = outputs[-1].value.transform
    np.testing.assert_allclose(end.matrix[:3, 3], REFERENCE_END_M, atol=0.06)
    assert np.linalg.norm(end.matrix[:3, 3] - truth[-1, :3, 3]) / 59.9 < 0.015
    assert 0.0 < np.sqrt(end.covariance[2, 2]) < 0.2
    assert min(o.quality.metrics["inliers"] for o in outputs[1:]) > 80


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_twenty_seeds_end_within_the_stated_bounds(real_data: RealData) -> None:
    """The first twelve steps of the truth are interpolated, which alone puts the end off by as much: see the page."""
    pairs, truth = kitti.read(real_data("kitti_stereo/KITTI_sequence_1"))
    found = [kitti.ours(pairs, seed) for seed in range(20)]
    whole = [kitti.end_percent(poses, truth) for poses in found]
    measured = [kitti.measured_percent(poses, truth) for poses in found]
    assert np.median(whole) <= 0.8
    assert max(whole) <= 1.2
    assert np.median(measured) <= 0.6
    assert max(measured) <= 0.7


def test_a_rover_step_is_the_same_at_full_and_half_resolution(real_data: RealData) -> None:
    """Minnie's recorded step is 157 mm; its pose record is heading and odometry, good to a centimetre."""
    folder = real_data("cdff_upstream/MinnieStereo")
    K = np.array([[1018.6, 0.0, 956.501], [0.0, 1018.6, 617.314], [0.0, 0.0, 1.0]])
    recorded = np.array([0.0114, -0.0867, 0.1331])  # T_first_second of the .meta files, left camera, metres
    moved = []
    for scale in (1.0, 0.5):
        pairs = []
        for i, when in enumerate(("", "Next")):
            images = [cv2.imread(str(folder / f"MinnieRect{side}{when}.png")) for side in ("Left", "Right")]
            left, right = (cv2.resize(m, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) for m in images)
            C = np.diag([scale, scale, 1.0]) @ K
            C[:2, 2] += 0.5 * (scale - 1.0)  # pixel centres, not corners, are at whole coordinates
            pairs.append(
                FramePair.from_images(
                    left, right, baseline_m=0.2675, camera_matrix=C, stamp_ns=i * 10 * FRAME_NS, mode="BGR"
                )
            )
        last = run(pairs, seed=0)[-1]
        assert last.quality.status is Status.OK
        moved.append(last.value.transform.matrix[:3, 3])
        # Heading, pitch and roll of the two records: 2 mrad each, says their covariance (4e-6 rad2).
        R = se3.exp_so3(RECORDED_TURN_RAD) @ last.value.transform.matrix[:3, :3].T
        assert float(np.sum(se3.log_so3(R) ** 2)) / (2 * 4e-6) < 7.81  # 95 % of three degrees of freedom
    assert np.linalg.norm(moved[0] - recorded) < 0.015
    assert np.linalg.norm(moved[0] - moved[1]) < 0.001
