# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""VisualOdometrySparse on real images: KITTI odometry 06, frames 0 to 50 (59.9 m), and a step of the rover Minnie."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from cdff_dev.evaluate import _minnie as minnie
from cdff_dev.evaluate import _visual_kitti as kitti
from cdff_dev.evaluate.visual_odometry_minnie import SCALES, known_best, located, squared_errors

pytestmark = pytest.mark.golden
#: End position of the recorded run in its first left camera, metres; library versions may move it by centimetres.
REFERENCE_END_M = (-0.643, -0.890, 59.749)
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
    assert np.linalg.norm(end.matrix[:3, 3] - truth[-1, :3, 3]) / 59.9 < 0.0085
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
    assert max(whole) <= 0.85
    assert np.median(measured) <= 0.6
    assert max(measured) <= 0.65


def test_a_rover_step_is_within_the_covariance_of_its_recorded_poses_at_each_resolution(real_data: RealData) -> None:
    folder = real_data(minnie.FOLDER)
    recorded = minnie.recorded_step(folder)
    best, sigma_m, _ = known_best(recorded)
    assert sigma_m < 0.11  # in the other two directions the record is of kilometres and says nothing
    moved = []
    for scale in SCALES:
        last = located(minnie.pairs(folder, scale))
        assert last.quality.status is Status.OK
        T = last.value.transform.matrix
        pose, turn = squared_errors(recorded, T)
        assert pose < chi2.ppf(0.95, 6)
        assert turn < chi2.ppf(0.95, 3)
        moved.append(T[:3, 3])
        assert abs(best @ (T[:3, 3] - recorded.matrix[:3, 3])) < sigma_m
        assert np.linalg.norm(T[:3, 3] - recorded.matrix[:3, 3]) < 0.0125
    assert np.linalg.norm(moved[0] - moved[1]) < 0.0004
    assert np.linalg.norm(moved[0] - moved[2]) < 0.0015
