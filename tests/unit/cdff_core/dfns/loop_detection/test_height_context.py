# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.loop_detection._interface import LoopDetectionInputs, LoopDetectionOutputs
from cdff_core.dfns.loop_detection.height_context import HeightContext
from tests.hills import Float, Ground, hills, plain, standing, sweep_points


def made(**config: float) -> HeightContext:
    node = HeightContext()
    node.configure({"radius_m": 20.0, **config})
    return node


def seen(ground: Ground, T: Float, seed: int) -> Float:
    return sweep_points(ground, T, T, np.random.default_rng(seed))[0]


def look(ground: Ground, T: Float, seed: int, database: np.ndarray | None = None) -> LoopDetectionOutputs:
    return made().process(LoopDetectionInputs(seen(ground, T, seed), database))


@pytest.fixture(scope="module")
def ground() -> Ground:
    return hills(3)


def test_a_place_is_known_again_from_another_heading(ground: Ground) -> None:
    places = [standing(ground, 60.0 * i, 10.0 * i, 0.3 * i) for i in range(8)]
    database = np.stack([look(ground, T, i).descriptor for i, T in enumerate(places)])
    T = standing(ground, 60.0 * 5 + 0.8, 10.0 * 5 - 0.5, 2.1)
    found = look(ground, T, 99, database)
    assert found.candidates[0] == 5
    assert found.similarity[0] > 0.75
    error = se3.inverse(se3.inverse(places[5]) @ T) @ found.transforms[0]
    assert np.degrees(se3.rotation_angle(error[:3, :3])) < 8.0


def test_a_place_never_seen_has_no_candidates(ground: Ground) -> None:
    database = np.stack([look(ground, standing(ground, 60.0 * i, 0.0, 0.0), i).descriptor for i in range(8)])
    assert len(look(ground, standing(ground, 200.0, 400.0, 0.0), 9, database).candidates) == 0


def test_the_tilt_of_the_sensor_does_not_matter(ground: Ground) -> None:
    T = standing(ground, 0.0, 0.0, 0.0)
    tilted = T @ se3.transform(se3.exp_so3([0.15, -0.1, 0.0]), np.zeros(3))
    found = look(ground, tilted, 4, look(ground, T, 3).descriptor[None])
    assert found.similarity[0] > 0.9
    error = se3.inverse(se3.inverse(T) @ tilted) @ found.transforms[0]
    assert np.degrees(se3.rotation_angle(error[:3, :3])) < 8.0


def test_a_plain_looks_like_any_other_and_is_not_compared() -> None:
    T = standing(plain, 0.0, 0.0, 0.0)
    first = look(plain, T, 0)
    assert float(first.relief_m) < 0.08
    assert len(look(plain, T, 1, first.descriptor[None]).candidates) == 0


def test_too_few_points_describe_nothing() -> None:
    found = made().process(LoopDetectionInputs(np.zeros((3, 3))))
    assert float(found.relief_m) == 0.0
    assert len(found.candidates) == 0


def test_a_database_of_other_descriptors_is_refused(ground: Ground) -> None:
    with pytest.raises(InputError, match="database"):
        look(ground, standing(ground, 0.0, 0.0, 0.0), 0, np.zeros((4, 7), np.float32))
