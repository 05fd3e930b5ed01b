# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.features_matching_2d._interface import FeaturesMatching2DInputs
from cdff_core.dfns.features_matching_2d.mutual_ratio import MutualRatio

RNG = np.random.default_rng(0)


def matcher(**config: object) -> MutualRatio:
    made = MutualRatio()
    made.configure(config)
    return made


@pytest.mark.parametrize("width", [128, 32])
def test_a_shuffled_copy_is_found_and_distances_are_those_of_the_norm(width: int) -> None:
    source = RNG.integers(0, 256, (200, width), np.uint8)
    order = RNG.permutation(200)
    sink = source[order].copy()
    sink[:, 0] ^= 1
    out = matcher().process(FeaturesMatching2DInputs(source, sink))
    assert len(out.matches) == 200
    assert np.array_equal(order[out.matches[:, 1]], out.matches[:, 0])
    assert np.allclose(out.distances, 1.0)


def test_twins_are_ambiguous_and_one_way_neighbours_are_dropped() -> None:
    source = RNG.integers(0, 256, (50, 128), np.uint8)
    assert not len(matcher().process(FeaturesMatching2DInputs(source, np.vstack([source, source]))).matches)
    near = source[:1] ^ np.uint8(1)
    out = matcher().process(FeaturesMatching2DInputs(np.vstack([source, near]), source))
    assert 50 not in out.matches[:, 0]
    free = matcher(mutual=False, max_ratio=1.0).process(FeaturesMatching2DInputs(np.vstack([source, near]), source))
    assert 50 in free.matches[:, 0]


def test_along_epipolar_lines_a_twin_elsewhere_does_not_count() -> None:
    source = RNG.integers(0, 256, (50, 128), np.uint8)
    points = np.column_stack([RNG.uniform(0, 640, 50), np.arange(50) * 9.0])
    twins = points + np.array([0.0, 500.0])
    F = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rows are epipolar lines
    inputs = FeaturesMatching2DInputs(
        source, np.vstack([source, source]), points, np.vstack([points - np.array([20.0, 0.0]), twins]), F
    )
    out = matcher(band_px=2.0).process(inputs)
    assert np.array_equal(np.sort(out.matches[:, 0]), np.arange(50))
    assert np.array_equal(out.matches[:, 0], out.matches[:, 1])


def test_descriptors_of_two_kinds_are_refused_and_none_are_no_matches() -> None:
    some = np.zeros((3, 128), np.uint8)
    with pytest.raises(InputError, match="descriptors"):
        matcher().process(FeaturesMatching2DInputs(some, np.zeros((3, 32), np.uint8)))
    with pytest.raises(InputError, match="sourceFeatures"):
        matcher().process(FeaturesMatching2DInputs(some, some, fundamental_matrix=np.eye(3)))
    assert len(matcher().process(FeaturesMatching2DInputs(some[:0], some)).matches) == 0
