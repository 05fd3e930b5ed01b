# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled steps of the registrations agree with their formulas and have exact limits."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.registration_3d._steps import has_converged, moved_by, newton_step, step_length


def test_a_newton_step_is_damped_by_a_millionth_of_the_trace() -> None:
    rng = np.random.default_rng(1)
    A, g = rng.normal(size=(6, 9)), rng.normal(size=6)
    H = A @ A.T
    expected = np.linalg.solve(H + 1e-6 * np.trace(H) * np.eye(6), -g)
    np.testing.assert_allclose(newton_step(H, g), expected, rtol=1e-9)
    flat = np.diag([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(newton_step(flat, np.ones(6)), [-1.0 / 2.000002, *[-1.0 / 2e-6] * 5])
    np.testing.assert_allclose(newton_step(np.zeros((6, 6)), 1e-20 * np.ones(6)), [-0.01] * 6)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.5])
def test_a_transform_is_moved_about_the_centre(angle: float) -> None:
    T = se3.exp_se3([1.0, 2.0, 3.0, 0.3, -0.2, 0.1])
    axis, centre, radius = np.array([2.0, -1.0, 2.0]) / 3.0, np.array([5.0, 1.0, -2.0]), 2.5
    translation = np.array([0.1, -0.2, 0.3])
    T_moved = moved_by(T, np.concatenate([translation, angle * radius * axis]), centre, radius)
    R = se3.exp_so3(angle * axis)
    np.testing.assert_allclose(T_moved[:3, :3], R @ T[:3, :3], atol=1e-14)
    np.testing.assert_allclose(T_moved[:3, 3], R @ (T[:3, 3] - centre) + centre + translation, atol=1e-13)
    np.testing.assert_array_equal(T_moved[3], [0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("ratio", "length"),
    [(-0.5, 1.0), (0.0, 1.0), (0.24, 1.0), (0.25, 4.0 / 3.0), (0.5, 2.0), (0.8, 5.0), (0.9, 6.0), (1.0, 1.0),
     (1.5, 1.0)],
)  # fmt: skip
def test_a_slow_sequence_is_extrapolated_to_its_limit_up_to_six_steps(ratio: float, length: float) -> None:
    first = np.array([4.0, 0.0, 0.0, 0.0, -2.0, 0.0])
    steps = np.array([100.0 * first, first, ratio * first])
    assert step_length(steps, False) == pytest.approx(length)
    assert step_length(steps, True) == 1.0
    assert step_length(steps[:1], False) == 1.0
    assert step_length(steps[1:], False) == pytest.approx(length)


def test_a_step_after_no_motion_is_not_extrapolated() -> None:
    assert step_length(np.zeros((2, 6)), False) == 1.0
    assert step_length(np.array([np.zeros(6), np.ones(6)]), False) == 1.0


@pytest.mark.parametrize(("cycle", "converged"), [(1, True), (2, True), (3, True), (4, True), (5, False)])
def test_convergence_is_a_small_step_or_a_cycle_of_at_most_four(cycle: int, converged: bool) -> None:
    rng = np.random.default_rng(cycle)
    steps = rng.normal(size=(8, 6))
    steps[-1] -= steps[-cycle:].sum(axis=0)
    steps[-1, :3] += [0.0, 3e-3, 4e-3]
    steps[-1, 3:] += [4e-3, 0.0, -3e-3]
    assert has_converged(steps, 0.01 + 1e-9) is converged
    assert has_converged(steps, 0.01 - 1e-9) is False


def test_convergence_before_four_steps_and_at_the_tolerance() -> None:
    steps = np.array([[0.25, 0.0, 0.0, 0.0, 0.25, 0.0]])
    assert not has_converged(steps, 0.5)
    assert has_converged(steps, 0.500001)
    assert has_converged(np.vstack([steps, -steps]), 0.1)
    assert not has_converged(np.zeros((0, 6)), 1.0)
