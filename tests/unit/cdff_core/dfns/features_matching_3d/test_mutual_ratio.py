# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MutualRatio: pairs of descriptors that are mutual nearest neighbours and pass the ratio test."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.features_matching_3d.interface import FeaturesMatching3DInputs, FeaturesMatching3DOutputs
from cdff_core.dfns.features_matching_3d.mutual_ratio import MutualRatio


def run_matching(source: object, target: object, **config: object) -> FeaturesMatching3DOutputs:
    node = MutualRatio()
    node.configure(config)
    inputs = FeaturesMatching3DInputs(
        source=np.asarray(source, np.float32), target=np.asarray(target, np.float32)
    )
    return node.process(inputs)


def test_a_shuffled_copy_is_matched_row_by_row_over_several_blocks(rng: np.random.Generator) -> None:
    source = rng.normal(size=(2500, 16))
    permutation = rng.permutation(2500)
    out = run_matching(source, source[permutation] + rng.normal(0, 1e-3, (2500, 16)))
    assert len(out.matches) == 2500
    assert np.array_equal(permutation[out.matches[:, 1]], out.matches[:, 0])
    assert np.all(np.diff(out.ratios) >= 0.0)


def test_matches_agree_with_an_exhaustive_search(rng: np.random.Generator) -> None:
    source, target = rng.random((60, 4)), rng.random((80, 4))
    distance = np.linalg.norm(source[:, None] - target[None], axis=2)
    expected = {(i, int(j)) for i, j in enumerate(distance.argmin(axis=1)) if distance[:, j].argmin() == i}
    out = run_matching(source, target)
    assert {tuple(m) for m in out.matches.tolist()} == expected
    assert np.allclose(out.distances, distance[out.matches[:, 0], out.matches[:, 1]], atol=1e-3)


def test_one_sided_matches_are_dropped_unless_requested() -> None:
    source, target = [[0.0, 0], [0.4, 0]], [[0.1, 0], [9.0, 0]]
    assert run_matching(source, target).matches.tolist() == [[0, 0]]
    assert len(run_matching(source, target, mutual=False).matches) == 2


def test_ambiguous_pairs_are_dropped_and_the_least_ambiguous_are_first() -> None:
    source, target = [[0.0, 0], [10.0, 0]], [[0.9, 0], [-1.0, 0], [10.1, 0]]
    assert run_matching(source, target, max_ratio=0.5).matches.tolist() == [[1, 2]]
    assert run_matching(source, target).matches.tolist() == [[1, 2], [0, 0]]
    assert run_matching(source, target, max_matches=1).matches.tolist() == [[1, 2]]


def test_no_descriptors_give_no_matches_and_a_single_target_passes_the_ratio_test() -> None:
    for n, m in ((0, 4), (4, 0), (0, 0)):
        empty = run_matching(np.zeros((n, 3)), np.zeros((m, 3)))
        assert empty.matches.shape == (0, 2)
        assert (len(empty.distances), len(empty.ratios)) == (0, 0)
    assert run_matching([[1.0, 2]], [[1.0, 3]]).ratios.tolist() == [0.0]


def test_descriptors_of_different_lengths_are_refused() -> None:
    with pytest.raises(InputError, match="d=33 of source"):
        run_matching(np.zeros((3, 33)), np.zeros((3, 352)))
    with pytest.raises(InputError, match="finite"):
        run_matching(np.full((3, 2), np.nan), np.zeros((3, 2)))
