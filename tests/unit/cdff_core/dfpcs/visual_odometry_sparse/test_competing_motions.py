# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Doubt about the selected motion: it lasts until this motion surrounds its competitors."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfpcs.visual_odometry_sparse.competing_motions import CompetingMotions
from cdff_core.stereo_odometry.motion_hypotheses import Hypothesis, SelectedMotion

POINTS = 100
FORWARD, SIDEWAYS = (se3.transform(np.eye(3), t) for t in ([0.0, 0.0, -0.5], [0.3, 0.0, 0.0]))
PIXELS = np.random.default_rng(2).uniform(0.0, [640.0, 480.0], (POINTS, 2))
ALL = np.ones(POINTS, bool)
LEFT = PIXELS[:, 0] < 400.0


def hypothesis(pose: np.ndarray, points: np.ndarray) -> Hypothesis:
    return Hypothesis(pose, points, coverage=0.5, extent=0.5, is_distinct=True)


def selected(others: tuple[Hypothesis, ...], ambiguity: float) -> SelectedMotion:
    return SelectedMotion(hypothesis(SIDEWAYS, LEFT), others, ambiguity, prior_ratio=0.0)


AMBIGUOUS, CERTAIN = selected((hypothesis(FORWARD, ~LEFT),), 0.6), selected((), 0.0)


def after_an_ambiguous_view() -> CompetingMotions:
    competing = CompetingMotions()
    assert competing.update(AMBIGUOUS, PIXELS, ALL, LEFT, elapsed_s=1.0) is AMBIGUOUS
    return competing


def test_a_motion_that_competed_remains_in_the_covariance_while_its_points_are_hidden() -> None:
    competing = after_an_ambiguous_view()
    for elapsed_s in (0.5, 1.0):
        motion = competing.update(CERTAIN, PIXELS, ALL, LEFT, elapsed_s)
        assert motion.is_ambiguous
        assert not motion.other_inliers.any()
        sigma_m = np.sqrt(motion.selection_covariance()[2, 2])
        assert 0.3 * elapsed_s < sigma_m < 0.5 * elapsed_s


def test_the_doubt_ends_when_the_selected_motion_surrounds_the_image() -> None:
    competing = after_an_ambiguous_view()
    assert competing.update(CERTAIN, PIXELS, ALL, ALL, elapsed_s=1.0) is CERTAIN
    assert competing.predict(1.0) == []
    assert competing.update(CERTAIN, PIXELS, ALL, LEFT, elapsed_s=1.0) is CERTAIN


@pytest.mark.parametrize("elapsed_s", [0.5, 2.0])
def test_competing_motions_are_predicted_at_constant_velocity(elapsed_s: float) -> None:
    (predicted,) = after_an_ambiguous_view().predict(elapsed_s)
    np.testing.assert_allclose(predicted, se3.exp_se3(elapsed_s * se3.log_se3(FORWARD)), atol=1e-12)
