# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sparse visual odometry on real images: 51 frames of KITTI odometry 06, and a step of the rover Minnie."""

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
from evaluation.data_sets import kitti, minnie
from evaluation.visual_odometry_minnie import (
    SCALES,
    most_precise_direction_of,
    pose_of_second_pair,
    squared_errors,
)

pytestmark = pytest.mark.golden
#: Length of the reference trajectory.
PATH_LENGTH_M = 59.9
#: End position of the recorded run in the frame of the first left image, m; library versions may move it by
#: centimetres.
REFERENCE_END_M = (-0.643, -0.890, 59.749)
RealData = Callable[[str], Path]


def run(pairs: list[FramePair], seed: int) -> list[Output]:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="car", seed=seed))
    samples = (Sample("stereo", pair.stamp_ns, i, pair, id=str(i)) for i, pair in enumerate(pairs))
    return [output for sample in samples for output in dfpc.step(sample)]


@pytest.mark.req("CDFF-CORE-070")
def test_a_recorded_drive_gives_the_recorded_end_position_with_status_ok(real_data: RealData) -> None:
    pairs, truth = kitti.read(real_data("kitti_stereo/KITTI_sequence_1"))
    outputs = run(pairs, seed=0)
    assert [o.quality.status for o in outputs] == [Status.OK] * 51
    end_pose = outputs[-1].value.transform
    np.testing.assert_allclose(end_pose.matrix[:3, 3], REFERENCE_END_M, atol=0.06)
    assert np.linalg.norm(end_pose.matrix[:3, 3] - truth[-1, :3, 3]) / PATH_LENGTH_M < 0.0085
    # Relative standard deviations of focal length and baseline of 0.5 % each, over 59.9 m.
    assert 0.3 < np.sqrt(end_pose.covariance[2, 2]) < 0.6
    assert min(o.quality.metrics["inliers"] for o in outputs[1:]) > 80


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_seeds_give_errors_within_the_stated_bounds(real_data: RealData) -> None:
    """Most of the end error comes from the first twelve steps of the reference, which are interpolated.

    The evaluation record has 20 seeds; their end errors differ by 0.014 % of the path at most.
    """
    pairs, truth = kitti.read(real_data("kitti_stereo/KITTI_sequence_1"))
    trajectories = [kitti.run_dfpc(pairs, seed) for seed in range(1, 4)]
    end_errors_percent = [kitti.end_percent(poses, truth) for poses in trajectories]
    errors_on_measured_truth_percent = [kitti.measured_percent(poses, truth) for poses in trajectories]
    assert np.median(end_errors_percent) <= 0.8
    assert max(end_errors_percent) <= 0.85
    assert np.median(errors_on_measured_truth_percent) <= 0.6
    assert max(errors_on_measured_truth_percent) <= 0.65


def test_a_rover_motion_is_within_the_covariance_of_the_reference_at_each_resolution(
    real_data: RealData,
) -> None:
    folder = real_data(minnie.FOLDER)
    recorded = minnie.recorded_step(folder)
    best_direction, sigma_m, _ = most_precise_direction_of(recorded)
    assert sigma_m < 0.11  # in the other two directions, the recorded sigma is kilometres
    translations_m = []
    for scale in SCALES:
        output = pose_of_second_pair(minnie.pairs(folder, scale))
        assert output.quality.status is Status.OK
        T = output.value.transform.matrix
        pose_nees, rotation_nees = squared_errors(recorded, T)
        assert pose_nees < chi2.ppf(0.95, 6)
        assert rotation_nees < chi2.ppf(0.95, 3)
        translations_m.append(T[:3, 3])
        assert abs(best_direction @ (T[:3, 3] - recorded.matrix[:3, 3])) < sigma_m
        assert np.linalg.norm(T[:3, 3] - recorded.matrix[:3, 3]) < 0.0125
    assert np.linalg.norm(translations_m[0] - translations_m[1]) < 0.0004
    assert np.linalg.norm(translations_m[0] - translations_m[2]) < 0.0015
