# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors with a ground truth that is interpolated at its start, as in KITTI without GPS readings."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from evaluation.data_sets.kitti import end_percent, measured_from, measured_percent, unmeasured_percent

STEP = se3.transform(np.eye(3), [0.0, 0.0, 1.2])


def drive(turns: np.ndarray) -> np.ndarray:
    """Poses ``(n + 1, 4, 4)`` after steps of 1.2 m that turn by the rotation vectors ``(n, 3)``."""
    poses = [np.eye(4)]
    for turn in turns:
        poses.append(poses[-1] @ STEP @ se3.transform(se3.exp_so3(turn), np.zeros(3)))
    return np.stack(poses)


@pytest.fixture
def turns(rng: np.random.Generator) -> np.ndarray:
    """Rotation vectors of the true motion of the camera, some hundredths of a degree per step."""
    return np.asarray(np.radians(rng.normal(0.0, 0.05, (40, 3))))


@pytest.mark.parametrize("missing", [0, 10])
def test_the_interpolated_start_of_the_reference_is_distinguished_from_measurements(
    turns: np.ndarray, missing: int
) -> None:
    turns[:missing] = turns[0]
    assert measured_from(drive(turns)) == missing


def test_a_perfect_odometry_has_only_the_error_of_the_interpolated_start(turns: np.ndarray) -> None:
    recorded = turns.copy()
    recorded[:10] = np.radians(
        [0.0, 0.05, 0.0]
    )  # the heading has an error of 0.5 degrees at the first reading
    poses, truth = drive(turns), drive(recorded)
    assert measured_percent(poses, truth) == pytest.approx(0.0, abs=1e-9)
    assert end_percent(poses, truth) > 0.3
    assert unmeasured_percent(poses, truth) == pytest.approx(end_percent(poses, truth))
