# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.features_matching_2d.interface import FeaturesMatching2DInputs
from cdff_core.dfns.features_matching_2d.mutual_ratio import MutualRatio

RNG = np.random.default_rng(0)


def matcher(**config: object) -> MutualRatio:
    result = MutualRatio()
    result.configure(config)
    return result


@pytest.mark.parametrize("width", [128, 32])
def test_a_shuffled_copy_is_matched_with_the_distances_of_the_norm(width: int) -> None:
    source = RNG.integers(0, 256, (200, width), np.uint8)
    permutation = RNG.permutation(200)
    sink = source[permutation].copy()
    sink[:, 0] ^= 1
    out = matcher().process(FeaturesMatching2DInputs(source=source, sink=sink))
    assert len(out.matches) == 200
    assert np.array_equal(permutation[out.matches[:, 1]], out.matches[:, 0])
    assert np.allclose(out.distances, 1.0)


def test_ambiguous_and_one_sided_matches_are_dropped() -> None:
    source = RNG.integers(0, 256, (50, 128), np.uint8)
    assert not len(
        matcher().process(FeaturesMatching2DInputs(source=source, sink=np.vstack([source, source]))).matches
    )
    near = source[:1] ^ np.uint8(1)
    out = matcher().process(FeaturesMatching2DInputs(source=np.vstack([source, near]), sink=source))
    assert 50 not in out.matches[:, 0]
    unrestricted = matcher(mutual=False, max_ratio=1.0).process(
        FeaturesMatching2DInputs(source=np.vstack([source, near]), sink=source)
    )
    assert 50 in unrestricted.matches[:, 0]


def test_duplicates_off_the_epipolar_line_are_ignored() -> None:
    source = RNG.integers(0, 256, (50, 128), np.uint8)
    points = np.column_stack([RNG.uniform(0, 640, 50), np.arange(50) * 9.0])
    off_line = points + np.array([0.0, 500.0])
    F = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rows are epipolar lines
    inputs = FeaturesMatching2DInputs(
        source=source,
        sink=np.vstack([source, source]),
        source_features=points,
        sink_features=np.vstack([points - np.array([20.0, 0.0]), off_line]),
        fundamental_matrix=F,
    )
    out = matcher(band_px=2.0).process(inputs)
    assert np.array_equal(np.sort(out.matches[:, 0]), np.arange(50))
    assert np.array_equal(out.matches[:, 0], out.matches[:, 1])


def test_descriptors_of_different_kinds_are_refused_and_empty_ones_give_no_matches() -> None:
    descriptors = np.zeros((3, 128), np.uint8)
    with pytest.raises(InputError, match="d=128 of source"):
        matcher().process(FeaturesMatching2DInputs(source=descriptors, sink=np.zeros((3, 32), np.uint8)))
    with pytest.raises(InputError, match="sourceFeatures"):
        matcher().process(
            FeaturesMatching2DInputs(source=descriptors, sink=descriptors, fundamental_matrix=np.eye(3))
        )
    assert (
        len(matcher().process(FeaturesMatching2DInputs(source=descriptors[:0], sink=descriptors)).matches)
        == 0
    )
