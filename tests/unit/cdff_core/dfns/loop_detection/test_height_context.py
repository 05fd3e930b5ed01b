# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.loop_detection.height_context import HeightContext
from cdff_core.dfns.loop_detection.interface import LoopDetectionInputs, LoopDetectionOutputs
from tests.support.hills import Float, Ground, flat_ground, hills, pose_on_ground, sweep_points


def make_node(**config: float) -> HeightContext:
    node = HeightContext()
    node.configure({"radius_m": 20.0, **config})
    return node


def sweep(ground: Ground, T: Float, seed: int) -> Float:
    return sweep_points(ground, T, T, np.random.default_rng(seed))[0]


def detect(ground: Ground, T: Float, seed: int, database: np.ndarray | None = None) -> LoopDetectionOutputs:
    return make_node().process(LoopDetectionInputs(points=sweep(ground, T, seed), database=database))


@pytest.fixture(scope="module")
def ground() -> Ground:
    return hills(3)


def test_a_place_is_recognised_from_another_heading(ground: Ground) -> None:
    poses = [pose_on_ground(ground, 60.0 * i, 10.0 * i, 0.3 * i) for i in range(8)]
    database = np.stack([detect(ground, T, i).descriptor for i, T in enumerate(poses)])
    T = pose_on_ground(ground, 60.0 * 5 + 0.8, 10.0 * 5 - 0.5, 2.1)
    result = detect(ground, T, 99, database)
    assert result.candidates[0] == 5
    assert result.similarity[0] > 0.75
    error = se3.inverse(se3.inverse(poses[5]) @ T) @ result.transforms[0]
    assert np.degrees(se3.rotation_angle(error[:3, :3])) < 8.0


def test_an_unvisited_place_has_no_candidates(ground: Ground) -> None:
    database = np.stack(
        [detect(ground, pose_on_ground(ground, 60.0 * i, 0.0, 0.0), i).descriptor for i in range(8)]
    )
    assert len(detect(ground, pose_on_ground(ground, 200.0, 400.0, 0.0), 9, database).candidates) == 0


def test_a_place_is_recognised_with_a_tilted_sensor(ground: Ground) -> None:
    T = pose_on_ground(ground, 0.0, 0.0, 0.0)
    tilted = T @ se3.transform(se3.exp_so3([0.15, -0.1, 0.0]), np.zeros(3))
    result = detect(ground, tilted, 4, detect(ground, T, 3).descriptor[None])
    assert result.similarity[0] > 0.9
    error = se3.inverse(se3.inverse(T) @ tilted) @ result.transforms[0]
    assert np.degrees(se3.rotation_angle(error[:3, :3])) < 8.0


def test_featureless_plains_are_not_compared() -> None:
    T = pose_on_ground(flat_ground, 0.0, 0.0, 0.0)
    first = detect(flat_ground, T, 0)
    assert first.relief_m < 0.08
    assert len(detect(flat_ground, T, 1, first.descriptor[None]).candidates) == 0


def test_a_place_with_too_few_points_has_no_relief_and_no_candidates() -> None:
    outputs = make_node().process(LoopDetectionInputs(points=np.zeros((3, 3))))
    assert outputs.relief_m == 0.0
    assert len(outputs.candidates) == 0


def test_a_database_of_other_descriptors_is_refused(ground: Ground) -> None:
    with pytest.raises(InputError, match="database"):
        detect(ground, pose_on_ground(ground, 0.0, 0.0, 0.0), 0, np.zeros((4, 7), np.float32))
